//! Friction that falls with speed, as the film builds: `k s(v) exp(-(|v| / v_s)^d)`, s friction's sign.

use super::row::{single, Formula};
use super::smooth_friction::own_sign;
use super::EffectInput;
use crate::lanes::{self, Lanes};
use crate::slices::{at, first, put};

/// Name in files and reports.
pub(super) const KIND: &str = "stribeck";

/// Two columns of the motor's speed and its sign, one per direction, like Coulomb's. `shape`: v_s \[rad/s\], d,
/// eps \[rad/s\], p.
pub(super) struct Stribeck;

impl Formula<2, 2> for Stribeck {
    #[inline(always)]
    fn row<L: Lanes>([v, sign]: [L; 2], shape: &[f64]) -> [L; 2] {
        let [stribeck_velocity, exponent] = first(shape);
        let zero = L::splat(0.0);
        // A speed whose quotient is infinite is as one that only nearly is.
        let ratio = (v.abs() / L::splat(stribeck_velocity)).at_most(L::splat(f64::MAX));
        let power = lanes::exp(L::splat(exponent) * lanes::ln(ratio));
        let column = sign * lanes::exp(-power);
        [v.if_less(zero, zero, column), v.if_less(zero, column, zero)]
    }
}

/// [`Stribeck`] at one sample.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [_, _, transition_width, sharpness] = first(shape);
    let sign = own_sign(j, input, transition_width, sharpness);
    let signals = [at(input.state.dq_motor, j), sign];
    put(&single::<Stribeck, 2, 2>(signals, shape), columns);
}
