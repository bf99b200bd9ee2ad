//! Friction whose sign is rounded by a shape of its own: `s(v) = v / (|v|^p + e^p)^(1/p)`.
//!
//! The larger the sharpness p, the longer the sign is a straight line and the shorter the way from there to one: 1 is like an
//! arctan, 2.5 like a tanh, 6 nearly a corner. Odd and even terms make up the two directions, up to the second order.

use super::friction::direction;
use super::{EffectInput, SpeedRow};
use crate::lanes::{self, Kernel, Lanes};
use crate::slices::{at, first, put};

/// Name in files and reports.
pub(crate) const KIND: &str = "smooth_friction";

/// Columns that jump at standstill where the transition is narrow: `s` and `|s|`. The others are zero there.
pub(crate) const N_SIGN: usize = 2;

/// Columns per joint.
pub(super) const N_COLUMNS: usize = 6;

/// The sign of `v`, rounded over the width `e` with the sharpness `p`.
///
/// Finite for every finite `v`: a power is only ever taken of what is at most one.
#[must_use]
pub fn rounded_sign(v: f64, e: f64, p: f64) -> f64 {
    struct One([f64; 3]);

    impl Kernel for One {
        type Output = f64;

        #[inline(always)]
        fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> f64 {
            let [v, e, p] = self.0.map(S::splat);
            let [sign] = sign_row(v, e, p).raw();
            sign
        }
    }

    lanes::run_narrow(One([v, e, p]))
}

/// [`rounded_sign`] of a row of speeds.
#[inline(always)]
pub(super) fn sign_row<L: Lanes>(v: L, e: L, p: L) -> L {
    let (size, one) = (v.abs(), L::splat(1.0));
    let ratio = size.at_most(e) / size.at_least(e);
    let power = lanes::exp(p * lanes::ln(ratio));
    let part = lanes::exp(-(lanes::ln(one + power) / p));
    (part * size.if_less(e, ratio, one)).xor(v.sign())
}

/// The columns of a row of speeds, with width and sharpness.
pub(super) struct SmoothFriction;

impl SpeedRow<N_COLUMNS> for SmoothFriction {
    #[inline(always)]
    fn row<L: Lanes>(v: L, e: L, p: L) -> [L; N_COLUMNS] {
        let (s, size) = (sign_row(v, e, p), v.abs());
        [s, s.abs(), v, size, v * size, v * v]
    }
}

/// Slopes of the sign and of its size: by the logarithm of the width, then by that of the sharpness.
pub const N_SLOPES: usize = 4;

/// Change of `s` and of `|s|` with the logarithm of the width, and the same with that of the sharpness.
///
/// With u = |v| / e and w = u^p those of `s` are `-s / (1 + w)` and `s (ln(1 + w) / p - w ln(u) / (1 + w))`. Beyond the width
/// both are written by 1 / w, so that a power is only ever taken of what is at most one; the second looks the same then.
#[derive(Clone, Copy, Debug)]
pub struct SignSlopes;

impl SpeedRow<N_SLOPES> for SignSlopes {
    #[inline(always)]
    fn row<L: Lanes>(v: L, e: L, p: L) -> [L; N_SLOPES] {
        let (size, one) = (v.abs(), L::splat(1.0));
        let ratio = (size.at_most(e) / size.at_least(e)).at_least(L::splat(f64::MIN_POSITIVE));
        let log = lanes::ln(ratio);
        let power = lanes::exp(p * log);
        let (whole, part) = (one + power, lanes::ln(one + power) / p);
        let s = (lanes::exp(-part) * size.if_less(e, ratio, one)).xor(v.sign());
        let width = -(s * size.if_less(e, one, power) / whole);
        let sharpness = s * (part - power * log / whole);
        [
            width,
            width.xor(v.sign()),
            sharpness,
            sharpness.xor(v.sign()),
        ]
    }
}

/// The sign of `v` as friction has it: [`rounded_sign`], or `tanh(v / e)` where the sharpness is zero.
#[must_use]
pub fn friction_sign(v: f64, e: f64, p: f64) -> f64 {
    if p > 0.0 {
        rounded_sign(v, e, p)
    } else {
        direction(v, e)
    }
}

/// [`friction_sign`] of the motor's speed of joint `j`.
pub(super) fn own_sign(j: usize, input: &EffectInput<'_>, e: f64, p: f64) -> f64 {
    let now = || friction_sign(at(input.state.dq_motor, j), e, p);
    input.sign.unwrap_or_else(now)
}

/// Six columns at the motor's speed v: `s`, `|s|`, `v`, `|v|`, `v |v|`, `v^2`. `shape`: e \[rad/s\], p.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [transition_width, sharpness] = first(shape);
    let v = at(input.state.dq_motor, j);
    let (s, size) = (rounded_sign(v, transition_width, sharpness), v.abs());
    put(&[s, s.abs(), v, size, v * size, v * v], columns);
}

#[cfg(test)]
mod tests {
    use super::{friction_sign, rounded_sign, SignSlopes};
    use crate::effects::SpeedRow;
    use crate::lanes::{Lanes, Portable};

    type Number = Portable<1, false>;

    const SPEEDS: [f64; 9] = [
        f64::MIN_POSITIVE,
        1e-200,
        1e-60,
        1e-5,
        0.02,
        0.7,
        1e60,
        1e200,
        f64::MAX,
    ];

    #[test]
    fn it_is_the_formula() {
        for p in [0.5, 1.0, 1.5, 2.5, 6.0] {
            for v in [1e-5, 0.003, 0.02, 0.05, 0.7, 30.0] {
                let formula = v / (f64::powf(v, p) + f64::powf(0.02, p)).powf(1.0 / p);
                let s = rounded_sign(v, 0.02, p);
                assert!((s - formula).abs() < 1e-14 * formula, "{v} {p}");
            }
        }
    }

    #[test]
    fn its_slopes_are_what_it_changes_by() {
        let slopes = |v: f64, e: f64, p: f64| {
            SignSlopes::row(Number::splat(v), Number::splat(e), Number::splat(p))
                .map(|x| x.raw()[0])
        };
        let (e, step) = (0.02_f64, 1e-5_f64);
        let (more, less) = (step.exp(), (-step).exp());
        for p in [0.5, 1.0, 2.5, 6.0] {
            for v in [
                -30.0, -0.02, -1e-5, 1e-7, 0.003, 0.0199, 0.02, 0.0201, 0.05, 0.7,
            ] {
                let [width, of_size, sharpness, _] = slopes(v, e, p);
                assert!(of_size == width * v.signum(), "{v} {p}");
                let by_width =
                    (rounded_sign(v, e * more, p) - rounded_sign(v, e * less, p)) / (2.0 * step);
                let by_sharpness =
                    (rounded_sign(v, e, p * more) - rounded_sign(v, e, p * less)) / (2.0 * step);
                assert!(
                    (width - by_width).abs() < 1e-9,
                    "{v} {p}: {width} {by_width}"
                );
                assert!(
                    (sharpness - by_sharpness).abs() < 1e-9,
                    "{v} {p}: {sharpness} {by_sharpness}"
                );
            }
            for v in [0.0, f64::MIN_POSITIVE, f64::MAX] {
                assert!(
                    slopes(v, e, p).iter().all(|slope| slope.abs() < 1e-3),
                    "{v} {p}"
                );
            }
        }
    }

    #[test]
    fn effects_have_friction_s_sign_and_without_a_sharpness_a_tanh() {
        for v in [-30.0, -0.02, -1e-5, 0.0, 1e-5, 0.02, 30.0] {
            assert!(friction_sign(v, 0.02, 1.5) == rounded_sign(v, 0.02, 1.5));
            assert!(friction_sign(v, 0.02, 0.0) == f64::tanh(v / 0.02));
        }
    }

    #[test]
    fn it_is_odd_rises_and_stays_within_one_at_any_speed() {
        for e in [1e-300, 0.0005, 0.12, 1e300] {
            for p in [1e-3, 1.0, 2.5, 6.0, 400.0] {
                let mut before = 0.0;
                for v in SPEEDS {
                    let s = rounded_sign(v, e, p);
                    assert!((before..=1.0).contains(&s), "{v} {e} {p}: {s}");
                    assert!(rounded_sign(-v, e, p).to_bits() == (-s).to_bits());
                    before = s;
                }
            }
        }
    }

    #[test]
    fn it_is_nothing_at_rest_and_straight_beside_it() {
        for p in [f64::MIN_POSITIVE, 1.0, 2.5, 6.0, f64::MAX] {
            assert!(rounded_sign(0.0, 0.01, p) == 0.0);
            assert!(rounded_sign(-0.0, 0.01, p) == 0.0);
        }
        // Powers of such a speed are no numbers any more.
        let s = rounded_sign(1e-250, 0.01, 6.0);
        assert!((s / 1e-248 - 1.0).abs() < 1e-15, "{s:e}");
    }
}
