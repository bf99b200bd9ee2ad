//! Friction that follows a measured temperature: `c (T - T_0) F(v)`, F the joint's friction at T_0 (Eqs. 9-11).

use super::friction::{friction_columns, N_FRICTION};
use super::EffectInput;

/// One column: change per kelvin, as a part of friction. `shape`: T_0 \[degC\], eps \[rad/s\], the eight coefficients of F.
/// Nothing where the temperature is not known.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let above = input.state.temperature.map_or(f64::NAN, |t| t[j]) - shape[0];
    columns[0] = 0.0;
    if above.is_finite() {
        let basis = friction_columns(input.state.dq_motor[j], 0.0, shape[1]);
        let friction: f64 = (0..N_FRICTION).map(|k| basis[k] * shape[2 + k]).sum();
        columns[0] = above * friction;
    }
}
