//! Samples in lanes: row-major signals in and out of rows.

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
        for (j, row) in self.rows.iter_mut().enumerate() {
            let q = gather::<L>(motion[0], samples, n, j);
            let (sin, cos) = lanes::sin_cos(q);
            row.q = q.raw();
            row.sin = sin.raw();
            row.cos = cos.raw();
            row.dq = gather::<L>(motion[1], samples, n, j).raw();
            row.ddq = gather::<L>(motion[2], samples, n, j).raw();
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

/// Rows of `width` entries to row-major samples: lane s to `out[s * width..]`. Lanes beyond the end of `out` are left.
#[inline(always)]
pub(crate) fn put<L: Lanes>(rows: &[L::Raw], out: &mut [f64], width: usize) {
    let mut block = [[0.0; MOST_LANES]; MOST_LANES];
    for (c, rows) in rows.chunks(MOST_LANES).enumerate() {
        for (numbers, row) in block.iter_mut().zip(rows) {
            L::from_raw(*row).store(numbers);
        }
        for (lane, sample) in out.chunks_exact_mut(width).take(L::LEN).enumerate() {
            let first = c * MOST_LANES;
            for (to, numbers) in sample[first..first + rows.len()].iter_mut().zip(&block) {
                *to = numbers[lane];
            }
        }
    }
}
