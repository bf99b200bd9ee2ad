//! Torque channels that are late by themselves: their terms are those of a while ago, and so is the momentum that an observer
//! holds against them. What is late together comes from the states ([`crate::intake`]), so that everything else that is told
//! of a step belongs to its time.

use crate::delay_line::{n_delay_rows, shared_and_own, DelayLine};
use crate::model::TorqueModel;
use crate::slices::{mirror_fields, rows_mut, set, Mirror};

/// What the last steps made of their states, joint by joint. All memory is taken in `of`.
#[derive(Clone, Debug)]
pub(crate) struct Late {
    /// How much later than all the channel of every joint is \[s\].
    own: Vec<f64>,
    line: DelayLine,
}

impl Late {
    /// [`Self::of`] every term of a model, and the variance.
    pub fn of_terms(model: &TorqueModel, lead: f64, step: f64) -> Option<Option<Self>> {
        Self::of(model, lead, step, model.n_terms() + 1)
    }

    /// Of a model whose states are known `lead` \[s\] (zero or negative) ahead and are `step` \[s\] apart, each of which
    /// makes `n_rows` rows of joints; the inner `None` where no channel is later than another, the outer one if it would ask
    /// for too much.
    pub fn of(model: &TorqueModel, lead: f64, step: f64, n_rows: usize) -> Option<Option<Self>> {
        let (_, own) = shared_and_own(model.torque_delay(), lead);
        Self::by(own, step, n_rows)
    }

    /// Of joints that are later by their `own` delays \[s\], as [`Self::of`].
    pub fn by(own: Vec<f64>, step: f64, n_rows: usize) -> Option<Option<Self>> {
        let longest = own.iter().copied().fold(0.0, f64::max);
        if longest == 0.0 {
            return Some(None);
        }
        let line = DelayLine::new(n_rows * own.len(), n_delay_rows(longest, step)?);
        Some(Some(Self { own, line }))
    }

    /// Keeps what a state makes (rows of joints, in two parts) `elapsed` \[s\] after the one before, and puts in its place
    /// what the channels show; false as long as states do not reach back far enough.
    pub fn show(&mut self, one: &mut [f64], other: &mut [f64], elapsed: f64) -> bool {
        self.line.push([&*one, &*other], elapsed);
        let n = self.own.len();
        let mut reached = true;
        for (j, delay) in self.own.iter().enumerate() {
            let past = self.line.look_back(*delay);
            reached &= past.reached;
            let rows = rows_mut(one, n).chain(rows_mut(other, n));
            for (k, row) in rows.enumerate() {
                set(row, j, self.line.value(past, k * n + j));
            }
        }
        reached
    }

    pub fn pass(&mut self, elapsed: f64) {
        self.line.pass(elapsed);
    }

    pub fn reset(&mut self) {
        self.line.reset();
    }

    pub fn continue_from(&mut self, before: &Self) {
        self.line.continue_from(&before.line);
    }
}

impl Mirror for Late {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(self, of; line; copied; kept own);
    }
}
