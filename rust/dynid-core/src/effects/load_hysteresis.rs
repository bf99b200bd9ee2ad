//! Friction before sliding that grows with the load of the gear: `k |tau_link| z`, z in \[-1, 1\] as in
//! [`friction_hysteresis`](super::friction_hysteresis).

use super::friction_hysteresis::bristles;
use super::EffectInput;
use crate::slices::{at, first, put};

/// One column. `shape`: pre-sliding distance d \[rad\]. The load is the rigid-body torque that the model predicts, never a
/// measured one; the bristles' way does not depend on it.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    memory: &mut [f64],
    columns: &mut [f64],
) {
    let [distance] = first(shape);
    let z = bristles(distance, at(input.state.q_motor, j), memory);
    put(&[at(input.tau_link, j).abs() * z], columns);
}
