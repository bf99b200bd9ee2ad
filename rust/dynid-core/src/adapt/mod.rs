//! Friction and payload that follow the arm slowly, within limits; the model itself never changes.
//!
//! Rows are those of the watch: means over a fifth of a second of what the model leaves, with the columns of a joint's own
//! friction and of a load at the last link. `squares.rs` estimates by how much each is to be added, and forgets; a joint at
//! rest, a state that the model was not trained on and a row with a contact in it say nothing, and nothing is forgotten for
//! them. What is used follows the estimate no faster than through its whole range within the memory, so that the torque never
//! jumps, and stops at the limits of [`AdaptSettings`].

mod adapted;
mod followed;
mod limits;
mod remembered;
mod settings;
mod squares;

use std::sync::Arc;

use crate::dynamics::{check_length, inverse_dynamics_into, Workspace};
use crate::error::CoreError;
use crate::estimator::TorqueEstimator;
use crate::link_params::N_LINK_PARAMS;
use crate::model::{check_step, TorqueModel};
use crate::observer::rest_speeds;
use crate::slices::{at, copy, mirror_fields, rows as rows_of, set, Mirror};
use crate::watch::rows::{friction_terms, Row, Rows};
pub use adapted::{adapted_model, Adapted, Part, Reason, N_PAYLOAD};
use followed::Followed;
pub use settings::{AdaptSettings, UNKNOWN_MEMORY};
use squares::Squares;

/// A row says no more than its limits allow and so many deviations of the noise: what is beyond is none of the arm's own.
const SPREAD: f64 = 3.0;

/// Half of what 95 % of numbers lie within, over their deviation: what is possible beforehand lies within the limits.
const WITHIN: f64 = 2.0;

/// Adapts one arm. All memory is taken in `new`.
#[derive(Clone, Debug)]
pub struct Adaptation {
    settings: AdaptSettings,
    model: Arc<TorqueModel>,
    is_friction: Vec<bool>,
    rest: Vec<f64>,
    rows: Rows,
    row: Row,
    /// Variance of a joint's rows over what the model expects, and how many are worth an independent one.
    inflation: Vec<f64>,
    memory: Vec<f64>,
    squares: Squares,
    /// Which joint's row is taken next; after the last one the limits.
    next: usize,
    per_step: usize,
    n_rows: u64,
    /// Factors less one, and a load: where the estimate stands within the limits, what is used, and what was said.
    friction: Followed,
    payload: Followed,
    /// Of the joints, then of the load.
    at_limit: Vec<bool>,
    rows_beyond: Vec<u32>,
    was_at_limit: Vec<bool>,
    put_back: Vec<bool>,
    /// Whose turn it is to be said.
    turn: usize,
    /// Torque that is added to the model's at the last good state, and the sum.
    added: Vec<f64>,
    tau: Vec<f64>,
    phi: Vec<f64>,
    workspace: Workspace,
}

impl Adaptation {
    /// `inflation` and `memory` as [`Watch::new`](crate::watch::Watch::new) takes them; ones and [`UNKNOWN_MEMORY`] where no
    /// healthy run has said them.
    ///
    /// # Errors
    /// [`CoreError`] if a setting is none, a length is wrong, the model expects no error, an inflation is not positive or a
    /// memory is less than one.
    pub fn new(
        model: Arc<TorqueModel>,
        settings: AdaptSettings,
        inflation: &[f64],
        memory: &[f64],
    ) -> Result<Self, CoreError> {
        settings.check()?;
        let n = model.robot().n_joints();
        check_length("inflation", inflation, n)?;
        check_length("memory", memory, n)?;
        let checks = [
            ("inflation", inflation.iter().all(|x| *x > 0.0)),
            ("noise_std", model.noise_std().iter().all(|x| *x > 0.0)),
            ("memory", memory.iter().all(|x| *x >= 1.0)),
        ];
        let numbers = inflation.iter().chain(memory);
        let finite = ("inflation or memory", numbers.copied().all(f64::is_finite));
        let mut all = checks.into_iter().chain([finite]);
        if let Some((what, _)) = all.find(|(_, holds)| !holds) {
            return Err(CoreError::Range { what });
        }
        let [least, most] = settings.factor;
        let range = if settings.friction { most - least } else { 0.0 };
        let friction = Followed::new(vec![range / settings.memory; n], vec![1.0; n]);
        let mass = if settings.payload { settings.mass } else { 0.0 };
        let moment = settings.reach * mass;
        let sizes = [mass, moment, moment, moment];
        let rates = sizes.map(|size| size / settings.memory).to_vec();
        let payload = Followed::new(rates, sizes.to_vec());
        let of_friction = 0.5 * range / WITHIN;
        let mut first = vec![of_friction * of_friction; if settings.friction { n } else { 0 }];
        if settings.payload {
            first.extend(sizes.map(|size| (size / WITHIN) * (size / WITHIN)));
        }
        let mut rows = Rows::new(Arc::clone(&model), settings.row, vec![0.0; n]);
        if !settings.payload {
            rows = rows.without_load();
        }
        let keep = (-settings.row / settings.memory).exp();
        Ok(Self {
            is_friction: friction_terms(&model).collect(),
            rest: rest_speeds(&model),
            rows,
            row: Row::new(n),
            inflation: inflation.to_vec(),
            memory: memory.to_vec(),
            squares: Squares::new(first, keep),
            next: n + 1,
            per_step: 1,
            n_rows: 0,
            friction,
            payload,
            at_limit: vec![false; n + 1],
            rows_beyond: vec![0; n + 1],
            was_at_limit: vec![false; n + 1],
            put_back: vec![false; n + 1],
            turn: 0,
            added: vec![0.0; n],
            tau: vec![0.0; n],
            phi: vec![0.0; N_LINK_PARAMS * n],
            workspace: Workspace::new(model.robot()),
            settings,
            model,
        })
    }

    /// Back to the model as it was identified, at once: as [`Self::new`] left it, but for what is said of it.
    pub fn reset(&mut self) {
        let n = self.tau.len();
        self.rows.clear();
        self.squares.reset();
        self.friction.reset();
        self.payload.reset();
        self.at_limit.fill(false);
        self.rows_beyond.fill(0);
        self.was_at_limit.fill(false);
        self.added.fill(0.0);
        self.put_back.fill(true);
        (self.next, self.per_step, self.turn) = (n + 1, 1, 0);
    }

    /// How it adapts.
    #[must_use]
    pub fn settings(&self) -> &AdaptSettings {
        &self.settings
    }

    /// Rows that were finished.
    #[must_use]
    pub fn n_rows(&self) -> u64 {
        self.n_rows
    }

    /// Factor on the friction of a joint that is used now, what the data say, and the deviation of that.
    #[must_use]
    pub fn factor(&self, joint: usize) -> (f64, f64, f64) {
        if !self.settings.friction || joint >= self.tau.len() {
            return (1.0, 1.0, 0.0);
        }
        let squares = &self.squares;
        let (used, estimate) = (at(&self.friction.used, joint), at(&squares.estimate, joint));
        (1.0 + used, 1.0 + estimate, squares.std(joint))
    }

    /// Mass and first moments at the last link that are used now, the mass that the data say, and its deviation.
    #[must_use]
    pub fn load(&self) -> ([f64; N_PAYLOAD], f64, f64) {
        let used = self.payload.used.first_chunk().copied().unwrap_or_default();
        if !self.settings.payload {
            return (used, 0.0, 0.0);
        }
        let k = self.n_friction();
        (used, at(&self.squares.estimate, k), self.squares.std(k))
    }

    /// True while something stands at its limit and the data lie beyond.
    #[must_use]
    pub fn is_at_limit(&self) -> bool {
        self.at_limit.contains(&true)
    }

    /// Torque that is added to the model's at the last good state, n values \[torque unit\].
    #[must_use]
    pub fn added(&self) -> &[f64] {
        &self.added
    }

    /// The model's torque and what is added, at the last good state. Finite.
    #[must_use]
    pub fn tau(&self) -> &[f64] {
        &self.tau
    }

    /// Goes on from another torque: another model is put in.
    pub(crate) fn begin_from(&mut self, tau: &[f64]) {
        copy(tau, &mut self.tau);
    }

    fn n_friction(&self) -> usize {
        if self.settings.friction {
            self.tau.len()
        } else {
            0
        }
    }

    /// Adds to `tau`, the model's torque at the state that `estimator` has just answered, what friction and load are more.
    /// Where nothing is, [`Self::tau`] is the model's to the bit.
    ///
    /// # Errors
    /// [`CoreError::Length`] if a length is wrong.
    pub fn correct(&mut self, estimator: &TorqueEstimator, tau: &[f64]) -> Result<(), CoreError> {
        check_length("tau", tau, self.tau.len())?;
        let n = self.tau.len();
        let is_loaded = self.payload.used.iter().any(|x| *x != 0.0);
        self.added.fill(0.0);
        if is_loaded {
            let first = N_LINK_PARAMS * (n - 1);
            for (k, used) in self.payload.used.iter().enumerate() {
                set(&mut self.phi, first + k, *used);
            }
            let state = estimator.true_state();
            let (q, dq, ddq) = (state.q, state.dq, state.ddq);
            let (robot, phi) = (self.model.robot(), &self.phi);
            let added = &mut self.added;
            inverse_dynamics_into(robot, &mut self.workspace, q, dq, ddq, phi, added)?;
            for (added, scale) in self.added.iter_mut().zip(self.model.torque_scale()) {
                *added *= scale;
            }
        }
        if self.friction.used.iter().any(|x| *x != 0.0) {
            // The rigid body comes first.
            let effects = rows_of(estimator.terms(), n).skip(1).zip(&self.is_friction);
            for (term, _) in effects.filter(|(_, is_friction)| **is_friction) {
                let joints = self.added.iter_mut().zip(term).zip(&self.friction.used);
                for ((added, torque), more) in joints {
                    *added += more * torque;
                }
            }
        }
        for ((sum, added), tau) in self.tau.iter_mut().zip(&mut self.added).zip(tau) {
            if !(*added + tau).is_finite() {
                *added = 0.0;
            }
            // Bits of a zero stay those of the model.
            *sum = if *added == 0.0 { *tau } else { tau + *added };
        }
        Ok(())
    }

    /// Takes the sample that `estimator` has just answered, with the torque that was measured at it (n values
    /// \[torque unit\]), `elapsed` seconds after the one before; what there is to say. Of a sample that is not `good` (not a
    /// state that the model was trained on, or one with a contact) the whole row says nothing, and nothing moves.
    ///
    /// # Errors
    /// [`CoreError`] if a length is wrong, the estimator has another number of joints, or the time is not positive.
    pub fn step(
        &mut self,
        estimator: &TorqueEstimator,
        tau: &[f64],
        elapsed: f64,
        good: bool,
    ) -> Result<Option<Adapted>, CoreError> {
        check_step(elapsed)?;
        if self.rows.is_full() {
            self.learn(usize::MAX);
            self.rows.finish(&mut self.row, false)?;
            self.per_step = (self.tau.len() + 1) / self.row.n.max(1) as usize + 1;
            self.n_rows += 1;
            self.next = 0;
        }
        self.rows.take(estimator, tau, elapsed, good)?;
        self.learn(self.per_step);
        if good {
            // After a pause the torque does not jump either.
            self.follow(estimator, elapsed.min(self.settings.row));
        }
        Ok(self.say())
    }

    /// Takes up to `most` joints of the row that have not been taken; after the last one forgets, and finds the limits.
    fn learn(&mut self, most: usize) {
        let n = self.tau.len();
        let first = self.next;
        if first > n {
            return;
        }
        self.next = first.saturating_add(most).min(n + 1);
        for j in first..self.next.min(n) {
            self.learn_of(j);
        }
        if self.next > n && self.row.moves.contains(&true) {
            self.squares.forget();
            self.limit();
        }
    }

    fn learn_of(&mut self, j: usize) {
        let row = &self.row;
        let variance = at(&row.variance, j) * at(&self.inflation, j);
        let left = at(&row.left, j);
        if row.moves.get(j) != Some(&true) || !left.is_finite() {
            return;
        }
        let mut most = SPREAD * variance.sqrt();
        let n_friction = self.n_friction();
        let column = self.squares.begin();
        if self.settings.friction {
            let [lower, upper] = self.settings.factor;
            let friction = at(&row.friction, j);
            set(column, j, friction);
            most += (1.0 - lower).max(upper - 1.0) * friction.abs();
        }
        if self.settings.payload {
            let moment = self.settings.reach * self.settings.mass;
            let sizes = [self.settings.mass, moment, moment, moment];
            let per_unit = load_columns(row, j);
            for (k, (per_unit, size)) in per_unit.into_iter().zip(sizes).enumerate() {
                set(column, n_friction + k, per_unit);
                most += per_unit.abs() * size;
            }
        }
        // No `clamp`, which may panic.
        let left = left.min(most).max(-most);
        self.squares.take(left, variance * at(&self.memory, j));
    }

    /// What is used goes a step on, where something moves.
    fn follow(&mut self, estimator: &TorqueEstimator, seconds: f64) {
        let speeds = estimator.true_state().dq_motor;
        let mut any = false;
        for (j, (dq, rest)) in speeds.iter().zip(&self.rest).enumerate() {
            if dq.abs() > *rest {
                any = true;
                if self.settings.friction {
                    self.friction.follow(j, seconds);
                }
            }
        }
        if any && self.settings.payload {
            self.payload.follow_together(seconds);
        }
    }

    /// What one joint, or the load, has to say, one after the other from step to step.
    fn say(&mut self) -> Option<Adapted> {
        let n = self.tau.len();
        let place = self.turn;
        self.turn = if place < n { place + 1 } else { 0 };
        let is_payload = place == n;
        if !(if is_payload {
            self.settings.payload
        } else {
            self.settings.friction
        }) {
            return None;
        }
        let (is, was) = (
            self.flag(place),
            self.was_at_limit.get(place) == Some(&true),
        );
        let (followed, own, one) = if is_payload {
            (&mut self.payload, 0..N_PAYLOAD, 0.0)
        } else {
            (&mut self.friction, place..place + 1, 1.0)
        };
        let from = one + at(&followed.said, own.start);
        let [moved, news] = [self.settings.said, 0.0].map(|part| followed.moved(&own, part));
        let reached = is && followed.is_there(&own);
        let is_back = std::mem::take(self.put_back.get_mut(place).unwrap_or(&mut false));
        let reason = match (reached, was) {
            _ if is_back && news => Reason::Reset,
            (true, false) => Reason::Limit,
            (false, true) if !is => Reason::Within,
            _ if moved => Reason::Followed,
            _ => return None,
        };
        followed.note(&own);
        if let Some(place) = self.was_at_limit.get_mut(place) {
            *place = reached;
        }
        Some(self.told(place, from, reason))
    }

    fn flag(&self, place: usize) -> bool {
        self.at_limit.get(place) == Some(&true)
    }

    /// What is used of a joint's friction, or of the load (`n`), as it is said.
    fn told(&self, place: usize, from: f64, reason: Reason) -> Adapted {
        let n = self.tau.len();
        if place < n {
            let (to, estimate, std) = self.factor(place);
            return Adapted {
                part: Part::Friction,
                joint: place,
                from,
                to,
                estimate,
                std,
                moments: [0.0; 3],
                reason,
            };
        }
        let ([to, x, y, z], estimate, std) = self.load();
        Adapted {
            part: Part::Payload,
            joint: n.saturating_sub(1),
            from,
            to,
            estimate,
            std,
            moments: [x, y, z],
            reason,
        }
    }
}

/// Torque of joint `j` per kg at the last link, and per kg m along each of its axes.
fn load_columns(row: &Row, j: usize) -> [f64; N_PAYLOAD] {
    let of_load = row.load.get(j).and_then(|load| load.first_chunk());
    of_load.copied().unwrap_or_default()
}

impl Mirror for Adaptation {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(
            self, of;
            rows, row, inflation, memory, squares, friction, payload, at_limit, rows_beyond, was_at_limit, put_back, added, tau, phi, workspace;
            copied settings, next, per_step, n_rows, turn;
            kept model, is_friction, rest
        );
    }
}

#[cfg(test)]
mod tests;
