//! The paper's friction (Eqs. 9-11): two directions with coefficients of their own, viscous terms above a threshold.

use super::{EffectInput, SpeedRow};
use crate::lanes::{self, Kernel, Lanes, MOST_LANES};
use crate::slices::{at, first, put, tail};

/// Name in files and reports.
pub(super) const KIND: &str = "friction";

/// Columns per joint: two Coulomb, and three viscous orders for each direction.
pub const N_FRICTION: usize = 8;

/// The superscripts of the paper's `k_v1^2` are indices, not powers.
pub const FRICTION_NAMES: [&str; N_FRICTION] = [
    "coulomb_pos",
    "coulomb_neg",
    "viscous1_pos",
    "viscous1_neg",
    "viscous2_pos",
    "viscous2_neg",
    "viscous3_pos",
    "viscous3_neg",
];

/// Direction of motion `s(v) = tanh(v / eps)`, smooth at standstill.
#[must_use]
pub fn direction(dq: f64, eps: f64) -> f64 {
    (dq / eps).tanh()
}

/// Basis of Eqs. 9-11 at motor speed `dq` \[rad/s\], in the order of [`FRICTION_NAMES`].
///
/// With `s = tanh(dq / eps)`, for `dq >= 0`: Coulomb `s (s + 1) / 2` and, where `|dq| >= lambda`, viscous
/// `(s + 1)/2 dq, dq^2, dq^3`; for `dq < 0` mirrored with `(1 - s)/2`. The quadratic term keeps its sign as printed, so
/// friction is odd (Eq. 4) only if the quadratic coefficients of the two sides are opposite.
#[must_use]
pub fn friction_columns(dq: f64, lambda: f64, eps: f64) -> [f64; N_FRICTION] {
    struct One([f64; 3]);

    impl Kernel for One {
        type Output = [f64; N_FRICTION];

        #[inline(always)]
        fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Self::Output {
            let [dq, lambda, eps] = self.0;
            narrow(PaperFriction::row(
                S::splat(dq),
                S::splat(lambda),
                S::splat(eps),
            ))
        }
    }

    lanes::run_narrow(One([dq, lambda, eps]))
}

/// Columns of one speed.
#[inline(always)]
fn narrow<S: Lanes<Raw = [f64; 1]>>(row: [S; N_FRICTION]) -> [f64; N_FRICTION] {
    row.map(|x| {
        let [x] = x.raw();
        x
    })
}

/// [`friction_columns`] of a row of speeds, with lambda and eps.
#[derive(Clone, Copy, Debug)]
pub struct PaperFriction;

impl SpeedRow<N_FRICTION> for PaperFriction {
    #[inline(always)]
    fn row<L: Lanes>(dq: L, lambda: L, eps: L) -> [L; N_FRICTION] {
        row_of_sign(lanes::tanh(dq / eps), dq, lambda)
    }
}

/// [`friction_columns`] of a speed whose sign `s` is rounded in another way, viscous from standstill on.
#[must_use]
pub(super) fn columns_of_sign(s: f64, dq: f64) -> [f64; N_FRICTION] {
    struct One([f64; 2]);

    impl Kernel for One {
        type Output = [f64; N_FRICTION];

        #[inline(always)]
        fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Self::Output {
            let [s, dq] = self.0;
            narrow(row_of_sign(S::splat(s), S::splat(dq), S::splat(0.0)))
        }
    }

    lanes::run_narrow(One([s, dq]))
}

/// [`PaperFriction`] with the sign `s` of `dq`.
#[inline(always)]
fn row_of_sign<L: Lanes>(s: L, dq: L, lambda: L) -> [L; N_FRICTION] {
    let zero = L::splat(0.0);
    // 1 in motion, 1/2 at rest: (s + 1)/2 for dq >= 0, (1 - s)/2 for dq < 0.
    let gate = s.abs().mul_add(L::splat(0.5), L::splat(0.5));
    let square = dq * dq;
    // Eq. 10, then Eq. 11 from the threshold of Eq. 9 on.
    let terms = [s * gate, gate * dq, square, square * dq];
    let mut columns = [zero; N_FRICTION];
    for (k, term) in terms.into_iter().enumerate() {
        let term = if k == 0 {
            term
        } else {
            dq.abs().if_less(lambda, zero, term)
        };
        columns[2 * k] = dq.if_less(zero, zero, term);
        columns[2 * k + 1] = dq.if_less(zero, term, zero);
    }
    columns
}

/// Two shape parameters and `n_columns` coefficients of every joint, turned over so that joints stand side by side, each
/// padded to whole rows: by ones where there is no joint, of coefficients by zeros.
pub(super) fn padded(shape: &[f64], coefficients: &[f64], n_columns: usize) -> Vec<f64> {
    let n = shape.len() / 2;
    let width = n.next_multiple_of(MOST_LANES);
    let mut numbers = vec![0.0; (2 + n_columns) * width];
    numbers[..2 * width].fill(1.0);
    for j in 0..n {
        let own = shape[2 * j..2 * j + 2]
            .iter()
            .chain(&coefficients[n_columns * j..n_columns * (j + 1)]);
        for (k, x) in own.enumerate() {
            numbers[k * width + j] = *x;
        }
    }
    numbers
}

/// Torque of all joints by a law of friction, in lanes: its columns times the coefficients. `numbers`: see [`padded`].
#[inline(always)]
pub(super) fn torque_in_lanes<L: Lanes, Law: SpeedRow<N>, const N: usize>(
    numbers: &[f64],
    dq: &[f64],
    tau: &mut [f64],
) {
    let width = dq.len().next_multiple_of(MOST_LANES);
    let rows = dq.chunks(L::LEN).zip(tau.chunks_mut(L::LEN));
    for (k, (dq, tau)) in rows.enumerate() {
        let own = tail(numbers, k * L::LEN);
        let columns = Law::row(L::load_some(dq), L::load(own), L::load(tail(own, width)));
        let mut sum = L::splat(0.0);
        for (k, column) in columns.into_iter().enumerate() {
            sum = sum + column * L::load(tail(own, (2 + k) * width));
        }
        sum.store_some(tau);
    }
}

/// Eight columns. `shape`: lambda of Eq. 9 and eps of Eqs. 10-11 \[rad/s\].
///
/// Friction acts in the gear's input stage, so its speed is the motor's.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [lambda, eps] = first(shape);
    let dq = at(input.state.dq_motor, j);
    put(&friction_columns(dq, lambda, eps), columns);
}
