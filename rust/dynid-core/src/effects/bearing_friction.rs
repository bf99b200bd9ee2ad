//! Friction of a bearing that the next joint's load bends: `(m0 + m1 |v|) |tau_link_k| s(v)`, `s(v) = tanh(v / eps)`.
//!
//! What hangs on joint k tilts the bearing of its neighbour j: a base that turns about the vertical feels no torque of
//! gravity and carries all its moment.

use super::catalogue::partner_of;
use super::friction::direction;
use super::EffectInput;

/// Two columns, at standstill speed and growing with it; zero where no joint bends it. `shape`: the joint k that bends it
/// (index along the chain, or -1), eps \[rad/s\]. The load is the rigid-body torque that the model predicts.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let dq = input.state.dq_motor[j];
    let load = partner_of(shape[0]).map_or(0.0, |k| input.tau_link[k].abs());
    columns[0] = load * direction(dq, shape[1]);
    columns[1] = columns[0] * dq.abs();
}
