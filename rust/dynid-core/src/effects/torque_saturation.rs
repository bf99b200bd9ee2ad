//! A torque constant that droops at high current: `c tau_motor^3`, c above zero where the drive claims more than it gives.

use super::EffectInput;
use crate::slices::{at, put};

/// One column: the cube of the motor's whole torque as the model predicts it, friction and rotor included, never of a
/// measured one. A current makes them all, so of the load's cube alone friction under load would be left.
pub fn columns(
    _shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let tau = at(input.tau_motor, j);
    put(&[tau * tau * tau], columns);
}
