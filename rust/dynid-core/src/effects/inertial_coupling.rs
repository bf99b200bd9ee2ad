//! Inertia of another joint's motor that this joint feels, as where a drive shaft runs through it: `c ddq_motor_p`.

use super::entry::partner_of;
use super::EffectInput;
use crate::slices::{at, first, put};

/// One column, zero without a partner. `shape`: partner p (index along the chain, or -1).
pub fn columns(
    shape: &[f64],
    _j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [partner] = first(shape);
    let column = partner_of(partner).map_or(0.0, |partner| at(input.state.ddq_motor, partner));
    put(&[column], columns);
}
