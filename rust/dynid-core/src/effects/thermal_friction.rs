//! Friction that changes as the gear warms up: `f (c0 s(v) + c1 v)`, f from 0 (as at the start of the run) towards 1.
//!
//! Warmth is of first order, `T df/dt = u - f`: with a reference speed v_r of 0 the source u is 1 (warm-up in time),
//! otherwise `|v| / v_r`, the power that Coulomb friction turns into heat, relative to that at v_r.

use super::smooth_friction::own_sign;
use super::EffectInput;
use crate::slices::{at, first, put};

/// Numbers per joint: the warmth f.
pub const MEMORY: usize = 1;

/// The source counts no more than this, so that one wild sample does not stay in the memory for minutes.
const GREATEST_SOURCE: f64 = 10.0;

/// Two columns: change of Coulomb and of viscous friction. `shape`: T \[s\], v_r \[rad/s\], eps \[rad/s\], p.
pub fn columns(
    shape: &[f64],
    j: usize,
    input: &EffectInput<'_>,
    memory: &mut [f64],
    columns: &mut [f64],
) {
    let [time_constant, reference_speed, transition_width, sharpness] = first(shape);
    let dq = at(input.state.dq_motor, j);
    let [warmth] = first(memory);
    put(
        &[
            warmth * own_sign(j, input, transition_width, sharpness),
            warmth * dq,
        ],
        columns,
    );
    let source = if reference_speed > 0.0 {
        (dq.abs() / reference_speed).min(GREATEST_SOURCE)
    } else {
        1.0
    };
    let next = warmth - (source - warmth) * (-input.step / time_constant).exp_m1();
    put(&[next], memory);
}
