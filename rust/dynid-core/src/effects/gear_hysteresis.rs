//! Torque that an elastic gear loses in its teeth: `k z`, z in \[-1, 1\] as in
//! [`friction_hysteresis`](super::friction_hysteresis), but along the gear's deflection q_motor - q.

use super::friction_hysteresis::bristles;
use super::EffectInput;

/// One column, zero where one encoder shows both sides. `shape`: deflection d within which z turns round \[rad\].
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    memory: &mut [f64],
    columns: &mut [f64],
) {
    let deflection = input.state.q_motor[j] - input.state.q[j];
    columns[0] = bristles(shape[0], deflection, memory);
}
