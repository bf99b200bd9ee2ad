//! The paper's friction (Eqs. 9-11): two directions with coefficients of their own, viscous terms above a threshold.

use super::EffectInput;

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
    let s = direction(dq, eps);
    let side = usize::from(dq < 0.0);
    // 1 in motion, 1/2 at rest: (s + 1)/2 for dq >= 0, (1 - s)/2 for dq < 0.
    let gate = (1.0 + s.abs()) / 2.0;
    let mut columns = [0.0; N_FRICTION];
    columns[side] = s * gate; // Eq. 10
    if dq.abs() >= lambda {
        // Eq. 11, from the threshold of Eq. 9 on.
        columns[2 + side] = gate * dq;
        columns[4 + side] = dq * dq;
        columns[6 + side] = dq * dq * dq;
    }
    columns
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
    columns.copy_from_slice(&friction_columns(
        input.state.dq_motor[j],
        shape[0],
        shape[1],
    ));
}
