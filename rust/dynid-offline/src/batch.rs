//! The core's formulas over many samples, on all threads. Signals are row-major, n_samples × n_joints.

use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::{
    inverse_dynamics_into, joint_torque_regressor_into, CoreError, RobotModel, State,
    TorqueEstimator, Workspace,
};
use rayon::prelude::*;

use crate::observation::slice_state;

/// Samples per task.
const CHUNK: usize = 256;

/// Inverse dynamics of every sample into `tau` (n_samples × n).
///
/// # Errors
/// [`CoreError::Length`] if lengths disagree.
pub fn inverse_dynamics(
    robot: &RobotModel,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
    phi: &[f64],
    tau: &mut [f64],
) -> Result<(), CoreError> {
    let n = robot.n_joints();
    same_length("tau", tau, tau.len() / n * n)?;
    for (what, signal) in [("q", q), ("dq", dq), ("ddq", ddq)] {
        same_length(what, signal, tau.len())?;
    }
    tau.par_chunks_mut(n * CHUNK).enumerate().try_for_each_init(
        || Workspace::new(robot),
        |workspace, (chunk, out)| {
            out.chunks_exact_mut(n)
                .enumerate()
                .try_for_each(|(k, tau)| {
                    let start = (chunk * CHUNK + k) * n;
                    let at = start..start + n;
                    inverse_dynamics_into(
                        robot,
                        workspace,
                        &q[at.clone()],
                        &dq[at.clone()],
                        &ddq[at],
                        phi,
                        tau,
                    )
                })
        },
    )
}

/// Regressor of every sample into `regressor` (n_samples × n × 10 n).
///
/// # Errors
/// [`CoreError::Length`] if lengths disagree.
pub fn joint_torque_regressor(
    robot: &RobotModel,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
    regressor: &mut [f64],
) -> Result<(), CoreError> {
    let n = robot.n_joints();
    let size = n * n * N_LINK_PARAMS;
    same_length("regressor", regressor, regressor.len() / size * size)?;
    for (what, signal) in [("q", q), ("dq", dq), ("ddq", ddq)] {
        same_length(what, signal, regressor.len() / size * n)?;
    }
    regressor
        .par_chunks_mut(size * CHUNK)
        .enumerate()
        .try_for_each_init(
            || Workspace::new(robot),
            |workspace, (chunk, out)| {
                out.chunks_exact_mut(size)
                    .enumerate()
                    .try_for_each(|(k, out)| {
                        let start = (chunk * CHUNK + k) * n;
                        let at = start..start + n;
                        joint_torque_regressor_into(
                            robot,
                            workspace,
                            &q[at.clone()],
                            &dq[at.clone()],
                            &ddq[at],
                            out,
                        )
                    })
            },
        )
}

/// Every sample through one estimator, in order, exactly as it runs online. `terms`: n_samples × n_terms × n;
/// `total`: n_samples × n; `status`: n_samples.
///
/// # Errors
/// [`CoreError::Length`] if lengths disagree.
pub fn estimate(
    estimator: &mut TorqueEstimator,
    states: &State<'_>,
    terms: &mut [f64],
    total: &mut [f64],
    status: &mut [u32],
) -> Result<(), CoreError> {
    let n = estimator.model().robot().n_joints();
    states.check(total.len())?;
    let row = estimator.terms().len();
    same_length("terms", terms, status.len() * row)?;
    same_length("total", total, status.len() * n)?;
    for (k, status) in status.iter_mut().enumerate() {
        let at = k * n..(k + 1) * n;
        let state = slice_state(states, at.clone());
        *status = estimator.estimate_into(&state, &mut total[at])?.bits();
        terms[k * row..(k + 1) * row].copy_from_slice(estimator.terms());
    }
    Ok(())
}

/// [`TorqueEstimator::predicted_std_into`] at every sample into `std` (n_samples × n).
///
/// # Errors
/// [`CoreError::Length`] if lengths disagree.
pub fn predicted_std(
    estimator: &mut TorqueEstimator,
    states: &State<'_>,
    std: &mut [f64],
) -> Result<(), CoreError> {
    let n = estimator.model().robot().n_joints();
    states.check(std.len())?;
    same_length("std", std, std.len() / n * n)?;
    let mut tau = vec![0.0; n];
    for (k, std) in std.chunks_exact_mut(n).enumerate() {
        estimator.estimate_into(&slice_state(states, k * n..(k + 1) * n), &mut tau)?;
        estimator.predicted_std_into(std)?;
    }
    Ok(())
}

fn same_length(what: &'static str, signal: &[f64], expected: usize) -> Result<(), CoreError> {
    if signal.len() == expected {
        Ok(())
    } else {
        Err(CoreError::Length {
            what,
            expected,
            actual: signal.len(),
        })
    }
}
