//! A URDF with other inertials: the text of the original, changed at `<inertial>` and `<dynamics>` and nowhere else.
//!
//! Comments, meshes, entities, CDATA and elements that nobody here knows stay as they are, byte for byte.

use std::fmt::Write;
use std::ops::Range;

use dynid_core::link_params::{pseudo_inertia, to_centre, LinkParams};
use dynid_core::physical::PhysicalSet;
use dynid_core::robot::RobotModel;
use nalgebra::{Cholesky, Matrix3, Vector3};

use super::chain::{Body, Held};
use super::document::Motion;
use super::error::UrdfError;
use super::source::{Notes, Source};
use super::spans::{self, Span, Spans};
use super::tree::Tree;
use super::{chain, guard, merge, read_values, UrdfOptions};

/// Frames that differ by less are the same \[m, 1\]: model files and URDFs hold the same bits.
const SAME: f64 = 1e-9;

/// The original's text with the inertials of `physical`, and its friction as `<dynamics>`.
///
/// The link behind a moving joint gets the total of all that is fixed to it; `<inertial>` of the links fixed to it is
/// taken out. Links and joints that are no part of the model's chain stay as they are; what they weigh, in the posture that
/// they are held in, is taken off the link that carries them.
///
/// # Errors
/// [`UrdfError::Invalid`] as for [`parse`](super::parse), [`UrdfError::OtherRobot`] if its chain is not the model's; and if those
/// links weigh more than was identified.
pub fn with_physical(
    text: impl AsRef<[u8]>,
    source_name: &str,
    robot: &RobotModel,
    physical: &PhysicalSet,
) -> Result<Vec<u8>, UrdfError> {
    let bytes = text.as_ref();
    let source = Source::decode(source_name, bytes)?;
    let mut notes = Notes::default();
    let document = guard::read(&source, &mut notes)?;
    let tree = Tree::new(&document, &source)?;
    let urdf = read_values(&document, &source)?;
    let bodies = matching_chain(&tree, &source, robot, &urdf)?;
    let spans = spans::find(&source)?;
    let edits = edits(&tree, &bodies, &spans, &source, physical, &urdf)?;
    let mark = bytes.len() - source.text.len(); // a byte order mark stays too
    let mut result = bytes.get(..mark).unwrap_or_default().to_vec();
    result.extend(apply(source.text, edits).into_bytes());
    Ok(result)
}

/// The bodies of the chain that is the model's. The model does not know its base link: any above the first joint may be it.
fn matching_chain(
    tree: &Tree,
    source: &Source,
    robot: &RobotModel,
    urdf: &urdf_rs::Robot,
) -> Result<Vec<Body>, UrdfError> {
    let other = |message: String| UrdfError::OtherRobot {
        file: source.file.to_owned(),
        message,
    };
    let joints = robot.joints();
    let first = joints.first().map_or("", |joint| joint.name.as_str());
    let index = tree
        .document
        .joints
        .iter()
        .position(|facts| facts.name == first);
    let Some(index) = index else {
        return Err(other(format!(
            "no joint is named \"{first}\", the model's first one"
        )));
    };
    let (mut difference, mut refusal) = (None, None);
    let mut base = Some(tree.edges[index].parent);
    while let Some(link) = base {
        // Whoever identified a shorter chain chose a tip, the model's last link.
        for tip in [None, joints.last().map(|joint| joint.link.clone())] {
            let options = UrdfOptions {
                base: Some(tree.link_name(link).to_owned()),
                tip,
                gravity: (*robot.gravity()).into(),
                rotor_inertia: None,
            };
            let mut notes = Notes::default();
            let found = chain::find(tree, source, &options, &mut notes).and_then(|chain| {
                merge::robot_model(tree, &chain.bodies, urdf, source, &options)
                    .map(|found| (chain.bodies, found))
            });
            match found {
                Ok((bodies, found)) => match unlike(robot, &found) {
                    None => return Ok(bodies),
                    Some(sentence) => difference = difference.or(Some(sentence)),
                },
                Err(error) => refusal = refusal.or(Some(error)),
            }
        }
        base = tree.above[link].map(|joint| tree.edges[joint].parent);
    }
    match (difference, refusal) {
        (None, Some(error)) => Err(error),
        (difference, _) => Err(other(difference.unwrap_or_default())),
    }
}

/// Where two chains differ in their kinematics.
fn unlike(model: &RobotModel, file: &RobotModel) -> Option<String> {
    let (ours, theirs) = (model.joints(), file.joints());
    for (k, (a, b)) in ours.iter().zip(theirs).enumerate() {
        if a.name != b.name || a.link != b.link {
            return Some(format!(
                "joint {k} is \"{}\" with the link \"{}\" here and \"{}\" with \"{}\" in the model",
                b.name, b.link, a.name, a.link
            ));
        }
        let same = a.kind == b.kind
            && (a.rotation - b.rotation).amax() <= SAME
            && (a.translation - b.translation).amax() <= SAME
            && (a.axis - b.axis).amax() <= SAME;
        if !same {
            return Some(format!(
                "the joint \"{}\" has another type, placement or axis here than in the model",
                a.name
            ));
        }
    }
    (ours.len() != theirs.len()).then(|| {
        format!(
            "{} joints move here and {} in the model",
            theirs.len(),
            ours.len()
        )
    })
}

/// A range of the text and what stands there instead.
type Edit = (Range<usize>, String);

fn edits(
    tree: &Tree,
    bodies: &[Body],
    spans: &Spans,
    source: &Source,
    physical: &PhysicalSet,
    urdf: &urdf_rs::Robot,
) -> Result<Vec<Edit>, UrdfError> {
    let layout = Layout::of(source.text);
    let mut edits = Vec::new();
    let moving = bodies
        .iter()
        .filter_map(|body| body.joint.map(|joint| (joint, body)));
    for (k, ((joint, body), phi)) in moving.zip(physical.links()).enumerate() {
        let (fixed, posed) = parts(tree, body);
        let others = merge::declared_part(tree, body, urdf, &posed);
        let own: LinkParams = std::array::from_fn(|i| phi[i] - others[i]);
        if !posed.is_empty() && Cholesky::new(pseudo_inertia(&own)).is_none() {
            let message = format!(
                "the links that hang on \"{}\" and are no part of the chain are declared with more mass or inertia than was \
                 identified for all of them; correct theirs, or leave the original out",
                tree.link_name(body.link)
            );
            let at = tree.document.links[body.link].at;
            return Err(source.refuse(at, "<link>", message));
        }
        if let Some(span) = spans.links.get(tree.link_name(body.link)) {
            edits.extend(layout.inertial(span, &own));
        }
        for link in fixed {
            if let Some(span) = spans.links.get(tree.link_name(link)) {
                edits.extend(
                    span.inertials
                        .iter()
                        .map(|place| (place.clone(), String::new())),
                );
            }
        }
        if let Some(span) = spans.joints.get(&tree.document.joints[joint].name) {
            let values = [
                ("damping", physical.damping[k]),
                ("friction", physical.friction[k]),
            ];
            edits.extend(layout.dynamics(span, values));
        }
    }
    Ok(edits)
}

/// A body's links that are fixed to its frame link, and those behind a joint that is held.
fn parts(tree: &Tree, body: &Body) -> (Vec<usize>, Vec<usize>) {
    let (mut fixed, mut posed) = (Vec::new(), Vec::new());
    let mut behind = vec![false; tree.document.links.len()];
    for &Held { joint, .. } in &body.held {
        let edge = tree.edges[joint];
        behind[edge.child] =
            behind[edge.parent] || tree.document.joints[joint].motion != Motion::Fixed;
        if behind[edge.child] {
            posed.push(edge.child);
        } else {
            fixed.push(edge.child);
        }
    }
    (fixed, posed)
}

fn apply(text: &str, mut edits: Vec<Edit>) -> String {
    edits.sort_by_key(|(place, _)| place.start);
    let mut result = String::with_capacity(text.len());
    let mut done = 0;
    for (place, new) in edits {
        result.push_str(text.get(done..place.start).unwrap_or_default());
        result.push_str(&new);
        done = place.end;
    }
    result.push_str(text.get(done..).unwrap_or_default());
    result
}

/// How the file breaks its lines and indents them.
struct Layout<'a> {
    text: &'a str,
    newline: &'static str,
}

impl<'a> Layout<'a> {
    fn of(text: &'a str) -> Self {
        let newline = if text.contains("\r\n") { "\r\n" } else { "\n" };
        Self { text, newline }
    }

    /// White space before the element at `at`; none if it does not start its line.
    fn indent(&self, at: usize) -> &'a str {
        let before = self.text.get(..at).unwrap_or_default();
        let start = before.rfind('\n').map_or(0, |newline| newline + 1);
        let line = before.get(start..).unwrap_or_default();
        if line.trim().is_empty() {
            line
        } else {
            ""
        }
    }

    /// The first `<inertial>` is replaced; where there is none, one is put in.
    fn inertial(&self, span: &Span, phi: &LinkParams) -> Vec<Edit> {
        if let Some((first, more)) = span.inertials.split_first() {
            let lines = inertial(phi);
            let text = lines.join(&format!("{}{}", self.newline, self.indent(first.start)));
            let mut edits = vec![(first.clone(), text)];
            edits.extend(more.iter().map(|place| (place.clone(), String::new())));
            return edits;
        }
        vec![self.put_in(span, "link", &inertial(phi))]
    }

    fn dynamics(&self, span: &Span, values: [(&str, f64); 2]) -> Vec<Edit> {
        if span.dynamics.is_empty() {
            return vec![self.put_in(span, "joint", &[dynamics(values)])];
        }
        let mut edits = Vec::new();
        for element in &span.dynamics {
            let mut added = String::new();
            for (name, value) in values {
                match element.values.get(name) {
                    Some(place) => edits.push((place.clone(), format!("{value:?}"))),
                    None => added.push_str(&format!(" {name}=\"{value:?}\"")),
                }
            }
            edits.push((element.name_end..element.name_end, added));
        }
        edits
    }

    /// `lines` behind the opening tag; an element that closes itself is opened for them.
    fn put_in(&self, span: &Span, name: &str, lines: &[String]) -> Edit {
        let outer = self.indent(span.start);
        let mut text = String::new();
        for line in lines {
            text.push_str(&format!("{}{outer}  {line}", self.newline));
        }
        if span.self_closing {
            let slash = span.open_end.saturating_sub("/>".len());
            let whole = format!(">{text}{}{outer}</{name}>", self.newline);
            return (slash..span.open_end, whole);
        }
        (span.open_end..span.open_end, text)
    }
}

/// `{:?}` is the shortest text that reads back as the same number.
pub(crate) fn triple(v: &Vector3<f64>) -> String {
    format!("{:?} {:?} {:?}", v.x, v.y, v.z)
}

/// The lines of an `<inertial>`. URDF wants the inertia about the centre; the parameters are about the link's origin.
pub(super) fn inertial(phi: &LinkParams) -> Vec<String> {
    let (mass, com, i) = to_centre(phi).unwrap_or((0.0, Vector3::zeros(), Matrix3::zeros()));
    vec![
        "<inertial>".to_owned(),
        format!("  <origin xyz=\"{}\" rpy=\"0 0 0\"/>", triple(&com)),
        format!("  <mass value=\"{mass:?}\"/>"),
        format!(
            "  <inertia ixx=\"{:?}\" ixy=\"{:?}\" ixz=\"{:?}\" iyy=\"{:?}\" iyz=\"{:?}\" izz=\"{:?}\"/>",
            i[(0, 0)],
            i[(0, 1)],
            i[(0, 2)],
            i[(1, 1)],
            i[(1, 2)],
            i[(2, 2)]
        ),
        "</inertial>".to_owned(),
    ]
}

/// A whole `<dynamics/>`.
pub(super) fn dynamics(values: [(&str, f64); 2]) -> String {
    let mut text = "<dynamics".to_owned();
    for (name, value) in values {
        let _ = write!(text, " {name}=\"{value:?}\""); // Writing to a String cannot fail.
    }
    text + "/>"
}
