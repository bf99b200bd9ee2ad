//! Zero-phase low-pass: a cascade of second-order sections, forwards and backwards.
//!
//! The sections are designed in Python (`runs/low_pass.py`); only the running is here, because it has to follow every
//! column of the regressor. Columns run side by side, one per lane. Same result as `scipy.signal.sosfiltfilt` (odd
//! padding, steady-state start).

use std::ops::Range;

use dynid_core::lanes::{self, Kernel, Lanes};

use crate::error::OfflineError;

/// Columns that are filtered together.
pub const LANES: usize = 8;

/// A second-order section `(b0 + b1 z^-1 + b2 z^-2) / (1 + a1 z^-1 + a2 z^-2)` and its steady state for a unit input.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Section {
    b: [f64; 3],
    a: [f64; 2],
    steady: [f64; 2],
}

/// Forward-backward filter. With no section it hands its input through.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ZeroPhase {
    sections: Vec<Section>,
    pad: usize,
}

impl ZeroPhase {
    /// `sections`: rows `b0 b1 b2 a0 a1 a2` as `scipy.signal.butter(..., output="sos")` gives them; `steady`: rows of
    /// `scipy.signal.sosfilt_zi`; `pad`: samples of odd extension at each end.
    ///
    /// # Errors
    /// [`OfflineError`] if the two have different lengths, a number is not finite, or an `a0` is not 1.
    pub fn new(
        sections: &[[f64; 6]],
        steady: &[[f64; 2]],
        pad: usize,
    ) -> Result<Self, OfflineError> {
        if sections.len() != steady.len() {
            return Err(OfflineError::Shape {
                what: "steady state of the filter",
            });
        }
        let numbers = sections.iter().flatten().chain(steady.iter().flatten());
        if !numbers.into_iter().all(|x| x.is_finite()) {
            return Err(OfflineError::NonFinite {
                what: "filter coefficients",
            });
        }
        if sections.iter().any(|s| s[3] != 1.0) {
            return Err(OfflineError::Shape {
                what: "filter section (a0 must be 1)",
            });
        }
        Ok(Self {
            sections: sections
                .iter()
                .zip(steady)
                .map(|(s, steady)| Section {
                    b: [s[0], s[1], s[2]],
                    a: [s[4], s[5]],
                    steady: *steady,
                })
                .collect(),
            pad,
        })
    }

    /// True if there is no section, so that it hands its input through.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.sections.is_empty()
    }

    /// Least number of samples that can be filtered.
    #[must_use]
    pub fn min_samples(&self) -> usize {
        self.pad + 1
    }

    /// Filters `samples` (time along the slice, one column per lane) in place. `work` is scratch of any length.
    pub fn apply<const N: usize>(&self, samples: &mut [[f64; N]], work: &mut Vec<[f64; N]>) {
        if self.sections.is_empty() {
            return;
        }
        let n = samples.len();
        debug_assert!(n >= self.min_samples());
        work.clear();
        work.resize(self.pad, [0.0; N]);
        work.extend_from_slice(samples);
        self.both_ways(work);
        samples.copy_from_slice(&work[self.pad..self.pad + n]);
    }

    /// Some columns of `raw` (n × width, row-major), at most `N`, both ways into `work`, behind the padding.
    pub(crate) fn apply_to<const N: usize>(
        &self,
        raw: &[f64],
        width: usize,
        columns: Range<usize>,
        work: &mut Vec<[f64; N]>,
    ) {
        work.clear();
        work.resize(self.pad + raw.len() / width, [0.0; N]);
        // Column by column: of a few numbers at a time each copy would be a call.
        for (lane, column) in columns.enumerate() {
            let from = raw[column..].iter().step_by(width);
            for (to, x) in work[self.pad..].iter_mut().zip(from) {
                to[lane] = *x;
            }
        }
        self.both_ways(work);
    }

    /// Extends `samples`, before which there is room for the padding, and filters them forwards and backwards.
    fn both_ways<const N: usize>(&self, samples: &mut Vec<[f64; N]>) {
        self.put_before(samples);
        self.put_behind(samples);
        let mut memory = self.steady(&samples[0]);
        self.run(&mut memory, samples, Direction::Forwards);
        let mut memory = self.steady(&samples[samples.len() - 1]);
        self.run(&mut memory, samples, Direction::Backwards);
    }

    /// Low-passes every column of `x` (n × width, row-major) in place.
    ///
    /// # Errors
    /// [`OfflineError::TooFewSamples`] if there are no more than the padding.
    pub fn low_pass(&self, x: &mut [f64], width: usize) -> Result<(), OfflineError> {
        let n = x.len() / width.max(1);
        if n < self.min_samples() {
            return Err(OfflineError::TooFewSamples {
                actual: n,
                needed: self.min_samples(),
            });
        }
        if self.is_empty() {
            return Ok(());
        }
        let mut work: Vec<[f64; LANES]> = Vec::with_capacity(n + 2 * self.pad);
        for first in (0..width).step_by(LANES) {
            let columns = first..width.min(first + LANES);
            self.apply_to(x, width, columns.clone(), &mut work);
            for (lane, column) in columns.enumerate() {
                let to = x[column..].iter_mut().step_by(width);
                for (to, lanes) in to.zip(&work[self.pad..]) {
                    *to = lanes[lane];
                }
            }
        }
        Ok(())
    }

    /// Odd extension into the first places of `samples`, before at least [`Self::min_samples`] that are there.
    pub(crate) fn put_before<const N: usize>(&self, samples: &mut [[f64; N]]) {
        let pad = self.pad;
        for k in 0..pad {
            samples[k] = mirror(&samples[pad], &samples[2 * pad - k]);
        }
    }

    /// Odd extension behind the last of `samples`, at least [`Self::min_samples`].
    pub(crate) fn put_behind<const N: usize>(&self, samples: &mut Vec<[f64; N]>) {
        let n = samples.len();
        for k in 0..self.pad {
            samples.push(mirror(&samples[n - 1], &samples[n - 2 - k]));
        }
    }

    /// What the sections remember of a signal that has been `first` for ever.
    pub(crate) fn steady<const N: usize>(&self, first: &[f64; N]) -> Memory<N> {
        // A section's steady output for a steady input is the next one's input; `steady` already counts on that.
        let of = |s: &Section| s.steady.map(|share| first.map(|x| x * share));
        Memory(self.sections.iter().map(of).collect())
    }

    /// One direction, direct form II transposed; goes on from `memory`.
    pub(crate) fn run<const N: usize>(
        &self,
        memory: &mut Memory<N>,
        samples: &mut [[f64; N]],
        direction: Direction,
    ) {
        lanes::run(Pass {
            sections: &self.sections,
            memory: &mut memory.0,
            samples,
            direction,
        });
    }
}

/// What the sections remember between two stretches of a signal: two numbers each, for every column.
#[derive(Clone, Debug)]
pub(crate) struct Memory<const N: usize>(Vec<[[f64; N]; 2]>);

/// Which end of a stretch is filtered first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Direction {
    Forwards,
    Backwards,
}

struct Pass<'a, const N: usize> {
    sections: &'a [Section],
    memory: &'a mut [[[f64; N]; 2]],
    samples: &'a mut [[f64; N]],
    direction: Direction,
}

impl<const N: usize> Kernel for Pass<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(mut self) {
        let mut first = 0;
        while first + 4 * L::LEN <= N {
            self.columns::<L, 4>(first);
            first += 4 * L::LEN;
        }
        while first + L::LEN <= N {
            self.columns::<L, 1>(first);
            first += L::LEN;
        }
        // Fewer columns than lanes: one waits for itself, four side by side do not.
        while first + 4 <= N {
            self.columns::<S, 4>(first);
            first += 4;
        }
        while first < N {
            self.columns::<S, 1>(first);
            first += 1;
        }
    }
}

impl<const N: usize> Pass<'_, N> {
    /// Columns from `first` on, `U` rows of them at a time: what one has to wait for is time for the others.
    #[inline(always)]
    fn columns<L: Lanes, const U: usize>(&mut self, first: usize) {
        // The band's filter has two sections; with their number known they stay in registers.
        if let (Ok(sections), Ok(memory)) = (
            <&[Section; 2]>::try_from(self.sections),
            <&mut [_; 2]>::try_from(&mut *self.memory),
        ) {
            cascade::<L, N, U, 2>(sections, memory, self.samples, first, self.direction);
            return;
        }
        for (section, memory) in self.sections.iter().zip(self.memory.iter_mut()) {
            let (section, memory) = (std::slice::from_ref(section), std::slice::from_mut(memory));
            if let (Ok(section), Ok(memory)) = (section.try_into(), memory.try_into()) {
                cascade::<L, N, U, 1>(section, memory, self.samples, first, self.direction);
            }
        }
    }
}

/// Runs `S` sections one after the other over all samples.
#[inline(always)]
fn cascade<L: Lanes, const N: usize, const U: usize, const S: usize>(
    sections: &[Section; S],
    memory: &mut [[[f64; N]; 2]; S],
    samples: &mut [[f64; N]],
    first: usize,
    direction: Direction,
) {
    let zero = L::splat(0.0);
    let (mut b, mut a) = ([[zero; 3]; S], [[zero; 2]; S]);
    let mut z = [[[zero; U]; 2]; S];
    for k in 0..S {
        for (to, x) in b[k].iter_mut().zip(sections[k].b) {
            *to = L::splat(x);
        }
        for (to, x) in a[k].iter_mut().zip(sections[k].a) {
            *to = L::splat(x);
        }
        for (to, from) in z[k].iter_mut().zip(&memory[k]) {
            for (u, to) in to.iter_mut().enumerate() {
                *to = L::load(&from[first + u * L::LEN..]);
            }
        }
    }
    let n = samples.len();
    for i in 0..n {
        let at = match direction {
            Direction::Forwards => i,
            Direction::Backwards => n - 1 - i,
        };
        let sample = &mut samples[at][first..first + U * L::LEN];
        for u in 0..U {
            let mut x = L::load(&sample[u * L::LEN..]);
            for k in 0..S {
                let y = b[k][0] * x + z[k][0][u];
                z[k][0][u] = b[k][1] * x - a[k][0] * y + z[k][1][u];
                z[k][1][u] = b[k][2] * x - a[k][1] * y;
                x = y;
            }
            x.store(&mut sample[u * L::LEN..]);
        }
    }
    for k in 0..S {
        for (to, from) in memory[k].iter_mut().zip(&z[k]) {
            for (u, from) in from.iter().enumerate() {
                from.store(&mut to[first + u * L::LEN..]);
            }
        }
    }
}

/// Point reflection of `inner` through the end value: odd extension.
fn mirror<const N: usize>(end: &[f64; N], inner: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|lane| 2.0 * end[lane] - inner[lane])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A one-pole smoother as a section: y = (x + x z^-1)/2 per sample is FIR, enough to see phase and gain.
    #[test]
    fn a_symmetric_pair_of_passes_keeps_a_straight_line() {
        let filter = ZeroPhase::new(&[[0.5, 0.5, 0.0, 1.0, 0.0, 0.0]], &[[0.5, 0.0]], 4).unwrap();
        let mut line: Vec<[f64; LANES]> = (0..50).map(|k| [f64::from(k); LANES]).collect();
        filter.apply(&mut line, &mut Vec::new());
        for (k, sample) in line.iter().enumerate() {
            assert!((sample[3] - k as f64).abs() < 1e-12);
        }
    }

    #[test]
    fn no_section_hands_through() {
        let filter = ZeroPhase::default();
        let mut x = vec![[1.0; LANES], [5.0; LANES]];
        filter.apply(&mut x, &mut Vec::new());
        assert_eq!(x, vec![[1.0; LANES], [5.0; LANES]]);
    }
}
