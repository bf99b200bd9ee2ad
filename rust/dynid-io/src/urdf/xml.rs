//! Well-formed XML as a stream of tags with offsets; everything hostile about XML ends here.
//!
//! quick-xml finds the markup. It is lenient, so this walker adds what it leaves open: one root, matching ends, names,
//! quotes, duplicate attributes, entities, and limits on depth and on attributes.

use std::borrow::Cow;

use quick_xml::errors::{Error, SyntaxError};
use quick_xml::events::Event;
use quick_xml::Reader;

use super::error::UrdfError;
use super::source::{shorten, Source};
use super::tag::{self, is_name, Tag};

/// Deepest nesting that is read. urdf-rs recurses and would overflow the stack.
const MAX_DEPTH: usize = 32;
/// What the walker meets.
pub(super) enum Node<'a> {
    Open(Tag<'a>),
    Close,
    /// Character data other than white space.
    Text(Cow<'a, str>, usize),
    /// The end of a whole document.
    End,
}

/// Streams over a source.
pub(super) struct Walker<'s, 'a> {
    source: &'s Source<'a>,
    reader: Reader<&'a [u8]>,
    open: Vec<(&'a str, usize)>,
    /// A self-closing tag was returned; its end comes next.
    close_pending: bool,
    root_seen: bool,
}

impl<'s, 'a> Walker<'s, 'a> {
    pub(super) fn new(source: &'s Source<'a>) -> Self {
        let mut reader = Reader::from_str(source.text);
        let config = reader.config_mut();
        // Matched here, where the place of the opening tag is known.
        config.check_end_names = false;
        config.allow_unmatched_ends = true;
        Self {
            source,
            reader,
            open: Vec::new(),
            close_pending: false,
            root_seen: false,
        }
    }

    /// Behind what was returned last.
    pub(super) fn offset(&self) -> usize {
        usize::try_from(self.reader.buffer_position()).unwrap_or(usize::MAX)
    }

    /// The next tag, end or text.
    ///
    /// # Errors
    /// [`UrdfError::Invalid`] where the text is not well-formed XML or exceeds a limit.
    pub(super) fn next(&mut self) -> Result<Node<'a>, UrdfError> {
        if std::mem::take(&mut self.close_pending) {
            self.open.pop();
            return Ok(Node::Close);
        }
        loop {
            let start = self.offset();
            let event = match self.reader.read_event() {
                Ok(event) => event,
                Err(error) => {
                    let at = usize::try_from(self.reader.error_position()).unwrap_or(start);
                    return Err(self.source.refuse(at, "XML", not_well_formed(&error)));
                }
            };
            match event {
                Event::Start(_) => return self.open_tag(start).map(Node::Open),
                Event::Empty(_) => {
                    self.close_pending = true;
                    return self.open_tag(start).map(Node::Open);
                }
                Event::End(end) => {
                    self.close_tag(end.name().into_inner(), start)?;
                    return Ok(Node::Close);
                }
                Event::Text(text) => {
                    let text = text.into_inner();
                    let blank = text.len() - text.trim_start().len();
                    if blank < text.len() {
                        return self.text(text, start + blank);
                    }
                }
                Event::CData(text) => return self.text(text.into_inner(), start),
                Event::GeneralRef(reference) => {
                    let raw = format!("&{};", &*reference);
                    let text = tag::resolve(self.source, &raw, start, "text")?.into_owned();
                    return self.text(Cow::Owned(text), start);
                }
                Event::DocType(_) => {
                    let message =
                        "<!DOCTYPE> and its entities are not read; delete the declaration";
                    return Err(self.source.refuse(start, "<!DOCTYPE>", message));
                }
                Event::Comment(_) | Event::Decl(_) | Event::PI(_) => {}
                Event::Eof => return self.end().map(|()| Node::End),
            }
        }
    }

    fn text(&self, text: Cow<'a, str>, at: usize) -> Result<Node<'a>, UrdfError> {
        if self.open.is_empty() {
            let side = if self.root_seen {
                "after the closing tag of the root"
            } else {
                "before the root element"
            };
            let message = format!("text {side}: \"{}\"; delete it", shorten(text.trim()));
            return Err(self.source.refuse(at, "XML", message));
        }
        Ok(Node::Text(text, at))
    }

    fn end(&self) -> Result<(), UrdfError> {
        if let Some(&(name, at)) = self.open.last() {
            let message = format!(
                "opened here and never closed; the file may be cut off, or </{name}> is missing"
            );
            return Err(self.source.refuse(at, format!("<{name}>"), message));
        }
        if !self.root_seen {
            return Err(self.source.refuse(
                0,
                "file",
                "no element found, expected <robot>; the file is empty",
            ));
        }
        Ok(())
    }

    fn close_tag(&mut self, name: &str, at: usize) -> Result<(), UrdfError> {
        match self.open.pop() {
            Some((open, _)) if open == name => Ok(()),
            Some((open, open_at)) => {
                let (line, _) = self.source.position(open_at);
                let found = shorten(name);
                let message = format!(
                    "found </{found}>, expected </{open}> for the <{open}> opened on line {line}"
                );
                Err(self.source.refuse(at, format!("<{open}>"), message))
            }
            None => {
                let message = "closes an element that is not open; delete it";
                Err(self
                    .source
                    .refuse(at, format!("</{}>", shorten(name)), message))
            }
        }
    }

    /// Cuts the tag that starts at `start` out of the source: the slices keep their place.
    fn open_tag(&mut self, start: usize) -> Result<Tag<'a>, UrdfError> {
        let raw = self
            .source
            .text
            .get(start..self.offset())
            .unwrap_or_default();
        let content = raw.strip_prefix('<').unwrap_or(raw);
        let content = content.strip_suffix('>').unwrap_or(content);
        let content = if self.close_pending {
            content.strip_suffix('/').unwrap_or(content)
        } else {
            content
        };
        let name = content
            .split([' ', '\t', '\n', '\r'])
            .next()
            .unwrap_or_default();
        if !is_name(name) {
            let message = format!(
                "\"<{}\" does not start a tag; write &lt; if the character is meant",
                shorten(name)
            );
            return Err(self.source.refuse(start, "XML", message));
        }
        if self.open.is_empty() && self.root_seen {
            let message = "a second root element; a file holds one <robot>";
            return Err(self.source.refuse(start, format!("<{name}>"), message));
        }
        self.root_seen = true;
        if self.open.len() >= MAX_DEPTH {
            let message = format!(
                "nested deeper than {MAX_DEPTH} elements; a closing tag may be missing above"
            );
            return Err(self.source.refuse(start, format!("<{name}>"), message));
        }
        self.open.push((name, start));
        let attributes = tag::read(self.source, content, name, start + 1)?;
        Ok(Tag {
            name,
            at: start,
            attributes,
        })
    }
}

/// A sentence on an error of quick-xml.
fn not_well_formed(error: &Error) -> String {
    use SyntaxError::{UnclosedDoubleQuotedAttributeValue, UnclosedSingleQuotedAttributeValue};
    match error {
        Error::Syntax(UnclosedDoubleQuotedAttributeValue | UnclosedSingleQuotedAttributeValue) => {
            "a quote is not closed in the tag that starts here, or in one soon after it".to_owned()
        }
        other => format!("not well-formed: {other}"),
    }
}
