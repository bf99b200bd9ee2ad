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
        let n = self.rows.len();
        let n_samples = motion[0].len() / n;
        let mut starts = [0; MOST_LANES];
        for (lane, start) in starts.iter_mut().enumerate() {
            *start = (k * L::LEN + lane).min(n_samples - 1) * n;
        }
        for (j, row) in self.rows.iter_mut().enumerate() {
            let q = gather::<L>(motion[0], &starts, j);
            let (sin, cos) = lanes::sin_cos(q);
            *row = JointState {
                q: q.raw(),
                sin: sin.raw(),
                cos: cos.raw(),
                dq: gather::<L>(motion[1], &starts, j).raw(),
                ddq: gather::<L>(motion[2], &starts, j).raw(),
            };
        }
    }
}

#[inline(always)]
fn gather<L: Lanes>(signal: &[f64], starts: &[usize; MOST_LANES], j: usize) -> L {
    let mut numbers = [0.0; MOST_LANES];
    for (x, start) in numbers[..L::LEN].iter_mut().zip(starts) {
        *x = signal[start + j];
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
