//! Friction of a gear stage that two joints turn, as in wrists: `k s(v_j + r v_p)`, p the partner of j.
//!
//! By its power the stage gives joint p the torque `r k s(v_j + r v_p) = |r| k s(v_p + v_j / r)`: the same effect, seen
//! from p, with the ratio 1/r, the width eps/|r| and a coefficient of its own.

use super::catalogue::partner_of;
use super::friction::direction;
use super::EffectInput;

/// One column, zero without a partner. `shape`: partner (index along the chain, or -1), ratio r, eps \[rad/s\].
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let (partner, ratio, transition_width) = (shape[0], shape[1], shape[2]);
    let dq = input.state.dq_motor;
    columns[0] = partner_of(partner).map_or(0.0, |partner| {
        direction(dq[j] + ratio * dq[partner], transition_width)
    });
}
