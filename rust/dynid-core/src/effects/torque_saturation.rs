//! A torque constant that droops at high current: `c tau_link^3`, c above zero where the drive claims more than it gives.

use super::EffectInput;
use crate::slices::{at, copy};

/// One column: the cube of the rigid-body torque that the model predicts, never of a measured one.
pub fn columns(
    _shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let tau = at(input.tau_link, j);
    copy(&[tau * tau * tau], columns);
}
