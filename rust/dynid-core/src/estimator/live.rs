//! What a running estimator needs beside its step: another time between samples, another model, its true state.

use std::sync::Arc;

use super::{Evaluation, TorqueEstimator};
use crate::error::CoreError;
use crate::model::{check_step, TorqueModel};
use crate::slices::{copy, mirror_fields, Mirror};
use crate::state::State;

impl TorqueEstimator {
    /// Time between the last sample and the next one \[s\], from now on. Room for a late torque channel's states is
    /// that of the step it was made for: a shorter one may leave too few of them, which the status then says.
    ///
    /// # Errors
    /// [`CoreError::Range`] if `step` is not positive; the old one stays then.
    pub fn set_step(&mut self, step: f64) -> Result<(), CoreError> {
        check_step(step)?;
        self.own.step = step;
        Ok(())
    }

    /// Time that is counted from one sample to the next \[s\]; zero where neither the model nor the caller gave one.
    #[must_use]
    pub fn step(&self) -> f64 {
        self.own.step
    }

    /// `elapsed` seconds went by, and brought no state that could be used: what a late torque channel shows goes on all the
    /// same.
    pub fn pass(&mut self, elapsed: f64) {
        self.intake.pass(elapsed);
        if let Some(late) = &mut self.late {
            late.pass(elapsed);
        }
    }

    /// The states that come begin anew: those of before are not what a late torque channel shows. What effects remember
    /// stays.
    pub fn begin_anew(&mut self) {
        self.intake.reset();
        if let Some(late) = &mut self.late {
            late.reset();
        }
    }

    /// The model, to share.
    #[must_use]
    pub fn shared_model(&self) -> Arc<TorqueModel> {
        Arc::clone(&self.own.model)
    }

    /// Takes over what the effects of `before` remember and its last good torque, so that a new model goes on where the
    /// old one was. An effect goes on with the memory of the same effect (kind and shape) at the same count among its like;
    /// others begin with zeros. Nothing is taken over from another number of joints.
    pub fn continue_from(&mut self, before: &Self) {
        let n = self.own.model.robot().n_joints();
        self.intake.continue_from(&before.intake);
        if let (Some(own), Some(before)) = (&mut self.late, &before.late) {
            own.continue_from(before);
        }
        self.own.continue_from(&before.own, n);
    }

    /// Sum of [`Self::terms`] (n values).
    pub(crate) fn total(&self) -> &[f64] {
        &self.own.total
    }

    /// Rigid-body torque of the last step before the channel's scale (n values), as [`Self::true_state`].
    pub(crate) fn tau_link(&self) -> &[f64] {
        &self.own.tau_link
    }

    /// Squares of what [`Self::predicted_std_into`] writes (n values).
    pub(crate) fn predicted_variance(&self) -> &[f64] {
        &self.own.variance
    }

    /// The state of the last step less the encoders' error, both channels on the motor channel's clock. Not the last
    /// *good* step's: read it after a step that was good.
    #[must_use]
    pub fn true_state(&self) -> State<'_> {
        let [q, dq, ddq] = &self.own.link;
        let [q_motor, dq_motor, ddq_motor] = &self.own.motor;
        State {
            q,
            dq,
            ddq,
            q_motor,
            dq_motor,
            ddq_motor,
            temperature: None,
        }
    }
}

impl Evaluation {
    fn continue_from(&mut self, before: &Self, n: usize) {
        if before.model.robot().n_joints() != n {
            return;
        }
        copy(&before.total, &mut self.total);
        let mut at = 0;
        for (k, term) in self.model.effects().iter().enumerate() {
            let effect = term.effect();
            let len = effect.memory_len(n);
            let earlier = self.model.effects().iter().take(k);
            let count = earlier.filter(|other| other.effect() == effect).count();
            let mut from = 0;
            let mut like = before.model.effects().iter().filter_map(|other| {
                let start = from;
                from += other.effect().memory_len(n);
                (other.effect() == effect).then_some(start)
            });
            let source = like
                .nth(count)
                .and_then(|start| before.memory.get(start..start + len));
            if let (Some(memory), Some(source)) = (self.memory.get_mut(at..at + len), source) {
                copy(source, memory);
            }
            at += len;
        }
    }
}

impl Mirror for TorqueEstimator {
    fn mirror(&mut self, of: &Self) {
        if let (Some(own), Some(of)) = (&mut self.late, &of.late) {
            own.mirror(of);
        }
        mirror_fields!(self, of; intake, own; copied lead; kept late);
    }
}

impl Mirror for Evaluation {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(
            self, of;
            workspace, link, motor, rows, tau_link, tau_motor, of_motor, noise_variance, wants_temperature, memory,
            next_memory, scratch, terms, total, scratch_variance, variance;
            copied wants_any, any_of_motor, step;
            kept model
        );
    }
}
