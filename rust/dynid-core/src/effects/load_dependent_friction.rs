//! Friction that grows with the load of the gear: `(m0 + m1 |v|) |tau_link| s(v)`, s friction's sign.

use super::smooth_friction::own_sign;
use super::EffectInput;
use crate::slices::{at, first, put};

/// Two columns, at standstill speed and growing with it. `shape`: eps \[rad/s\], p. The load is the rigid-body torque that
/// the model predicts, never a measured one.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [transition_width, sharpness] = first(shape);
    let dq = at(input.state.dq_motor, j);
    let standstill = at(input.tau_link, j).abs() * own_sign(j, input, transition_width, sharpness);
    put(&[standstill, standstill * dq.abs()], columns);
}
