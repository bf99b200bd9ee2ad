//! The core's formulas over many samples, on all threads. Signals are row-major, n_samples × n_joints.

use dynid_core::chain;
use dynid_core::frames::LinkNumbers;
use dynid_core::lanes::{self, Kernel, Lanes};
use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::newton;
use dynid_core::{CoreError, RobotModel, State, Status, TorqueEstimator};
use rayon::prelude::*;

use crate::ahead::Ahead;
use crate::error::OfflineError;
use crate::observation::slice_state;
use crate::rows::{put, put_at, StateRows};

/// Samples per task; a multiple of every row.
const CHUNK: usize = 256;

/// Inverse dynamics of every sample into `tau` (n_samples × n).
///
/// # Errors
/// [`CoreError::Length`] if lengths disagree, [`OfflineError::NonFinite`] if a number of the motion is not finite (found on
/// the way, so that `tau` is written all the same).
pub fn inverse_dynamics(
    robot: &RobotModel,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
    phi: &[f64],
    tau: &mut [f64],
) -> Result<(), OfflineError> {
    let n = robot.n_joints();
    same_length("phi", phi, N_LINK_PARAMS * n)?;
    same_length("tau", tau, tau.len() / n * n)?;
    for (what, signal) in [("q", q), ("dq", dq), ("ddq", ddq)] {
        same_length(what, signal, tau.len())?;
    }
    let links = &robot.frames().links(phi);
    in_chunks(tau, n, |first, tau| {
        let at = first * n..first * n + tau.len();
        lanes::run(Torques {
            robot,
            motion: [q, dq, ddq].map(|signal| &signal[at.clone()]),
            links,
            tau,
        })
    })
}

/// `work(first sample, chunk)` on every [`CHUNK`] samples of `out` (`size` numbers each), on all threads; it says whether
/// what it read was finite. What fits in one chunk stays on this thread: waking another takes longer.
fn in_chunks(
    out: &mut [f64],
    size: usize,
    work: impl Fn(usize, &mut [f64]) -> bool + Sync,
) -> Result<(), OfflineError> {
    let finite = if out.len() <= size * CHUNK {
        work(0, out)
    } else {
        out.par_chunks_mut(size * CHUNK)
            .enumerate()
            .map(|(chunk, out)| work(chunk * CHUNK, out))
            .reduce(|| true, |one, other| one & other)
    };
    if finite {
        Ok(())
    } else {
        Err(OfflineError::NonFinite { what: "run" })
    }
}

struct Torques<'a> {
    robot: &'a RobotModel,
    motion: [&'a [f64]; 3],
    links: &'a [LinkNumbers],
    tau: &'a mut [f64],
}

impl Kernel for Torques<'_> {
    /// Whether every number of the motion is finite.
    type Output = bool;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> bool {
        if self.tau.len() == self.robot.n_joints() {
            self.rows::<S>()
        } else {
            self.rows::<L>()
        }
    }
}

impl Torques<'_> {
    #[inline(always)]
    fn rows<L: Lanes>(self) -> bool {
        let n = self.robot.n_joints();
        let frames = self.robot.frames();
        let mut states = StateRows::<L>::turned(n, &frames.offsets);
        let mut wrenches = vec![[[L::ZERO; 3]; 2]; n];
        let mut tau = vec![L::ZERO; n];
        for (k, out) in self.tau.chunks_mut(n * L::LEN).enumerate() {
            states.take(self.motion, k);
            newton::inverse_dynamics::<L>(
                frames,
                self.links,
                states.rows(),
                &mut wrenches,
                &mut tau,
            );
            put::<L>(&tau, out, n);
        }
        states.are_finite()
    }
}

/// Regressor of every sample into `regressor` (n_samples × n × 10 n).
///
/// # Errors
/// As [`inverse_dynamics`].
pub fn joint_torque_regressor(
    robot: &RobotModel,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
    regressor: &mut [f64],
) -> Result<(), OfflineError> {
    let n = robot.n_joints();
    let size = n * n * N_LINK_PARAMS;
    same_length("regressor", regressor, regressor.len() / size * size)?;
    for (what, signal) in [("q", q), ("dq", dq), ("ddq", ddq)] {
        same_length(what, signal, regressor.len() / size * n)?;
    }
    in_chunks(regressor, size, |first, regressor| {
        let at = first * n..first * n + regressor.len() / size * n;
        lanes::run(Regressors {
            robot,
            motion: [q, dq, ddq].map(|signal| &signal[at.clone()]),
            regressor,
        })
    })
}

struct Regressors<'a> {
    robot: &'a RobotModel,
    motion: [&'a [f64]; 3],
    regressor: &'a mut [f64],
}

impl Kernel for Regressors<'_> {
    /// Whether every number of the motion is finite.
    type Output = bool;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> bool {
        let n = self.robot.n_joints();
        if self.regressor.len() == n * n * N_LINK_PARAMS {
            self.rows::<S>()
        } else {
            self.rows::<L>()
        }
    }
}

impl Regressors<'_> {
    #[inline(always)]
    fn rows<L: Lanes>(self) -> bool {
        let n = self.robot.n_joints();
        let width = n * N_LINK_PARAMS;
        let size = n * width;
        let mut states = StateRows::<L>::new(n);
        let mut twists = vec![[[L::ZERO; 3]; 2]; n];
        let mut regressor = vec![L::ZERO; size];
        for (k, out) in self.regressor.chunks_mut(size * L::LEN).enumerate() {
            states.take(self.motion, k);
            chain::joint_torque_regressor::<L>(
                self.robot,
                states.rows(),
                &mut twists,
                &mut regressor,
            );
            for j in 0..n {
                // No link before joint j is moved by it.
                let (start, own) = (j * width, j * width + j * N_LINK_PARAMS);
                for sample in out.chunks_exact_mut(size) {
                    // Whole rows again: what goes too far is overwritten below.
                    for at in (start..own).step_by(L::LEN) {
                        L::splat(0.0).store(&mut sample[at..]);
                    }
                }
                put_at::<L>(&regressor[own..start + width], out, size, own);
            }
        }
        states.are_finite()
    }
}

/// Every sample through one estimator, in order, as it runs online; but a torque channel that is early is no riddle here,
/// for the states that it shows the torque of stand in the record. `terms`: n_samples × n_terms × n; `total`:
/// n_samples × n; `status`: n_samples.
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
    let row = estimator.terms().len();
    same_length("terms", terms, status.len() * row)?;
    same_length("total", total, status.len() * n)?;
    each(
        estimator,
        states,
        status.len(),
        |k, estimator, state, ahead| {
            let found = estimator.estimate_into(state, &mut total[k * n..(k + 1) * n])?;
            status[k] = found.and(ahead).bits();
            terms[k * row..(k + 1) * row].copy_from_slice(estimator.terms());
            Ok(())
        },
    )
}

/// The total of [`estimate`] alone: `total` is n_samples × n.
///
/// # Errors
/// [`CoreError::Length`] if lengths disagree.
pub fn torque(
    estimator: &mut TorqueEstimator,
    states: &State<'_>,
    total: &mut [f64],
) -> Result<(), CoreError> {
    let n = estimator.model().robot().n_joints();
    same_length("total", total, total.len() / n * n)?;
    let n_samples = total.len() / n;
    each(estimator, states, n_samples, |k, estimator, state, _| {
        estimator.estimate_into(state, &mut total[k * n..(k + 1) * n])?;
        Ok(())
    })
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
    same_length("std", std, std.len() / n * n)?;
    let mut tau = vec![0.0; n];
    let n_samples = std.len() / n;
    each(estimator, states, n_samples, |k, estimator, state, _| {
        estimator.estimate_into(state, &mut tau)?;
        estimator.predicted_std_into(&mut std[k * n..(k + 1) * n])
    })
}

/// `work(sample, estimator, state, status)` on every sample in order, with the state that the torque channel shows there as
/// far as the estimator does not find it by itself.
fn each(
    estimator: &mut TorqueEstimator,
    states: &State<'_>,
    n_samples: usize,
    mut work: impl FnMut(usize, &mut TorqueEstimator, &State<'_>, Status) -> Result<(), CoreError>,
) -> Result<(), CoreError> {
    let n = estimator.model().robot().n_joints();
    states.check(n_samples * n)?;
    let mut ahead = Ahead::of(estimator.look_ahead()?, estimator.step(), n);
    for k in 0..n_samples {
        match &mut ahead {
            None => {
                let state = slice_state(states, k * n..(k + 1) * n);
                work(k, estimator, &state, Status::OK)?;
            }
            Some(ahead) => {
                let (state, inside) = ahead.state(states, k, n_samples);
                let status = if inside { Status::OK } else { Status::SETTLING };
                work(k, estimator, &state, status)?;
            }
        }
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
