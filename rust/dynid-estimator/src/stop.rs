//! Why the program ends before its input does.

use std::fmt;
use std::io;
use std::process::ExitCode;

use dynid_io::ModelFileError;

/// The end of the work.
#[derive(Debug)]
pub enum Stop {
    /// Wrong use, unreadable model, broken input: one sentence for stderr.
    Because(String),
    /// Whoever read the output has left; nobody to tell.
    ReaderLeft,
}

impl Stop {
    /// 2 as for every command of dynid; 141 as a shell shows a broken pipe.
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Self::Because(_) => 2,
            Self::ReaderLeft => 141,
        })
    }

    /// stdout is not there.
    pub fn no_output() -> Self {
        Self::Because(
            "stdout: it is closed, and the answer is lost; send it to another place".to_owned(),
        )
    }

    /// stdout could not be written.
    pub fn output(error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::BrokenPipe {
            Self::ReaderLeft
        } else {
            Self::Because(format!("stdout: {error}"))
        }
    }
}

/// Why a read of standard input gave nothing: somebody asked for an end, or the duration is over.
#[derive(Debug)]
pub struct EndAsked;

impl fmt::Display for EndAsked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an end was asked for")
    }
}

impl std::error::Error for EndAsked {}

impl EndAsked {
    /// Whether it is the reason of an error.
    pub fn is_behind(error: &io::Error) -> bool {
        error.get_ref().is_some_and(|reason| reason.is::<Self>())
    }
}

impl fmt::Display for Stop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Because(sentence) => f.write_str(sentence),
            Self::ReaderLeft => f.write_str("nobody reads the output"),
        }
    }
}

impl From<ModelFileError> for Stop {
    fn from(error: ModelFileError) -> Self {
        Self::Because(error.to_string())
    }
}
