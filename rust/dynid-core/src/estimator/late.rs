//! Torque channels that are late by themselves: their terms are those of a while ago. What is late together comes from the
//! states ([`crate::intake`]), so that everything else that is told of a step belongs to its time.

use crate::delay_line::{n_delay_rows, shared_and_own, DelayLine};
use crate::model::TorqueModel;
use crate::slices::{mirror_fields, rows_mut, set, Mirror};

/// The terms of the last steps. All memory is taken in `of`.
#[derive(Clone, Debug)]
pub(super) struct Late {
    /// How much later than all the channel of every joint is \[s\].
    own: Vec<f64>,
    line: DelayLine,
}

impl Late {
    /// Of a model whose states are known `lead` \[s\] (zero or negative) ahead and are `step` \[s\] apart; the inner
    /// `None` where no channel is later than another, the outer one if it would ask for too much.
    pub fn of(model: &TorqueModel, lead: f64, step: f64) -> Option<Option<Self>> {
        let (_, own) = shared_and_own(model.torque_delay(), lead);
        let longest = own.iter().copied().fold(0.0, f64::max);
        if longest == 0.0 {
            return Some(None);
        }
        let n_rows = n_delay_rows(longest, step)?;
        // Every term, and the variance.
        let width = (model.n_terms() + 1) * own.len();
        let line = DelayLine::new(width, n_rows);
        Some(Some(Self { own, line }))
    }

    /// Keeps the `terms` (rows of joints) and `variance` of a state `elapsed` \[s\] after the one before, and puts in their
    /// place what the channels show; false as long as states do not reach back far enough.
    pub fn show(&mut self, terms: &mut [f64], variance: &mut [f64], elapsed: f64) -> bool {
        self.line.push([&*terms, &*variance], elapsed);
        let n = self.own.len();
        let mut reached = true;
        for (j, delay) in self.own.iter().enumerate() {
            let past = self.line.look_back(*delay);
            reached &= past.reached;
            let rows = rows_mut(terms, n).chain(rows_mut(variance, n));
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
