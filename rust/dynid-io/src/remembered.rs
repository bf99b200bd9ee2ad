//! What a watch, an adaptation or both remember over a restart, as a file: numbers of
//! [`Watch::remember`](dynid_core::watch::Watch::remember), then of
//! [`Adaptation::remember`](dynid_core::Adaptation::remember), and of which model and settings they are.

use std::path::Path;

use dynid_core::{AdaptSettings, TorqueModel};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::model_file::to_text;
use crate::small_file::Kind;
use crate::whole::write_whole;
use crate::{ModelFileError, WatchFile};

/// Name in the `format` field.
pub const FORMAT: &str = "dynid-watch-remembered";
/// Newest version of the file that this reader understands: one for every order of the numbers.
pub const VERSION: u32 = 3;
/// Larger files are refused before memory is taken \[bytes\].
pub const MAX_BYTES: u64 = 4 << 20;

/// A model and how it is watched, in few bytes: what one watch remembers is of no use to another.
pub type Identity = [u8; 32];

/// What a watch remembers.
#[derive(Clone, Debug, PartialEq)]
pub struct Remembered {
    /// [`identity`] of the watch, in hexadecimal digits.
    pub of: String,
    /// As [`Watch::recall`](dynid_core::watch::Watch::recall) takes them.
    pub numbers: Vec<f64>,
}

const KIND: Kind = Kind {
    none: "not what a watch remembers",
    format: FORMAT,
    version: VERSION,
    max_bytes: MAX_BYTES,
    mend: "name another file, or remove this one to begin anew",
};

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Parts {
    format: String,
    version: u32,
    of: String,
    numbers: Vec<f64>,
}

/// Of a model and its watch.
///
/// # Errors
/// [`ModelFileError::Invalid`] if the model cannot be written as JSON.
pub fn identity(model: &TorqueModel, watch: &WatchFile) -> Result<Identity, ModelFileError> {
    identity_of(model, Some(watch), None)
}

/// Settings of an adaptation, and what healthy runs said of the noise: variance of rows over what the model expects, and rows that
/// are worth an independent one, per joint.
pub type Adapts<'a> = (&'a AdaptSettings, &'a [f64], &'a [f64]);

/// Of a model and all that learns beside it: the numbers of a watch come first, then those of an adaptation.
///
/// # Errors
/// [`ModelFileError::Invalid`] if the model cannot be written as JSON.
pub fn identity_of(
    model: &TorqueModel,
    watch: Option<&WatchFile>,
    adapts: Option<Adapts<'_>>,
) -> Result<Identity, ModelFileError> {
    let text = to_text(model).map_err(|error| ModelFileError::Invalid {
        path: "model".to_owned(),
        message: error.to_string(),
    })?;
    let mut sum = Sha256::new();
    sum.update(text.as_bytes());
    if let Some(watch) = watch {
        sum.update(format!("{:?} {:?}", watch.settings, watch.healthy).as_bytes());
    }
    if let Some((settings, inflation, memory)) = adapts {
        sum.update(format!("{settings:?} {inflation:?} {memory:?}").as_bytes());
    }
    Ok(sum.finalize().into())
}

/// As [`Remembered::of`] has it.
#[must_use]
pub fn digits_of(identity: &Identity) -> String {
    identity.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Reads the file.
///
/// # Errors
/// [`ModelFileError`], with one sentence that names the file and the mend.
pub fn load_remembered(path: &Path) -> Result<Remembered, ModelFileError> {
    KIND.load(path, read)
}

/// Reads it from bytes; `name` is used in messages.
///
/// # Errors
/// [`ModelFileError::Invalid`].
pub fn parse_remembered(bytes: &[u8], name: &str) -> Result<Remembered, ModelFileError> {
    KIND.parse(bytes, name, read)
}

fn read(bytes: &[u8]) -> Result<Remembered, String> {
    let parts: Parts = KIND.parts(bytes)?;
    Ok(Remembered {
        of: parts.of,
        numbers: parts.numbers,
    })
}

impl Remembered {
    /// The file's text.
    ///
    /// # Errors
    /// `serde_json::Error` if it cannot be written as JSON.
    pub fn to_text(&self) -> Result<String, serde_json::Error> {
        let mut text = serde_json::to_string(&Parts {
            format: FORMAT.to_owned(),
            version: VERSION,
            of: self.of.clone(),
            numbers: self.numbers.clone(),
        })?;
        text.push('\n');
        Ok(text)
    }

    /// Writes the file: to a temporary one beside it, then renamed.
    ///
    /// # Errors
    /// [`ModelFileError::Io`] if the folder cannot be written, or anything but a file is in its place.
    pub fn save(&self, path: &Path) -> Result<(), ModelFileError> {
        let text = self.to_text().map_err(|error| ModelFileError::Invalid {
            path: path.display().to_string(),
            message: error.to_string(),
        })?;
        write_whole(path, text.as_bytes()).map_err(|source| ModelFileError::Io {
            path: path.display().to_string(),
            source,
        })
    }
}
