//! What can go wrong with a URDF: sentences with a place, and no type of a dependency.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

/// Why a URDF was not read.
///
/// The XML crates behind the loader stay hidden, so that updating them is not a breaking change.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum UrdfError {
    /// The file cannot be opened or read; the kind of the system's error is kept.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file that was asked for.
        path: PathBuf,
        /// The system's error, e.g. of kind `NotFound` or `PermissionDenied`.
        source: io::Error,
    },
    /// The content is refused.
    #[error("{file}:{line}:{column}: {element}: {message}")]
    Invalid {
        /// Path, or the name given to [`parse`](super::parse).
        file: String,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
        /// The element at fault, e.g. `<origin> of joint "elbow"`.
        element: String,
        /// What was expected, what was found, and the mend.
        message: String,
    },
    /// The file is well, but an option does not fit it.
    #[error("{file}: option `{option}`: {message}")]
    Option {
        /// Path, or the name given to [`parse`](super::parse).
        file: String,
        /// Field of [`UrdfOptions`](super::UrdfOptions).
        option: &'static str,
        /// What was expected, what was found, and the mend.
        message: String,
    },
    /// The file is well, and not the robot of the model.
    #[error("{file}: is another robot than the model's: {message}; give the URDF that the model was identified with")]
    OtherRobot {
        /// Path, or the name given to [`with_physical`](super::with_physical).
        file: String,
        /// The first difference.
        message: String,
    },
}
