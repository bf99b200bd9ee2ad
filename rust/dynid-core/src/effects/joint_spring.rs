//! A spring at the joint, as a cable pack or a balancer: `k (q - q_0)`.

use super::EffectInput;
use crate::slices::{at, first, put};

/// One column. `shape`: rest position q_0 \[rad\]; beside a torque offset any will do, the offset makes up for it.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    _memory: &mut [f64],
    columns: &mut [f64],
) {
    let [rest] = first(shape);
    put(&[at(input.state.q, j) - rest], columns);
}
