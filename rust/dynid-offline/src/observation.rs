//! From the states of a run to the filtered, decimated rows of every joint: one pass over the regressor.

use dynid_core::effects::MAX_COLUMNS;
use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::{joint_torque_regressor_into, Effect, RobotModel, State, Workspace};
use rayon::prelude::*;

use crate::columns::{columns, RunSignals};
use crate::error::OfflineError;
use crate::filter::{Lanes, ZeroPhase, LANES};

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
    fn kept_in_band(&self, raw: &[f64], width: usize) -> Vec<Vec<Lanes>> {
        (0..width.div_ceil(LANES))
            .into_par_iter()
            .map_init(Vec::new, |work, block| {
                let first = block * LANES;
                let used = LANES.min(width - first);
                let mut samples: Vec<Lanes> = raw
                    .chunks_exact(width)
                    .map(|row| {
                        let mut lanes = [0.0; LANES];
                        lanes[..used].copy_from_slice(&row[first..first + used]);
                        lanes
                    })
                    .collect();
                self.filter.apply(&mut samples, work);
                self.kept.iter().map(|&k| samples[k]).collect()
            })
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

/// Columns of all joints side by side: `wanted[c]` says what column c of the wide raw matrix is.
#[derive(Clone, Copy)]
pub(crate) enum Wanted {
    Effect { term: usize, column: usize },
    Link { parameter: usize },
    Torque,
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

    let plan: Vec<Vec<Wanted>> = (0..n).map(|j| columns_of(j, effects, pivots)).collect();
    let width: usize = plan.iter().map(Vec::len).sum();
    let history = history(effects, n, &run.signals);
    let mut raw = vec![0.0; n_samples * width];
    raw.par_chunks_mut(width * 256)
        .enumerate()
        .try_for_each(|(chunk, out)| {
            fill(robot, effects, &history, run, &plan, chunk * 256, out)
        })?;

    let blocks = sampling.kept_in_band(&raw, width);

    let mut first = 0;
    let joints = plan
        .iter()
        .map(|wanted| {
            let columns = first..first + wanted.len();
            first = columns.end;
            let rows = (0..sampling.kept.len())
                .flat_map(|k| columns.clone().map(move |c| (k, c)))
                .map(|(k, c)| blocks[c / LANES][k][c % LANES])
                .collect();
            JointRows {
                rows,
                width: wanted.len(),
            }
        })
        .collect();
    Ok(Observation {
        n_rows: sampling.kept.len(),
        joints,
    })
}

/// Columns of the effects that remember, which run once along the whole run; everything else is evaluated where it is
/// needed.
pub(crate) fn history(
    effects: &[Effect],
    n_joints: usize,
    signals: &RunSignals<'_>,
) -> Vec<Option<Vec<f64>>> {
    let all: Vec<usize> = (0..n_joints).collect();
    let remembers = |effect: &Effect| effect.entry().memory > 0;
    effects
        .par_iter()
        .map(|effect| remembers(effect).then(|| columns(effect, n_joints, signals, &all)))
        .collect()
}

/// Columns of joint `j`: effects first (they are eliminated first), then the base columns of links j and beyond, torque.
pub(crate) fn columns_of(j: usize, effects: &[Effect], pivots: &[usize]) -> Vec<Wanted> {
    let effects = effects.iter().enumerate().flat_map(|(term, effect)| {
        (0..effect.n_columns()).map(move |column| Wanted::Effect { term, column })
    });
    let links = pivots
        .iter()
        .filter(|&&parameter| parameter >= j * N_LINK_PARAMS)
        .map(|&parameter| Wanted::Link { parameter });
    effects.chain(links).chain([Wanted::Torque]).collect()
}

/// Raw rows of the samples from `start` on, as many as `out` holds.
fn fill(
    robot: &RobotModel,
    effects: &[Effect],
    history: &[Option<Vec<f64>>],
    run: &RunStates<'_>,
    plan: &[Vec<Wanted>],
    start: usize,
    out: &mut [f64],
) -> Result<(), OfflineError> {
    let n = robot.n_joints();
    let width: usize = plan.iter().map(Vec::len).sum();
    let mut workspace = Workspace::new(robot);
    let mut regressor = vec![0.0; n * n * N_LINK_PARAMS];
    let any_links = plan
        .iter()
        .flatten()
        .any(|wanted| matches!(wanted, Wanted::Link { .. }));
    let mut columns = vec![[0.0; MAX_COLUMNS]; effects.len()];
    for (k, row) in out.chunks_exact_mut(width).enumerate() {
        let at = (start + k) * n..(start + k + 1) * n;
        let input = run.signals.input(start + k, n);
        let state = &input.state;
        if any_links {
            joint_torque_regressor_into(
                robot,
                &mut workspace,
                state.q,
                state.dq,
                state.ddq,
                &mut regressor,
            )?;
        }
        let mut cell = row.iter_mut();
        for (j, wanted) in plan.iter().enumerate() {
            for ((effect, history), columns) in effects.iter().zip(history).zip(&mut columns) {
                let columns = &mut columns[..effect.n_columns()];
                match history {
                    Some(all) => {
                        let first = (at.start + j) * columns.len();
                        columns.copy_from_slice(&all[first..first + columns.len()]);
                    }
                    None => effect.columns_into(j, &input, &mut [], columns),
                }
            }
            for (wanted, cell) in wanted.iter().zip(cell.by_ref()) {
                *cell = match *wanted {
                    Wanted::Effect { term, column } => columns[term][column],
                    Wanted::Link { parameter } => regressor[j * n * N_LINK_PARAMS + parameter],
                    Wanted::Torque => run.tau[at.start + j],
                };
            }
        }
    }
    Ok(())
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
    if !run.tau.iter().all(|x| x.is_finite()) {
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
