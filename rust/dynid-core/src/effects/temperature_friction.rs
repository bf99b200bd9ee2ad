//! Friction that follows a measured temperature: `c (T - T_0) F(v)`, F the joint's friction at T_0 (Eqs. 9-11).

use super::friction::{friction_columns, N_FRICTION};
use super::EffectInput;
use crate::slices::{at, first, put};

/// One column: change per kelvin, as a part of friction. `shape`: T_0 \[degC\], eps \[rad/s\], the eight coefficients of F.
/// Nothing where the temperature is not known.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [reference, transition_width] = first(shape);
    let above = input.state.temperature.map_or(f64::NAN, |t| at(t, j)) - reference;
    let mut column = 0.0;
    if above.is_finite() {
        let basis = friction_columns(at(input.state.dq_motor, j), 0.0, transition_width);
        let coefficients: [f64; N_FRICTION] = first(shape.get(2..).unwrap_or_default());
        let products = basis.into_iter().zip(coefficients).map(|(b, c)| b * c);
        column = above * products.sum::<f64>();
    }
    put(&[column], columns);
}
