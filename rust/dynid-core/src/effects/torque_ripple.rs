//! Ripple of gear teeth or motor poles: `a cos(N q_motor) + b sin(N q_motor)` and its second harmonic.

use super::row::{single, Formula};
use super::EffectInput;
use crate::lanes::{self, Lanes};
use crate::slices::{at, first, put};

/// Name in files and reports.
pub(super) const KIND: &str = "torque_ripple";

/// Four columns: cosine and sine of N, cosine and sine of 2 N. `shape`: N \[cycles per turn of the joint\], not
/// necessarily whole: once per turn of the motor is the gear ratio.
pub(super) struct Ripple;

impl Formula<1, 4> for Ripple {
    #[inline(always)]
    fn row<L: Lanes>([q_motor]: [L; 1], shape: &[f64]) -> [L; 4] {
        let [cycles] = first(shape);
        let angle = L::splat(cycles) * q_motor;
        let (sin, cos) = lanes::sin_cos(angle);
        let (sin_twice, cos_twice) = lanes::sin_cos(L::splat(2.0) * angle);
        [cos, sin, cos_twice, sin_twice]
    }
}

/// [`Ripple`] at one sample.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    put(
        &single::<Ripple, 1, 4>([at(input.state.q_motor, j)], shape),
        columns,
    );
}
