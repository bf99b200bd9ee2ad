//! Rotor inertia, reflected to the link side: `tau_j = J_j ddq_motor_j`.

use super::EffectInput;
use crate::slices::{at, put};

/// One column: the motor's acceleration, reduced by the gear \[rad/s²\]. Its coefficient is the rotor's inertia times
/// the gear ratio squared \[kg·m²\].
pub fn columns(
    _shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    put(&[at(input.state.ddq_motor, j)], columns);
}
