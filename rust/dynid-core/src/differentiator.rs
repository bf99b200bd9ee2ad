//! Velocities and accelerations from positions, causally, with a delay that is stated and the same for all three.
//!
//! A parabola is fitted by least squares to the samples of the last `window` periods, and its value, slope and curvature
//! are taken in the **middle** of the window (Savitzky and Golay, Anal. Chem. 36, 1964). On a uniform grid that is a filter
//! of linear phase: every frequency comes late by the same
//!
//! ```text
//! delay = (window - 1) / 2 * step
//! ```
//!
//! and position, velocity and acceleration belong to one instant. The band ends (-3 dB of the position) near 0.53 / delay
//! in Hz: of a long window the gain at x = 2 pi f delay is the integral of (9 - 15 s^2) / 8 cos(x s) over -1 < s < 1, which
//! falls to sqrt(1/2) at x = 3.34.
//!
//! The fit is made at the times that came, so lost samples leave a thinner window, not a wrong one; and it forgets: what
//! left the window has no influence on any bit.

use crate::dynamics::check_length;
use crate::error::CoreError;
use crate::model::check_step;
use crate::slices::{copy, mirror_fields, Mirror};

/// Fewest samples of a window: one more than a parabola needs, and odd.
pub const MIN_WINDOW: usize = 5;

/// Most samples of a window.
pub const MAX_WINDOW: usize = 101;

/// Length of the window where nothing else is asked for \[s\], and its fewest samples.
const USUAL_WINDOW: (f64, usize) = (0.02, 7);

/// Longest window whose first answer is that of the tenth sample, and the length up to which more samples are worth more
/// cycles, because the noise of a fitted curvature goes with the window to the power -5/2 \[s\].
const ANSWERS_WITHIN_TEN: (usize, f64) = (15, 0.015);

/// The oldest sample must stand this far before the middle, in halves of the window: the middle is then well inside.
const LEAST_REACH: f64 = 0.25;

/// What times may be off by, in halves of the window.
const ROUNDING: f64 = 1e-6;

/// A system of normal equations with a smaller determinant (relative to the product of its diagonal) holds no parabola.
const LEAST_DETERMINANT: f64 = 1e-6;

/// Least squares on a sliding window, for channels that are sampled together.
#[derive(Clone, Debug)]
pub struct Differentiator {
    n_channels: usize,
    window: usize,
    step: f64,
    /// Rings of `window` places; the newest stands at `newest`.
    times: Vec<f64>,
    samples: Vec<f64>,
    newest: usize,
    len: usize,
    /// Value, slope, curvature of every channel.
    fitted: [Vec<f64>; 3],
}

/// The window that is used where none is asked for, an odd number: about 20 ms, at least seven samples, at most what answers
/// within ten samples or, where they come faster than once a millisecond, 15 ms.
#[must_use]
pub fn usual_window(step: f64) -> usize {
    // A cast saturates, so no step is too short or too long.
    let odd = |seconds: f64| (seconds / step).round() as usize | 1;
    let (seconds, least) = USUAL_WINDOW;
    let (samples, worth) = ANSWERS_WITHIN_TEN;
    odd(seconds)
        .min(odd(worth).max(samples))
        .clamp(least, MAX_WINDOW)
}

/// By how much the middle of a window is behind its newest sample \[s\].
#[must_use]
pub fn delay(window: usize, step: f64) -> f64 {
    window.saturating_sub(1) as f64 / 2.0 * step
}

/// At which sample the first answer comes after a start, or after a gap as long as the window.
#[must_use]
pub fn first_answer(window: usize) -> usize {
    let half = window.saturating_sub(1) as f64 / 2.0;
    let reached = ((1.0 + LEAST_REACH) * half).ceil() as usize + 1;
    reached.max(MIN_WINDOW).max(window.div_ceil(3))
}

impl Differentiator {
    /// The last allocation. `step` \[s\] is the usual time between samples, `window` an odd number of samples.
    ///
    /// # Errors
    /// [`CoreError::Range`] if the step is not positive or the window even, shorter than [`MIN_WINDOW`] or longer than
    /// [`MAX_WINDOW`].
    pub fn new(n_channels: usize, step: f64, window: usize) -> Result<Self, CoreError> {
        check_step(step)?;
        if !(MIN_WINDOW..=MAX_WINDOW).contains(&window) || window.is_multiple_of(2) {
            return Err(CoreError::Range { what: "window" });
        }
        Ok(Self {
            n_channels,
            window,
            step,
            times: vec![0.0; window],
            samples: vec![0.0; window * n_channels],
            newest: 0,
            len: 0,
            fitted: std::array::from_fn(|_| vec![0.0; n_channels]),
        })
    }

    /// By how much the answer is behind the newest sample \[s\].
    #[must_use]
    pub fn delay(&self) -> f64 {
        delay(self.window, self.step)
    }

    /// Samples in the window.
    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.len
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.len = 0;
    }

    /// Value, slope \[1/s\] and curvature \[1/s²\] of every channel, [`Self::delay`] before the newest sample; what stood
    /// there before where the last [`Self::push`] said false.
    #[must_use]
    pub fn fitted(&self) -> [&[f64]; 3] {
        let [value, slope, curvature] = &self.fitted;
        [value, slope, curvature]
    }

    /// The newest sample, if the window holds any: its time and its channels.
    #[must_use]
    pub fn newest(&self) -> Option<(f64, &[f64])> {
        if self.len == 0 {
            return None;
        }
        let start = self.newest * self.n_channels;
        let sample = self.samples.get(start..start + self.n_channels)?;
        Some((*self.times.get(self.newest)?, sample))
    }

    /// Takes a sample and fits; false while the window holds too little: after a start, or after a gap as long as the
    /// window. A time that does not lie after the newest one starts again.
    ///
    /// # Errors
    /// [`CoreError::Length`] if `sample` is not one value per channel.
    pub fn push(&mut self, time: f64, sample: &[f64]) -> Result<bool, CoreError> {
        check_length("sample", sample, self.n_channels)?;
        // Written so that a NaN starts again too.
        if !self.newest().is_some_and(|(newest, _)| time > newest) {
            self.len = 0;
        }
        self.newest = if self.newest + 1 < self.window {
            self.newest + 1
        } else {
            0
        };
        let start = self.newest * self.n_channels;
        let place = self.samples.get_mut(start..start + self.n_channels);
        if let (Some(place), Some(at)) = (place, self.times.get_mut(self.newest)) {
            copy(sample, place);
            *at = time;
            self.len = (self.len + 1).min(self.window);
        }
        self.drop_what_is_older_than(time - (self.window as f64 - 0.5) * self.step);
        Ok(self.fit())
    }

    fn drop_what_is_older_than(&mut self, time: f64) {
        while self.len > 1 && self.time_of(self.len - 1) < time {
            self.len -= 1;
        }
    }

    /// Time of the sample `age` places before the newest one.
    fn time_of(&self, age: usize) -> f64 {
        let time = self.times.get(place(self.newest, self.window, age));
        time.copied().unwrap_or(f64::NEG_INFINITY)
    }

    /// Fits around the middle of the window, in units of its half.
    fn fit(&mut self) -> bool {
        let half = self.delay();
        let Some((newest, _)) = self.newest() else {
            return false;
        };
        let mut moments = [0.0; 5];
        let mut reach = f64::INFINITY;
        let mut at = [0.0; MAX_WINDOW];
        // Oldest first, so that the order of summation depends on the window alone.
        for (at, age) in at.iter_mut().zip((0..self.len).rev()) {
            let s = 1.0 + (self.time_of(age) - newest) / half;
            reach = reach.min(s);
            let mut power = 1.0;
            for moment in &mut moments {
                *moment += power;
                power *= s;
            }
            *at = s;
        }
        let enough =
            self.len >= MIN_WINDOW.max(self.window.div_ceil(3)) && reach <= ROUNDING - LEAST_REACH;
        let Some(inverse) = enough.then(|| parabola(&moments)).flatten() else {
            return false;
        };
        self.sum(&inverse, &at, [1.0, 1.0 / half, 2.0 / (half * half)]);
        true
    }

    /// Weighs the samples with the rows of the inverse normal equations.
    fn sum(&mut self, inverse: &[[f64; 3]; 3], at: &[f64], scale: [f64; 3]) {
        let [value, slope, curvature] = &mut self.fitted;
        let start = self.newest * self.n_channels;
        let Some(last) = self.samples.get(start..start + self.n_channels) else {
            return;
        };
        for fitted in [&mut *value, &mut *slope, &mut *curvature] {
            fitted.fill(0.0);
        }
        for (s, age) in at.iter().zip((0..self.len).rev()) {
            let row = place(self.newest, self.window, age) * self.n_channels;
            let Some(sample) = self.samples.get(row..row + self.n_channels) else {
                return;
            };
            let [w0, w1, w2] = inverse.map(|[a, b, c]| a + s * (b + s * c));
            // About the newest sample: a large offset then cancels exactly.
            let fitted = value.iter_mut().zip(slope.iter_mut().zip(&mut *curvature));
            for ((x, last), (value, (slope, curvature))) in sample.iter().zip(last).zip(fitted) {
                let x = x - last;
                *value += w0 * x;
                *slope += w1 * x;
                *curvature += w2 * x;
            }
        }
        for (value, last) in value.iter_mut().zip(last) {
            *value += last;
        }
        for (fitted, scale) in [slope, curvature]
            .into_iter()
            .zip(scale.into_iter().skip(1))
        {
            fitted.iter_mut().for_each(|x| *x *= scale);
        }
    }
}

/// Where the sample `age` places before the newest one stands in a ring.
fn place(newest: usize, window: usize, age: usize) -> usize {
    let ahead = newest + window - age;
    if ahead < window {
        ahead
    } else {
        ahead - window
    }
}

/// Inverse of the normal equations of `a + b s + c s^2` from the sums of the powers of s; `None` if they are singular.
fn parabola(&[m0, m1, m2, m3, m4]: &[f64; 5]) -> Option<[[f64; 3]; 3]> {
    let (c00, c01, c02) = (m2 * m4 - m3 * m3, m2 * m3 - m1 * m4, m1 * m3 - m2 * m2);
    let (c11, c12, c22) = (m0 * m4 - m2 * m2, m1 * m2 - m0 * m3, m0 * m2 - m1 * m1);
    let determinant = m0 * c00 + m1 * c01 + m2 * c02;
    // Written so that a NaN fails too.
    (determinant > LEAST_DETERMINANT * m0 * m2 * m4).then(|| {
        [[c00, c01, c02], [c01, c11, c12], [c02, c12, c22]].map(|row| row.map(|c| c / determinant))
    })
}

impl Mirror for Differentiator {
    fn mirror(&mut self, of: &Self) {
        // An empty window holds nothing that is read, and it is long.
        if of.len > 0 {
            self.times.mirror(&of.times);
            self.samples.mirror(&of.samples);
            self.fitted.mirror(&of.fitted);
        }
        mirror_fields!(self, of; ; copied n_channels, window, step, newest, len; kept times, samples, fitted);
    }
}

#[cfg(test)]
#[allow(clippy::print_stdout, clippy::unwrap_used)]
mod tests;
