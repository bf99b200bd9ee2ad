//! Rotor inertia, reflected to the link side: `tau_j = J_j ddq_motor_j`.

use crate::state::State;

/// Its coefficient is the rotor's inertia times the gear ratio squared \[kg·m²\].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RotorInertia;

impl RotorInertia {
    /// One column: the motor's acceleration, reduced by the gear \[rad/s²\].
    pub fn columns_into(self, j: usize, state: &State<'_>, columns: &mut [f64]) {
        columns[0] = state.ddq_motor[j];
    }
}
