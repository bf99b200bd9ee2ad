//! Friction that falls with speed, as the film builds: `k s(v) exp(-(|v| / v_s)^d)`, s friction's sign.

use super::smooth_friction::own_sign;
use super::EffectInput;
use crate::slices::{at, first, put};

/// Two columns, one per direction of the motor's speed, like Coulomb's. `shape`: v_s \[rad/s\], d, eps \[rad/s\], p.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [stribeck_velocity, exponent, transition_width, sharpness] = first(shape);
    let dq = at(input.state.dq_motor, j);
    let fall = (-(dq.abs() / stribeck_velocity).powf(exponent)).exp();
    let column = own_sign(j, input, transition_width, sharpness) * fall;
    let sides = if dq < 0.0 {
        [0.0, column]
    } else {
        [column, 0.0]
    };
    put(&sides, columns);
}
