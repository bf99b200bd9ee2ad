//! Small JSON files of one format and version: what every reader of them asks before it looks at the content.

use serde::de::DeserializeOwned;

use crate::text::shorten_said;

/// What a file says that it is.
pub(crate) trait Stamped: DeserializeOwned {
    /// Its `format` and `version`.
    fn stamp(&self) -> (&str, u32);
}

/// A kind of file.
pub(crate) struct Kind {
    /// Half a sentence for what is none of them.
    pub none: &'static str,
    /// Name in the `format` field.
    pub format: &'static str,
    /// Version that is read.
    pub version: u32,
    /// Larger files are refused \[bytes\].
    pub max_bytes: u64,
}

impl Kind {
    /// The parts of a file of this kind.
    ///
    /// # Errors
    /// Half a sentence: it is too large, no JSON of this form, another kind, or of another version.
    pub fn parts<T: Stamped>(&self, bytes: &[u8]) -> Result<T, String> {
        let Self {
            none,
            format,
            version,
            max_bytes,
        } = self;
        if bytes.len() as u64 > *max_bytes {
            return Err(format!("more than {max_bytes} bytes are too many"));
        }
        let parts: T = serde_json::from_slice(bytes)
            .map_err(|error| format!("{none}: {}", shorten_said(&error.to_string())))?;
        let stamp = parts.stamp();
        if stamp.0 != *format {
            return Err(format!("{none} (expected \"format\": \"{format}\")"));
        }
        if stamp.1 != *version {
            let found = stamp.1;
            return Err(format!(
                "of version {found}, this program reads version {version}"
            ));
        }
        Ok(parts)
    }
}
