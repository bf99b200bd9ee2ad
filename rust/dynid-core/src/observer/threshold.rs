//! What noise, unknown parameters and friction at rest explain at this state, and what lies beyond.

use super::MomentumObserver;
use crate::effects::EffectInput;
use crate::state::State;

/// A contact ends where every joint is below this part of its threshold.
const RELEASE: f64 = 0.5;

/// Thresholds hold static friction for so many time constants after a joint moved slowly.
const REST_MEMORY: f64 = 3.0;

impl MomentumObserver {
    /// What joints may hold that stand at this state.
    pub(super) fn sum_rest(&mut self, state: &State<'_>, tau_link: &[f64]) {
        for (holds, [torque, _]) in self.holds.iter_mut().zip(&self.at_rest) {
            *holds = *torque;
        }
        for (place, speeds) in &self.of_state {
            let Some(effect) = self.model.effects().get(*place) else {
                continue;
            };
            // Half of the step is what there is on one side: friction that grows with the load is the same on both.
            let input = EffectInput {
                state: State {
                    dq: speeds,
                    dq_motor: speeds,
                    ..*state
                },
                tau_link,
                tau_motor: &self.zeros,
                step: 0.0,
                sign: None,
            };
            effect.torque_into(&input, &mut [], &mut self.scratch);
            for (holds, own) in self.holds.iter_mut().zip(&self.scratch) {
                // Around the turn it is more here and less there; a load adds to it on both sides.
                *holds += if effect.effect().entry().needs("q") {
                    *own
                } else {
                    own.abs()
                };
            }
        }
        for holds in &mut self.holds {
            *holds = holds.abs();
        }
    }

    pub(super) fn judge(&mut self, dq_motor: &[f64], elapsed: f64) {
        let gain = self.settings.noise_gain();
        let remembered = REST_MEMORY * self.settings.time_constant;
        let joints = self.at_rest.iter().zip(&self.holds);
        let joints = joints.zip(dq_motor).zip(&mut self.since_rest);
        let outputs = self.threshold.iter_mut().zip(&mut self.rest);
        let known = self.std.iter().zip(&self.factors);
        let outputs = outputs.zip(known);
        for (((([_, speed], holds), dq), since), ((threshold, rest), (std, factor))) in
            joints.zip(outputs)
        {
            *since = if dq.abs() <= *speed {
                0.0
            } else {
                *since + elapsed
            };
            *rest = if *since < remembered { *holds } else { 0.0 };
            *threshold = factor * gain * std + *rest;
        }
    }

    /// Thresholds where the deviation at the state is known.
    pub(super) fn judge_by_state(&mut self) {
        let Some(deviation) = &self.deviation else {
            return;
        };
        let joints = deviation.variance().iter().zip(deviation.may_stick());
        let outputs = self.threshold.iter_mut().zip(&mut self.rest);
        let outputs = outputs.zip(&self.factors);
        for (((threshold, rest), factor), (variance, sticks)) in outputs.zip(joints) {
            if !sticks {
                *rest = 0.0;
            }
            *threshold = factor * variance.sqrt() + *rest;
        }
    }

    /// Is it a contact, and what may a hand guide the arm by?
    pub(super) fn decide(&mut self) {
        let level = if self.contact { RELEASE } else { 1.0 };
        let mut joints = self.external.iter().zip(&self.threshold);
        self.contact = joints.any(|(r, threshold)| r.abs() > level * threshold);
        let joints = self.external.iter().zip(&self.threshold);
        let guides = self.guide.iter_mut().zip(&self.factors);
        for ((guide, factor), (r, threshold)) in guides.zip(joints) {
            let beyond = r.abs() - threshold;
            // Written so that a NaN guides nothing.
            *guide = if beyond > 0.0 {
                (beyond * (beyond / (beyond + threshold / factor))).copysign(*r)
            } else {
                0.0
            };
        }
    }
}
