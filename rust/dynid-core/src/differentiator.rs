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
use crate::slices::copy;

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

#[cfg(test)]
#[allow(clippy::print_stdout, clippy::unwrap_used)]
mod tests {
    use super::*;

    const STEP: f64 = 0.001;

    /// Runs `signal` through a window, leaving out what `lost` says, and hands over every answer.
    fn run(
        window: usize,
        signal: impl Fn(f64) -> f64,
        lost: impl Fn(usize) -> bool,
        mut check: impl FnMut(f64, [f64; 3]),
    ) -> usize {
        let mut filter = Differentiator::new(1, STEP, window).unwrap();
        let mut answers = 0;
        for k in (0..2000).filter(|k| !lost(*k)) {
            let t = k as f64 * STEP;
            if filter.push(t, &[signal(t)]).unwrap() {
                answers += 1;
                check(t - filter.delay(), filter.fitted().map(|x| x[0]));
            }
        }
        answers
    }

    #[test]
    fn a_sine_comes_late_by_the_stated_delay_at_every_frequency() {
        for window in [7, 21, 51] {
            let half = (window / 2) as i32;
            for hertz in [0.5, 2.0, 7.0, 20.0] {
                let w = std::f64::consts::TAU * hertz;
                // Gains of a filter of linear phase: real, from the weights of Savitzky and Golay.
                let s = |i: i32| f64::from(i) / f64::from(half);
                let sums: Vec<f64> = [0, 2, 4]
                    .iter()
                    .map(|p| (-half..=half).map(|i| s(i).powi(*p)).sum())
                    .collect();
                let (m0, m2, m4) = (sums[0], sums[1], sums[2]);
                let det = m0 * m4 - m2 * m2;
                let gain = |weight: &dyn Fn(f64) -> f64, odd: bool| -> f64 {
                    (-half..=half)
                        .map(|i| {
                            let phase = w * STEP * f64::from(i);
                            weight(s(i)) * if odd { phase.sin() } else { phase.cos() }
                        })
                        .sum()
                };
                let h = f64::from(half) * STEP;
                let value = gain(&|s| (m4 - m2 * s * s) / det, false);
                let slope = gain(&|s| s / m2, true) / h;
                let curvature = gain(&|s| 2.0 * (m0 * s * s - m2) / det, false) / (h * h);
                let answers = run(
                    window,
                    |t| (w * t + 0.3).sin(),
                    |_| false,
                    |t, fitted| {
                        if t < h - 0.1 * STEP {
                            return; // the window is not full yet
                        }
                        let (sin, cos) = (w * t + 0.3).sin_cos();
                        for (fitted, expected) in
                            fitted
                                .iter()
                                .zip([value * sin, slope * cos, curvature * sin])
                        {
                            let size = expected.abs().max(w * w);
                            assert!(
                                (fitted - expected).abs() < 1e-9 * size,
                                "{window} {hertz} {fitted} {expected}"
                            );
                        }
                    },
                );
                assert!(answers > 1900);
                // In the band it is the derivative itself.
                if window == 7 && hertz <= 2.0 {
                    assert!((value - 1.0).abs() < 1e-3 && (slope / w - 1.0).abs() < 1e-3);
                    assert!((curvature / (w * w) + 1.0).abs() < 1e-3);
                }
            }
        }
    }

    #[test]
    fn the_band_ends_where_the_formula_says() {
        for window in [21, 51] {
            let hertz = 0.532 / delay(window, STEP);
            let mut most = 0.0_f64;
            let sine = |t: f64| (std::f64::consts::TAU * hertz * t).sin();
            run(
                window,
                sine,
                |_| false,
                |t, [value, ..]| {
                    if t > 0.1 {
                        most = most.max(value.abs());
                    }
                },
            );
            assert!((most - 0.5_f64.sqrt()).abs() < 0.05, "{window} {most}");
        }
    }

    #[test]
    fn a_parabola_comes_back_exactly_through_any_gap() {
        let curve = |t: f64| 100.0 + 3.0 * t - 7.0 * t * t;
        let lost: [&dyn Fn(usize) -> bool; 3] = [
            &|_| false,
            &|k| k * 7919 % 100 < 50,     // half of them
            &|k| (300..900).contains(&k), // 0.6 s
        ];
        for (case, lost) in lost.iter().enumerate() {
            let answers = run(21, curve, lost, |t, fitted| {
                let expected = [curve(t), 3.0 - 14.0 * t, -14.0];
                for (fitted, (expected, tolerance)) in
                    fitted.iter().zip(expected.iter().zip([1e-11, 1e-9, 1e-7]))
                {
                    assert!(
                        (fitted - expected).abs() < tolerance,
                        "case {case}: {fitted} {expected}"
                    );
                }
            });
            assert!(answers > [1980, 800, 1350][case], "case {case}: {answers}");
        }
    }

    #[test]
    fn what_left_the_window_is_forgotten_to_the_last_bit() {
        let mut old = Differentiator::new(2, STEP, 9).unwrap();
        for k in 0..40 {
            let _ = old
                .push(f64::from(k) * STEP, &[1e300 * f64::from(k), f64::from(k)])
                .unwrap();
        }
        let mut fresh = Differentiator::new(2, STEP, 9).unwrap();
        for k in 40..80 {
            let (t, sample) = (f64::from(k) * STEP, [(f64::from(k) * 0.1).sin(), 5.0]);
            let (of_old, of_fresh) = (
                old.push(t, &sample).unwrap(),
                fresh.push(t, &sample).unwrap(),
            );
            if k >= 49 {
                assert!(of_old && of_fresh);
                assert_eq!(old.fitted(), fresh.fitted());
            }
        }
    }

    #[test]
    fn time_that_does_not_go_on_starts_again() {
        let mut filter = Differentiator::new(1, STEP, 5).unwrap();
        let mut settled = |t: f64| filter.push(t, &[1.0]).unwrap();
        assert_eq!(
            [0.0, 0.001, 0.002, 0.003, 0.004].map(&mut settled),
            [false, false, false, false, true]
        );
        assert!(!settled(0.004));
        assert!(!settled(f64::NAN));
        assert_eq!(
            [1.0, 1.001, 1.002, 1.003, 1.004].map(settled),
            [false, false, false, false, true]
        );
    }

    #[test]
    fn the_first_answer_comes_when_it_is_said_to() {
        for (window, first) in [(5, 5), (7, 5), (9, 6), (15, 10), (21, 14), (101, 64)] {
            assert_eq!(first_answer(window), first);
            for step in [0.00025, 0.001, 0.004] {
                let mut filter = Differentiator::new(1, step, window).unwrap();
                for start in [0.0, 12_345.678] {
                    let times = (0..200).map(|k| start + f64::from(k) * step);
                    let answers = times.map(|t| filter.push(t, &[1.0]).unwrap());
                    let before = answers.take_while(|answer| !answer).count();
                    assert_eq!(before + 1, first, "{window} {step} {start}");
                    filter.reset();
                }
            }
        }
    }

    #[test]
    fn the_usual_window_answers_within_ten_samples() {
        for step in [0.001, 0.00125, 0.002, 0.004, 0.008, 0.02] {
            assert!(first_answer(usual_window(step)) <= 10, "{step}");
        }
        assert!(first_answer(usual_window(STEP) + 2) > 10);
        // Faster than that it is ten milliseconds.
        for step in [0.0005, 0.00025] {
            assert!(
                first_answer(usual_window(step)) as f64 * step < 0.0105,
                "{step}"
            );
        }
    }

    /// Noise of one encoder step of 1e-5 rad, evenly spread, as noise of the answer: value, slope, curvature.
    fn noise(window: usize) -> [f64; 3] {
        let mut state = 1_u64;
        let encoder: Vec<f64> = (0..2000)
            .map(|_| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                1e-5 * ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5)
            })
            .collect();
        let (mut squares, mut count) = ([0.0; 3], 0.0);
        let read = |t: f64| encoder[(t / STEP).round() as usize];
        run(
            window,
            read,
            |_| false,
            |t, fitted| {
                // From the first full window on.
                if t > 0.1 {
                    count += 1.0;
                    for (sum, x) in squares.iter_mut().zip(fitted) {
                        *sum += x * x;
                    }
                }
            },
        );
        squares.map(|sum: f64| (sum / count).sqrt())
    }

    #[test]
    fn what_a_shorter_window_costs() {
        let [usual, longer] = [usual_window(STEP), 21].map(noise);
        for (window, [q, dq, ddq]) in [(usual_window(STEP), usual), (21, longer)] {
            println!("window {window}: q {q:.1e} rad, dq {dq:.1e} rad/s, ddq {ddq:.3} rad/s^2");
        }
        let cost: Vec<f64> = usual.iter().zip(longer).map(|(a, b)| a / b).collect();
        println!(
            "times: q {:.2}, dq {:.2}, ddq {:.2}",
            cost[0], cost[1], cost[2]
        );
        // White noise: the window to the powers -1/2, -3/2 and -5/2.
        let shorter = 21.0 / usual_window(STEP) as f64;
        for (cost, power) in cost.into_iter().zip([0.5, 1.5, 2.5]) {
            assert!(
                (cost / shorter.powf(power) - 1.0).abs() < 0.15,
                "{cost} {power}"
            );
        }
    }

    #[test]
    fn windows_that_are_none() {
        for (step, window) in [(0.0, 7), (f64::NAN, 7), (STEP, 6), (STEP, 3), (STEP, 103)] {
            assert!(Differentiator::new(1, step, window).is_err());
        }
        assert_eq!(
            [0.001, 0.002, 0.008, 0.0005, 1e-9, 1e9].map(usual_window),
            [15, 11, 7, 31, 101, 7]
        );
        assert!(Differentiator::new(1, STEP, 5)
            .unwrap()
            .push(0.0, &[1.0, 2.0])
            .is_err());
    }
}
