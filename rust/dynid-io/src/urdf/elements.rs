//! The attributes of each kinematic element, checked one by one.

use super::document::{Mimic, Motion, Reference};
use super::numbers::{bound, moderate, not_negative, one, three};
use super::source::shorten;
use super::tag::{Attribute, Tag};
use crate::text::nearest;

/// Longest name of a link or joint \[bytes\].
const MAX_NAME: usize = 256;
/// Shorter axes are zero \[-\].
const MIN_AXIS: f64 = 1e-6;

/// A sentence about a place; the guard adds the element.
pub(super) struct Fault {
    pub(super) at: usize,
    pub(super) message: String,
}

/// A fault at an attribute.
fn at<T>(attribute: &Attribute, result: Result<T, String>) -> Result<T, Fault> {
    result.map_err(|message| Fault {
        at: attribute.at,
        message,
    })
}

fn required<'t, 'a>(tag: &'t Tag<'a>, name: &str, mend: &str) -> Result<&'t Attribute<'a>, Fault> {
    tag.get(name).ok_or_else(|| {
        let others = tag.attributes.iter().map(|other| other.name);
        let misspelt = others
            .filter(|other| !is_foreign(other))
            .find(|other| nearest(other, &[name]).is_some());
        let hint = misspelt.map_or(String::new(), |other| {
            format!(" (is {other} meant to be it?)")
        });
        let message = format!("the attribute {name} is missing{hint}; write {mend}");
        Fault {
            at: tag.at,
            message,
        }
    })
}

/// Attributes with a prefix belong to other programs.
fn is_foreign(name: &str) -> bool {
    name.contains(':') || name == "xmlns"
}

/// Refuses attributes beyond `known`: a misspelt one would silently count as its default.
fn only(tag: &Tag, known: &[&str]) -> Result<(), Fault> {
    let unknown = tag
        .attributes
        .iter()
        .find(|a| !known.contains(&a.name) && !is_foreign(a.name));
    unknown.map_or(Ok(()), |attribute| {
        let name = shorten(attribute.name);
        let mend = match nearest(attribute.name, known) {
            Some(meant) => format!("is {meant} meant?"),
            None => format!("expected {}; rename or delete it", known.join(", ")),
        };
        let message = format!("the attribute {name} is not read here; {mend}");
        Err(Fault {
            at: attribute.at,
            message,
        })
    })
}

/// A remark on attributes of a link or joint that mean nothing here. What counts is required, so none can hide a slip.
pub(super) fn idle(tag: &Tag, known: &[&str]) -> Option<String> {
    let idle: Vec<String> = tag
        .attributes
        .iter()
        .filter(|a| !known.contains(&a.name) && !is_foreign(a.name))
        .map(|a| shorten(a.name))
        .collect();
    (!idle.is_empty()).then(|| format!("attributes that do not count here: {}", idle.join(", ")))
}

/// The `name` of a link or joint.
pub(super) fn name(tag: &Tag) -> Result<String, Fault> {
    let attribute = required(tag, "name", "name=\"...\"")?;
    at(attribute, checked_name(attribute))
}

fn checked_name(attribute: &Attribute) -> Result<String, String> {
    let value = &*attribute.value;
    if value.trim().is_empty() {
        return Err(format!("{} is empty, expected a name", attribute.name));
    }
    if value.len() > MAX_NAME || value.chars().any(char::is_control) {
        let found = shorten(value);
        let expected = format!("expected at most {MAX_NAME} bytes on one line");
        return Err(format!(
            "{} is no name: \"{found}\", {expected}",
            attribute.name
        ));
    }
    Ok(value.to_owned())
}

/// The `type` of a joint.
pub(super) fn motion(tag: &Tag) -> Result<Motion, Fault> {
    let mend = "type=\"revolute\", continuous, prismatic or fixed";
    let attribute = required(tag, "type", mend)?;
    let found = attribute.value.trim();
    let unknown = || format!("the type \"{}\" is unknown; write {mend}", shorten(found));
    at(attribute, Motion::from_name(found).ok_or_else(unknown))
}

/// The `link` of `<parent>` and `<child>`.
pub(super) fn reference(tag: &Tag) -> Result<Reference, Fault> {
    only(tag, &["link"])?;
    let attribute = required(tag, "link", "link=\"name of a link\"")?;
    let link = at(attribute, checked_name(attribute))?;
    Ok(Reference {
        link,
        at: attribute.at,
    })
}

/// A placement: translation \[m\] and fixed-axis roll, pitch, yaw \[rad\].
#[derive(Clone, Copy, Default)]
pub(super) struct Pose {
    pub(super) xyz: [f64; 3],
    pub(super) rpy: [f64; 3],
}

/// `<origin>`; an absent attribute is zero.
pub(super) fn pose(tag: &Tag) -> Result<Pose, Fault> {
    if let Some(quaternion) = tag.get("quat_xyzw") {
        let message =
            "quat_xyzw is not read; write the rotation as rpy=\"roll pitch yaw\" in radians"
                .to_owned();
        return Err(Fault {
            at: quaternion.at,
            message,
        });
    }
    only(tag, &["xyz", "rpy"])?;
    let read = |name, mend| {
        tag.get(name)
            .map_or(Ok([0.0; 3]), |a| at(a, three(a, mend)))
    };
    Ok(Pose {
        xyz: read("xyz", "xyz=\"x y z\" in metres")?,
        rpy: read("rpy", "rpy=\"roll pitch yaw\" in radians")?,
    })
}

/// `<axis>`, brought to unit length; the flag says whether it was of another length.
pub(super) fn axis(tag: &Tag) -> Result<([f64; 3], bool), Fault> {
    only(tag, &["xyz"])?;
    let mend = "xyz=\"x y z\", a direction in the joint frame";
    let attribute = required(tag, "xyz", mend)?;
    let [x, y, z] = at(attribute, three(attribute, mend))?;
    let length = (x * x + y * y + z * z).sqrt();
    if length < MIN_AXIS {
        let message =
            "the axis has no length, expected a direction; write e.g. xyz=\"0 0 1\"".to_owned();
        return Err(Fault {
            at: attribute.at,
            message,
        });
    }
    Ok((
        [x / length, y / length, z / length],
        (length - 1.0).abs() > 1e-6,
    ))
}

/// `<mimic>`, whose joint is refused later if it is in the chain.
pub(super) fn mimic(tag: &Tag) -> Result<Mimic, Fault> {
    only(tag, &["joint", "multiplier", "offset"])?;
    let master = required(tag, "joint", "joint=\"name of the joint that it follows\"")?;
    let joint = at(master, checked_name(master))?;
    let read = |name: &str, absent| {
        tag.get(name).map_or(Ok(absent), |a| {
            let number = one(name, &a.value, &format!("{name}=\"number\""));
            at(a, number.and_then(|number| moderate(name, number)))
        })
    };
    Ok(Mimic {
        at: tag.at,
        joint,
        multiplier: read("multiplier", 1.0)?,
        offset: read("offset", 0.0)?,
    })
}

/// `<mass>` \[kg\].
pub(super) fn mass(tag: &Tag) -> Result<f64, Fault> {
    only(tag, &["value"])?;
    let mend = "value=\"mass\" in kg";
    let attribute = required(tag, "value", mend)?;
    let mass = at(attribute, one("value", &attribute.value, mend))?;
    at(
        attribute,
        moderate("value", mass).and_then(|m| not_negative("value", m, "a mass in kg")),
    )
}

/// Names of the six entries of `<inertia>`, in the order of [`inertia`]'s result.
pub(super) const INERTIA: [&str; 6] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];

/// `<inertia>` \[kg·m²\]: see [`INERTIA`].
pub(super) fn inertia(tag: &Tag) -> Result<[f64; 6], Fault> {
    only(tag, &INERTIA)?;
    let mut entries = [0.0; 6];
    for (entry, name) in entries.iter_mut().zip(INERTIA) {
        let mend = format!("{name}=\"inertia\" in kg m^2");
        let attribute = required(tag, name, &mend)?;
        let number = one(name, &attribute.value, &mend).and_then(|number| moderate(name, number));
        *entry = at(attribute, number)?;
    }
    Ok(entries)
}

/// Attributes of `<limit>`; the last two are of URDF 1.2, and no model needs them.
const LIMIT: [&str; 7] = [
    "lower",
    "upper",
    "velocity",
    "acceleration",
    "effort",
    "deceleration",
    "jerk",
];

/// Attributes of `<limit>` that every exporter writes; a continuous joint has the last two.
const COUNTING: [&str; 4] = ["lower", "upper", "velocity", "effort"];

/// `<limit>`; infinite where nothing is declared.
#[derive(Clone, Copy)]
pub(super) struct Limit {
    pub(super) lower: f64,
    pub(super) upper: f64,
    pub(super) velocity: f64,
    pub(super) acceleration: f64,
    pub(super) effort: f64,
}

impl Default for Limit {
    fn default() -> Self {
        Self {
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
            velocity: f64::INFINITY,
            acceleration: f64::INFINITY,
            effort: f64::INFINITY,
        }
    }
}

/// `<limit>`, and a remark where a reader may be surprised.
///
/// Of `lower` and `upper` one alone leaves the other at zero, as the URDF specification has it; both absent mean no limit.
/// An attribute that nobody here knows is passed over where nothing that counts is missing: then it can be no slip of one.
pub(super) fn limit(tag: &Tag, motion: Motion) -> Result<(Limit, Option<String>), Fault> {
    let whole = |name: &&str| tag.get(name).is_some();
    let bounds = if motion == Motion::Continuous {
        2..4
    } else {
        0..4
    };
    let absent: Vec<&str> = LIMIT.into_iter().filter(|name| !whole(name)).collect();
    let slip = |a: &Attribute| !LIMIT.contains(&a.name) && nearest(a.name, &absent).is_some();
    let strangers = if COUNTING[bounds].iter().all(whole) && !tag.attributes.iter().any(slip) {
        idle(tag, &LIMIT)
    } else {
        only(tag, &LIMIT)?;
        None
    };
    let read = |name: &str| {
        let mend = format!("{name}=\"number\", or leave it out for no limit");
        tag.get(name)
            .map(|a| at(a, one(name, &a.value, &mend)).map(|number| (a, bound(number))))
            .transpose()
    };
    let (lower, upper) = (read("lower")?, read("upper")?);
    let positive = |name: &str, meaning| match read(name)? {
        None => Ok(f64::INFINITY),
        Some((a, number)) => at(a, not_negative(name, number, meaning)),
    };
    let mut limit = Limit {
        velocity: positive("velocity", "a greatest speed")?,
        acceleration: positive("acceleration", "a greatest acceleration")?,
        effort: positive("effort", "a greatest torque or force")?,
        ..Limit::default()
    };
    if motion == Motion::Continuous {
        let remark = (lower.is_some() || upper.is_some())
            .then_some("lower and upper of a continuous joint do not count");
        return Ok((limit, remark.map(str::to_owned).or(strangers)));
    }
    let mut remark = None;
    if let (Some(_), None) | (None, Some(_)) = (&lower, &upper) {
        remark = Some("only one of lower and upper is given; the other is zero, as the URDF specification has it");
    }
    if let Some((attribute, _)) = lower.as_ref().or(upper.as_ref()) {
        let value = |bound: &Option<(_, f64)>| bound.as_ref().map_or(0.0, |&(_, number)| number);
        (limit.lower, limit.upper) = (value(&lower), value(&upper));
        if limit.lower > limit.upper {
            let message = format!(
                "lower is {}, above upper, {}; swap or correct them",
                limit.lower, limit.upper
            );
            return Err(Fault {
                at: attribute.at,
                message,
            });
        }
    }
    if limit.velocity == 0.0 || limit.effort == 0.0 || limit.lower == limit.upper {
        remark = remark.or(Some(
            "a range of zero is taken literally; leave the attribute out if no limit is meant",
        ));
    }
    Ok((limit, remark.map(str::to_owned).or(strangers)))
}
