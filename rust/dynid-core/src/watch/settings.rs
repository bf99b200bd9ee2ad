//! What is put up with before something is called changed.

use crate::error::CoreError;

/// Changes that have a name, and one for those that have none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Friction of a joint, in parts of what the model has at the state.
    Friction,
    /// Torque that the channel shows per torque that there is, less one: a gain or a torque constant.
    Gain,
    /// A constant torque on a joint \[torque unit\].
    Offset,
    /// A mass at the last link \[kg\], with its first moments.
    Load,
    /// More is left than before, and no name says why; the size is the deviation over the expected one, less one.
    Unknown,
}

impl Kind {
    /// In files and reports.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Friction => "friction",
            Self::Gain => "gain",
            Self::Offset => "offset",
            Self::Load => "load",
            Self::Unknown => "unknown",
        }
    }
}

/// How a model is watched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WatchSettings {
    /// Time over which what the model leaves is averaged \[s\].
    pub row: f64,
    /// Alarms per day that nothing has caused, of all changes together, that are put up with.
    pub false_per_day: f64,
    /// Change of a joint's friction that is none yet: it warms up.
    pub friction: f64,
    /// Change of a channel's gain that is none yet.
    pub gain: f64,
    /// Constant torque that is none yet, in deviations of what the model leaves.
    pub offset: f64,
    /// Mass that is none yet \[kg\].
    pub load: f64,
    /// What is left over what the model expects that is nothing unknown yet.
    pub unknown: f64,
}

impl Default for WatchSettings {
    fn default() -> Self {
        Self {
            row: 0.2,
            false_per_day: 1.0,
            friction: 0.1,
            gain: 0.05,
            offset: 2.0,
            load: 0.1,
            unknown: 1.0,
        }
    }
}

impl WatchSettings {
    /// # Errors
    /// [`CoreError::Range`] naming what is not positive.
    pub fn check(&self) -> Result<(), CoreError> {
        let all = [
            ("row", self.row),
            ("false_per_day", self.false_per_day),
            ("friction", self.friction),
            ("gain", self.gain),
            ("offset", self.offset),
            ("load", self.load),
            ("unknown", self.unknown),
        ];
        let wrong = all.into_iter().find(|(_, x)| !(*x > 0.0 && x.is_finite()));
        wrong.map_or(Ok(()), |(what, _)| Err(CoreError::Range { what }))
    }

    /// Logarithm of A: the sum of Shiryaev and Roberts passes it within n rows with a chance of at most n / A, so of
    /// `n_tests` that make `false_per_day` together each may have A rows per false alarm of its own.
    #[must_use]
    pub fn log_threshold(&self, n_tests: usize) -> f64 {
        const DAY: f64 = 86_400.0;
        (n_tests as f64 * DAY / self.row / self.false_per_day)
            .max(1.0)
            .ln()
    }
}
