//! Why a call did not do what it was asked: a code, and a sentence that waits for the thread that asked.

use core::cell::RefCell;
use core::ffi::c_char;
use core::fmt::{self, Write};

use dynid_core::CoreError;
use dynid_io::ModelFileError;

/// What a call came to.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DynidCode {
    /// Done.
    Ok = 0,
    /// A pointer is null, or does not point to where such a value can be.
    Pointer = 1,
    /// A length is not the one that is needed.
    Length = 2,
    /// A number is outside its range.
    Range = 3,
    /// The file could not be read.
    File = 4,
    /// What was read is not a model.
    Model = 5,
    /// A fault of this library; please report it. The handle may be reset or freed, and nothing was written.
    Internal = 6,
}

/// Why, before it is words. Of a step it is `Copy` inside, so that reporting allocates nothing.
#[derive(Debug)]
pub(crate) enum Failure {
    /// A pointer is null.
    Null(&'static str),
    /// A pointer is not aligned.
    Unaligned(&'static str),
    /// Some of three signals that come together are null.
    Partial,
    /// A length does not fit.
    Length {
        what: &'static str,
        expected: usize,
        actual: usize,
    },
    /// There is no such joint or term.
    Index {
        what: &'static str,
        index: usize,
        count: usize,
    },
    /// The core refused.
    Core(CoreError),
    /// The model file was refused.
    File(ModelFileError),
    /// A path is not text.
    #[cfg(not(unix))]
    Path,
    /// A panic was caught.
    Panic,
}

impl Failure {
    pub(crate) fn code(&self) -> DynidCode {
        match self {
            Self::Null(_) | Self::Unaligned(_) | Self::Partial => DynidCode::Pointer,
            Self::Length { .. } | Self::Core(CoreError::Length { .. }) => DynidCode::Length,
            Self::Core(_) | Self::Index { .. } => DynidCode::Range,
            Self::File(ModelFileError::Io { .. }) => DynidCode::File,
            #[cfg(not(unix))]
            Self::Path => DynidCode::File,
            Self::File(ModelFileError::Invalid { .. }) => DynidCode::Model,
            Self::Panic => DynidCode::Internal,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Null(what) => write!(f, "{what} is NULL"),
            Self::Unaligned(what) => write!(f, "{what} is not aligned as its type needs"),
            Self::Partial => f.write_str(
                "q_motor, dq_motor and ddq_motor come together: give all three, or NULL for all",
            ),
            Self::Length {
                what,
                expected,
                actual,
            } => write!(f, "{what} is {actual}, the model needs {expected}"),
            Self::Index { what, index, count } => write!(
                f,
                "there is no {what} {index}, the model has {count}, counted from 0"
            ),
            Self::Core(error) => error.fmt(f),
            Self::File(error) => error.fmt(f),
            #[cfg(not(unix))]
            Self::Path => f.write_str("the path is not UTF-8 text"),
            Self::Panic => {
                f.write_str("a fault inside libdynid was stopped at its boundary; please report it")
            }
        }
    }
}

const SENTENCE_BYTES: usize = 1024;

/// A sentence in a place that is always there. Zero-terminated, cut at a character where it is too long.
struct Sentence {
    bytes: [u8; SENTENCE_BYTES],
    length: usize,
}

impl Write for Sentence {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for character in text.chars() {
            // A zero would end the sentence early.
            let character = if character == '\0' { '?' } else { character };
            let room = SENTENCE_BYTES - 1 - self.length;
            if character.len_utf8() > room {
                return Err(fmt::Error);
            }
            let end = self.length + character.len_utf8();
            character.encode_utf8(&mut self.bytes[self.length..end]);
            self.length = end;
        }
        Ok(())
    }
}

thread_local! {
    // `const`, and nothing to drop: reading and writing it neither allocates nor fails at the thread's end.
    static LAST: RefCell<Sentence> = const {
        RefCell::new(Sentence { bytes: [0; SENTENCE_BYTES], length: 0 })
    };
}

/// Keeps the sentence of `failure` for [`dynid_last_error`].
pub(crate) fn remember(failure: &Failure) {
    LAST.with_borrow_mut(|last| {
        last.length = 0;
        // The only error is that it was too long, and then the front of it is there.
        let _ = write!(last, "{failure}");
        last.bytes[last.length] = 0;
    });
}

/// One sentence on why the last call on this thread that failed did so; empty if none has. Zero-terminated UTF-8 that
/// stays until the next call on this thread fails, or the thread ends. A call that works leaves it as it is.
#[no_mangle]
pub extern "C" fn dynid_last_error() -> *const c_char {
    LAST.with_borrow(|last| last.bytes.as_ptr().cast())
}

/// Version of this library, as "0.1.0".
#[no_mangle]
pub extern "C" fn dynid_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_sentence_is_cut_at_a_character_and_still_ends() {
        let message = format!("{}\u{e9}\u{0}", "ä".repeat(SENTENCE_BYTES));
        let path = "p".to_owned();
        remember(&Failure::File(ModelFileError::Invalid { path, message }));
        LAST.with_borrow(|last| {
            assert!(last.length >= SENTENCE_BYTES - 2);
            assert_eq!(last.bytes[last.length], 0);
            let text = core::str::from_utf8(&last.bytes[..last.length]);
            assert!(text.is_ok_and(|text| text.starts_with("p: ää")));
        });
        remember(&Failure::Null("q"));
        LAST.with_borrow(|last| assert_eq!(&last.bytes[..10], b"q is NULL\0"));
    }
}
