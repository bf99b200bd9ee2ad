//! Friction of a gear stage that two joints turn, as in wrists: `k s(u) + d u`, `u = v_j + r v_p`, p the partner.
//!
//! By its power the stage gives joint p the torque `r (k s(u) + d u) = |r| k s(u / r) + r^2 d u / r`: the same effect, seen
//! from p, with the ratio 1/r, the width eps/|r| and the coefficients |r| k and r^2 d.

use super::entry::partner_of;
use super::smooth_friction::friction_sign;
use super::EffectInput;
use crate::slices::{at, first, put};

/// Name in files and reports.
pub(super) const KIND: &str = "coupled_friction";

/// Two columns, zeros without a partner. `shape`: partner (index along the chain, or -1), ratio r, eps \[rad/s\], p.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [partner, ratio, transition_width, sharpness] = first(shape);
    let dq = input.state.dq_motor;
    let both = partner_of(partner).map_or([0.0; 2], |partner| {
        let speed = at(dq, j) + ratio * at(dq, partner);
        [friction_sign(speed, transition_width, sharpness), speed]
    });
    put(&both, columns);
}
