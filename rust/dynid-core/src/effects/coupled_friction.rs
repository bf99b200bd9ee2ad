//! Friction of a gear stage that two joints turn, as in wrists: `k s(v_j + r v_p)`, p the partner of j.
//!
//! By its power the stage gives joint p the torque `r k s(v_j + r v_p) = |r| k s(v_p + v_j / r)`: the same effect, seen
//! from p, with the ratio 1/r, the width eps/|r| and a coefficient of its own.

use super::entry::partner_of;
use super::friction::direction;
use super::EffectInput;
use crate::slices::{at, copy, first};

/// One column, zero without a partner. `shape`: partner (index along the chain, or -1), ratio r, eps \[rad/s\].
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [partner, ratio, transition_width] = first(shape);
    let dq = input.state.dq_motor;
    let column = partner_of(partner).map_or(0.0, |partner| {
        direction(at(dq, j) + ratio * at(dq, partner), transition_width)
    });
    copy(&[column], columns);
}
