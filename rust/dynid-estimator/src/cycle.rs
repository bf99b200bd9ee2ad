//! One cycle: a measurement in, an answer out. No allocation, no lock, no system call.

use std::sync::Arc;

use dynid_core::{CoreError, OnlineEstimator, Sample, Status, TorqueModel};

use crate::output::Answer;
use crate::stop::Stop;

/// How answers are made.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Settings {
    /// Time between measurements \[s\]; none: as the model says.
    pub step: Option<f64>,
    /// Samples that are differentiated over, where positions come alone; none: about 20 ms.
    pub window: Option<usize>,
}

/// The memory of a running estimator.
#[derive(Debug)]
pub struct Cycle {
    online: OnlineEstimator,
    std: Vec<f64>,
    status: Status,
}

impl Cycle {
    /// The last allocation.
    ///
    /// # Errors
    /// [`Stop`] if the settings do not fit.
    pub fn new(model: Arc<TorqueModel>, settings: &Settings) -> Result<Self, Stop> {
        let n = model.robot().n_joints();
        let online = OnlineEstimator::new(model, settings.step, settings.window)
            .map_err(|error| Stop::Because(error.to_string()))?;
        let mut cycle = Self {
            online,
            std: vec![0.0; n],
            status: Status::OK,
        };
        cycle
            .take_deviation()
            .map_err(|error| Stop::Because(error.to_string()))?;
        Ok(cycle)
    }

    /// By how much answers are late where positions come alone \[s\].
    pub fn delay(&self) -> f64 {
        self.online.delay()
    }

    /// Uses a measurement.
    ///
    /// # Errors
    /// [`CoreError`] if it is not one of this robot.
    pub fn step(&mut self, sample: &Sample<'_>) -> Result<(), CoreError> {
        self.status = self.online.step(sample)?;
        self.take_deviation()
    }

    fn take_deviation(&mut self) -> Result<(), CoreError> {
        self.online.estimator().predicted_std_into(&mut self.std)
    }

    /// What there is to say now.
    pub fn answer(&self, time: Option<f64>) -> Answer<'_> {
        Answer {
            time,
            tau: self.online.tau(),
            terms: self.online.estimator().terms(),
            std: &self.std,
            status: self.status,
        }
    }
}
