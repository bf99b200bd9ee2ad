//! Samples in lanes: row-major signals in and out of rows.

use core::ops::Range;

use dynid_core::chain::JointState;
use dynid_core::lanes::{self, Lanes, MOST_LANES};

/// [`Lanes::LEN`] samples of a robot's state.
pub(crate) struct StateRows<L: Lanes> {
    rows: Vec<JointState<L::Raw>>,
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
        }
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
            // One by one: what stands in a closure is not compiled for these registers.
            let q = square::<L>(motion[0], samples, n, joints.clone());
            let dq = square::<L>(motion[1], samples, n, joints.clone());
            let ddq = square::<L>(motion[2], samples, n, joints.clone());
            let columns = q.iter().zip(&dq).zip(&ddq);
            for (row, ((q, dq), ddq)) in self.rows[joints].iter_mut().zip(columns) {
                let (sin, cos) = lanes::sin_cos(*q);
                row.q = q.raw();
                row.sin = sin.raw();
                row.cos = cos.raw();
                row.dq = dq.raw();
                row.ddq = ddq.raw();
            }
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
    for (c, rows) in rows.chunks(L::LEN).enumerate() {
        let mut square = [L::splat(0.0); MOST_LANES];
        for (to, row) in square.iter_mut().zip(rows) {
            *to = L::from_raw(*row);
        }
        let samples = L::transpose(square);
        let first = start + c * L::LEN;
        for (lane, sample) in samples[..n_samples].iter().enumerate() {
            let at = lane * width + first;
            sample.store_some(&mut out[at..at + rows.len()]);
        }
    }
}
