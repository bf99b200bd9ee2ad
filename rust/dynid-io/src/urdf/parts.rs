//! A `<link>` and a `<joint>` while they are open: which children they have so far, and what is still missing at the end.

use super::clean;
use super::document::{Document, JointFacts, LinkFacts, Mimic, Motion, Reference, SecondOrigin};
use super::elements::{self, Fault, Limit, Pose};
use super::places::Place;
use super::tag::Tag;

/// What became of a child element.
pub(super) struct Taken {
    pub(super) place: Place,
    /// A sentence for the notes.
    pub(super) remark: Option<String>,
}

impl Taken {
    fn leaf(remark: Option<String>) -> Self {
        Self {
            place: Place::Leaf,
            remark,
        }
    }
}

/// Fills an empty slot, or refuses the second element of a kind.
fn once<T>(slot: &mut Option<T>, tag: &Tag, value: T) -> Result<(), Fault> {
    if slot.is_some() {
        let message = "stands here a second time, and readers differ in which one counts; keep one"
            .to_owned();
        return Err(Fault {
            at: tag.at,
            message,
        });
    }
    *slot = Some(value);
    Ok(())
}

fn missing<T>(value: Option<T>, at: usize, mend: &str) -> Result<T, Fault> {
    value.ok_or_else(|| Fault {
        at,
        message: format!("{mend} is missing"),
    })
}

/// Degrees in place of radians are the usual slip.
fn doubt_degrees(pose: &Pose) -> Option<String> {
    let doubtful = pose.rpy.iter().any(|angle| angle.abs() > 6.3);
    doubtful.then(|| "rpy is more than a turn; it is read in radians".to_owned())
}

#[derive(Default)]
struct OpenInertial {
    at: usize,
    origin: Option<Pose>,
    mass: Option<f64>,
    inertia: Option<[f64; 6]>,
}

/// A `<link>` being read.
pub(super) struct OpenLink {
    pub(super) name: String,
    at: usize,
    inertial: Option<OpenInertial>,
    /// An `<origin>` of the link itself, which means nothing.
    pub(super) stray_origin: Option<usize>,
}

impl OpenLink {
    pub(super) fn new(name: String, tag: &Tag) -> Self {
        Self {
            name,
            at: tag.at,
            inertial: None,
            stray_origin: None,
        }
    }

    /// Takes in `<inertial>` or one of its children.
    pub(super) fn element(&mut self, tag: &Tag) -> Result<Taken, Fault> {
        let Some(inertial) = self.inertial.as_mut().filter(|_| tag.name != "inertial") else {
            let empty = OpenInertial {
                at: tag.at,
                ..OpenInertial::default()
            };
            once(&mut self.inertial, tag, empty)?;
            return Ok(Taken {
                place: Place::Inertial,
                remark: None,
            });
        };
        match tag.name {
            "mass" => once(&mut inertial.mass, tag, elements::mass(tag)?)?,
            "inertia" => once(&mut inertial.inertia, tag, elements::inertia(tag)?)?,
            _ => {
                let pose = elements::pose(tag)?;
                once(&mut inertial.origin, tag, pose)?;
                return Ok(Taken::leaf(doubt_degrees(&pose)));
            }
        }
        Ok(Taken::leaf(None))
    }

    /// Hands the whole link over.
    pub(super) fn finish(self, document: &mut Document) -> Result<(), Fault> {
        let mut inertial = None;
        if let Some(open) = self.inertial {
            if let (Some(at), None) = (self.stray_origin, &open.origin) {
                let message = "the <origin> beside <inertial> does not count there; move it into <inertial>, or delete it"
                    .to_owned();
                return Err(Fault { at, message });
            }
            let mass = missing(
                open.mass,
                open.at,
                "<mass value=\"...\"/> inside <inertial>",
            )?;
            let mend = "<inertia ixx=\"...\" ixy ixz iyy iyz izz/> inside <inertial>";
            let inertia = missing(open.inertia, open.at, mend)?;
            let origin = open.origin.unwrap_or_default();
            inertial = Some(clean::Inertial {
                origin,
                mass,
                inertia,
            });
        }
        clean::link(&mut document.clean, &self.name, inertial.as_ref());
        document.links.push(LinkFacts {
            name: self.name,
            at: self.at,
        });
        Ok(())
    }
}

/// A `<joint>` being read.
pub(super) struct OpenJoint {
    pub(super) name: String,
    at: usize,
    motion: Motion,
    origin: Option<Pose>,
    second_origin: Option<SecondOrigin>,
    parent: Option<Reference>,
    child: Option<Reference>,
    axis: Option<[f64; 3]>,
    limit: Option<Limit>,
    mimic: Option<Mimic>,
}

impl OpenJoint {
    pub(super) fn new(name: String, motion: Motion, tag: &Tag) -> Self {
        Self {
            name,
            at: tag.at,
            motion,
            origin: None,
            second_origin: None,
            parent: None,
            child: None,
            axis: None,
            limit: None,
            mimic: None,
        }
    }

    /// Takes in a child.
    pub(super) fn element(&mut self, tag: &Tag) -> Result<Taken, Fault> {
        let mut remark = None;
        match tag.name {
            "parent" => once(&mut self.parent, tag, elements::reference(tag)?)?,
            "child" => once(&mut self.child, tag, elements::reference(tag)?)?,
            "origin" => remark = self.origin(tag)?,
            // Exporters fill in idle zeros here for joints that do not move.
            _ if !self.motion.has_axis() => {
                return Ok(Taken {
                    place: Place::Skip,
                    remark,
                })
            }
            "mimic" => once(&mut self.mimic, tag, elements::mimic(tag)?)?,
            "axis" => {
                let (axis, scaled) = elements::axis(tag)?;
                once(&mut self.axis, tag, axis)?;
                remark = scaled.then(|| "brought to unit length".to_owned());
            }
            _ => {
                let (limit, surprise) = elements::limit(tag, self.motion)?;
                once(&mut self.limit, tag, limit)?;
                remark = surprise;
            }
        }
        Ok(Taken::leaf(remark))
    }

    fn origin(&mut self, tag: &Tag) -> Result<Option<String>, Fault> {
        let pose = elements::pose(tag)?;
        match &self.origin {
            None => self.origin = Some(pose),
            // The chain decides: before the first moving joint it changes no torque.
            Some(first) if self.second_origin.is_none() => {
                let same_rotation = first.rpy == pose.rpy;
                self.second_origin = Some(SecondOrigin {
                    at: tag.at,
                    same_rotation,
                });
            }
            Some(_) => once(&mut self.origin, tag, pose)?,
        }
        Ok(doubt_degrees(&pose))
    }

    /// Hands the whole joint over.
    pub(super) fn finish(self, document: &mut Document) -> Result<(), Fault> {
        let parent = missing(self.parent, self.at, "<parent link=\"...\"/>")?;
        let child = missing(self.child, self.at, "<child link=\"...\"/>")?;
        let limit = self.limit.unwrap_or_default();
        let joint = clean::Joint {
            name: &self.name,
            motion: self.motion,
            parent: &parent.link,
            child: &child.link,
            origin: self.origin.unwrap_or_default(),
            axis: self.axis.unwrap_or([1.0, 0.0, 0.0]),
            limit,
        };
        clean::joint(&mut document.clean, &joint);
        document.joints.push(JointFacts {
            name: self.name,
            at: self.at,
            motion: self.motion,
            parent,
            child,
            acceleration: limit.acceleration,
            range: [limit.lower, limit.upper],
            mimic: self.mimic,
            second_origin: self.second_origin,
        });
        Ok(())
    }
}
