//! What can go wrong in the core. `Copy`, so that reporting never allocates.

use core::fmt;

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
        }
    }
}

impl core::error::Error for CoreError {}
