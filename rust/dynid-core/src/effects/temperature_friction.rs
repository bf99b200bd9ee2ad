//! Friction that follows a measured temperature: `c (T - T_0) F(v)`, F the joint's friction at T_0 (Eqs. 9-11).

use super::friction::{columns_of_sign, N_FRICTION};
use super::smooth_friction::own_sign;
use super::EffectInput;
use crate::slices::{at, first, put};

/// One column: change per kelvin, as a part of friction. `shape`: T_0 \[degC\], eps \[rad/s\], p, the eight coefficients of F.
/// Nothing where the temperature is not known.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [reference, transition_width, sharpness] = first(shape);
    let above = input.state.temperature.map_or(f64::NAN, |t| at(t, j)) - reference;
    let mut column = 0.0;
    if above.is_finite() {
        let dq = at(input.state.dq_motor, j);
        let basis = columns_of_sign(own_sign(j, input, transition_width, sharpness), dq);
        let coefficients: [f64; N_FRICTION] = first(shape.get(3..).unwrap_or_default());
        let products = basis.into_iter().zip(coefficients).map(|(b, c)| b * c);
        column = above * products.sum::<f64>();
    }
    put(&[column], columns);
}
