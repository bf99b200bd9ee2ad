//! Friction that grows with the load of the gear: `(m0 + m1 |v|) |tau_link| s(v)`, `s(v) = tanh(v / eps)`.

use super::friction::direction;
use super::EffectInput;

/// Two columns, at standstill speed and growing with it. `shape`: eps \[rad/s\]. The load is the rigid-body torque that
/// the model predicts, never a measured one.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let dq = input.state.dq_motor[j];
    columns[0] = input.tau_link[j].abs() * direction(dq, shape[0]);
    columns[1] = columns[0] * dq.abs();
}
