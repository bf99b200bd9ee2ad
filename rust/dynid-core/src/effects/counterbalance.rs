//! A gas cylinder, or a hydraulic one with a gas accumulator, between a pin on the link and a pin on its parent.
//!
//! The pins are `a` and `b` away from the joint's axis, so `L^2 = a^2 + b^2 + 2 a b cos(q + phase)`; the torque is
//! `F(L) dL/dq`, F a tension. Isothermal gas in a column of cross-section A: `F = p A = c / (s - x)`, with the stroke
//! `x = L - |a - b|` from the shortest length, the gas length `s = V / A` there, and `c = Z R T m` \[N·m\].

use super::row::{single, Formula};
use super::EffectInput;
use crate::lanes::{self, Lanes};
use crate::slices::{at, first, put};

/// Name in files and reports.
pub(super) const KIND: &str = "counterbalance";

/// One column, `dL/dq / (s - x)`. `shape`: a, b \[m\], phase \[rad\], gas length s \[m\].
///
/// A positive s is gas that is pressed together as the cylinder is drawn out (it pulls); a negative one is a strut that
/// pushes, whose gas column is `|s| + x`. Scaling a, b and s together changes nothing.
pub(super) struct Cylinder;

impl Formula<1, 1> for Cylinder {
    #[inline(always)]
    fn row<L: Lanes>([q]: [L; 1], shape: &[f64]) -> [L; 1] {
        let [a, b, phase, gas_length] = first(shape);
        let (sin, cos) = lanes::sin_cos(q + L::splat(phase));
        let length = (L::splat(a * a + b * b) + L::splat(2.0 * a * b) * cos).sqrt();
        let lever_arm = L::splat(-a * b) * sin / length; // dL/dq
        let stroke = length - L::splat((a - b).abs());
        [lever_arm / (L::splat(gas_length) - stroke)]
    }
}

/// [`Cylinder`] at one sample.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    put(
        &single::<Cylinder, 1, 1>([at(input.state.q, j)], shape),
        columns,
    );
}

/// # Errors
/// The pins can meet, or the gas can vanish at some angle.
pub fn check(shape: &[f64]) -> Result<(), &'static str> {
    let (a, b, gas_length) = (shape[0], shape[1], shape[3]);
    if a == b {
        Err("needs different a and b: with equal ones the cylinder has no length at some angle")
    } else if gas_length == 0.0 || (gas_length > 0.0 && gas_length <= 2.0 * a.min(b)) {
        Err("needs a gas_length above the stroke 2 min(a, b), or a negative one for a strut that pushes")
    } else {
        Ok(())
    }
}
