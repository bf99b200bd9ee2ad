//! Friction of a joint's bearing, which carries what the joint beside it makes: `m |tau_link_n| s(v)`, s friction's sign
//!
//! Where the axes of neighbours cross, the torque about one is a moment that tilts the bearing of the other. So a first joint
//! that turns about the vertical, whose gear carries no weight at all, rubs more the further the arm reaches out.

use super::smooth_friction::own_sign;
use super::EffectInput;
use crate::slices::{first, put};

/// The joint `side` places along the chain from `j`: -1 before it, 1 behind it.
fn beside(j: usize, side: f64) -> Option<usize> {
    j.checked_add_signed(if side < 0.0 { -1 } else { 1 })
}

/// One column; none of a joint that has no neighbour there. `shape`: side, eps \[rad/s\], p. The load is the rigid-body
/// torque that the model predicts, never a measured one.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [side, transition_width, sharpness] = first(shape);
    let neighbour = beside(j, side).and_then(|neighbour| input.tau_link.get(neighbour));
    let load = neighbour.map_or(0.0, |load| load.abs());
    put(
        &[load * own_sign(j, input, transition_width, sharpness)],
        columns,
    );
}
