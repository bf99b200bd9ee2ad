//! Small JSON files of one format and version: how each of them is read, before anybody looks at its content.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde::Deserialize;

use crate::model_file::read_at_most;
use crate::text::shorten_said;
use crate::ModelFileError;

/// A kind of file.
pub(crate) struct Kind {
    /// Half a sentence for what is none of them.
    pub none: &'static str,
    /// Name in the `format` field.
    pub format: &'static str,
    /// Version that is read.
    pub version: u32,
    /// Larger files are refused before memory is taken \[bytes\].
    pub max_bytes: u64,
    /// What to do about one that cannot be used.
    pub mend: &'static str,
}

/// What a file says that it is. Read before the rest, which in another version has other fields.
#[derive(Deserialize)]
struct Stamp {
    format: String,
    version: u32,
}

impl Kind {
    /// Reads a file, and of its bytes what `read` makes of them.
    ///
    /// # Errors
    /// [`ModelFileError`], with one sentence that names the file and the mend.
    pub fn load<T>(
        &self,
        path: &Path,
        read: impl Fn(&[u8]) -> Result<T, String>,
    ) -> Result<T, ModelFileError> {
        let bytes = read_at_most(path, self.max_bytes)?;
        self.parse(&bytes, &path.display().to_string(), read)
    }

    /// The same of bytes; `name` is used in messages.
    ///
    /// # Errors
    /// [`ModelFileError::Invalid`], the half sentence of `read` with file and mend.
    pub fn parse<T>(
        &self,
        bytes: &[u8],
        name: &str,
        read: impl Fn(&[u8]) -> Result<T, String>,
    ) -> Result<T, ModelFileError> {
        read(bytes).map_err(|message| ModelFileError::Invalid {
            path: name.to_owned(),
            message: format!("{message}; {}", self.mend),
        })
    }

    /// The parts of a file of this kind.
    ///
    /// # Errors
    /// Half a sentence: it is too large, no JSON of this form, another kind, or of another version.
    pub fn parts<T: DeserializeOwned>(&self, bytes: &[u8]) -> Result<T, String> {
        let Self {
            none,
            format,
            version,
            max_bytes,
            ..
        } = self;
        if bytes.len() as u64 > *max_bytes {
            return Err(format!("more than {max_bytes} bytes are too many"));
        }
        let stamp: Stamp = self.json(bytes)?;
        if stamp.format != *format {
            return Err(format!("{none} (expected \"format\": \"{format}\")"));
        }
        if stamp.version != *version {
            let found = stamp.version;
            return Err(format!(
                "of version {found}, this program reads version {version}"
            ));
        }
        self.json(bytes)
    }

    fn json<T: DeserializeOwned>(&self, bytes: &[u8]) -> Result<T, String> {
        serde_json::from_slice(bytes)
            .map_err(|error| format!("{}: {}", self.none, shorten_said(&error.to_string())))
    }
}
