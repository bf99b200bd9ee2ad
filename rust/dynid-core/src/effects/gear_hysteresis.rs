//! Torque that an elastic gear loses in its teeth while it winds up: `k z`, z in \[-1, 1\] as in
//! [`friction_hysteresis`](super::friction_hysteresis), but along the gear's load.
//!
//! The wind-up is the load over the stiffness, so the load tells its way as well as two encoders would, without their
//! noise and without the teeth's own errors.

use super::friction_hysteresis::bristles;
use super::EffectInput;
use crate::slices::{at, copy, first};

/// One column. `shape`: change of load d within which z turns round \[N·m\]. The load is the rigid-body torque that the
/// model predicts, never a measured one.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    memory: &mut [f64],
    columns: &mut [f64],
) {
    let [change] = first(shape);
    copy(&[bristles(change, at(input.tau_link, j), memory)], columns);
}
