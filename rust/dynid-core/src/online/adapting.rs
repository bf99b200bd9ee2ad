//! A stream whose answers follow the arm: the model's torque, and what its friction and its load have become.

use super::{OnlineEstimator, ELSEWHERE, REPEATS};
use crate::adapt::{AdaptSettings, Adaptation, Adapted};
use crate::error::CoreError;
use crate::estimator::Status;

impl OnlineEstimator {
    /// The same with an adaptation ([`Adaptation::new`]), for samples that hold the measured torque. [`Self::tau`] has what it
    /// adds; terms and deviation are the model's, and so is what a watch judges.
    ///
    /// # Errors
    /// [`CoreError`] if a setting is none or a length is wrong.
    pub fn adapting(
        mut self,
        settings: AdaptSettings,
        inflation: &[f64],
        memory: &[f64],
    ) -> Result<Self, CoreError> {
        let model = self.estimator.shared_model();
        let mut adaptation = Adaptation::new(model, settings, inflation, memory)?;
        adaptation.begin_from(&self.tau);
        self.adaptation = Some(adaptation);
        Ok(self)
    }

    /// The adaptation, if there is one.
    #[must_use]
    pub fn adaptation(&self) -> Option<&Adaptation> {
        self.adaptation.as_ref()
    }

    /// The adaptation, to reset it, or let it remember or recall.
    pub fn adaptation_mut(&mut self) -> Option<&mut Adaptation> {
        self.adaptation.as_mut()
    }

    /// What the adaptation said at the last step, whose status has [`Status::ADAPTED`] then.
    #[must_use]
    pub fn adapted(&self) -> Option<&Adapted> {
        self.adapted.as_ref()
    }

    /// Measured torque at the state of the last answer, n values, where positions come alone and both were filtered, or a
    /// channel is early and was held back; NaN before.
    #[must_use]
    pub fn measured(&self) -> &[f64] {
        &self.measured
    }

    /// What is answered: the model's torque, and with an adaptation what that adds.
    pub(super) fn correct(&mut self, answered: Status) -> Result<(), CoreError> {
        if let Some(adaptation) = &mut self.adaptation {
            if answered.only(REPEATS) == Status::OK {
                adaptation.correct(&self.estimator, &self.tau)?;
            }
        }
        Ok(())
    }

    /// Lets the adaptation learn of a measured torque, unless something pushes the arm, a sensor is stuck, or the state is none
    /// that the model was trained on.
    pub(super) fn adapt(
        &mut self,
        tau: Option<&[f64]>,
        apart: f64,
        answered: Status,
    ) -> Result<Status, CoreError> {
        let good = answered.only(ELSEWHERE.and(Status::STUCK)) == Status::OK
            && !self.standing().contains(Status::CONTACT);
        let Some(adaptation) = &mut self.adaptation else {
            return Ok(Status::OK);
        };
        let tau = tau.unwrap_or(&self.measured);
        self.adapted = adaptation.step(&self.estimator, tau, apart, good)?;
        let mut status = self.standing();
        status.set(Status::ADAPTED, self.adapted.is_some());
        Ok(status)
    }

    /// Takes off a measured torque what the adaptation adds to the model's: an observer sees the rest.
    pub(super) fn take_off_added(&mut self, shown: Option<&[f64]>) {
        let tau = shown.unwrap_or(&self.measured);
        let added = self.adaptation.as_ref().map(Adaptation::added);
        let joints = self.rest.iter_mut().zip(tau).zip(added.unwrap_or(&[]));
        for ((rest, tau), added) in joints {
            *rest = tau - added;
        }
    }
}
