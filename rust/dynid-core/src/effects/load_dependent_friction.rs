//! Friction that grows with the load of the gear: `(m0 + m1 |v|) |tau_link| s(v)`, `s(v) = tanh(v / eps)`.

use super::friction::direction;
use super::EffectInput;
use crate::slices::{at, first, put};

/// Two columns, at standstill speed and growing with it. `shape`: eps \[rad/s\]. The load is the rigid-body torque that
/// the model predicts, never a measured one.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [transition_width] = first(shape);
    let dq = at(input.state.dq_motor, j);
    let standstill = at(input.tau_link, j).abs() * direction(dq, transition_width);
    put(&[standstill, standstill * dq.abs()], columns);
}
