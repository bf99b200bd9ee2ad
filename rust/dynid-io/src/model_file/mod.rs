//! `model.json`: one schema, one writer, one reader.
//!
//! The file carries a SHA-256 over all of its own bytes (its own digits counted as zeros), so a file that was cut or
//! changed anywhere is refused rather than believed.

mod effect_part;
mod residual_part;
mod schema;

use std::fs;
use std::io::{self, Read};
use std::path::Path;

use dynid_core::{Effect, RobotModel, TorqueModel};
use serde::Deserialize;
use sha2::{Digest, Sha256};

use schema::{ModelFile, RobotPart};

use crate::text::{shorten_said, shorten_to};
use crate::whole::write_whole;

/// Name in the `format` field.
pub const FORMAT: &str = "dynid-model";
/// Newest version of the schema that this reader understands; it understands all before. A file says the oldest version
/// that can hold it: 2 came with the torque channel's delay and the band in which errors are told, 3 with effects of the
/// motor's torque (`torque_saturation`), 4 with effects that end at angles (`held_from`, `held_to`), 5 with a delay of each
/// torque channel, 6 with effects whose sign has friction's sharpness.
pub const VERSION: u32 = 6;
/// Kind that files of version 3 and later hold: it was of the rigid body's torque alone before.
pub(crate) const OF_MOTOR: &str = "torque_saturation";
/// Larger files are refused before memory is taken \[bytes\].
pub const MAX_BYTES: u64 = 64 << 20;

/// Longest fault of a part in a sentence \[characters\]: names in it are the file's.
const LONGEST: usize = 400;

const CHECKSUM_PREFIX: &str = "sha256:";
const N_DIGITS: usize = 64;

/// Why a model file could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ModelFileError {
    /// The operating system refused.
    #[error("{path}: {source}")]
    Io {
        /// File.
        path: String,
        /// Reason.
        source: std::io::Error,
    },
    /// The content is not a model.
    #[error("{path}: {message}")]
    Invalid {
        /// File.
        path: String,
        /// One sentence.
        message: String,
    },
}

/// Reads a model.
///
/// # Errors
/// [`ModelFileError`], with one sentence that names the file and the mend.
pub fn load(path: &Path) -> Result<TorqueModel, ModelFileError> {
    let name = path.display().to_string();
    if path.is_dir() {
        let inside = path.join("model.json");
        let text = format!(
            "this is a folder; name the model in it, {}",
            inside.display()
        );
        return Err(ModelFileError::Io {
            path: name,
            source: io::Error::new(io::ErrorKind::IsADirectory, text),
        });
    }
    let bytes = read_at_most(path, MAX_BYTES)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(ModelFileError::Invalid {
            path: name,
            message: format!("more than {MAX_BYTES} bytes are too many for a model"),
        });
    }
    parse(&bytes, &name)
}

/// Reads a file, `most` bytes of it and one more.
///
/// # Errors
/// [`ModelFileError::Io`]; [`ModelFileError::Invalid`] of a device or a pipe, which might be waited for without end.
pub(crate) fn read_at_most(path: &Path, most: u64) -> Result<Vec<u8>, ModelFileError> {
    let io = |source| ModelFileError::Io {
        path: path.display().to_string(),
        source,
    };
    let found = fs::metadata(path).map_err(io)?;
    if !found.is_file() && !found.is_dir() {
        return Err(ModelFileError::Invalid {
            path: path.display().to_string(),
            message: "this is a device or a pipe, not a file; save it as a file first".to_owned(),
        });
    }
    let mut bytes = Vec::new();
    let file = fs::File::open(path).map_err(io)?;
    file.take(most + 1).read_to_end(&mut bytes).map_err(io)?;
    Ok(bytes)
}

/// Reads a model from bytes; `name` is used in messages.
///
/// # Errors
/// [`ModelFileError::Invalid`].
pub fn parse(bytes: &[u8], name: &str) -> Result<TorqueModel, ModelFileError> {
    let invalid = |message: String| ModelFileError::Invalid {
        path: name.to_owned(),
        message,
    };
    let text = std::str::from_utf8(bytes).map_err(|_| {
        invalid("not a text file; give the model.json that `dynid identify` wrote".into())
    })?;
    check_header(text).map_err(invalid)?;
    let file: ModelFile = serde_json::from_str(text).map_err(|e| invalid(json_message(&e)))?;
    file.check_meaning().map_err(invalid)?;
    file.into_model().map_err(|message| {
        invalid(format!(
            "{}; save the model again",
            shorten_to(&message, LONGEST)
        ))
    })
}

/// Writes a model: to a temporary file beside `path`, then renamed, so that a reader never sees half of it.
///
/// # Errors
/// [`ModelFileError::Io`] if the folder cannot be written, or anything but a file is in the place of the model.
pub fn save(model: &TorqueModel, path: &Path) -> Result<(), ModelFileError> {
    let text = to_text(model).map_err(|error| ModelFileError::Invalid {
        path: path.display().to_string(),
        message: error.to_string(),
    })?;
    write_whole(path, text.as_bytes()).map_err(|source| ModelFileError::Io {
        path: path.display().to_string(),
        source,
    })
}

/// The file's text, checksum included.
///
/// # Errors
/// `serde_json::Error` if the model cannot be written as JSON.
pub fn to_text(model: &TorqueModel) -> Result<String, serde_json::Error> {
    let blank = format!("{CHECKSUM_PREFIX}{}", "0".repeat(N_DIGITS));
    let mut effects = model.effects().iter().map(|term| term.effect());
    let delays = model.torque_delay();
    let has_sharpness = |effect: &Effect| {
        let shape = effect.shape_to_write();
        shape
            .iter()
            .any(|(name, _)| effect.entry().where_absent(name).is_some())
    };
    let version = if effects.clone().any(has_sharpness) {
        6
    } else if delays.iter().any(|delay| Some(delay) != delays.first()) {
        5
    } else if effects.clone().any(Effect::is_held) {
        4
    } else if effects.any(|effect| effect.kind() == OF_MOTOR) {
        3
    } else if delays.iter().any(|delay| *delay != 0.0) || model.band().is_some() {
        2
    } else {
        1
    };
    let file = ModelFile::from_model(model, FORMAT, version, blank.clone());
    let mut text = serde_json::to_string_pretty(&file)?;
    text.push('\n');
    let sum = format!("{CHECKSUM_PREFIX}{}", digest(&text));
    Ok(text.replacen(&blank, &sum, 1))
}

/// A robot as the text that a model file holds of it, for copies in other processes.
///
/// # Errors
/// `serde_json::Error` if the robot cannot be written as JSON.
pub fn robot_to_text(robot: &RobotModel) -> Result<String, serde_json::Error> {
    serde_json::to_string(&RobotPart::from_robot(robot))
}

/// The robot of [`robot_to_text`], to the last bit.
///
/// # Errors
/// [`ModelFileError::Invalid`]; `name` is used in messages.
pub fn robot_from_text(text: &str, name: &str) -> Result<RobotModel, ModelFileError> {
    let invalid = |message: String| ModelFileError::Invalid {
        path: name.to_owned(),
        message,
    };
    let part: RobotPart = serde_json::from_str(text).map_err(|e| invalid(json_message(&e)))?;
    part.into_robot()
        .map_err(|message| invalid(shorten_to(&message, LONGEST)))
}

fn digest(text: &str) -> String {
    Sha256::digest(text.as_bytes())
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect()
}

#[derive(Deserialize)]
struct Header {
    format: Option<String>,
    version: Option<u32>,
    checksum: Option<String>,
}

/// Format, version and checksum, before anything else is believed.
fn check_header(text: &str) -> Result<(), String> {
    let first = text.trim_start().chars().next();
    if first.is_some_and(|first| first != '{') {
        return Err(
            "not a readable model: it is no JSON object; give the model.json that `dynid identify` wrote"
                .into(),
        );
    }
    let header: Header = serde_json::from_str(text).map_err(|e| json_message(&e))?;
    if header.format.as_deref() != Some(FORMAT) {
        return Err(format!(
            "not a torque model (expected \"format\": \"{FORMAT}\"); give the model.json that `dynid identify` wrote"
        ));
    }
    match header.version {
        Some(1..=VERSION) => {}
        Some(version) if version > VERSION => {
            return Err(format!(
                "written by a newer program (version {version}, this one reads {VERSION}); update dynid-rs"
            ));
        }
        _ => return Err(format!(
            "no usable version (expected \"version\": 1 to {VERSION}); give the model.json as `dynid identify` wrote it, or identify again"
        )),
    }
    let stated = header.checksum.unwrap_or_default();
    let blank = format!("{CHECKSUM_PREFIX}{}", "0".repeat(N_DIGITS));
    if stated.len() != blank.len()
        || format!(
            "{CHECKSUM_PREFIX}{}",
            digest(&text.replacen(&stated, &blank, 1))
        ) != stated
    {
        return Err(
            "the checksum does not match: the file was cut or changed after it was written; save the model again".into(),
        );
    }
    Ok(())
}

fn json_message(error: &serde_json::Error) -> String {
    if error.is_eof() {
        format!(
            "the file ends too early (line {}); it was cut, copy or save it again",
            error.line()
        )
    } else {
        format!(
            "not a readable model: {}; save the model again",
            shorten_said(&error.to_string())
        )
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
