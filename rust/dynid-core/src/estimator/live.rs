//! What a running estimator needs beside its step: another time between samples, another model, its true state.

use std::sync::Arc;

use super::TorqueEstimator;
use crate::error::CoreError;
use crate::model::{check_step, TorqueModel};
use crate::slices::{copy, mirror_fields, Mirror};
use crate::state::State;

impl TorqueEstimator {
    /// Time between the last sample and the next one \[s\], from now on.
    ///
    /// # Errors
    /// [`CoreError::Range`] if `step` is not positive; the old one stays then.
    pub fn set_step(&mut self, step: f64) -> Result<(), CoreError> {
        check_step(step)?;
        self.step = step;
        Ok(())
    }

    /// Time that is counted from one sample to the next \[s\]; zero where neither the model nor the caller gave one.
    #[must_use]
    pub fn step(&self) -> f64 {
        self.step
    }

    /// The model, to share.
    #[must_use]
    pub fn shared_model(&self) -> Arc<TorqueModel> {
        Arc::clone(&self.model)
    }

    /// Takes over what the effects of `before` remember and its last good torque, so that a new model goes on where the
    /// old one was. An effect goes on with the memory of the same effect (kind and shape) at the same count among its like;
    /// others begin with zeros. Nothing is taken over from another number of joints.
    pub fn continue_from(&mut self, before: &Self) {
        let n = self.model.robot().n_joints();
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

    /// The state of the last step less the encoders' error, both channels on the motor channel's clock. Not the last
    /// *good* step's: read it after a step that was good.
    #[must_use]
    pub fn true_state(&self) -> State<'_> {
        let [q, dq, ddq] = &self.link;
        let [q_motor, dq_motor, ddq_motor] = &self.motor;
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

impl Mirror for TorqueEstimator {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(
            self, of;
            workspace, link, motor, rows, tau_link, noise_variance, wants_temperature, memory, next_memory, scratch, terms,
            total, scratch_variance, variance;
            copied wants_any, step;
            kept model
        );
    }
}
