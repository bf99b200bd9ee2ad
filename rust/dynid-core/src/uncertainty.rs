//! How far off the observer is where nothing pushes the arm, from state to state.
//!
//! What the observer says of an arm that nothing touches has two sources. What the model leaves depends on whether a joint
//! moves, stands, or has just begun, stopped or turned, and grows with the torque (a gain that is not quite right); healthy
//! runs say how much. And parameters are known as well as the training runs could tell: with their covariance C, the torque
//! of joint j at the columns y of this state is off by
//!
//! ```text
//! y C y' = sum over k of (y d_k)^2,        C = D D',  D = [d_1 .. d_m]
//! ```
//!
//! which is small where the arm was trained and grows outside. D is found before the loop; each d_k is a set of
//! parameters, so `y d_k` is a torque like any other. The observer forgets with its time constant T, and with it what it saw
//! in the states before: the variance is that of this state or what is left of the one before, whichever is larger,
//!
//! ```text
//! s^2 = max(variance now, exp(-2 dt / T) s^2 before)
//! ```
//!
//! How often per hour `|r| / s` of a joint passes k on healthy runs falls with k^2, as that of a normal process does: `per_hour exp(-(k^2 - level) / growth)` (peaks over a threshold; A. C. Davison and R. L. Smith, J. R. Stat.
//! Soc. B 52, 1990). `growth` would be 2 for a normal one; it is found, because what a model leaves is none. Of n joints each may pass its k an n-th of what is put up with.

use std::sync::Arc;

use crate::dynamics::{check_length, inverse_dynamics_into, Workspace};
use crate::effects::{EffectInput, TAU_MOTOR};
use crate::error::CoreError;
use crate::estimator::TorqueEstimator;
use crate::link_params::N_LINK_PARAMS;
use crate::model::TorqueModel;
use crate::slices::{at, mirror_fields, rows, rows_mut, set, tail, Mirror};

/// More directions than this are refused: a step would take long.
pub const MOST_DIRECTIONS: usize = 64;

/// Numbers beyond this are an overflow, or would make one.
const MOST: f64 = 1e100;

/// A joint counts as having just begun, stopped or turned for so many time constants of the observer.
const TURN_MEMORY: f64 = 3.0;

/// A set of parameters by which the model may be off.
#[derive(Clone, Debug, PartialEq)]
pub struct Direction {
    /// Ten numbers per link, in the model's units.
    pub phi: Vec<f64>,
    /// Of every effect of the model, its coefficients, row-major by joint.
    pub effects: Vec<Vec<f64>>,
}

/// What a joint does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Doing {
    /// It moves.
    Moving,
    /// It stands.
    Standing,
    /// It has just begun to move, stopped, or turned.
    Turning,
}

/// How often a joint passes a multiple of its deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tail {
    /// k^2 that is passed:
    pub level: f64,
    /// so often per hour.
    pub per_hour: f64,
    /// k^2 has to grow by this for that to be e times less.
    pub growth: f64,
}

impl Tail {
    fn check(&self) -> Result<(), CoreError> {
        if !(self.level >= 0.0 && self.level < MOST) {
            return Err(CoreError::Range { what: "level" });
        }
        for (what, x) in [("per_hour", self.per_hour), ("growth", self.growth)] {
            if !(x > 0.0 && x < MOST) {
                return Err(CoreError::Range { what });
            }
        }
        Ok(())
    }

    /// k that is passed as often per hour.
    #[must_use]
    pub fn factor(&self, per_hour: f64) -> f64 {
        (self.level + self.growth * (self.per_hour / per_hour).ln())
            .max(1.0)
            .sqrt()
    }
}

/// How far off the observer of one arm is. Facts only.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncertainty {
    /// Variance of what the observer says \[torque unit²\] of a joint that moves.
    pub moving: Vec<f64>,
    /// Of one that stands.
    pub standing: Vec<f64>,
    /// Of one that has just begun, stopped or turned.
    pub turning: Vec<f64>,
    /// What is added to it per square of the predicted torque.
    pub torque: Vec<f64>,
    /// Joints that stood, and that turned, so often in healthy runs that static friction needs no room of its own there.
    pub stops_known: Vec<bool>,
    /// See `stops_known`.
    pub turns_known: Vec<bool>,
    /// Columns of D.
    pub directions: Vec<Direction>,
    /// From which thresholds follow, one per joint.
    pub tails: Vec<Tail>,
}

impl Uncertainty {
    /// # Errors
    /// [`CoreError`] if lengths are not those of `model`, or a number is out of its range.
    pub fn check(&self, model: &TorqueModel) -> Result<(), CoreError> {
        let n = model.robot().n_joints();
        let variances = [
            ("moving", &self.moving),
            ("standing", &self.standing),
            ("turning", &self.turning),
            ("torque", &self.torque),
        ];
        for (what, values) in variances {
            check_length(what, values, n)?;
            let least = if what == "torque" {
                0.0
            } else {
                f64::MIN_POSITIVE
            };
            if !values.iter().all(|x| *x >= least && *x < MOST) {
                return Err(CoreError::Range { what });
            }
        }
        let known = [
            ("stops_known", &self.stops_known),
            ("turns_known", &self.turns_known),
        ];
        for (what, values) in known {
            if values.len() != n {
                return Err(CoreError::Length {
                    what,
                    expected: n,
                    actual: values.len(),
                });
            }
        }
        if self.directions.len() > MOST_DIRECTIONS {
            return Err(CoreError::Range {
                what: "the number of directions",
            });
        }
        for direction in &self.directions {
            check_length("phi", &direction.phi, N_LINK_PARAMS * n)?;
            if direction.effects.len() != model.effects().len() {
                return Err(CoreError::Length {
                    what: "effects",
                    expected: model.effects().len(),
                    actual: direction.effects.len(),
                });
            }
            for (own, term) in direction.effects.iter().zip(model.effects()) {
                check_length("coefficients", own, term.coefficients().len())?;
            }
            let mut numbers = direction
                .phi
                .iter()
                .chain(direction.effects.iter().flatten());
            // Written so that a NaN is none.
            if !numbers.all(|x| x.abs() < MOST) {
                return Err(CoreError::Range {
                    what: "a direction",
                });
            }
        }
        if self.tails.len() != n {
            return Err(CoreError::Length {
                what: "tails",
                expected: n,
                actual: self.tails.len(),
            });
        }
        self.tails.iter().try_for_each(Tail::check)
    }

    /// k of every joint, for so many false contacts per hour of all joints together.
    #[must_use]
    pub fn factors(&self, per_hour: f64) -> Vec<f64> {
        let share = per_hour / self.tails.len().max(1) as f64;
        self.tails.iter().map(|tail| tail.factor(share)).collect()
    }
}

/// The deviation at the states of one arm. All memory is taken in `new`.
#[derive(Clone, Debug)]
pub(crate) struct Deviation {
    of: Arc<Uncertainty>,
    /// One for each direction, which keeps its parameters.
    workspaces: Vec<Workspace>,
    /// Columns of every effect, row-major by joint; zeros of those that count as known.
    columns: Vec<f64>,
    /// Of one direction.
    torque: Vec<f64>,
    zeros: Vec<f64>,
    since_fast: Vec<f64>,
    doing: Vec<Doing>,
    /// What parameters that are not known well add.
    of_parameters: Vec<f64>,
    variance: Vec<f64>,
}

impl Deviation {
    /// # Errors
    /// [`CoreError`] if it is not of this model.
    pub fn new(of: Arc<Uncertainty>, model: &TorqueModel) -> Result<Self, CoreError> {
        of.check(model)?;
        let n = model.robot().n_joints();
        let sizes = model.effects().iter().map(|term| term.coefficients().len());
        Ok(Self {
            workspaces: of
                .directions
                .iter()
                .map(|_| Workspace::new(model.robot()))
                .collect(),
            columns: vec![0.0; sizes.sum()],
            torque: vec![0.0; n],
            zeros: vec![0.0; n],
            since_fast: vec![f64::INFINITY; n],
            doing: vec![Doing::Standing; n],
            of_parameters: vec![0.0; n],
            variance: vec![0.0; n],
            of,
        })
    }

    /// Joints on which static friction needs room of its own now.
    pub fn may_stick(&self) -> impl Iterator<Item = bool> + '_ {
        let known = self.of.stops_known.iter().zip(&self.of.turns_known);
        let joints = self.doing.iter().zip(known);
        joints.map(|(doing, (stops, turns))| match doing {
            Doing::Moving => false,
            Doing::Standing => !stops,
            Doing::Turning => !turns,
        })
    }

    /// What every joint does.
    pub fn doing(&self) -> &[Doing] {
        &self.doing
    }

    /// Variance by the parameters at this state, n values \[torque unit²\].
    pub fn of_parameters(&self) -> &[f64] {
        &self.of_parameters
    }

    /// s^2, n values \[torque unit²\].
    pub fn variance(&self) -> &[f64] {
        &self.variance
    }

    /// Takes the state that `estimator` has answered well. `since_slow`: time since each joint was slower than `slow` says,
    /// this sample included.
    pub fn step(
        &mut self,
        model: &TorqueModel,
        estimator: &TorqueEstimator,
        slow: &[[f64; 2]],
        since_slow: &[f64],
        elapsed: f64,
        time_constant: f64,
    ) -> Result<(), CoreError> {
        self.look_at_parameters(model, estimator)?;
        let state = estimator.true_state();
        let n = self.variance.len();
        let keep = (-2.0 * elapsed / time_constant).exp();
        let memory = TURN_MEMORY * time_constant;
        let speeds = state.dq_motor.iter().zip(slow).zip(since_slow);
        let joints = self.since_fast.iter_mut().zip(&mut self.doing);
        for (j, (((dq, [_, slow]), since_slow), (since_fast, doing))) in
            speeds.zip(joints).enumerate()
        {
            *since_fast = if dq.abs() > *slow {
                0.0
            } else {
                *since_fast + elapsed
            };
            *doing = if *since_slow >= memory {
                Doing::Moving
            } else if *since_fast >= memory {
                Doing::Standing
            } else {
                Doing::Turning
            };
            let usual = match doing {
                Doing::Moving => at(&self.of.moving, j),
                Doing::Standing => at(&self.of.standing, j),
                Doing::Turning => at(&self.of.turning, j),
            };
            let torque: f64 = rows(estimator.terms(), n).map(|term| at(term, j)).sum();
            let of_torque = at(&self.of.torque, j) * torque * torque;
            let now = usual + of_torque + at(&self.of_parameters, j);
            let next = now.max(keep * at(&self.variance, j));
            // An overflow is no deviation: nothing would ever pass it, and it would be remembered.
            set(&mut self.variance, j, next.min(MOST));
        }
        Ok(())
    }

    /// Effects that remember, and those of the motor's torque, count as known, and so does what follows the load.
    fn look_at_parameters(
        &mut self,
        model: &TorqueModel,
        estimator: &TorqueEstimator,
    ) -> Result<(), CoreError> {
        self.of_parameters.fill(0.0);
        if self.of.directions.is_empty() {
            return Ok(());
        }
        let state = estimator.true_state();
        let input = EffectInput {
            state,
            tau_link: &self.zeros,
            tau_motor: &self.zeros,
            step: estimator.step(),
            sign: None,
        };
        let n = self.zeros.len();
        let mut rest = &mut self.columns[..];
        for term in model.effects() {
            let effect = term.effect();
            let whole = core::mem::take(&mut rest);
            let Some((own, others)) = whole.split_at_mut_checked(n * effect.n_columns()) else {
                break;
            };
            rest = others;
            if effect.memory_len(n) > 0 || effect.entry().needs(TAU_MOTOR) {
                continue;
            }
            for (j, columns) in rows_mut(own, effect.n_columns()).enumerate() {
                effect.columns_into(j, &input, &mut [], columns);
            }
        }
        for (direction, workspace) in self.of.directions.iter().zip(&mut self.workspaces) {
            let torque = &mut self.torque;
            let robot = model.robot();
            let (q, dq, ddq, phi) = (state.q, state.dq, state.ddq, &direction.phi);
            inverse_dynamics_into(robot, workspace, q, dq, ddq, phi, torque)?;
            for (torque, scale) in torque.iter_mut().zip(model.torque_scale()) {
                *torque *= scale;
            }
            let mut rest = &self.columns[..];
            for (own, term) in direction.effects.iter().zip(model.effects()) {
                let width = term.effect().n_columns();
                let joints = rows(rest, width).zip(rows(own, width));
                for (torque, (columns, own)) in torque.iter_mut().zip(joints) {
                    *torque += dot(columns, own);
                }
                rest = tail(rest, own.len());
            }
            for (sum, torque) in self.of_parameters.iter_mut().zip(torque.iter()) {
                *sum += torque * torque;
            }
        }
        Ok(())
    }
}

/// Of as many values as both have.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Mirror for Deviation {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(
            self, of;
            columns, torque, zeros, since_fast, doing, of_parameters, variance;
            copied;
            kept of, workspaces
        );
    }
}
