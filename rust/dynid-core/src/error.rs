//! What can go wrong in the core. `Copy`, so that reporting never allocates.

use core::fmt;

use crate::effects::{Entry, CATALOGUE};

/// A caller's mistake or an unusable number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CoreError {
    /// A slice has the wrong length.
    Length {
        /// What the slice is, e.g. `"dq"`.
        what: &'static str,
        /// Length that was needed.
        expected: usize,
        /// Length that came.
        actual: usize,
    },
    /// No joint, or too many.
    JointCount {
        /// Joints that came.
        count: usize,
    },
    /// A parameter of the robot or of the model is NaN or infinite.
    NonFiniteParameter,
    /// A joint's axis is not of unit length, or its frame is not a rotation.
    Geometry {
        /// Index along the chain.
        joint: usize,
    },
    /// A mixture component's input covariance is not positive definite, or a weight is not positive.
    Mixture {
        /// Index of the component.
        component: usize,
    },
    /// A parameter is outside its range.
    Range {
        /// Which parameter.
        what: &'static str,
    },
    /// A parameter is larger than anything on an arm, [`MOST`](crate::model::MOST).
    TooLarge {
        /// Which parameter.
        what: &'static str,
    },
    /// A shape parameter of an effect is outside its range.
    Shape {
        /// Kind of the effect.
        kind: &'static str,
        /// Which parameter.
        what: &'static str,
        /// Index along the chain.
        joint: usize,
        /// What it must be, as the end of a sentence.
        rule: &'static str,
    },
    /// A regression of the third loop has another number of inputs than there are signals to feed them.
    ResidualInputs {
        /// Index along the chain.
        joint: usize,
        /// Inputs that it has.
        actual: usize,
        /// Signals that there are.
        expected: usize,
    },
    /// A signal is named of a joint that the chain does not have.
    SignalJoint {
        /// Joint whose torque is meant.
        joint: usize,
        /// Joint that the signal is of.
        other: usize,
    },
    /// An effect remembers in time, and the model has no sample step.
    NoStep {
        /// Kind of the effect.
        kind: &'static str,
    },
}

impl fmt::Display for CoreError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Length { what, expected, actual } => {
                write!(f, "{what} has {actual} values, expected {expected}")
            }
            Self::JointCount { count } => {
                write!(f, "the chain has {count} moving joints, expected 1 to {}", crate::robot::MAX_JOINTS)
            }
            Self::NonFiniteParameter => write!(f, "a parameter is NaN or infinite"),
            Self::Geometry { joint } => {
                write!(f, "joint {joint}: the axis is not a unit vector or the frame is not a rotation")
            }
            Self::Mixture { component } => write!(
                f,
                "mixture component {component}: the weight must be positive and the covariance positive definite"
            ),
            Self::Range { what } => write!(f, "{what} is outside its range"),
            Self::TooLarge { what } => {
                write!(f, "{what} of the model is beyond 1e9, more than any arm holds")
            }
            Self::Shape { kind, what, joint, rule } => {
                write!(f, "{kind}: {what} of joint {joint} {rule}")
            }
            Self::ResidualInputs { joint, actual, expected } => {
                write!(f, "the residual of joint {joint} has {actual} inputs, expected {expected}")
            }
            Self::SignalJoint { joint, other } => {
                write!(f, "the residual of joint {joint} names a signal of joint {other}, which the chain does not have")
            }
            Self::NoStep { kind } => {
                write!(f, "{kind} changes with time: the model needs the step between samples in seconds")
            }
        }
    }
}

impl core::error::Error for CoreError {}

/// Why there is no such [`Effect`](crate::Effect). Only construction meets it, so it may allocate.
#[derive(Clone, Debug)]
pub enum EffectError {
    /// No kind of this name.
    Kind(String),
    /// The shape parameters are not those of the kind.
    Names {
        /// The kind.
        entry: &'static Entry,
        /// Names that came, separated by commas.
        given: String,
    },
    /// A shape parameter does not have one value per joint.
    Lengths {
        /// The kind.
        entry: &'static Entry,
        /// Which parameter.
        what: &'static str,
        /// Values that came.
        actual: usize,
        /// Values of the first parameter.
        expected: usize,
    },
    /// A value is out of its range.
    Core(CoreError),
}

impl fmt::Display for EffectError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Kind(kind) => {
                let kinds: Vec<&str> = CATALOGUE.iter().map(|entry| entry.kind).collect();
                write!(
                    f,
                    "there is no effect {kind:?}, expected one of {}",
                    kinds.join(", ")
                )
            }
            Self::Names { entry, given } => {
                let wanted: Vec<&str> = entry.shape.iter().map(|shape| shape.name).collect();
                let named = |names: &str| {
                    if names.is_empty() {
                        "none".to_owned()
                    } else {
                        names.to_owned()
                    }
                };
                write!(
                    f,
                    "{}: the shape parameters are {}, found {}",
                    entry.kind,
                    named(&wanted.join(", ")),
                    named(given)
                )
            }
            Self::Lengths {
                entry,
                what,
                actual: 0,
                ..
            } => {
                write!(
                    f,
                    "{}: {what} has no values, expected one per joint",
                    entry.kind
                )
            }
            Self::Lengths {
                entry,
                what,
                actual,
                expected,
            } => write!(
                f,
                "{}: {what} has {actual} values, {} has {expected}; expected one per joint",
                entry.kind, entry.shape[0].name
            ),
            Self::Core(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for EffectError {}

impl From<CoreError> for EffectError {
    fn from(error: CoreError) -> Self {
        Self::Core(error)
    }
}
