//! A MuJoCo model (MJCF) of the chain: bodies, joints, and one motor per joint; every number to its last digit.

use dynid_core::link_params::to_centre;
use dynid_core::physical::PhysicalSet;
use dynid_core::robot::{Joint, JointKind, RobotModel};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use quick_xml::escape::escape;

use crate::urdf::{triple, unlike_any};

/// The chain as MJCF: `physical`'s inertials, rotor inertia as `armature`, viscous friction as `damping`, Coulomb friction
/// as `frictionloss`, and as `gear` of each motor the torque per unit of the model's torque channel, so that what drives a
/// motor (`ctrl`) is a joint torque \[N·m, N\], or a current \[A\] where currents were fitted. Declared efforts are the
/// joints' `actuatorfrcrange`.
#[must_use]
pub fn minimal(robot: &RobotModel, physical: &PhysicalSet) -> String {
    let joints = robot.joints();
    let mut lines = vec![
        format!("<mujoco model=\"{}\">", escape(robot.name())),
        "  <compiler angle=\"radian\" autolimits=\"true\" balanceinertia=\"false\"/>".to_owned(),
        format!("  <option gravity=\"{}\"/>", triple(robot.gravity())),
        "  <worldbody>".to_owned(),
    ];
    let base = unlike_any(robot, "base_link");
    lines.push(format!("    <body name=\"{}\">", escape(base.as_str())));
    for (k, (joint, phi)) in joints.iter().zip(physical.links()).enumerate() {
        let indent = "  ".repeat(k + 3);
        let (mass, centre, i) = to_centre(phi).unwrap_or((0.0, Vector3::zeros(), Matrix3::zeros()));
        let rotation = Rotation3::from_matrix_unchecked(joint.rotation);
        let [x, y, z, w]: [f64; 4] = UnitQuaternion::from_rotation_matrix(&rotation)
            .coords
            .into();
        lines.push(format!(
            "{indent}<body name=\"{}\" pos=\"{}\" quat=\"{w:?} {x:?} {y:?} {z:?}\">",
            escape(joint.link.as_str()),
            triple(&joint.translation)
        ));
        lines.push(format!(
            "{indent}  <inertial pos=\"{}\" mass=\"{mass:?}\" fullinertia=\"{:?} {:?} {:?} {:?} {:?} {:?}\"/>",
            triple(&centre),
            i[(0, 0)],
            i[(1, 1)],
            i[(2, 2)],
            i[(0, 1)],
            i[(0, 2)],
            i[(1, 2)]
        ));
        lines.push(format!(
            "{indent}  <joint name=\"{}\" type=\"{}\" axis=\"{}\"{}{} armature=\"{:?}\" damping=\"{:?}\" frictionloss=\"{:?}\"/>",
            escape(joint.name.as_str()),
            match joint.kind {
                JointKind::Prismatic => "slide",
                JointKind::Revolute => "hinge",
            },
            triple(&joint.axis),
            range(joint),
            force(joint),
            physical.rotor_inertia[k],
            physical.damping[k],
            physical.friction[k]
        ));
    }
    for k in (0..=joints.len()).rev() {
        lines.push(format!("{}</body>", "  ".repeat(k + 2)));
    }
    lines.extend(["  </worldbody>".to_owned(), "  <actuator>".to_owned()]);
    for (joint, gear) in joints.iter().zip(&physical.drive_gain) {
        let name = escape(joint.name.as_str());
        lines.push(format!(
            "    <motor name=\"{name}_motor\" joint=\"{name}\" gear=\"{gear:?}\"/>"
        ));
    }
    lines.extend(["  </actuator>".to_owned(), "</mujoco>".to_owned()]);
    lines.join("\n") + "\n"
}

/// Both bounds, where there are both and a way between them: MuJoCo knows no range with one end.
fn range(joint: &Joint) -> String {
    let (lower, upper) = (joint.limits.lower, joint.limits.upper);
    if lower.is_finite() && upper.is_finite() && lower < upper {
        return format!(" range=\"{lower:?} {upper:?}\"");
    }
    String::new()
}

/// The declared greatest torque, at the joint: a motor's own range would count before its `gear`, in ampere.
fn force(joint: &Joint) -> String {
    let effort = joint.limits.effort;
    if effort.is_finite() && effort > 0.0 {
        return format!(" actuatorfrcrange=\"{:?} {effort:?}\"", -effort);
    }
    String::new()
}
