//! Friction that falls with speed, as the film builds: `k s(v) exp(-(|v| / v_s)^d)`, `s(v) = tanh(v / eps)`.

use super::friction::direction;
use super::EffectInput;

/// Two columns, one per direction of the motor's speed, like Coulomb's. `shape`: v_s \[rad/s\], d, eps \[rad/s\].
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let (stribeck_velocity, exponent, transition_width) = (shape[0], shape[1], shape[2]);
    let dq = input.state.dq_motor[j];
    let fall = (-(dq.abs() / stribeck_velocity).powf(exponent)).exp();
    columns.fill(0.0);
    columns[usize::from(dq < 0.0)] = direction(dq, transition_width) * fall;
}
