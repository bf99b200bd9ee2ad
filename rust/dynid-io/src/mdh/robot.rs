//! From the rows of a `robot.toml` to a [`RobotModel`].

use std::collections::HashMap;

use dynid_core::link_params::LinkParams;
use dynid_core::robot::{Joint, JointKind, JointLimits, RobotModel, MAX_JOINTS};
use nalgebra::{Matrix3, Vector3};

use super::error::MdhError;
use super::table::{Source, Table};
use super::MdhOptions;
use crate::frame::{lump, Frame};
use crate::text::shorten;

const TOP: [&str; 6] = ["name", "angle", "gravity", "base", "joint", "tool"];
const POSE: [&str; 2] = ["xyz", "rpy"];
const BODY: [&str; 5] = [
    "mass",
    "com",
    "inertia_com",
    "inertia_rpy",
    "inertia_origin",
];
const ROW: [&str; 4] = ["alpha", "a", "d", "theta"];
const JOINT: [&str; 10] = [
    "name",
    "link",
    "kind",
    "lower",
    "upper",
    "velocity",
    "acceleration",
    "effort",
    "gear_ratio",
    "rotor_inertia",
];
const INERTIA: [&str; 6] = ["xx", "yy", "zz", "xy", "xz", "yz"];

const DEFAULT_GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];
/// Little more than a turn: nobody twists a frame further, but many mistake degrees for radians \[rad\].
const MAX_TURN: f64 = std::f64::consts::TAU * 1.001;

/// The unit of every angle in the file.
#[derive(Clone, Copy)]
enum Angle {
    Degrees,
    Radians,
}

impl Angle {
    fn to_radians(self, angle: f64) -> f64 {
        match self {
            Self::Degrees => angle.to_radians(),
            Self::Radians => angle,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Degrees => "deg",
            Self::Radians => "rad",
        }
    }
}

/// Reads the whole file.
///
/// # Errors
/// [`MdhError`]; see the module's documentation.
pub(super) fn read(source: &Source, options: &MdhOptions) -> Result<RobotModel, MdhError> {
    check_options(source, options)?;
    let content = source.parse()?;
    let top = Table::new(source, &content, 0, "", &TOP)?;
    let angle = angle(&top)?;
    let base = top.table("base", &POSE)?;
    let mut before = base.map_or(Ok(Frame::identity()), |base| pose(&base, angle))?;
    let rows = top.tables("joint")?;
    if rows.is_empty() {
        return Err(top.missing("joint", "one [[joint]] table per joint, from the base on"));
    }
    if rows.len() > MAX_JOINTS {
        let message = format!("{} joints, expected at most {MAX_JOINTS}", rows.len());
        return Err(top.refuse("joint", message));
    }
    let known: Vec<&str> = JOINT.iter().chain(&ROW).chain(&BODY).copied().collect();
    let mut joints = Vec::with_capacity(rows.len());
    let mut taken = HashMap::new();
    for (index, (row, at)) in rows.into_iter().enumerate() {
        let number = index + 1;
        let mut table = Table::new(source, row, at, format!("joint {number}"), &known)?;
        let name = table
            .name("name")?
            .map_or_else(|| format!("joint_{number}"), str::to_owned);
        table.relabel(format!("joint \"{}\"", shorten(&name)));
        if let Some(first) = taken.insert(name.clone(), number) {
            let message = format!("joint {first} has this name already; rename one");
            return Err(table.refuse("name", message));
        }
        joints.push(joint(&table, name, number, angle, &before)?);
        before = Frame::identity(); // the next row starts where this one ends
    }
    if let Some(tool) = top.table("tool", &[&POSE[..], &BODY[..]].concat())? {
        let placed = (pose(&tool, angle)?, body(&tool, angle)?);
        if let Some(last) = joints.last_mut() {
            last.phi = lump([(Frame::identity(), last.phi), placed]);
        }
    }
    override_rotors(source, options, &mut joints)?;
    let own_gravity = top.three("gravity")?.unwrap_or(DEFAULT_GRAVITY);
    let gravity = Vector3::from(options.gravity.unwrap_or(own_gravity));
    let name = top.name("name")?.unwrap_or("robot").to_owned();
    RobotModel::new(name, joints, gravity)
        .map_err(|error| source.refuse(0, "robot", error.to_string()))
}

fn angle(top: &Table) -> Result<Angle, MdhError> {
    let mend = "\"deg\" or \"rad\", the unit of every angle in this file";
    match top.text("angle", mend)? {
        None => Err(top.missing("angle", "angle = \"deg\" or angle = \"rad\"")),
        Some("deg") => Ok(Angle::Degrees),
        Some("rad") => Ok(Angle::Radians),
        Some(other) => {
            let found = shorten(other);
            Err(top.refuse("angle", format!("must be {mend}, found \"{found}\"")))
        }
    }
}

/// An angle of the geometry \[rad\].
fn turn(table: &Table, key: &str, angle: Angle, value: f64) -> Result<f64, MdhError> {
    let turned = angle.to_radians(value);
    if turned.abs() <= MAX_TURN {
        return Ok(turned);
    }
    let mend = match angle {
        Angle::Radians => "is angle = \"deg\" meant?",
        Angle::Degrees => "give it within -360 and 360",
    };
    let message = format!("is {value} {}, more than a turn; {mend}", angle.name());
    Err(table.refuse(key, message))
}

fn turns(table: &Table, key: &str, angle: Angle) -> Result<[f64; 3], MdhError> {
    let mut angles = table.three(key)?.unwrap_or_default();
    for value in &mut angles {
        *value = turn(table, key, angle, *value)?;
    }
    Ok(angles)
}

/// `xyz` \[m\] and `rpy`; what is left out is zero.
fn pose(table: &Table, angle: Angle) -> Result<Frame, MdhError> {
    let xyz = table.three("xyz")?.unwrap_or_default();
    Ok(Frame::from_xyz_rpy(xyz, turns(table, "rpy", angle)?))
}

fn required(table: &Table, key: &str, mend: &str) -> Result<f64, MdhError> {
    table.number(key)?.ok_or_else(|| table.missing(key, mend))
}

fn at_least_zero(table: &Table, key: &str, meaning: &str) -> Result<Option<f64>, MdhError> {
    let number = table.number(key)?;
    if let Some(negative) = number.filter(|number| *number < 0.0) {
        let message = format!("is {negative}, expected zero or more: it is {meaning}");
        return Err(table.refuse(key, message));
    }
    Ok(number)
}

/// One row; `before` is where the row starts in the link before.
fn joint(
    table: &Table,
    name: String,
    number: usize,
    angle: Angle,
    before: &Frame,
) -> Result<Joint, MdhError> {
    let kind = match table.text("kind", "\"revolute\" or \"prismatic\"")? {
        None | Some("revolute") => JointKind::Revolute,
        Some("prismatic") => JointKind::Prismatic,
        Some(other) => {
            let found = shorten(other);
            let message = format!("must be \"revolute\" or \"prismatic\", found \"{found}\"");
            return Err(table.refuse("kind", message));
        }
    };
    let [alpha, a, d, theta] = row(table, angle)?;
    // T = Rx(alpha) Tx(a) Rz(theta) Tz(d)
    let placement = before
        .compose(&Frame::from_xyz_rpy([a, 0.0, 0.0], [alpha, 0.0, 0.0]))
        .compose(&Frame::from_xyz_rpy([0.0, 0.0, d], [0.0, 0.0, theta]));
    let gear_ratio = gear_ratio(table)?;
    let link = table.name("link")?;
    Ok(Joint {
        name,
        link: link.map_or_else(|| format!("link_{number}"), str::to_owned),
        kind,
        rotation: placement.rotation,
        translation: placement.translation,
        axis: Vector3::z(),
        limits: limits(table, kind, angle)?,
        rotor_inertia: rotor_inertia(table, gear_ratio)?,
        gear_ratio,
        phi: lump([(Frame::identity(), body(table, angle)?)]),
    })
}

/// `[alpha, a, d, theta]` \[rad, m\].
fn row(table: &Table, angle: Angle) -> Result<[f64; 4], MdhError> {
    let mut row = [0.0; 4];
    for (value, key) in row.iter_mut().zip(ROW) {
        let mend = format!("{key} = 0.0 if there is none; a row has alpha, a, d and theta");
        *value = required(table, key, &mend)?;
        if key == "alpha" || key == "theta" {
            *value = turn(table, key, angle, *value)?;
        }
    }
    Ok(row)
}

fn limits(table: &Table, kind: JointKind, angle: Angle) -> Result<JointLimits, MdhError> {
    let in_si = |number: f64| match kind {
        JointKind::Revolute => angle.to_radians(number),
        JointKind::Prismatic => number,
    };
    let most = |key, meaning| {
        let limit = at_least_zero(table, key, meaning)?;
        Ok::<_, MdhError>(limit.map_or(f64::INFINITY, in_si))
    };
    let mut limits = JointLimits {
        velocity: most("velocity", "a greatest speed")?,
        acceleration: most("acceleration", "a greatest acceleration")?,
        ..JointLimits::default()
    };
    let effort = at_least_zero(table, "effort", "a greatest torque or force")?;
    limits.effort = effort.unwrap_or(f64::INFINITY);
    match (table.number("lower")?, table.number("upper")?) {
        (None, None) => {}
        (Some(_), None) => return Err(table.missing("upper", "it beside lower, or neither")),
        (None, Some(_)) => return Err(table.missing("lower", "it beside upper, or neither")),
        (Some(lower), Some(upper)) if lower > upper => {
            let message = format!("is {lower}, above upper, {upper}; swap or correct them");
            return Err(table.refuse("lower", message));
        }
        (Some(lower), Some(upper)) => (limits.lower, limits.upper) = (in_si(lower), in_si(upper)),
    }
    Ok(limits)
}

fn gear_ratio(table: &Table) -> Result<Option<f64>, MdhError> {
    let ratio = table.number("gear_ratio")?;
    match ratio {
        Some(ratio) if ratio <= 0.0 => {
            let message = format!(
                "is {ratio}, expected motor turns per joint turn, above zero; a direction belongs into [signs] of dynid.toml"
            );
            Err(table.refuse("gear_ratio", message))
        }
        _ => Ok(ratio),
    }
}

/// Reflected to the link side: the motor's own times the ratio squared.
fn rotor_inertia(table: &Table, gear_ratio: Option<f64>) -> Result<f64, MdhError> {
    let own = at_least_zero(table, "rotor_inertia", "the motor's own inertia")?;
    match (own, gear_ratio) {
        (None, _) => Ok(0.0),
        (Some(own), Some(ratio)) => Ok(own * (ratio * ratio)),
        (Some(_), None) => {
            let mend = "it beside rotor_inertia, which is the motor's own (1.0 without a gear)";
            Err(table.missing("gear_ratio", mend))
        }
    }
}

/// Declared inertial parameters about the frame's origin; zeros where none are declared.
fn body(table: &Table, angle: Angle) -> Result<LinkParams, MdhError> {
    let Some(first) = BODY.iter().find(|key| table.has(key)) else {
        return Ok([0.0; 10]);
    };
    let mend = |key: &str, how: &str| {
        let mend = format!("{how} beside {first}, or no inertial parameters at all");
        table.missing(key, &mend)
    };
    let mass = at_least_zero(table, "mass", "a mass in kg")?;
    let mass = mass.ok_or_else(|| mend("mass", "mass = ... in kg"))?;
    let com = table.three("com")?;
    let com = com.ok_or_else(|| mend("com", "com = [x, y, z] in m"))?;
    let axes = turns(table, "inertia_rpy", angle)?;
    match (
        inertia(table, "inertia_com")?,
        inertia(table, "inertia_origin")?,
    ) {
        (Some(about_centre), None) => {
            Ok(Frame::from_xyz_rpy(com, axes).centred(mass, &about_centre))
        }
        (None, Some(_)) if table.has("inertia_rpy") => {
            let message = "turns inertia_com only; give inertia_origin along the frame's own axes";
            Err(table.refuse("inertia_rpy", message))
        }
        (None, Some(i)) => Ok([
            mass,
            mass * com[0],
            mass * com[1],
            mass * com[2],
            i[(0, 0)],
            i[(0, 1)],
            i[(1, 1)],
            i[(0, 2)],
            i[(1, 2)],
            i[(2, 2)],
        ]),
        (None, None) => Err(mend(
            "inertia_com",
            "inertia_com = { xx = ..., yy = ..., zz = ... } in kg m^2",
        )),
        (Some(_), Some(_)) => {
            let message = "stands beside inertia_com, which says the same; keep one";
            Err(table.refuse("inertia_origin", message))
        }
    }
}

/// `xx`, `yy` and `zz` of an inertia matrix, and its products, which may be left out where they are zero \[kg·m²\].
fn inertia(table: &Table, key: &str) -> Result<Option<Matrix3<f64>>, MdhError> {
    let Some(entries) = table.table(key, &INERTIA)? else {
        return Ok(None);
    };
    let moment = |entry: &str| required(&entries, entry, &format!("{entry} = ... in kg m^2"));
    let product = |entry: &str| Ok::<_, MdhError>(entries.number(entry)?.unwrap_or(0.0));
    let (xx, yy, zz) = (moment("xx")?, moment("yy")?, moment("zz")?);
    let (xy, xz, yz) = (product("xy")?, product("xz")?, product("yz")?);
    Ok(Some(Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)))
}

fn check_options(source: &Source, options: &MdhOptions) -> Result<(), MdhError> {
    match options.gravity {
        Some(gravity) if !gravity.iter().all(|g| g.is_finite()) => Err(MdhError::Option {
            file: source.file.to_owned(),
            option: "gravity",
            message: format!("is {gravity:?}, expected three finite numbers in m/s^2"),
        }),
        _ => Ok(()),
    }
}

fn override_rotors(
    source: &Source,
    options: &MdhOptions,
    joints: &mut [Joint],
) -> Result<(), MdhError> {
    let Some(list) = options.rotor_inertia.as_deref() else {
        return Ok(());
    };
    let refuse = |message| MdhError::Option {
        file: source.file.to_owned(),
        option: "rotor_inertia",
        message,
    };
    if list.len() != joints.len() {
        let message = format!(
            "has {} values, expected {}, one per joint",
            list.len(),
            joints.len()
        );
        return Err(refuse(message));
    }
    if let Some(bad) = list.iter().find(|x| !(x.is_finite() && **x >= 0.0)) {
        let message =
            format!("holds {bad}, expected finite numbers of zero or more in kg m^2 (kg)");
        return Err(refuse(message));
    }
    for (joint, &inertia) in joints.iter_mut().zip(list) {
        joint.rotor_inertia = inertia;
    }
    Ok(())
}
