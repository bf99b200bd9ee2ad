//! Friction that changes around the turn, as of a shaft out of true: `s(v) (a cos N q + b sin N q)`.

use super::row::{single, Formula};
use super::smooth_friction::own_sign;
use super::EffectInput;
use crate::lanes::{self, Lanes};
use crate::slices::{at, first, put};

/// Name in files and reports.
pub(super) const KIND: &str = "position_dependent_friction";

/// Two columns of the angle and the sign. `shape`: N \[cycles per turn\], eps \[rad/s\], p. It turns round with the speed,
/// which tells it from gravity.
pub(super) struct PositionDependentFriction;

impl Formula<2, 2> for PositionDependentFriction {
    #[inline(always)]
    fn row<L: Lanes>([q, sign]: [L; 2], shape: &[f64]) -> [L; 2] {
        let [cycles] = first(shape);
        let (sin, cos) = lanes::sin_cos(L::splat(cycles) * q);
        [sign * cos, sign * sin]
    }
}

/// [`PositionDependentFriction`] at one sample.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [_, transition_width, sharpness] = first(shape);
    let sign = own_sign(j, input, transition_width, sharpness);
    let signals = [at(input.state.q, j), sign];
    put(
        &single::<PositionDependentFriction, 2, 2>(signals, shape),
        columns,
    );
}
