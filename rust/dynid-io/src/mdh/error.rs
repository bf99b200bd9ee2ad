//! What can go wrong with a `robot.toml`: sentences with a place, and no type of a dependency.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

/// Why a `robot.toml` was not read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MdhError {
    /// The file cannot be opened or read; the kind of the system's error is kept.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file that was asked for.
        path: PathBuf,
        /// The system's error, e.g. of kind `NotFound` or `PermissionDenied`.
        source: io::Error,
    },
    /// The content is refused.
    #[error("{file}:{line}:{column}: {place}: {message}")]
    Invalid {
        /// Path, or the name given to [`parse`](super::parse).
        file: String,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
        /// The key or table at fault, e.g. `alpha of joint "elbow"`.
        place: String,
        /// What was expected, what was found, and the mend.
        message: String,
    },
    /// The file is well, but an option does not fit it.
    #[error("{file}: option `{option}`: {message}")]
    Option {
        /// Path, or the name given to [`parse`](super::parse).
        file: String,
        /// Field of [`MdhOptions`](super::MdhOptions).
        option: &'static str,
        /// What was expected, what was found, and the mend.
        message: String,
    },
}
