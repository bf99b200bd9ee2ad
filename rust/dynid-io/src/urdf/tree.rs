//! The links as a tree: every reference resolved, one root, no loops.

use std::collections::HashMap;

use super::document::Document;
use super::error::UrdfError;
use super::source::Source;

/// A joint between two links, by their indices in the document.
#[derive(Clone, Copy)]
pub(super) struct Edge {
    pub(super) parent: usize,
    pub(super) child: usize,
}

/// The links of a document, connected.
pub(super) struct Tree<'d> {
    pub(super) document: &'d Document,
    /// Per joint.
    pub(super) edges: Vec<Edge>,
    /// Per link: the joints that hang on it, in the order of the file.
    pub(super) below: Vec<Vec<usize>>,
    /// Per link: the joint that it hangs on.
    pub(super) above: Vec<Option<usize>>,
    pub(super) root: usize,
    index: HashMap<&'d str, usize>,
}

/// Names listed in a sentence.
const MAX_LISTED: usize = 8;

/// `"a", "b", "c"` and how many more.
pub(super) fn list<'n>(names: impl ExactSizeIterator<Item = &'n str>) -> String {
    let more = names.len().saturating_sub(MAX_LISTED);
    let mut text = names
        .take(MAX_LISTED)
        .map(|name| format!("\"{name}\""))
        .collect::<Vec<_>>()
        .join(", ");
    if more > 0 {
        text.push_str(&format!(" and {more} more"));
    }
    text
}

impl<'d> Tree<'d> {
    /// Connects the links.
    ///
    /// # Errors
    /// [`UrdfError::Invalid`] for a reference to no link, a joint from a link to itself, a link with two parents, two
    /// roots, and a loop.
    pub(super) fn new(document: &'d Document, source: &Source) -> Result<Self, UrdfError> {
        if document.links.is_empty() {
            return Err(source.refuse(
                document.root_at,
                "<robot>",
                "holds no <link>, expected two or more",
            ));
        }
        let index = document
            .links
            .iter()
            .enumerate()
            .map(|(i, link)| (link.name.as_str(), i))
            .collect();
        let mut tree = Self {
            document,
            edges: Vec::with_capacity(document.joints.len()),
            below: vec![Vec::new(); document.links.len()],
            above: vec![None; document.links.len()],
            root: 0,
            index,
        };
        for joint in 0..document.joints.len() {
            tree.connect(joint, source)?;
        }
        tree.root = tree.only_root(source)?;
        tree.refuse_loops(source)?;
        Ok(tree)
    }

    /// The link of that name.
    pub(super) fn find(&self, name: &str) -> Option<usize> {
        self.index.get(name).copied()
    }

    pub(super) fn link_name(&self, link: usize) -> &'d str {
        self.document
            .links
            .get(link)
            .map_or("", |facts| facts.name.as_str())
    }

    fn connect(&mut self, joint: usize, source: &Source) -> Result<(), UrdfError> {
        let Some(facts) = self.document.joints.get(joint) else {
            return Ok(());
        };
        let mut ends = [0; 2];
        for (end, (reference, which)) in ends
            .iter_mut()
            .zip([(&facts.parent, "parent"), (&facts.child, "child")])
        {
            *end = self.find(&reference.link).ok_or_else(|| {
                let element = format!("<{which}> of joint \"{}\"", facts.name);
                let message = format!(
                    "no link is named \"{}\"; correct the name or add the <link>",
                    reference.link
                );
                source.refuse(reference.at, element, message)
            })?;
        }
        let [parent, child] = ends;
        let element = format!("<child> of joint \"{}\"", facts.name);
        if parent == child {
            let message = format!(
                "the joint connects the link \"{}\" to itself",
                facts.child.link
            );
            return Err(source.refuse(facts.child.at, element, message));
        }
        if let Some(other) = self.above[child].and_then(|other| self.document.joints.get(other)) {
            let message = format!(
                "the link \"{}\" is the child of joint \"{}\" already; a link has one parent, closed loops are not read",
                facts.child.link, other.name
            );
            return Err(source.refuse(facts.child.at, element, message));
        }
        self.above[child] = Some(joint);
        self.below[parent].push(joint);
        self.edges.push(Edge { parent, child });
        Ok(())
    }

    /// The link without a parent. Links on a loop all have one.
    fn only_root(&self, source: &Source) -> Result<usize, UrdfError> {
        let roots: Vec<usize> = (0..self.above.len())
            .filter(|&link| self.above[link].is_none())
            .collect();
        match roots.as_slice() {
            [] => Err(self.loop_through(0, source)),
            [root] => Ok(*root),
            [_, second, ..] => {
                let at = self.document.links.get(*second).map_or(0, |link| link.at);
                let names = list(roots.iter().map(|&link| self.link_name(link)));
                let message = format!(
                    "{} links hang on no joint: {names}; a robot has one root, join the others by a fixed joint or delete them",
                    roots.len()
                );
                Err(source.refuse(at, format!("link \"{}\"", self.link_name(*second)), message))
            }
        }
    }

    /// With one root, links that cannot be reached from it stand on or below a loop.
    fn refuse_loops(&self, source: &Source) -> Result<(), UrdfError> {
        let mut reached = vec![false; self.below.len()];
        let mut todo = vec![self.root];
        while let Some(link) = todo.pop() {
            reached[link] = true;
            todo.extend(
                self.below[link]
                    .iter()
                    .map(|&joint| self.edges[joint].child),
            );
        }
        match reached.iter().position(|&r| !r) {
            None => Ok(()),
            Some(link) => Err(self.loop_through(link, source)),
        }
    }

    /// The refusal of the loop above a link that has no root.
    fn loop_through(&self, link: usize, source: &Source) -> UrdfError {
        let up = |link: usize| self.above[link].map_or(link, |joint| self.edges[joint].parent);
        // As many steps as there are links end on the loop.
        let on_loop = (0..self.above.len()).fold(link, |link, _| up(link));
        let mut members = vec![on_loop];
        let mut next = up(on_loop);
        while next != on_loop {
            members.push(next);
            next = up(next);
        }
        members.reverse();
        let names = list(members.iter().map(|&link| self.link_name(link)));
        let message = format!("the joints lead in a circle through the links {names}; a robot is a tree, delete one joint");
        let joint = self.above[on_loop].and_then(|joint| self.document.joints.get(joint));
        let (at, element) = joint.map_or((0, String::new()), |j| {
            (j.at, format!("joint \"{}\"", j.name))
        });
        source.refuse(at, element, message)
    }
}
