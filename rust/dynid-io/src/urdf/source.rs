//! The text of one file: bytes to characters, and offsets to lines and columns.

use crate::text::position;
pub(super) use crate::text::shorten;

use super::error::UrdfError;

/// Largest file that is read \[bytes\]. Robots without meshes are a thousand times smaller.
pub(super) const MAX_BYTES: usize = 16 * 1024 * 1024;
/// Notes beyond this number are only counted.
const MAX_NOTES: usize = 64;

/// Text of a file together with its name. Offsets are bytes from the start of `text`.
pub(super) struct Source<'a> {
    pub(super) file: &'a str,
    pub(super) text: &'a str,
}

impl<'a> Source<'a> {
    /// Checks size and encoding; strips a UTF-8 byte order mark.
    ///
    /// # Errors
    /// [`UrdfError::Invalid`] for more than [`MAX_BYTES`], UTF-16, bytes that are not UTF-8, and zero bytes.
    pub(super) fn decode(file: &'a str, bytes: &'a [u8]) -> Result<Self, UrdfError> {
        let whole = |text| Self { file, text };
        if bytes.len() > MAX_BYTES {
            return Err(too_large(file));
        }
        let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
        if bytes.starts_with(b"\xFF\xFE") || bytes.starts_with(b"\xFE\xFF") {
            return Err(whole("").refuse(
                0,
                "text",
                "the file is UTF-16, expected UTF-8; save it as UTF-8",
            ));
        }
        let text = match std::str::from_utf8(bytes) {
            Ok(text) => text,
            Err(error) => {
                let good = bytes.get(..error.valid_up_to()).unwrap_or_default();
                let before = std::str::from_utf8(good).unwrap_or_default();
                let message = "this byte is not UTF-8; save the file as UTF-8";
                return Err(whole(before).refuse(before.len(), "text", message));
            }
        };
        let source = whole(text);
        if let Some(at) = text.find('\0') {
            return Err(source.refuse(
                at,
                "text",
                "a zero byte may not stand in XML; the file is damaged or no text",
            ));
        }
        if text.starts_with("version https://git-lfs") {
            let message = "this is a Git LFS pointer, not the robot; fetch the file: git lfs pull";
            return Err(source.refuse(0, "text", message));
        }
        Ok(source)
    }

    /// Line and column of an offset, both from 1; columns count characters.
    pub(super) fn position(&self, at: usize) -> (usize, usize) {
        position(self.text, at)
    }

    /// The refusal of `element` at an offset.
    pub(super) fn refuse(
        &self,
        at: usize,
        element: impl Into<String>,
        message: impl Into<String>,
    ) -> UrdfError {
        let (line, column) = self.position(at);
        UrdfError::Invalid {
            file: self.file.to_owned(),
            line,
            column,
            element: element.into(),
            message: message.into(),
        }
    }
}

/// The refusal of a file beyond [`MAX_BYTES`].
pub(super) fn too_large(file: &str) -> UrdfError {
    let limit = MAX_BYTES / (1024 * 1024);
    let message =
        format!("larger than {limit} MiB; a URDF names its meshes and does not hold them");
    Source { file, text: "" }.refuse(0, "file", message)
}

/// The first character that XML 1.0 does not allow.
pub(super) fn unprintable(text: &str) -> Option<char> {
    text.chars().find(
        |c| !matches!(c, '\t' | '\n' | '\r' | ' '..='~' | '\u{A0}'..='\u{FFFD}' | '\u{10000}'..),
    )
}

/// Remarks about things that were read, but that the reader of the model should know about.
#[derive(Default)]
pub(super) struct Notes {
    list: Vec<String>,
    dropped: usize,
}

impl Notes {
    /// Adds a remark about a place in the file.
    pub(super) fn at(&mut self, source: &Source, at: usize, sentence: impl AsRef<str>) {
        if self.list.len() < MAX_NOTES {
            let (line, column) = source.position(at);
            self.list.push(format!(
                "{}:{line}:{column}: {}",
                source.file,
                sentence.as_ref()
            ));
        } else {
            self.dropped += 1;
        }
    }

    /// All remarks, in order of appearance.
    pub(super) fn into_list(mut self) -> Vec<String> {
        if self.dropped > 0 {
            self.list.push(format!("{} more notes", self.dropped));
        }
        self.list
    }
}
