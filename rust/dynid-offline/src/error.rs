//! What can go wrong offline.

use core::fmt;

use dynid_core::CoreError;

/// A caller's mistake.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OfflineError {
    /// From the core.
    Core(CoreError),
    /// Too few samples for what was asked.
    TooFewSamples {
        /// Samples that came.
        actual: usize,
        /// Samples that are needed.
        needed: usize,
    },
    /// A matrix or vector has the wrong size.
    Shape {
        /// What it is.
        what: &'static str,
    },
    /// A number is NaN or infinite.
    NonFinite {
        /// Where.
        what: &'static str,
    },
    /// The data do not tell parameters apart.
    Dependent {
        /// Whose columns.
        what: &'static str,
    },
    /// An effect needs a signal that did not come.
    Missing {
        /// Kind of the effect.
        kind: &'static str,
        /// Signal.
        what: &'static str,
    },
}

impl fmt::Display for OfflineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Core(error) => error.fmt(f),
            Self::TooFewSamples { actual, needed } => {
                write!(
                    f,
                    "{actual} samples are too few, at least {needed} are needed"
                )
            }
            Self::Shape { what } => write!(f, "{what} has the wrong shape"),
            Self::Dependent { what } => write!(
                f,
                "the data do not tell the {what} apart; move more joints, faster, or leave columns out"
            ),
            Self::Missing { kind, what } => write!(f, "{kind} needs {what}, which was not given"),
            Self::NonFinite { what } => write!(f, "{what} holds a NaN or an infinity"),
        }
    }
}

impl std::error::Error for OfflineError {}

impl From<CoreError> for OfflineError {
    fn from(error: CoreError) -> Self {
        Self::Core(error)
    }
}
