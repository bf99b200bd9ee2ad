//! Friction that follows a measured temperature: `(T - T_0) (c0 s(v) + c1 v)`, `s(v) = tanh(v / eps)`.

use super::friction::direction;
use super::EffectInput;

/// Two columns: change of Coulomb and of viscous friction per kelvin. `shape`: T_0 \[degC\], eps \[rad/s\]. Nothing where the
/// temperature is not known.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let dq = input.state.dq_motor[j];
    let above = input.state.temperature.map_or(f64::NAN, |t| t[j]) - shape[0];
    columns.fill(0.0);
    if above.is_finite() {
        columns[0] = above * direction(dq, shape[1]);
        columns[1] = above * dq;
    }
}
