//! The arm of the benchmarks.

use dynid_core::{Joint, JointKind, JointLimits, RobotModel};
use nalgebra::{Rotation3, Vector3};

/// A six-axis arm of common shape: every axis turned a quarter from the one before or parallel to it, and joint j leaning by
/// another `tilt` j \[rad\].
pub fn arm(tilt: f64) -> RobotModel {
    let turns = [0.0, 1.0, 0.0, 0.0, 1.0, -1.0].map(|t| t * std::f64::consts::FRAC_PI_2);
    let joints = turns.iter().enumerate().map(|(j, turn)| Joint {
        name: format!("joint {j}"),
        link: format!("link {j}"),
        kind: JointKind::Revolute,
        rotation: Rotation3::from_euler_angles(*turn, tilt * j as f64, 0.0).into_inner(),
        translation: Vector3::new(0.1 * j as f64, -0.05, 0.3),
        axis: Vector3::z(),
        limits: JointLimits::default(),
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi: [2.0, 0.3, -0.1, 0.5, 0.7, 0.02, 0.9, -0.05, 0.04, 1.1],
    });
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    RobotModel::new("arm".to_owned(), joints.collect(), gravity).unwrap()
}
