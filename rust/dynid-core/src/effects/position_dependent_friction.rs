//! Friction that changes around the turn, as of a shaft out of true: `s(v) (a cos N q + b sin N q)`.

use super::smooth_friction::own_sign;
use super::EffectInput;
use crate::slices::{at, first, put};

/// Two columns. `shape`: N \[cycles per turn\], eps \[rad/s\], p. It turns round with the speed, which tells it from gravity.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [cycles, transition_width, sharpness] = first(shape);
    let s = own_sign(j, input, transition_width, sharpness);
    let (sin, cos) = (cycles * at(input.state.q, j)).sin_cos();
    put(&[s * cos, s * sin], columns);
}
