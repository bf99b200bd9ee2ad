//! How the observer listens, and what follows from it for noise alone.

use crate::error::CoreError;

/// How the observer listens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObserverSettings {
    /// T \[s\]: an external torque shows by 63 % after it.
    pub time_constant: f64,
    /// c \[s\], over which what the model leaves forgets; `None` if it is not known.
    pub correlation_time: Option<f64>,
    /// False contacts per hour that are put up with, of noise alone.
    pub false_per_hour: f64,
}

impl Default for ObserverSettings {
    fn default() -> Self {
        Self {
            time_constant: 0.02,
            correlation_time: None,
            false_per_hour: 0.01,
        }
    }
}

impl ObserverSettings {
    /// # Errors
    /// [`CoreError::Range`] naming what is not positive.
    pub fn check(&self) -> Result<(), CoreError> {
        let positive = |what, x: f64| {
            if x > 0.0 && x.is_finite() {
                Ok(())
            } else {
                Err(CoreError::Range { what })
            }
        };
        positive("time_constant", self.time_constant)?;
        positive("correlation_time", self.correlation_time.unwrap_or(1.0))?;
        positive("false_per_hour", self.false_per_hour)
    }

    /// Standard deviation of r over that of what the model leaves.
    #[must_use]
    pub fn noise_gain(&self) -> f64 {
        let t = self.time_constant;
        self.correlation_time.map_or(1.0, |c| (c / (c + t)).sqrt())
    }

    /// k: thresholds in standard deviations of r, for `n_joints` joints.
    #[must_use]
    pub fn threshold_factor(&self, n_joints: usize) -> f64 {
        let t = self.time_constant;
        let pace = (self.correlation_time.unwrap_or(t) * t).sqrt();
        let crossings = 2.0 * n_joints as f64 * 3600.0 / (std::f64::consts::TAU * pace);
        (2.0 * (crossings / self.false_per_hour).ln())
            .max(1.0)
            .sqrt()
    }
}
