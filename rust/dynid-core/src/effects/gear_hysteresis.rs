//! Torque that an elastic gear loses in its teeth while it winds up: `k z`, z in \[-1, 1\] as in
//! [`friction_hysteresis`](super::friction_hysteresis), but along the gear's wind-up.
//!
//! The wind-up is what the load leaves the spring, over the stiffness: `x = tau_link - c z`, where c is the part of the
//! load that slipping teeth carry themselves. So the load tells the way as well as two encoders would, without their
//! noise and without the teeth's own errors. Between two samples the load goes one way, and `|dx| = u` follows from
//! `u + c (1 - z s)(1 - exp(-u/d)) = |dtau_link|`, s the sign of that way: exact for any step.

use super::EffectInput;
use crate::slices::{at, first, put};

/// Most Newton steps: enough for eight digits where teeth carry a thousand times d, for all where it is like d.
const STEPS: usize = 8;

/// One column. `shape`: change of x within which z turns round d, and load c that slipping teeth carry, both \[N·m\]. The
/// load is the rigid-body torque that the model predicts, never a measured one.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    memory: &mut [f64],
    columns: &mut [f64],
) {
    let [distance, carried] = first(shape);
    let load = at(input.tau_link, j);
    let [z, before, started] = first(memory);
    let change = if started > 0.0 { load - before } else { 0.0 };
    let way = if change == 0.0 { 0.0 } else { change.signum() };
    let turning = carried * (1.0 - z * way);
    let left = left_of(change.abs() / distance, turning / distance);
    let z = way + (z - way) * left;
    put(&[z, load, 1.0], memory);
    put(&[z], columns);
}

/// exp(-y) at the root y of `y + a (1 - exp(-y)) = t` for t and a of at least zero: Newton's steps from the left never
/// pass it, and end where the next one would change exp(-y) by less than its rounding.
fn left_of(t: f64, a: f64) -> f64 {
    let mut y = (t / (1.0 + a)).max(t - a);
    for _ in 0..STEPS {
        let left = (-y).exp();
        let step = (t - y - a * (1.0 - left)) / (1.0 + a * left);
        if step < f64::EPSILON {
            return left;
        }
        y += step;
    }
    (-y).exp()
}
