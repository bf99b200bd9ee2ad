//! A constant torque per joint: `tau_j = o_j`.

use super::EffectInput;
use crate::slices::put;

/// One column of ones: offset of the torque channel, or the even part of friction \[N·m\].
pub fn columns(
    _shape: &[f64],
    _j: usize,
    _input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    put(&[1.0], columns);
}
