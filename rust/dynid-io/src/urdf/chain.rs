//! The serial chain inside the tree: which joints move, and which links each of them carries rigidly.

use dynid_core::robot::MAX_JOINTS;

use super::document::Motion;
use super::error::UrdfError;
use super::source::{shorten, Notes, Source};
use super::tree::{list, Tree};
use super::UrdfOptions;

/// Links that move as one: a frame link and what hangs on it by fixed joints.
pub(super) struct Body {
    /// The moving joint that carries it; none for the base.
    pub(super) joint: Option<usize>,
    /// The link whose frame the body has.
    pub(super) link: usize,
    /// Its fixed joints, parents first.
    pub(super) fixed: Vec<usize>,
}

struct Finder<'t, 's, 'a> {
    tree: &'t Tree<'t>,
    source: &'s Source<'a>,
    notes: &'s mut Notes,
    base: usize,
    /// The tip, and per joint whether it is on the way there.
    route: Option<(usize, Vec<bool>)>,
}

/// The bodies from the base to the end, base first; all others are carried by one joint each.
///
/// # Errors
/// [`UrdfError::Option`] if `base` or `tip` does not fit the tree; [`UrdfError::Invalid`] if the moving joints are no
/// serial chain, or none.
pub(super) fn find(
    tree: &Tree,
    source: &Source,
    options: &UrdfOptions,
    notes: &mut Notes,
) -> Result<Vec<Body>, UrdfError> {
    let named = |option: &'static str, name: &Option<String>| {
        let find = |name: &String| {
            tree.find(name).ok_or_else(|| {
                let links = list(tree.document.links.iter().map(|link| link.name.as_str()));
                let message = format!(
                    "no link is named \"{}\"; the links are {links}",
                    shorten(name)
                );
                UrdfError::Option {
                    file: source.file.to_owned(),
                    option,
                    message,
                }
            })
        };
        name.as_ref().map(find).transpose()
    };
    let base = named("base", &options.base)?.unwrap_or(tree.root);
    let tip = named("tip", &options.tip)?;
    let mut finder = Finder {
        tree,
        source,
        notes,
        base,
        route: None,
    };
    finder.route = tip
        .map(|tip| Ok::<_, UrdfError>((tip, finder.route(tip)?)))
        .transpose()?;
    finder.bodies()
}

impl Finder<'_, '_, '_> {
    /// Per joint, whether it is on the way from the base to `tip`.
    fn route(&self, tip: usize) -> Result<Vec<bool>, UrdfError> {
        let mut on_route = vec![false; self.tree.edges.len()];
        let mut link = tip;
        while link != self.base {
            let Some(joint) = self.tree.above[link] else {
                let (tip, base) = (self.tree.link_name(tip), self.tree.link_name(self.base));
                let message = format!("the link \"{tip}\" does not hang on the base, \"{base}\"; choose another tip or base");
                return Err(UrdfError::Option {
                    file: self.source.file.to_owned(),
                    option: "tip",
                    message,
                });
            };
            on_route[joint] = true;
            link = self.tree.edges[joint].parent;
        }
        Ok(on_route)
    }

    fn bodies(&mut self) -> Result<Vec<Body>, UrdfError> {
        let mut bodies = Vec::new();
        let mut next = Some((None, self.base));
        while let Some((joint, link)) = next {
            let (body, leaving) = self.body(joint, link);
            self.check_second_origins(&body)?;
            self.note_lumped(&body);
            let joint = self.choose(&body, &leaving)?;
            next = joint.map(|joint| (Some(joint), self.tree.edges[joint].child));
            bodies.push(body);
        }
        let n_joints = bodies.len().saturating_sub(1); // The first body is the base.
        if n_joints > MAX_JOINTS {
            let message =
                format!("{n_joints} joints move, expected at most {MAX_JOINTS}; choose a tip");
            return Err(self
                .source
                .refuse(self.tree.document.root_at, "<robot>", message));
        }
        if n_joints > 0 {
            return Ok(bodies);
        }
        let end = self.route.as_ref().map_or(String::new(), |(tip, _)| {
            format!(" and \"{}\"", self.tree.link_name(*tip))
        });
        let message = format!(
            "no joint moves between \"{}\"{end}; a model needs a revolute, continuous or prismatic joint",
            self.tree.link_name(self.base)
        );
        Err(self
            .source
            .refuse(self.tree.document.root_at, "<robot>", message))
    }

    /// The body of a link, and the joints that leave it.
    fn body(&self, joint: Option<usize>, link: usize) -> (Body, Vec<usize>) {
        let mut body = Body {
            joint,
            link,
            fixed: Vec::new(),
        };
        let mut leaving = Vec::new();
        let mut todo = vec![link];
        while let Some(link) = todo.pop() {
            for &joint in &self.tree.below[link] {
                if self.tree.document.joints[joint].motion == Motion::Fixed {
                    body.fixed.push(joint);
                    todo.push(self.tree.edges[joint].child);
                } else {
                    leaving.push(joint);
                }
            }
        }
        leaving.sort_unstable();
        (body, leaving)
    }

    /// The joint that continues the chain, or none at its end.
    fn choose(&mut self, body: &Body, leaving: &[usize]) -> Result<Option<usize>, UrdfError> {
        let next = match (&self.route, leaving) {
            (Some((_, route)), _) => leaving.iter().copied().find(|&joint| route[joint]),
            (None, [first, second, ..]) => return Err(self.branching(body, *first, *second)),
            (None, _) => leaving.first().copied(),
        };
        for &joint in leaving.iter().filter(|&&joint| Some(joint) != next) {
            let facts = &self.tree.document.joints[joint];
            if body.joint.is_some() {
                let message = format!(
                    "moves, hangs on the moving link \"{}\" and is not on the way to the tip; its weight would depend on \
                     its position. Write type=\"fixed\", with <origin> at the posture it is held in, or choose another tip",
                    self.tree.link_name(body.link)
                );
                return Err(self.refuse(joint, message));
            }
            let sentence = format!(
                "joint \"{}\" hangs on the base; what it carries does not count",
                facts.name
            );
            self.notes.at(self.source, facts.at, sentence);
        }
        next.map_or(Ok(()), |joint| self.check_moving(joint))?;
        Ok(next)
    }

    fn check_moving(&self, joint: usize) -> Result<(), UrdfError> {
        let facts = &self.tree.document.joints[joint];
        if !facts.motion.has_axis() {
            let message = format!(
                "is of type \"{}\", expected revolute, continuous, prismatic or fixed; if the arm starts behind it, \
                 choose base=\"{}\"",
                facts.motion.name(),
                facts.child.link
            );
            return Err(self.refuse(joint, message));
        }
        if let Some(at) = facts.mimic_at {
            let message = "the joint follows another one, which a serial chain cannot express; delete <mimic> or write \
                           type=\"fixed\"";
            let element = format!("<mimic> of joint \"{}\"", facts.name);
            return Err(self.source.refuse(at, element, message));
        }
        self.refuse_second_origin(joint)
    }

    fn refuse(&self, joint: usize, message: String) -> UrdfError {
        let facts = &self.tree.document.joints[joint];
        self.source
            .refuse(facts.at, format!("joint \"{}\"", facts.name), message)
    }

    fn branching(&self, body: &Body, first: usize, second: usize) -> UrdfError {
        let tree = self.tree;
        let mut leaves = Vec::new();
        let mut todo = vec![self.base];
        while let Some(link) = todo.pop() {
            if tree.below[link].is_empty() {
                leaves.push(tree.link_name(link));
            }
            todo.extend(
                tree.below[link]
                    .iter()
                    .rev()
                    .map(|&joint| tree.edges[joint].child),
            );
        }
        let joints = &tree.document.joints;
        let also = if body.joint.is_some() {
            ", and write type=\"fixed\" at the joints of the other branches"
        } else {
            ""
        };
        let message = format!(
            "moves, and so does joint \"{}\" on the same link \"{}\", expected one serial chain; choose tip= one of {}{also}",
            joints[first].name,
            tree.link_name(body.link),
            list(leaves.into_iter())
        );
        self.refuse(second, message)
    }

    /// Tolerates a second `<origin>` in the base, where it changes no torque unless it turns gravity.
    fn check_second_origins(&mut self, body: &Body) -> Result<(), UrdfError> {
        for &joint in &body.fixed {
            let facts = &self.tree.document.joints[joint];
            match facts.second_origin {
                Some(second) if body.joint.is_none() && second.same_rotation => {
                    let sentence = format!(
                        "joint \"{}\" has a second <origin>; the first one counts, as in ROS",
                        facts.name
                    );
                    self.notes.at(self.source, second.at, sentence);
                }
                _ => self.refuse_second_origin(joint)?,
            }
        }
        Ok(())
    }

    fn refuse_second_origin(&self, joint: usize) -> Result<(), UrdfError> {
        let facts = &self.tree.document.joints[joint];
        facts.second_origin.map_or(Ok(()), |second| {
            let element = format!("<origin> of joint \"{}\"", facts.name);
            let message =
                "stands here a second time, and readers differ in which one counts; keep one";
            Err(self.source.refuse(second.at, element, message))
        })
    }

    fn note_lumped(&mut self, body: &Body) {
        if let (Some(_), Some(&first)) = (body.joint, body.fixed.first()) {
            let names: Vec<&str> = body
                .fixed
                .iter()
                .map(|&j| self.tree.link_name(self.tree.edges[j].child))
                .collect();
            let onto = self.tree.link_name(body.link);
            let sentence = format!(
                "fixed links count as part of \"{onto}\": {}",
                list(names.into_iter())
            );
            self.notes
                .at(self.source, self.tree.document.joints[first].at, sentence);
        }
    }
}
