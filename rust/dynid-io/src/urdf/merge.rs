//! From the chain's bodies and the numbers that urdf-rs read to a [`RobotModel`].

use std::collections::HashMap;

use dynid_core::link_params::LinkParams;
use dynid_core::robot::{Joint, JointKind, JointLimits, RobotModel};
use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::frame::{lump, Frame};
use crate::text::shorten;

use super::chain::{Body, Held};
use super::document::{Motion, Rotor};
use super::error::UrdfError;
use super::source::Source;
use super::tree::Tree;
use super::{PlacedLink, UrdfOptions};

fn frame(pose: &urdf_rs::Pose) -> Frame {
    Frame::from_xyz_rpy(pose.xyz.0, pose.rpy.0)
}

/// Frames of a body's links in that of its frame link, by the links' indices.
fn place(tree: &Tree, body: &Body, urdf: &urdf_rs::Robot, frames: &mut [Frame]) {
    frames[body.link] = Frame::identity();
    for held in &body.held {
        let edge = tree.edges[held.joint];
        let placed = frame(&urdf.joints[held.joint].origin);
        let placed = placed.compose(&moved(tree, urdf, held));
        frames[edge.child] = frames[edge.parent].compose(&placed);
    }
}

/// Declared parameters of some of a body's links together, in the frame of its frame link.
pub(super) fn declared_part(
    tree: &Tree,
    body: &Body,
    urdf: &urdf_rs::Robot,
    links: &[usize],
) -> LinkParams {
    let mut frames = vec![Frame::identity(); tree.document.links.len()];
    place(tree, body, urdf, &mut frames);
    let part = |&link: &usize| (frames[link], declared_params(&urdf.links[link].inertial));
    lump(links.iter().map(part))
}

/// Every link that moves as one with the base or with a body of the chain.
pub(super) fn placed_links(tree: &Tree, bodies: &[Body], urdf: &urdf_rs::Robot) -> Vec<PlacedLink> {
    let mut frames = vec![Frame::identity(); tree.document.links.len()];
    let mut links = Vec::new();
    for (body, k) in bodies.iter().zip(0_usize..) {
        place(tree, body, urdf, &mut frames);
        let held = body.held.iter().map(|held| tree.edges[held.joint].child);
        links.extend(
            std::iter::once(body.link)
                .chain(held)
                .map(|link| PlacedLink {
                    name: tree.link_name(link).to_owned(),
                    joint: k.checked_sub(1),
                    rotation: frames[link].rotation,
                    translation: frames[link].translation,
                }),
        );
    }
    links
}

/// What a joint that is held adds to its placement.
fn moved(tree: &Tree, urdf: &urdf_rs::Robot, held: &Held) -> Frame {
    let (mut frame, position) = (Frame::identity(), held.position);
    if position == 0.0 {
        return frame;
    }
    let axis = Vector3::from(urdf.joints[held.joint].axis.xyz.0).normalize();
    if tree.document.joints[held.joint].motion == Motion::Prismatic {
        frame.translation = axis * position;
    } else {
        frame.rotation = Rotation3::new(axis * position).into_inner();
    }
    frame
}

/// Builds the model.
///
/// # Errors
/// [`UrdfError::Invalid`] for a rotor of no joint; [`UrdfError::Option`] for a `rotor_inertia` that
/// does not fit.
pub(super) fn robot_model(
    tree: &Tree,
    bodies: &[Body],
    urdf: &urdf_rs::Robot,
    source: &Source,
    options: &UrdfOptions,
) -> Result<RobotModel, UrdfError> {
    let n_joints = bodies.iter().filter(|body| body.joint.is_some()).count();
    let document = tree.document;
    let refuse = |message: String| source.refuse(document.root_at, "<robot>", message);
    let declared = rotors(tree, source)?;
    let overriding = overriding_rotors(n_joints, source, options)?;
    let mut frames = vec![Frame::identity(); document.links.len()];
    let mut joints = Vec::with_capacity(n_joints);
    for body in bodies {
        // The frame of the link that carries this body is known by now.
        let placed = body.joint.map(|j| {
            (
                j,
                frames[tree.edges[j].parent].compose(&frame(&urdf.joints[j].origin)),
            )
        });
        place(tree, body, urdf, &mut frames);
        let Some((index, placement)) = placed else {
            continue;
        };
        let held = body.held.iter().map(|held| tree.edges[held.joint].child);
        let links: Vec<usize> = std::iter::once(body.link).chain(held).collect();
        let part = |link: usize| (frames[link], declared_params(&urdf.links[link].inertial));
        let phi = lump(links.into_iter().map(part));
        let facts = &document.joints[index];
        let rotor = declared.get(facts.name.as_str());
        let rotor_inertia = match overriding {
            Some(list) => list[joints.len()],
            None => rotor.map_or(0.0, |rotor| rotor.reflected),
        };
        joints.push(Joint {
            name: facts.name.clone(),
            link: tree.link_name(body.link).to_owned(),
            kind: if facts.motion == Motion::Prismatic {
                JointKind::Prismatic
            } else {
                JointKind::Revolute
            },
            rotation: placement.rotation,
            translation: placement.translation,
            axis: Vector3::from(urdf.joints[index].axis.xyz.0).normalize(),
            limits: limits(&urdf.joints[index].limit, facts.acceleration),
            rotor_inertia,
            gear_ratio: rotor.and_then(|rotor| rotor.gear_ratio),
            phi,
        });
    }
    RobotModel::new(
        document.name.clone(),
        joints,
        Vector3::from(options.gravity),
    )
    .map_err(|error| refuse(error.to_string()))
}

fn limits(limit: &urdf_rs::JointLimit, acceleration: f64) -> JointLimits {
    JointLimits {
        lower: limit.lower,
        upper: limit.upper,
        velocity: limit.velocity,
        acceleration,
        effort: limit.effort,
    }
}

fn inertia_matrix(i: &urdf_rs::Inertia) -> Matrix3<f64> {
    Matrix3::new(
        i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz,
    )
}

/// Parameters of a link about its own origin; URDF gives the inertia about the centre, in the inertial frame.
fn declared_params(inertial: &urdf_rs::Inertial) -> LinkParams {
    let inertia = inertia_matrix(&inertial.inertia);
    frame(&inertial.origin).centred(inertial.mass.value, &inertia)
}

/// Rotors by joint name, as the file declares them.
fn rotors<'d>(tree: &Tree<'d>, source: &Source) -> Result<HashMap<&'d str, &'d Rotor>, UrdfError> {
    let document = tree.document;
    if document.rotors.is_empty() {
        return Ok(HashMap::new());
    }
    let names: std::collections::HashSet<&str> = document
        .joints
        .iter()
        .map(|joint| joint.name.as_str())
        .collect();
    let mut declared = HashMap::new();
    for rotor in &document.rotors {
        let refuse = |message| Err(source.refuse(rotor.at, "<drake:rotor_inertia>", message));
        let name = rotor.joint.as_str();
        if !names.contains(name) {
            return refuse(format!(
                "no joint is named \"{}\"; correct <joint name=\"...\"/> of the transmission",
                shorten(name)
            ));
        }
        if declared.insert(name, rotor).is_some() {
            return refuse(format!(
                "a second rotor inertia for joint \"{name}\"; keep one"
            ));
        }
    }
    Ok(declared)
}

fn overriding_rotors<'o>(
    n_joints: usize,
    source: &Source,
    options: &'o UrdfOptions,
) -> Result<Option<&'o [f64]>, UrdfError> {
    let Some(list) = options.rotor_inertia.as_deref() else {
        return Ok(None);
    };
    let refuse = |message| {
        Err(UrdfError::Option {
            file: source.file.to_owned(),
            option: "rotor_inertia",
            message,
        })
    };
    if list.len() != n_joints {
        return refuse(format!(
            "has {} values, expected {n_joints}, one per moving joint",
            list.len()
        ));
    }
    match list.iter().find(|x| !(x.is_finite() && **x >= 0.0)) {
        Some(bad) => refuse(format!(
            "holds {bad}, expected finite numbers of zero or more in kg m^2 (kg)"
        )),
        None => Ok(Some(list)),
    }
}
