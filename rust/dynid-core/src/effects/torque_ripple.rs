//! Ripple of gear teeth or motor poles: `a cos(N q_motor) + b sin(N q_motor)` and its second harmonic.

use super::EffectInput;
use crate::slices::{at, first, put};

/// Four columns: cosine and sine of N, cosine and sine of 2 N. `shape`: N \[cycles per turn of the joint\], not
/// necessarily whole: once per turn of the motor is the gear ratio.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [cycles] = first(shape);
    let angle = cycles * at(input.state.q_motor, j);
    let (sin, cos) = angle.sin_cos();
    let (sin_twice, cos_twice) = (2.0 * angle).sin_cos();
    put(&[cos, sin, cos_twice, sin_twice], columns);
}
