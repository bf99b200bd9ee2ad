//! Writes the kinematic elements anew for urdf-rs: every number explicit, every default spelt out, nothing else.
//!
//! urdf-rs reads an absent limit as zero and drops tokens that are no numbers; of this text it can misread nothing.

use std::fmt::Write;

use quick_xml::escape::escape;

use super::document::Motion;
use super::elements::{Limit, Pose, INERTIA};

/// Content of an `<inertial>`: placement, mass \[kg\], inertia about the centre \[kg·m²\].
pub(super) struct Inertial {
    pub(super) origin: Pose,
    pub(super) mass: f64,
    pub(super) inertia: [f64; 6],
}

/// `{:?}` is the shortest text that reads back as the same number; infinities are `inf` and `-inf`.
fn triple([x, y, z]: [f64; 3]) -> String {
    format!("{x:?} {y:?} {z:?}")
}

fn origin(pose: &Pose) -> String {
    format!(
        "<origin xyz=\"{}\" rpy=\"{}\"/>",
        triple(pose.xyz),
        triple(pose.rpy)
    )
}

/// Appends a `<link>`.
pub(super) fn link(text: &mut String, name: &str, inertial: Option<&Inertial>) {
    let _ = write!(text, "<link name=\"{}\">", escape(name)); // Writing to a String cannot fail.
    if let Some(inertial) = inertial {
        let mut entries = String::new();
        for (name, entry) in INERTIA.iter().zip(inertial.inertia) {
            let _ = write!(entries, " {name}=\"{entry:?}\"");
        }
        let place = origin(&inertial.origin);
        let _ = write!(
            text,
            "<inertial>{place}<mass value=\"{:?}\"/><inertia{entries}/></inertial>",
            inertial.mass
        );
    }
    text.push_str("</link>\n");
}

/// Content of a `<joint>`.
pub(super) struct Joint<'a> {
    pub(super) name: &'a str,
    pub(super) motion: Motion,
    pub(super) parent: &'a str,
    pub(super) child: &'a str,
    pub(super) origin: Pose,
    pub(super) axis: [f64; 3],
    pub(super) limit: Limit,
}

/// Appends a `<joint>`.
pub(super) fn joint(text: &mut String, joint: &Joint) {
    let limit = &joint.limit;
    let _ = writeln!(
        text,
        "<joint name=\"{}\" type=\"{}\">{}<parent link=\"{}\"/><child link=\"{}\"/><axis xyz=\"{}\"/>\
         <limit lower=\"{:?}\" upper=\"{:?}\" velocity=\"{:?}\" effort=\"{:?}\"/></joint>",
        escape(joint.name),
        joint.motion.name(),
        origin(&joint.origin),
        escape(joint.parent),
        escape(joint.child),
        triple(joint.axis),
        limit.lower,
        limit.upper,
        limit.velocity,
        limit.effort,
    );
}
