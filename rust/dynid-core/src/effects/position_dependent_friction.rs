//! Friction that changes around the turn, as of a shaft out of true: `s(v) (a cos N q + b sin N q)`.

use super::friction::direction;
use super::EffectInput;
use crate::slices::{at, first, put};

/// Two columns. `shape`: N \[cycles per turn\], eps \[rad/s\]. It turns round with the speed, which tells it from gravity.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [cycles, transition_width] = first(shape);
    let s = direction(at(input.state.dq_motor, j), transition_width);
    let (sin, cos) = (cycles * at(input.state.q, j)).sin_cos();
    put(&[s * cos, s * sin], columns);
}
