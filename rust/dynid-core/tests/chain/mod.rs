//! Random serial chains and states for the property tests of `dynid-core` and `dynid-offline`.

#![allow(dead_code)] // each test crate uses its own part

use dynid_core::{Joint, JointKind, JointLimits, LinkParams, RobotModel};
use nalgebra::{Rotation3, Vector3};
use proptest::array::{uniform10, uniform3};
use proptest::collection::vec;
use proptest::prelude::*;

/// A chain with a state: every slice has the length that the chain asks for.
#[derive(Clone, Debug)]
pub struct Case {
    pub robot: RobotModel,
    pub q: Vec<f64>,
    pub dq: Vec<f64>,
    pub ddq: Vec<f64>,
    pub phi: Vec<f64>,
}

pub fn vector3(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    uniform3(-size..size).prop_map(Vector3::from)
}

/// Any rotation, by three odd angles.
pub fn rotation() -> impl Strategy<Value = Rotation3<f64>> {
    uniform3(-3.1..3.1f64).prop_map(|[r, p, y]| Rotation3::from_euler_angles(r, p, y))
}

/// Ten numbers of order one; the torque is linear in them, so they need not be physical.
pub fn link_params() -> impl Strategy<Value = LinkParams> {
    uniform10(-2.0..2.0f64)
}

/// A joint of either kind, placed and turned anyhow, about any axis.
pub fn joint() -> impl Strategy<Value = Joint> {
    let axis =
        vector3(1.0).prop_filter_map("axis too short", |v| (v.norm() > 0.1).then(|| v / v.norm()));
    (any::<bool>(), rotation(), vector3(0.8), axis, link_params()).prop_map(
        |(slides, rotation, translation, axis, phi)| Joint {
            name: "joint".to_owned(),
            link: "link".to_owned(),
            kind: if slides {
                JointKind::Prismatic
            } else {
                JointKind::Revolute
            },
            rotation: rotation.into_inner(),
            translation,
            axis,
            limits: JointLimits::default(),
            rotor_inertia: 0.0,
            gear_ratio: None,
            phi,
        },
    )
}

/// Chains of up to `most` joints under any gravity, with a state of order one.
pub fn case(most: usize) -> impl Strategy<Value = Case> {
    (1..=most).prop_flat_map(|n| {
        let signal = |size: f64| vec(-size..size, n);
        (
            vec(joint(), n),
            vector3(10.0),
            signal(3.1),
            signal(2.0),
            signal(5.0),
        )
            .prop_map(|(joints, gravity, q, dq, ddq)| {
                let robot =
                    RobotModel::new("chain".to_owned(), joints, gravity).expect("a valid chain");
                let phi = robot.phi();
                Case {
                    robot,
                    q,
                    dq,
                    ddq,
                    phi,
                }
            })
    })
}
