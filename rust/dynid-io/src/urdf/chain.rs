//! The serial chain inside the tree: which joints move, and which links each of them carries.
//!
//! A branch that hangs on a moving link and is no part of the chain is carried in one posture: see [`posture`].

use dynid_core::robot::MAX_JOINTS;

use super::document::Motion;
use super::error::UrdfError;
use super::posture::Posture;
use super::propose::{self, Proposal};
use super::source::{shorten, Notes, Source};
use super::tree::{list, Tree};
use super::UrdfOptions;

/// A joint that does not move here: fixed, or held in one position.
#[derive(Clone, Copy)]
pub(super) struct Held {
    pub(super) joint: usize,
    /// \[rad, m\]; zero of a fixed joint.
    pub(super) position: f64,
}

/// Links that move as one: a frame link and what hangs on it by joints that do not move.
pub(super) struct Body {
    /// The moving joint that carries it; none for the base.
    pub(super) joint: Option<usize>,
    /// The link whose frame the body has.
    pub(super) link: usize,
    /// Its joints that do not move, parents first.
    pub(super) held: Vec<Held>,
}

/// The bodies from the base to the end, base first; all others are carried by one joint each.
pub(super) struct Chain {
    pub(super) bodies: Vec<Body>,
    /// One sentence on what was chosen, where the file leaves a choice.
    pub(super) choice: Option<String>,
}

struct Finder<'t, 's, 'a> {
    tree: &'t Tree<'t>,
    source: &'s Source<'a>,
    notes: &'s mut Notes,
    base: usize,
    /// Per joint, whether it moves: whether it is on the way to the tip.
    route: Vec<bool>,
    posture: Posture<'t>,
}

/// The chain from the base to the tip, or to the end that [`propose`] finds.
///
/// # Errors
/// [`UrdfError::Option`] if `base` or `tip` does not fit the tree; [`UrdfError::Invalid`] if the moving joints are no
/// serial chain, or none.
pub(super) fn find(
    tree: &Tree,
    source: &Source,
    options: &UrdfOptions,
    notes: &mut Notes,
) -> Result<Chain, UrdfError> {
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
    let proposal = match tip {
        Some(_) => None,
        None => Some(propose::proposal(tree, source, base)?),
    };
    let end = tip.or(proposal.as_ref().map(|proposal| proposal.tip));
    let end = end.unwrap_or(base);
    let route = route(tree, source, base, end)?;
    let mut finder = Finder {
        tree,
        source,
        notes,
        base,
        posture: Posture::new(tree, &route),
        route,
    };
    let bodies = finder.bodies(tip)?;
    let choice = finder.choice(&bodies, proposal.as_ref());
    Ok(Chain { bodies, choice })
}

/// Per joint, whether it is on the way from the base to `tip` and not fixed.
fn route(tree: &Tree, source: &Source, base: usize, tip: usize) -> Result<Vec<bool>, UrdfError> {
    let mut on_route = vec![false; tree.edges.len()];
    let mut link = tip;
    while link != base {
        let Some(joint) = tree.above[link] else {
            let (tip, base) = (tree.link_name(tip), tree.link_name(base));
            let message = format!("the link \"{tip}\" does not hang on the base, \"{base}\"; choose another tip or base");
            return Err(UrdfError::Option {
                file: source.file.to_owned(),
                option: "tip",
                message,
            });
        };
        on_route[joint] = tree.document.joints[joint].motion != Motion::Fixed;
        link = tree.edges[joint].parent;
    }
    Ok(on_route)
}

impl Finder<'_, '_, '_> {
    fn bodies(&mut self, tip: Option<usize>) -> Result<Vec<Body>, UrdfError> {
        let mut bodies = Vec::new();
        let mut next = Some((None, self.base));
        while let Some((joint, link)) = next {
            let (body, leaving) = self.body(joint, link)?;
            self.check_second_origins(&body)?;
            self.note_lumped(&body);
            let joint = leaving.iter().copied().find(|&joint| self.route[joint]);
            self.note_passed_over(&leaving);
            joint.map_or(Ok(()), |joint| self.check_moving(joint))?;
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
        let end = tip.map_or(String::new(), |tip| {
            format!(" and \"{}\"", self.tree.link_name(tip))
        });
        let message = format!(
            "no joint moves between \"{}\"{end}; a model needs a revolute, continuous or prismatic joint",
            self.tree.link_name(self.base)
        );
        Err(self
            .source
            .refuse(self.tree.document.root_at, "<robot>", message))
    }

    /// The body of a link, and the joints that leave it: of a moving body the one on the way, of the base all that move.
    fn body(&self, joint: Option<usize>, link: usize) -> Result<(Body, Vec<usize>), UrdfError> {
        let mut body = Body {
            joint,
            link,
            held: Vec::new(),
        };
        let mut leaving = Vec::new();
        let mut todo = vec![link];
        while let Some(link) = todo.pop() {
            for &below in &self.tree.below[link] {
                let fixed = self.tree.document.joints[below].motion == Motion::Fixed;
                // The base stands still, so what hangs on it puts no load on the chain, whatever it does.
                if self.route[below] || (joint.is_none() && !fixed) {
                    leaving.push(below);
                    continue;
                }
                let position = self.posture.of(below);
                let position = position.map_err(|master| self.refuse_follower(below, master))?;
                body.held.push(Held {
                    joint: below,
                    position,
                });
                todo.push(self.tree.edges[below].child);
            }
        }
        leaving.sort_unstable();
        Ok((body, leaving))
    }

    fn note_passed_over(&mut self, leaving: &[usize]) {
        for &joint in leaving.iter().filter(|&&joint| !self.route[joint]) {
            let facts = &self.tree.document.joints[joint];
            let sentence = format!(
                "joint \"{}\" hangs on the base; what it carries does not count",
                facts.name
            );
            self.notes.at(self.source, facts.at, sentence);
        }
    }

    fn check_moving(&self, joint: usize) -> Result<(), UrdfError> {
        let facts = &self.tree.document.joints[joint];
        if !facts.motion.has_axis() {
            return Err(propose::no_axis(self.tree, self.source, joint));
        }
        if let Some(mimic) = &facts.mimic {
            let message = "the joint follows another one, which a serial chain cannot express; choose a tip before it, \
                           delete <mimic> or write type=\"fixed\"";
            let element = format!("<mimic> of joint \"{}\"", facts.name);
            return Err(self.source.refuse(mimic.at, element, message));
        }
        self.refuse_second_origin(joint)
    }

    fn refuse_follower(&self, joint: usize, master: usize) -> UrdfError {
        let joints = &self.tree.document.joints;
        let message = format!(
            "follows the joint \"{}\", which moves, so its weight depends on that joint's position; choose a tip before \
             that joint, delete <mimic> or write type=\"fixed\"",
            joints[master].name
        );
        let element = format!("joint \"{}\"", joints[joint].name);
        self.source.refuse(joints[joint].at, element, message)
    }

    /// Tolerates a second `<origin>` in the base, where it changes no torque unless it turns gravity.
    fn check_second_origins(&mut self, body: &Body) -> Result<(), UrdfError> {
        for held in &body.held {
            let facts = &self.tree.document.joints[held.joint];
            match facts.second_origin {
                Some(second) if body.joint.is_none() && second.same_rotation => {
                    let sentence = format!(
                        "joint \"{}\" has a second <origin>; the first one counts, as in ROS",
                        facts.name
                    );
                    self.notes.at(self.source, second.at, sentence);
                }
                _ => self.refuse_second_origin(held.joint)?,
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
        let links = |moves: bool| -> Vec<&Held> {
            let joints = &self.tree.document.joints;
            let wanted = |held: &&Held| (joints[held.joint].motion != Motion::Fixed) == moves;
            body.held.iter().filter(wanted).collect()
        };
        let (fixed, held) = (links(false), links(true));
        if body.joint.is_none() {
            return;
        }
        let onto = self.tree.link_name(body.link);
        if let Some(first) = fixed.first() {
            let names: Vec<&str> = fixed
                .iter()
                .map(|held| self.tree.link_name(self.tree.edges[held.joint].child))
                .collect();
            let sentence = format!(
                "fixed links count as part of \"{onto}\": {}",
                list(names.into_iter())
            );
            let at = self.tree.document.joints[first.joint].at;
            self.notes.at(self.source, at, sentence);
        }
        for held in held {
            let facts = &self.tree.document.joints[held.joint];
            let sentence = format!(
                "joint \"{}\" is no part of the chain; what it carries counts as part of \"{onto}\", held at {}",
                facts.name, held.position
            );
            self.notes.at(self.source, facts.at, sentence);
        }
    }

    /// One sentence on the chain, where there was something to choose.
    fn choice(&self, bodies: &[Body], proposal: Option<&Proposal>) -> Option<String> {
        let joints = &self.tree.document.joints;
        let held: Vec<String> = bodies
            .iter()
            .filter(|body| body.joint.is_some())
            .flat_map(|body| &body.held)
            .filter(|held| joints[held.joint].motion != Motion::Fixed)
            .map(|held| format!("{} at {}", joints[held.joint].name, held.position))
            .collect();
        let proposed = proposal.filter(|proposal| !proposal.others.is_empty());
        if held.is_empty() && proposed.is_none() {
            return None;
        }
        let moving: Vec<usize> = bodies.iter().filter_map(|body| body.joint).collect();
        let end = bodies
            .last()
            .map_or("", |body| self.tree.link_name(body.link));
        let mut sentence = format!(
            "{}the chain of {} from \"{}\" to \"{end}\" is {}: {}",
            if proposal.is_some() {
                "the robot branches; "
            } else {
                ""
            },
            count(moving.len()),
            self.tree.link_name(self.base),
            if proposal.is_some() {
                "proposed"
            } else {
                "taken"
            },
            list(moving.iter().map(|&joint| joints[joint].name.as_str()))
        );
        if !held.is_empty() {
            let held = list(held.iter().map(String::as_str));
            sentence.push_str(&format!("; held where they stand: {held}"));
        }
        if let Some(proposal) = proposed {
            let others = proposal
                .others
                .iter()
                .map(|&link| self.tree.link_name(link));
            sentence.push_str(&format!("; other tips: {}", list(others)));
        }
        Some(sentence)
    }
}

fn count(n_joints: usize) -> String {
    let plural = if n_joints == 1 { "" } else { "s" };
    format!("{n_joints} joint{plural}")
}
