//! The attributes of one tag: names, quotes, entities, duplicates.

use std::borrow::Cow;

use quick_xml::escape::unescape;
use quick_xml::events::attributes::{AttrError, Attributes};

use super::error::UrdfError;
use super::source::{shorten, unprintable, Source};

/// Attributes of one element; more is no robot.
const MAX_ATTRIBUTES: usize = 64;
/// Length of an element's or attribute's name \[bytes\].
const MAX_NAME: usize = 128;

/// One attribute, entities resolved.
pub(super) struct Attribute<'a> {
    pub(super) name: &'a str,
    pub(super) value: Cow<'a, str>,
    pub(super) at: usize,
}

/// An opening tag. One that closes itself (`<a/>`) is followed by its `Node::Close` too.
pub(super) struct Tag<'a> {
    pub(super) name: &'a str,
    pub(super) at: usize,
    pub(super) attributes: Vec<Attribute<'a>>,
}

impl<'a> Tag<'a> {
    /// The attribute of that name.
    pub(super) fn get(&self, name: &str) -> Option<&Attribute<'a>> {
        self.attributes
            .iter()
            .find(|attribute| attribute.name == name)
    }
}

/// Reads the attributes of the tag whose text between `<` and `>` is `content`.
///
/// # Errors
/// [`UrdfError::Invalid`] at the attribute that is not well-formed or stands twice.
pub(super) fn read<'a>(
    source: &Source,
    content: &'a str,
    tag: &str,
    content_at: usize,
) -> Result<Vec<Attribute<'a>>, UrdfError> {
    let element = || format!("<{tag}>");
    let mut found: Vec<Attribute<'a>> = Vec::new();
    let mut value_end = 0;
    for item in Attributes::new(content, tag.len()).with_checks(false) {
        let item = item.map_err(|error| {
            let (offset, message) = explain(&error);
            source.refuse(content_at + offset, element(), message)
        })?;
        let name = item.key.into_inner();
        let offset = offset_in(content, name);
        let at = content_at + offset;
        let refuse = |message: String| source.refuse(at, element(), message);
        if offset == value_end {
            return Err(refuse(format!(
                "a blank is missing before the attribute \"{}\"",
                shorten(name)
            )));
        }
        let (Cow::Borrowed(raw), true) = (item.value, is_name(name)) else {
            return Err(refuse(format!(
                "\"{}\" is not the name of an attribute",
                shorten(name)
            )));
        };
        if raw.contains('<') {
            return Err(refuse(format!(
                "the value of {name} runs into the next tag; a closing quote is missing"
            )));
        }
        if found.iter().any(|other| other.name == name) {
            return Err(refuse(format!(
                "the attribute {name} stands twice; keep one"
            )));
        }
        if found.len() >= MAX_ATTRIBUTES {
            return Err(refuse(format!("more than {MAX_ATTRIBUTES} attributes")));
        }
        value_end = offset_in(content, raw) + raw.len() + 1;
        let value = resolve(source, raw, at, &element())?;
        found.push(Attribute { name, value, at });
    }
    Ok(found)
}

/// Resolves the five predefined entities and character references; there are no others without a DOCTYPE.
pub(super) fn resolve<'t>(
    source: &Source,
    raw: &'t str,
    at: usize,
    element: &str,
) -> Result<Cow<'t, str>, UrdfError> {
    match unescape(raw) {
        Ok(value) => match unprintable(&value) {
            None => Ok(value),
            Some(bad) => {
                let message = format!(
                    "the character U+{:04X} may not stand in XML; delete it",
                    u32::from(bad)
                );
                Err(source.refuse(at, element, message))
            }
        },
        Err(_) => {
            let message = format!(
                "\"{}\" holds an unknown entity; only &amp; &lt; &gt; &quot; &apos; and character references are read",
                shorten(raw)
            );
            Err(source.refuse(at, element, message))
        }
    }
}

/// Where `part`, a slice of `whole`, starts in it.
fn offset_in(whole: &str, part: &str) -> usize {
    (part.as_ptr() as usize).saturating_sub(whole.as_ptr() as usize)
}

/// The name of an element or attribute.
pub(super) fn is_name(name: &str) -> bool {
    let start = |c: char| c.is_alphabetic() || c == '_' || c == ':';
    name.len() <= MAX_NAME
        && name.starts_with(start)
        && name
            .chars()
            .all(|c| start(c) || c.is_numeric() || matches!(c, '-' | '.' | '\u{B7}'))
}

/// Offset in the tag's content and a sentence.
fn explain(error: &AttrError) -> (usize, String) {
    match error {
        AttrError::ExpectedEq(at) => (
            *at,
            "an attribute is not followed by =; write name=\"value\"".to_owned(),
        ),
        AttrError::ExpectedValue(at) => (
            *at,
            "an attribute has no value; write name=\"value\"".to_owned(),
        ),
        AttrError::UnquotedValue(at) => (
            *at,
            "an attribute's value has no quotes; write name=\"value\"".to_owned(),
        ),
        AttrError::ExpectedQuote(at, quote) => (
            *at,
            format!("a closing {quote:?} is missing", quote = char::from(*quote)),
        ),
        AttrError::Duplicated(at, _) => (*at, "an attribute stands twice; keep one".to_owned()),
    }
}
