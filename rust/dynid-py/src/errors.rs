//! Rust errors become Python exceptions here and nowhere else.

use std::fmt::Display;
use std::io;

use dynid_core::{CoreError, EffectError};
use dynid_io::mdh::MdhError as RustMdhError;
use dynid_io::urdf::UrdfError as RustUrdfError;
use dynid_io::{CHeaderError, ModelFileError};
use dynid_offline::OfflineError;
use pyo3::create_exception;
use pyo3::exceptions::{
    PyFileExistsError, PyFileNotFoundError, PyIsADirectoryError, PyNotADirectoryError, PyOSError,
    PyPermissionError, PyValueError,
};
use pyo3::prelude::*;

create_exception!(
    dynid_rs,
    UrdfError,
    PyValueError,
    "A robot file that is broken, hostile or not a serial chain."
);
create_exception!(
    dynid_rs,
    MdhError,
    PyValueError,
    "A robot.toml that is broken, hostile or no table of modified Denavit-Hartenberg rows."
);
create_exception!(
    dynid_rs,
    FormatError,
    PyValueError,
    "A model file that is not one, or was cut or changed."
);

/// Characters of a sentence, whatever name it quotes.
const LONGEST: usize = 1000;

/// A wrong value, in a sentence.
pub fn value(message: impl Display) -> PyErr {
    PyValueError::new_err(short(&message))
}

/// A sentence without the middle of a very long one: it begins with what is wrong and ends with the mend.
fn short(message: &impl Display) -> String {
    let text = message.to_string();
    let length = text.chars().count();
    if length <= LONGEST {
        return text;
    }
    let head = text.chars().take(LONGEST / 2);
    let tail = text.chars().skip(length - LONGEST / 2);
    head.chain(" … ".chars()).chain(tail).collect()
}

pub fn core(error: CoreError) -> PyErr {
    value(error)
}

pub fn effect(error: EffectError) -> PyErr {
    value(error)
}

pub fn offline(error: OfflineError) -> PyErr {
    value(error)
}

pub fn urdf(error: RustUrdfError) -> PyErr {
    match &error {
        RustUrdfError::Io { path, source } => os_error(source, &path.display().to_string()),
        _ => UrdfError::new_err(short(&error)),
    }
}

pub fn mdh(error: RustMdhError) -> PyErr {
    match &error {
        RustMdhError::Io { path, source } => os_error(source, &path.display().to_string()),
        _ => MdhError::new_err(short(&error)),
    }
}

pub fn c_header(error: CHeaderError) -> PyErr {
    value(error)
}

pub fn model_file(error: ModelFileError) -> PyErr {
    match &error {
        ModelFileError::Io { path, source } => os_error(source, path),
        ModelFileError::Invalid { .. } => FormatError::new_err(short(&error)),
    }
}

/// `OSError(errno, text, path)` picks `FileNotFoundError`, `PermissionError` and so on by itself; our own have no number.
fn os_error(source: &io::Error, path: &str) -> PyErr {
    match source.raw_os_error() {
        Some(code) => {
            let text = source.to_string();
            let text = text
                .split(" (os error")
                .next()
                .unwrap_or_default()
                .to_owned();
            PyOSError::new_err((code, text, path.to_owned()))
        }
        None => {
            let text = format!("{path}: {source}");
            match source.kind() {
                io::ErrorKind::AlreadyExists => PyFileExistsError::new_err(text),
                io::ErrorKind::IsADirectory => PyIsADirectoryError::new_err(text),
                io::ErrorKind::NotFound => PyFileNotFoundError::new_err(text),
                io::ErrorKind::NotADirectory => PyNotADirectoryError::new_err(text),
                io::ErrorKind::PermissionDenied => PyPermissionError::new_err(text),
                _ => PyOSError::new_err(text),
            }
        }
    }
}
