//! Names from model files where C can hold them: inside comments and strings, which they cannot end.

use super::CHeaderError;

/// Longer names are cut in comments.
const LONGEST_COMMENT: usize = 400;
const LONGEST_PREFIX: usize = 40;

/// `text` for a comment: whatever could end one, continue a line or mean a trigraph becomes an underscore.
pub(super) fn comment(text: &str) -> String {
    let kept = |c: char| {
        matches!(c, ' ' | 'a'..='z' | 'A'..='Z' | '0'..='9') || "_.,:;+-*()[]<>=#@".contains(c)
    };
    let text: String = text
        .chars()
        .take(LONGEST_COMMENT)
        .map(|c| if kept(c) { c } else { '_' })
        .collect();
    without_placeholder(text)
}

/// `text` as a C string literal with the same bytes, of which only letters, digits and blanks are written as they are.
pub(super) fn string(text: &str) -> String {
    let mut literal = String::from("\"");
    for byte in text.bytes() {
        // Three octal digits end by themselves, whatever follows.
        match byte {
            b' ' | b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' => literal.push(char::from(byte)),
            _ => literal.push_str(&format!("\\{byte:03o}")),
        }
    }
    literal.push('"');
    literal
}

/// The prefix's stand-in must not come out of a model file.
fn without_placeholder(text: String) -> String {
    text.replace("dynid_", "dynid-").replace("DYNID_", "DYNID-")
}

/// # Errors
/// [`CHeaderError::Prefix`] if C names cannot begin so.
pub(super) fn check_prefix(prefix: &str) -> Result<(), CHeaderError> {
    let letters = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let good = prefix.starts_with(|c: char| c.is_ascii_alphabetic())
        && prefix.chars().all(letters)
        && prefix.len() <= LONGEST_PREFIX
        // dynid.h has these names.
        && !prefix.eq_ignore_ascii_case("dynid");
    if good {
        Ok(())
    } else {
        Err(CHeaderError::Prefix(prefix.to_owned()))
    }
}

/// A prefix made of `text`, the name of a file say: what C cannot hold becomes an underscore.
#[must_use]
pub fn prefix_of(text: &str) -> String {
    let letter = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let made: String = text.chars().take(LONGEST_PREFIX).map(letter).collect();
    let made = made.trim_matches('_');
    if check_prefix(made).is_ok() {
        return made.to_owned();
    }
    let made: String = format!("model_{made}")
        .chars()
        .take(LONGEST_PREFIX)
        .collect();
    made.trim_matches('_').to_owned()
}
