//! Effects of a step: those that are made of the motor's torque come after all others, whatever their order in the model.

use crate::effects::{motor_torque_into, EffectInput, EffectTerm};
use crate::lanes::Lanes;
use crate::slices::{rows, rows_mut};

/// Effects of a model, what they remember, and where their torques go.
pub(super) struct Terms<'a> {
    pub effects: &'a [EffectTerm],
    pub of_motor: &'a [bool],
    pub memory: &'a mut [f64],
    pub rows: &'a mut [f64],
}

impl Terms<'_> {
    /// Torque of those effects that are, or are not, of the motor's torque; the others stay as they are.
    #[inline(always)]
    pub fn evaluate<L: Lanes>(&mut self, input: &EffectInput<'_>, of_motor: bool) {
        let n = input.tau_link.len();
        let mut memory = &mut *self.memory;
        let terms = self.effects.iter().zip(self.of_motor);
        for ((term, is), row) in terms.zip(rows_mut(self.rows, n)) {
            let own;
            (own, memory) = memory
                .split_at_mut_checked(term.effect().memory_len(n))
                .unwrap_or_default();
            if *is == of_motor {
                term.torque_on::<L>(input, own, row);
            }
        }
    }

    /// Torque of the motors, of the others' torques and the rigid body's as the channel shows it.
    #[inline(always)]
    pub fn motor_torque_into(&self, scaled: &[f64], tau_motor: &mut [f64]) {
        let terms = self.effects.iter().zip(rows(self.rows, scaled.len()));
        motor_torque_into(scaled, terms, tau_motor);
    }
}
