//! Samples that come without derivatives: a window of them, the state of its middle, and another stream that may have begun.

use super::{direct, estimate, OnlineEstimator, Sample, TORQUE};
use crate::error::CoreError;
use crate::estimator::Status;
use crate::slices::{copy, rows_mut};
use crate::state::State;
use crate::track::Taken;

impl OnlineEstimator {
    /// Keeps a sample that may be the first ones of another stream, whose row was `before` long: once the row is believed,
    /// derivatives need not wait for a whole window again.
    pub(super) fn suspect(&mut self, sample: &Sample<'_>, before: u8) -> Result<(), CoreError> {
        let row = self.stream.suspects();
        let present = self.present(sample);
        // What is not differentiated needs no window; and a row that did not grow ends with the same state once more.
        if direct(&present) || (row == before && row > 1) {
            return Ok(());
        }
        if row == 1 {
            self.suspects.filter.reset();
        }
        if self.fill_row(sample) {
            self.go_on_suspecting(sample);
            self.suspects.take_anew(&self.row, &self.most_speed)?;
        }
        Ok(())
    }

    pub(super) fn go_on_suspecting(&mut self, sample: &Sample<'_>) {
        let present = self.present(sample);
        if present != self.suspects.present {
            self.suspects.begin(present);
        }
        self.suspects.go_on(sample, self.step);
    }

    /// Lays the channels of a sample side by side; false if one is no number, which would stay in the window.
    pub(super) fn fill_row(&mut self, sample: &Sample<'_>) -> bool {
        let n = self.tau.len();
        let finite = |signal: &[f64]| signal.iter().all(|x| x.is_finite());
        let channels = self.channels(sample);
        if !channels.iter().flatten().all(|signal| finite(signal)) {
            return false;
        }
        for (row, channel) in rows_mut(&mut self.row, n).zip(channels) {
            match channel {
                Some(channel) => copy(channel, row),
                None => row.fill(0.0),
            }
        }
        true
    }

    /// Takes a sample into the window; what keeps it from an answer.
    pub(super) fn differentiate(&mut self, sample: &Sample<'_>) -> Result<Status, CoreError> {
        if !self.fill_row(sample) {
            return Ok(Status::NON_FINITE);
        }
        let mut taken = self.track.take(&self.row, &self.most_speed)?;
        if matches!(taken, Taken::Jump | Taken::Over) {
            self.go_on_suspecting(sample);
            let other = self.suspects.take_anew(&self.row, &self.most_speed)?;
            let is_believed = taken == Taken::Over || self.suspects.is_believed();
            // Of two alone nobody knows which is wrong: the newer one begins the window again.
            if is_believed || self.track.filter.n_samples() < 2 {
                core::mem::swap(&mut self.track, &mut self.suspects);
            }
            if is_believed {
                taken = other;
                self.estimator.begin_anew();
            }
        }
        if taken != Taken::Jump {
            self.suspects.filter.reset();
        }
        Ok(match taken {
            Taken::Answer => Status::OK,
            Taken::Settling => Status::SETTLING.and(Status::REPEATED),
            Taken::Jump | Taken::Over => Status::OUTSIDE_DOMAIN.and(Status::REPEATED),
        })
    }

    /// The state of half a window before now, from the signals that came.
    pub(super) fn answer_filtered(
        &mut self,
        sample: &Sample<'_>,
        elapsed: f64,
        numbered: bool,
    ) -> Result<Status, CoreError> {
        let taken = self.differentiate(sample)?;
        if taken != Status::OK {
            self.estimator.pass(elapsed);
            return Ok(taken);
        }
        self.assemble();
        let [q, dq, ddq, q_motor, dq_motor, ddq_motor] = &self.motion;
        let state = State {
            q,
            dq,
            ddq,
            q_motor,
            dq_motor,
            ddq_motor,
            temperature: sample.temperature,
        };
        estimate(
            &mut self.estimator,
            &state,
            &mut self.tau,
            numbered.then_some(elapsed),
        )
    }

    /// Signals of one instant: those that came, smoothed; the others as derivatives of the one below them.
    pub(super) fn assemble(&mut self) {
        let n = self.tau.len();
        let fitted = self.track.filter.fitted();
        let of = |channel: usize, order: usize| {
            let start = channel * n;
            fitted
                .get(order)
                .and_then(|fitted| fitted.get(start..start + n))
        };
        let there = |signal: usize| self.track.present.get(signal) == Some(&true);
        for (signal, motion) in self.motion.iter_mut().enumerate() {
            // A motor side that has a position of its own has derivatives of its own.
            let side = if signal >= 3 && there(3) { 3 } else { 0 };
            let order = signal % 3;
            // The signal itself, or the highest one below it of its side that came.
            let source = if there(signal) {
                (signal, 0)
            } else {
                let below = (0..=order).rev().find(|below| there(side + below));
                let below = below.unwrap_or(0);
                (side + below, order - below)
            };
            if let Some(values) = of(source.0, source.1) {
                copy(values, motion);
            }
        }
        if let Some(values) = of(TORQUE, 0) {
            copy(values, &mut self.measured);
        }
    }
}
