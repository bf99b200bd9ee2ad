//! From the states of a run to the filtered, decimated rows of every joint: one pass over the regressor.

use std::ops::Range;

use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::{all_finite, Effect, RobotModel, State};
use rayon::prelude::*;

use crate::columns::RunSignals;
use crate::error::OfflineError;
use crate::filter::{ZeroPhase, LANES};
use crate::in_band::{Columns, Sample, GROUP};
use crate::joint_columns::{EffectColumns, JointPlan};

/// States and torques of one run on a uniform time grid; every slice is row-major, n_samples × n_joints.
#[derive(Clone, Copy, Debug)]
pub struct RunStates<'a> {
    /// What effects see.
    pub signals: RunSignals<'a>,
    /// Measured torque \[N·m or A\].
    pub tau: &'a [f64],
}

/// The band and the rows that are kept.
#[derive(Clone, Debug, Default)]
pub struct Sampling {
    /// Low-pass for every column and for the torque.
    pub filter: ZeroPhase,
    /// Indices of the samples that become rows, ascending: decimation, and what is left out.
    pub kept: Vec<usize>,
}

impl Sampling {
    /// `raw` (n_samples × width, row-major) in the band at the kept samples, [`LANES`] columns in each block.
    fn kept_in_band(&self, raw: &[f64], width: usize) -> Vec<Vec<[f64; LANES]>> {
        let kept = |work: &mut Vec<_>, block: usize| {
            let first = block * LANES;
            let columns = first..width.min(first + LANES);
            self.filter.apply_to(raw, width, columns, work);
            let pad = self.filter.min_samples() - 1;
            self.kept.iter().map(|&k| work[pad + k]).collect()
        };
        if width <= LANES {
            return vec![kept(&mut Vec::new(), 0)]; // to wake the pool takes longer
        }
        (0..width.div_ceil(LANES))
            .into_par_iter()
            .map_init(Vec::new, kept)
            .collect()
    }

    fn check(&self, n_samples: usize) -> Result<(), OfflineError> {
        if !rising(&self.kept, n_samples) {
            return Err(OfflineError::Shape {
                what: "kept samples",
            });
        }
        let needed = self.filter.min_samples();
        if n_samples < needed {
            return Err(OfflineError::TooFewSamples {
                actual: n_samples,
                needed,
            });
        }
        Ok(())
    }

    /// Rows (kept × width) of `raw` (n_samples × width, row-major) in the band.
    ///
    /// # Errors
    /// [`OfflineError`] if the run is shorter than the filter's padding or a kept sample lies outside of it.
    pub fn rows_of(&self, raw: &[f64], width: usize) -> Result<Vec<f64>, OfflineError> {
        self.check(raw.len() / width.max(1))?;
        let blocks = self.kept_in_band(raw, width);
        Ok((0..self.kept.len())
            .flat_map(|k| (0..width).map(move |c| (k, c)))
            .map(|(k, c)| blocks[c / LANES][k][c % LANES])
            .collect())
    }
}

/// Rows `[effects of joint j | base columns of the links it moves | torque]` of every joint.
#[derive(Clone, Debug)]
pub struct Observation {
    /// Kept rows.
    pub n_rows: usize,
    /// One per joint.
    pub joints: Vec<JointRows>,
}

/// Rows of one joint.
#[derive(Clone, Debug)]
pub struct JointRows {
    /// `n_rows` × `width`, row-major; the last column is the torque.
    pub rows: Vec<f64>,
    /// Columns including the torque.
    pub width: usize,
}

/// Builds the rows of one run.
///
/// `effects` with their shapes; `pivots`: indices into phi of the base columns, ascending.
///
/// # Errors
/// [`OfflineError`] if lengths disagree, an index is out of range, a number is not finite or the run is shorter than
/// the filter's padding.
pub fn observe(
    robot: &RobotModel,
    effects: &[Effect],
    pivots: &[usize],
    run: &RunStates<'_>,
    sampling: &Sampling,
) -> Result<Observation, OfflineError> {
    let n = robot.n_joints();
    let n_samples = run.tau.len() / n;
    check(robot, effects, pivots, run, sampling, n_samples)?;

    let plan: Vec<_> = (0..n).map(|j| JointPlan::new(j, effects, pivots)).collect();
    // On the pool as a whole: each of its many steps would wake it anew.
    let groups = rayon::scope(|_| {
        let effects = EffectColumns::new(effects, n, &run.signals);
        let columns = Columns {
            robot,
            effects: &effects,
            plan: &plan,
            run,
        };
        columns.kept_in_band(sampling)
    });

    let mut first = 0;
    let joints = plan
        .iter()
        .map(|joint| {
            let width = joint.width();
            let columns = first..first + width;
            first = columns.end;
            let mut rows = Vec::with_capacity(sampling.kept.len() * width);
            for k in 0..sampling.kept.len() {
                put_columns(&groups, k, columns.clone(), &mut rows);
            }
            JointRows { rows, width }
        })
        .collect();
    Ok(Observation {
        n_rows: sampling.kept.len(),
        joints,
    })
}

/// Columns of row `k`, whichever groups they are in, behind `to`.
fn put_columns(groups: &[Vec<Sample>], k: usize, columns: Range<usize>, to: &mut Vec<f64>) {
    let mut c = columns.start;
    while c < columns.end {
        let (group, from) = (c / GROUP, c % GROUP);
        let until = GROUP.min(from + columns.end - c);
        to.extend_from_slice(&groups[group][k][from..until]);
        c += until - from;
    }
}

/// One instant of a run's row-major signals.
#[must_use]
pub fn slice_state<'a>(state: &State<'a>, at: std::ops::Range<usize>) -> State<'a> {
    State {
        q: &state.q[at.clone()],
        dq: &state.dq[at.clone()],
        ddq: &state.ddq[at.clone()],
        q_motor: &state.q_motor[at.clone()],
        dq_motor: &state.dq_motor[at.clone()],
        ddq_motor: &state.ddq_motor[at.clone()],
        temperature: state.temperature.map(|t| &t[at]),
    }
}

pub(crate) fn check(
    robot: &RobotModel,
    effects: &[Effect],
    pivots: &[usize],
    run: &RunStates<'_>,
    sampling: &Sampling,
    n_samples: usize,
) -> Result<(), OfflineError> {
    if !all_finite(run.tau) {
        return Err(OfflineError::NonFinite { what: "run" });
    }
    run.signals.check_finite()?;
    check_shapes(robot, effects, pivots, run, n_samples)?;
    sampling.check(n_samples)
}

/// [`check`] of a run whose samples are all kept, but for whether the links' state and the torque are finite.
pub(crate) fn check_shapes(
    robot: &RobotModel,
    effects: &[Effect],
    pivots: &[usize],
    run: &RunStates<'_>,
    n_samples: usize,
) -> Result<(), OfflineError> {
    let n = robot.n_joints();
    if run.tau.len() != n_samples * n {
        return Err(OfflineError::Shape { what: "tau" });
    }
    run.signals.check_shapes(effects, n, n_samples)?;
    run.signals.check_others()?;
    if !rising(pivots, n * N_LINK_PARAMS) {
        return Err(OfflineError::Shape { what: "pivots" });
    }
    Ok(())
}

/// Whether `indices` ascend and end before `end`.
fn rising(indices: &[usize], end: usize) -> bool {
    indices.windows(2).all(|pair| pair[0] < pair[1]) && indices.last().is_none_or(|&k| k < end)
}
