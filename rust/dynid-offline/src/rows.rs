//! Samples in lanes: row-major signals in and out of rows.

use core::ops::Range;

use dynid_core::chain::JointState;
use dynid_core::lanes::{self, Lanes, MOST_LANES};

/// [`Lanes::LEN`] samples of a robot's state.
pub(crate) struct StateRows<L: Lanes> {
    rows: Vec<JointState<L::Raw>>,
    /// What is added to positions before their sines and cosines are taken, if anything.
    offsets: Vec<f64>,
    /// Zeros, until a number was not finite: infinity times zero is not a number.
    doubt: L,
}

impl<L: Lanes> StateRows<L> {
    /// Memory for `n` joints.
    pub(crate) fn new(n: usize) -> Self {
        let zero = L::ZERO;
        let rest = JointState {
            q: zero,
            sin: zero,
            cos: zero,
            dq: zero,
            ddq: zero,
        };
        Self {
            rows: vec![rest; n],
            offsets: Vec::new(),
            doubt: L::splat(0.0),
        }
    }

    /// The same with the sines and cosines of positions and `offsets` together.
    pub(crate) fn turned(n: usize, offsets: &[f64]) -> Self {
        Self {
            offsets: offsets.to_vec(),
            ..Self::new(n)
        }
    }

    /// True if every number that was taken is finite.
    #[inline(always)]
    pub(crate) fn are_finite(&self) -> bool {
        self.doubt.abs().all_less(L::splat(1.0))
    }

    /// One entry per joint.
    #[inline(always)]
    pub(crate) fn rows(&self) -> &[JointState<L::Raw>] {
        &self.rows
    }

    /// The `k`th group of samples of `[q, dq, ddq]` (row-major, n_samples × n). Where samples end before the row does, the
    /// last one fills up: no lane knows of its neighbours.
    #[inline(always)]
    pub(crate) fn take(&mut self, motion: [&[f64]; 3], k: usize) {
        let n_samples = motion[0].len() / self.rows.len();
        let samples = lane_samples::<L>(k, n_samples);
        self.take_samples(motion, &samples[..L::LEN]);
    }

    /// These samples of `[q, dq, ddq]`, one per lane.
    #[inline(always)]
    pub(crate) fn take_samples(&mut self, motion: [&[f64]; 3], samples: &[usize]) {
        let n = self.rows.len();
        for first in (0..n).step_by(L::LEN) {
            let joints = first..n.min(first + L::LEN);
            // One by one: what stands in a closure is not compiled for these registers. Every square straight to its place:
            // one that waits does so in memory.
            let q = square::<L>(motion[0], samples, n, joints.clone());
            for (row, q) in each::<_, L>(&mut self.rows, first).zip(q) {
                row.q = q.raw();
            }
            let dq = square::<L>(motion[1], samples, n, joints.clone());
            for (row, dq) in each::<_, L>(&mut self.rows, first).zip(dq) {
                row.dq = dq.raw();
            }
            let ddq = square::<L>(motion[2], samples, n, joints);
            for (row, ddq) in each::<_, L>(&mut self.rows, first).zip(ddq) {
                row.ddq = ddq.raw();
            }
        }
        let zero = L::splat(0.0);
        for (j, row) in self.rows.iter_mut().enumerate() {
            let q = L::from_raw(row.q);
            let (sin, cos) = lanes::sin_cos(match self.offsets.get(j) {
                Some(offset) => q + L::splat(*offset),
                None => q,
            });
            row.sin = sin.raw();
            row.cos = cos.raw();
            let (dq, ddq) = (L::from_raw(row.dq), L::from_raw(row.ddq));
            self.doubt = ddq.mul_add(zero, dq.mul_add(zero, q.mul_add(zero, self.doubt)));
        }
    }
}

/// The samples of the `k`th group, one per lane; where they end, the last one fills up.
#[inline(always)]
pub(crate) fn lane_samples<L: Lanes>(k: usize, n_samples: usize) -> [usize; MOST_LANES] {
    let mut samples = [0; MOST_LANES];
    for (lane, sample) in samples.iter_mut().enumerate() {
        *sample = (k * L::LEN + lane).min(n_samples - 1);
    }
    samples
}

/// Number `j` of every sample of a signal (row-major, n_samples × n).
#[inline(always)]
pub(crate) fn gather<L: Lanes>(signal: &[f64], samples: &[usize], n: usize, j: usize) -> L {
    let mut numbers = [0.0; MOST_LANES];
    for (x, sample) in numbers[..L::LEN].iter_mut().zip(samples) {
        *x = signal[sample * n + j];
    }
    L::load(&numbers)
}

/// All `n` numbers of these samples of a signal, one row for each number.
#[inline(always)]
pub(crate) fn take_numbers<L: Lanes>(
    signal: &[f64],
    samples: &[usize],
    n: usize,
    rows: &mut [L::Raw],
) {
    for first in (0..n).step_by(L::LEN) {
        let numbers = square::<L>(signal, samples, n, first..n.min(first + L::LEN));
        for (row, number) in each::<_, L>(rows, first).zip(numbers) {
            *row = number.raw();
        }
    }
}

/// At most [`Lanes::LEN`] things from number `first` on, as many as there are.
#[inline(always)]
fn each<T, L: Lanes>(all: &mut [T], first: usize) -> impl Iterator<Item = &mut T> {
    all[first..].iter_mut().take(L::LEN)
}

/// At most [`Lanes::LEN`] neighbouring numbers of every sample, one row for each number.
#[inline(always)]
fn square<L: Lanes>(
    signal: &[f64],
    samples: &[usize],
    n: usize,
    numbers: Range<usize>,
) -> [L; MOST_LANES] {
    let mut rows = [L::splat(0.0); MOST_LANES];
    for (row, sample) in rows.iter_mut().zip(samples) {
        let at = sample * n;
        *row = L::load_some(&signal[at + numbers.start..at + numbers.end]);
    }
    L::transpose(rows)
}

/// Rows of `width` entries to row-major samples: lane s to `out[s * width..]`. Lanes beyond the end of `out` are left.
#[inline(always)]
pub(crate) fn put<L: Lanes>(rows: &[L::Raw], out: &mut [f64], width: usize) {
    put_at::<L>(rows, out, width, 0);
}

/// [`put`] from place `start` of every sample on: lane s to `out[s * width + start..]`.
#[inline(always)]
pub(crate) fn put_at<L: Lanes>(rows: &[L::Raw], out: &mut [f64], width: usize, start: usize) {
    let n_samples = (out.len() / width).min(L::LEN);
    if n_samples == L::LEN && rows.len() >= L::LEN {
        // Whole rows only, because parts of one take many times as long to store: the last square begins early enough.
        let last = rows.len() - L::LEN;
        for first in (0..rows.len()).step_by(L::LEN) {
            let first = first.min(last);
            put_square::<L>(&rows[first..], &mut out[start + first..], width);
        }
        return;
    }
    let one_row = rows.len() == width && width <= L::LEN;
    for (c, rows) in rows.chunks(L::LEN).enumerate() {
        let samples = L::transpose(some_rows::<L>(rows));
        for (lane, sample) in samples.iter().enumerate().take(n_samples) {
            let at = lane * width + start + c * L::LEN;
            // What a sample writes too much is written again by the next one.
            if one_row && at + L::LEN <= out.len() {
                sample.store(&mut out[at..]);
            } else {
                sample.store_some(&mut out[at..at + rows.len()]);
            }
        }
    }
}

/// The first square of `rows`: lane s to `out[s * width..]`. Counts that the compiler knows, so that it stays in registers.
#[inline(always)]
fn put_square<L: Lanes>(rows: &[L::Raw], out: &mut [f64], width: usize) {
    let samples = L::transpose(some_rows::<L>(&rows[..L::LEN]));
    for (lane, sample) in samples.iter().enumerate().take(L::LEN) {
        sample.store(&mut out[lane * width..]);
    }
}

/// At most [`Lanes::LEN`] rows, from memory; zeros after them.
#[inline(always)]
fn some_rows<L: Lanes>(rows: &[L::Raw]) -> [L; MOST_LANES] {
    let mut square = [L::splat(0.0); MOST_LANES];
    for (k, to) in square.iter_mut().enumerate().take(L::LEN) {
        if let Some(row) = rows.get(k) {
            *to = L::from_raw(*row);
        }
    }
    square
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_core::lanes::Kernel;

    /// More numbers than any row has lanes.
    const N: usize = 21;

    struct Taken<'a>(&'a [f64]);

    impl Kernel for Taken<'_> {
        type Output = ();

        #[inline(always)]
        fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
            let samples = lane_samples::<L>(0, 5);
            let mut rows = vec![L::ZERO; N];
            take_numbers::<L>(self.0, &samples[..L::LEN], N, &mut rows);
            for (j, row) in rows.into_iter().enumerate() {
                let expected = gather::<L>(self.0, &samples[..L::LEN], N, j);
                let mut numbers = [[0.0; MOST_LANES]; 2];
                L::from_raw(row).store(&mut numbers[0]);
                expected.store(&mut numbers[1]);
                assert_eq!(numbers[0], numbers[1], "{j}");
                assert_eq!(numbers[0][0], self.0[j]);
            }
        }
    }

    #[test]
    fn numbers_beyond_the_lanes_are_taken_too() {
        let signal: Vec<f64> = (0..5 * N).map(|k| k as f64).collect();
        dynid_core::lanes::run(Taken(&signal));
    }
}
