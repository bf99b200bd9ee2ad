//! A joint along an axis of its frames goes another way than one that is a hair off it, and must feel the same; torques go
//! another way than the regressor.

use std::f64::consts::FRAC_PI_2;

use dynid_core::{
    inverse_dynamics_into, joint_torque_regressor_into, Joint, JointKind, JointLimits, RobotModel,
    Workspace,
};
use nalgebra::{Rotation3, Unit, Vector3};

const N: usize = 3;
/// Turns a joint off the axis, \[rad\].
const HAIR: f64 = 1e-10;
const TOLERANCE: f64 = 1e-7;

/// Three equal joints, none of them along the base's axes by chance alone.
fn robot(axis: Vector3<f64>, rotation: Rotation3<f64>) -> RobotModel {
    let joints = (0..N).map(|j| Joint {
        name: format!("joint {j}"),
        link: format!("link {j}"),
        kind: JointKind::Revolute,
        rotation: rotation.into_inner(),
        translation: Vector3::new(0.1 * j as f64, -0.05, 0.3),
        axis,
        limits: JointLimits::default(),
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi: [2.0, 0.3, -0.1, 0.5, 0.7, 0.02, 0.9, -0.05, 0.04, 1.1],
    });
    let gravity = Vector3::new(1.0, -2.0, -9.0);
    RobotModel::new("arm".to_owned(), joints.collect(), gravity).expect("a robot")
}

/// Torques, then the regressor.
fn answer(robot: &RobotModel) -> Vec<f64> {
    answer_in(&mut Workspace::new(robot), robot)
}

fn answer_in(workspace: &mut Workspace, robot: &RobotModel) -> Vec<f64> {
    let (q, dq, ddq) = ([0.7, -1.1, 2.3], [0.9, 1.3, -0.6], [-2.0, 0.4, 1.7]);
    let mut tau = vec![0.0; N];
    let mut regressor = vec![0.0; 10 * N * N];
    let phi = robot.phi();
    inverse_dynamics_into(robot, workspace, &q, &dq, &ddq, &phi, &mut tau).expect("lengths");
    joint_torque_regressor_into(robot, workspace, &q, &dq, &ddq, &mut regressor).expect("lengths");
    tau.extend(regressor);
    tau
}

fn same(one: &RobotModel, other: &RobotModel, what: &str) {
    for (k, (x, y)) in answer(one).into_iter().zip(answer(other)).enumerate() {
        assert!((x - y).abs() < TOLERANCE, "{what}, number {k}: {x} and {y}");
    }
}

#[test]
fn a_joint_along_an_axis_feels_what_one_beside_it_feels() {
    for axis in (0..3).flat_map(|k| [Vector3::ith(k, 1.0), Vector3::ith(k, -1.0)]) {
        let beside = Unit::new_normalize(axis + Vector3::new(HAIR, -HAIR, HAIR)).into_inner();
        assert_ne!(axis, beside);
        for turns in 0..64 {
            let angle = |k: u32| FRAC_PI_2 * f64::from((turns >> (2 * k)) & 3);
            let quarters = Rotation3::from_euler_angles(angle(0), angle(1), angle(2));
            let what = format!("axis {axis:?}, quarters {turns}");
            same(&robot(axis, quarters), &robot(beside, quarters), &what);
            // In the plane across the axis any angle will do.
            let about = Rotation3::from_axis_angle(&Unit::new_unchecked(axis), 0.4);
            let turned = quarters * about;
            same(&robot(axis, turned), &robot(beside, turned), &what);
            // Only the link's frame knows this one.
            let askew = Rotation3::from_euler_angles(0.3, -0.2, 0.1) * quarters;
            same(&robot(axis, askew), &robot(beside, askew), &what);
        }
    }
}

/// The two are computed in other frames and by other sums. One workspace goes through all robots: what it keeps of one must
/// not be taken for the next.
#[test]
fn torques_are_those_of_the_regressor() {
    let mut workspace = None;
    for kinds in 0..8 {
        for (axis, turn) in [
            (0, 0.0),
            (1, FRAC_PI_2),
            (2, 0.3),
            (0, -FRAC_PI_2),
            (1, 1e-9),
        ] {
            let drawn = robot(
                Vector3::ith(axis, if kinds % 3 == 1 { -1.0 } else { 1.0 }),
                Rotation3::from_euler_angles(turn, 0.5 * turn, -turn),
            );
            let joints = drawn.joints().iter().cloned().enumerate();
            let joints = joints.map(|(j, mut joint)| {
                if kinds >> j & 1 == 1 {
                    joint.kind = JointKind::Prismatic;
                }
                joint
            });
            let robot = RobotModel::new("arm".to_owned(), joints.collect(), *drawn.gravity())
                .expect("a robot");
            let workspace = workspace.get_or_insert_with(|| Workspace::new(&robot));
            let answer = answer_in(workspace, &robot);
            let (tau, regressor) = answer.split_at(N);
            for (j, (tau, row)) in tau.iter().zip(regressor.chunks_exact(10 * N)).enumerate() {
                let of_row: f64 = row.iter().zip(robot.phi()).map(|(y, phi)| y * phi).sum();
                assert!(
                    (tau - of_row).abs() < 1e-11 * (1.0 + of_row.abs()),
                    "kinds {kinds}, axis {axis}, turn {turn}, joint {j}: {tau} and {of_row}"
                );
            }
        }
    }
}
