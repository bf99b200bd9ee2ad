//! Who listens beside the torque: an observer of contacts, with what it knows, and a watch over the model.

use std::sync::Arc;

use super::OnlineEstimator;
use crate::error::CoreError;
use crate::observer::{MomentumObserver, ObserverSettings};
use crate::uncertainty::Uncertainty;
use crate::watch::{Change, Healthy, Watch, WatchSettings};

impl OnlineEstimator {
    /// The same with an observer, for samples that hold the measured torque.
    ///
    /// # Errors
    /// [`CoreError::Range`] if a setting is none.
    pub fn observing(mut self, settings: ObserverSettings) -> Result<Self, CoreError> {
        let model = self.estimator.shared_model();
        self.observer = Some(MomentumObserver::new(model, settings)?.with_step(self.step)?);
        Ok(self)
    }

    /// The same, whose observer ([`Self::observing`]) has thresholds that follow from how far off it is at each state.
    ///
    /// # Errors
    /// [`CoreError`] if `uncertainty` is not of this model.
    pub fn knowing(mut self, uncertainty: Arc<Uncertainty>) -> Result<Self, CoreError> {
        let known = self.observer.map(|own| own.with_uncertainty(uncertainty));
        self.observer = known.transpose()?;
        Ok(self)
    }

    /// The same with a watch ([`Watch::new`]), for samples that hold the measured torque.
    ///
    /// # Errors
    /// [`CoreError`] if a setting is none, a length is wrong or a value is none.
    pub fn watching(
        mut self,
        settings: WatchSettings,
        healthy: &Healthy,
    ) -> Result<Self, CoreError> {
        let model = self.estimator.shared_model();
        self.watch = Some(Watch::new(model, settings, healthy)?);
        Ok(self)
    }

    /// The watch, if there is one.
    #[must_use]
    pub fn watch(&self) -> Option<&Watch> {
        self.watch.as_ref()
    }

    /// The watch, to let it remember or recall.
    pub fn watch_mut(&mut self) -> Option<&mut Watch> {
        self.watch.as_mut()
    }

    /// What the watch named at the last step, whose status has [`Status::CHANGED`](crate::estimator::Status::CHANGED) then.
    #[must_use]
    pub fn change(&self) -> Option<&Change> {
        self.change.as_ref()
    }

    /// The observer, if there is one.
    #[must_use]
    pub fn observer(&self) -> Option<&MomentumObserver> {
        self.observer.as_ref()
    }
}
