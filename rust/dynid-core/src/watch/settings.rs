//! What is put up with before something is called changed.

use crate::dynamics::check_length;
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
    /// A torque channel that is later behind the positions than it was, by so much \[s\].
    Delay,
    /// The position that a joint's encoder shows has jumped, by so much \[rad, m\].
    Slip,
    /// More is left than before, and no name says why; the size is the deviation over the expected one, less one.
    Unknown,
    /// A torque channel shows the same value all the time, its size \[torque unit\].
    Frozen,
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
            Self::Delay => "delay",
            Self::Slip => "slip",
            Self::Unknown => "unknown",
            Self::Frozen => "frozen",
        }
    }
}

/// What runs without a change say of a model's error and of the torque channels; one value per joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Healthy {
    /// Variance of rows over what the model expects.
    pub inflation: Vec<f64>,
    /// How many rows are worth an independent one.
    pub memory: Vec<f64>,
    /// Mean speed of a row \[rad/s, m/s\] below which hardly any was: what the model leaves there is not known.
    pub least_speed: Vec<f64>,
    /// Time after which a value that a torque channel repeats is none \[s\]; infinite: never.
    pub frozen_after: Vec<f64>,
    /// How far the model's torque goes meanwhile \[torque unit\].
    pub frozen_way: Vec<f64>,
}

impl Healthy {
    /// Where no run has told: the error is what the model expects, and a frozen channel is not known.
    #[must_use]
    pub fn untold(n_joints: usize) -> Self {
        Self {
            inflation: vec![1.0; n_joints],
            memory: vec![1.0; n_joints],
            least_speed: vec![0.0; n_joints],
            frozen_after: vec![f64::INFINITY; n_joints],
            frozen_way: vec![0.0; n_joints],
        }
    }

    /// # Errors
    /// [`CoreError`] naming what has another length, or a value that is none.
    pub fn check(&self, n_joints: usize) -> Result<(), CoreError> {
        let finite = |least: f64| move |x: &f64| *x >= least && x.is_finite();
        let positive = |x: &f64| *x > 0.0 && x.is_finite();
        let all = [
            (
                "inflation",
                &self.inflation,
                self.inflation.iter().all(positive),
            ),
            ("memory", &self.memory, self.memory.iter().all(finite(1.0))),
            (
                "least_speed",
                &self.least_speed,
                self.least_speed.iter().all(|x| *x >= 0.0),
            ),
            (
                "frozen_after",
                &self.frozen_after,
                self.frozen_after.iter().all(|x| *x > 0.0),
            ),
            (
                "frozen_way",
                &self.frozen_way,
                self.frozen_way.iter().all(finite(0.0)),
            ),
        ];
        for (what, values, holds) in all {
            check_length(what, values, n_joints)?;
            if !holds {
                return Err(CoreError::Range { what });
            }
        }
        Ok(())
    }
}

/// Tests that an arm of so many joints takes: friction, gain, constant torque, error, delay, slip and repeated values
/// of each, and a load.
#[must_use]
pub(super) fn n_tests(n_joints: usize) -> usize {
    7 * n_joints + 1
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
    /// Delay of a channel that is none yet \[s\].
    pub delay: f64,
    /// Jump of a joint's position that is none yet \[rad, m\].
    pub slip: f64,
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
            delay: 0.004,
            slip: 0.005,
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
            ("delay", self.delay),
            ("slip", self.slip),
            ("unknown", self.unknown),
        ];
        let wrong = all.into_iter().find(|(_, x)| !(*x > 0.0 && x.is_finite()));
        wrong.map_or(Ok(()), |(what, _)| Err(CoreError::Range { what }))
    }

    /// A: the sum of Shiryaev and Roberts passes it within n rows with a chance of at most n / A, so of
    /// `n_tests` that make `false_per_day` together each may have A rows per false alarm of its own.
    #[must_use]
    pub fn threshold(&self, n_tests: usize) -> f64 {
        const DAY: f64 = 86_400.0;
        (n_tests as f64 * DAY / self.row / self.false_per_day).max(1.0)
    }
}
