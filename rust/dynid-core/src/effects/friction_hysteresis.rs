//! Friction before sliding (Dahl, 1968): bristles bend over a distance d until they slip, `dz = dx/d (1 - z sign(dx))`.
//!
//! `tau_j = k z`, z in \[-1, 1\]. Only the way counts, not the time. Between two samples the motor moves one way, and
//! then the equation has the solution `z' = sign(dx) + (z - sign(dx)) exp(-|dx| / d)`: exact for any step.

use super::{EffectInput, Entry};
use crate::slices::{at, first, put};

/// Numbers per joint: z, the position of the sample before, and 1 from the first sample on.
pub const MEMORY: usize = 3;

/// Name in files and reports.
pub const KIND: &str = "friction_hysteresis";

/// Shortest way over which a gear's bristles bend \[rad\]: an arc minute, which makers of gears call no lost motion.
pub const SHORTEST_WAY: f64 = 2.9e-4;

/// True for hysteresis over a shorter way on every joint: Coulomb's friction with a sign that is told by the way, and keeps
/// its value at rest.
pub(super) fn is_sign(entry: &Entry, shape: &[f64]) -> bool {
    entry.kind == KIND && shape.iter().all(|way| *way < SHORTEST_WAY)
}

/// One column, z; bristles are straight at the first sample. `shape`: pre-sliding distance d \[rad\].
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    memory: &mut [f64],
    columns: &mut [f64],
) {
    let [distance] = first(shape);
    put(
        &[bristles(distance, at(input.state.q_motor, j), memory)],
        columns,
    );
}

/// z after the motor has come to position `q`; `memory` (length [`MEMORY`]) goes one sample on.
pub(super) fn bristles(distance: f64, q: f64, memory: &mut [f64]) -> f64 {
    let [z, before, started] = first(memory);
    let dx = if started > 0.0 { q - before } else { 0.0 };
    let slip = if dx == 0.0 { 0.0 } else { dx.signum() };
    let z = slip + (z - slip) * (-dx.abs() / distance).exp();
    put(&[z, q, 1.0], memory);
    z
}
