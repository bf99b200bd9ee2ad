//! Where links and joints stand in the text, and what an export changes in them: a second pass for the places.

use std::collections::HashMap;
use std::ops::Range;

use super::error::UrdfError;
use super::source::Source;
use super::tag::Tag;
use super::xml::{Node, Walker};

/// A `<dynamics>` element.
pub(super) struct DynamicsSpan {
    /// Behind the element's name, where an attribute can be added.
    pub(super) name_end: usize,
    /// Values between their quotes, by attribute.
    pub(super) values: HashMap<String, Range<usize>>,
}

/// A `<link>` or `<joint>`.
pub(super) struct Span {
    pub(super) start: usize,
    /// Behind the opening tag.
    pub(super) open_end: usize,
    /// `<link .../>` has no end of its own.
    pub(super) self_closing: bool,
    /// Its `<inertial>` elements, from `<` to behind `>`.
    pub(super) inertials: Vec<Range<usize>>,
    pub(super) dynamics: Vec<DynamicsSpan>,
}

/// All links and joints of a file by name.
#[derive(Default)]
pub(super) struct Spans {
    pub(super) links: HashMap<String, Span>,
    pub(super) joints: HashMap<String, Span>,
}

/// Finds them.
///
/// # Errors
/// [`UrdfError::Invalid`] where the text is not well-formed.
pub(super) fn find(source: &Source) -> Result<Spans, UrdfError> {
    let mut spans = Spans::default();
    let mut walker = Walker::new(source);
    let mut path: Vec<(String, usize)> = Vec::new();
    let mut open: Option<(String, Span)> = None;
    loop {
        match walker.next()? {
            Node::Open(tag) => {
                let end = walker.offset();
                let parents: Vec<&str> = path.iter().map(|(name, _)| name.as_str()).collect();
                match (parents.as_slice(), tag.name) {
                    ([_], "link" | "joint") => {
                        let name = tag.get("name").map(|a| a.value.clone().into_owned());
                        open = name.map(|name| (name, span(source, &tag, end)));
                    }
                    ([_, "joint"], "dynamics") => {
                        if let Some((_, joint)) = &mut open {
                            joint.dynamics.push(dynamics(source, &tag));
                        }
                    }
                    _ => {}
                }
                path.push((tag.name.to_owned(), tag.at));
            }
            Node::Close => {
                let Some((name, at)) = path.pop() else {
                    continue;
                };
                match (path.len(), name.as_str()) {
                    (2, "inertial") => {
                        if let Some((_, link)) = &mut open {
                            link.inertials.push(at..walker.offset());
                        }
                    }
                    (1, "link") => spans.links.extend(open.take()),
                    (1, "joint") => spans.joints.extend(open.take()),
                    _ => {}
                }
            }
            Node::Text(..) => {}
            Node::End => return Ok(spans),
        }
    }
}

fn span(source: &Source, tag: &Tag, open_end: usize) -> Span {
    let text = source.text.get(tag.at..open_end).unwrap_or_default();
    Span {
        start: tag.at,
        open_end,
        self_closing: text.ends_with("/>"),
        inertials: Vec::new(),
        dynamics: Vec::new(),
    }
}

/// The walker has checked quotes and equal signs already.
fn dynamics(source: &Source, tag: &Tag) -> DynamicsSpan {
    let values = tag.attributes.iter().filter_map(|attribute| {
        let after = attribute.at + attribute.name.len();
        let rest = source.text.get(after..)?;
        let open = rest.find(['"', '\''])?;
        let quote = rest.get(open..)?.chars().next()?;
        let value = after + open + 1;
        let length = source.text.get(value..)?.find(quote)?;
        Some((attribute.name.to_owned(), value..value + length))
    });
    DynamicsSpan {
        name_end: tag.at + 1 + tag.name.len(),
        values: values.collect(),
    }
}
