//! A URDF without an original: links and joints of the chain, and nothing else.

use dynid_core::physical::PhysicalSet;
use dynid_core::robot::{JointKind, JointLimits, RobotModel};
use nalgebra::{Matrix3, Vector3};
use quick_xml::escape::escape;

use super::edit::{dynamics, inertial, triple};

/// Stands for no limit where a number has to: [`super::parse`] reads it as none.
const UNLIMITED: f64 = 1e30;

/// A URDF of the chain alone: links without shapes, joints, inertials, friction, rotor inertias in Drake's notation.
#[must_use]
pub fn minimal(robot: &RobotModel, physical: &PhysicalSet) -> String {
    let mut parent = unlike_any(robot, "base_link");
    let mut lines = vec![
        "<?xml version=\"1.0\"?>".to_owned(),
        format!(
            "<robot name=\"{}\" xmlns:drake=\"http://drake.mit.edu\">",
            escape(robot.name())
        ),
        format!("  <link name=\"{}\"/>", escape(parent.as_str())),
    ];
    for (k, (joint, phi)) in robot.joints().iter().zip(physical.links()).enumerate() {
        let (name, link) = (escape(&joint.name), escape(&joint.link));
        lines.push(format!("  <link name=\"{link}\">"));
        lines.extend(inertial(phi).iter().map(|line| format!("    {line}")));
        lines.push("  </link>".to_owned());
        let limits = &joint.limits;
        let bounded = limits.lower.is_finite() && limits.upper.is_finite();
        let kind = match joint.kind {
            JointKind::Prismatic => "prismatic",
            JointKind::Revolute if bounded => "revolute",
            JointKind::Revolute => "continuous",
        };
        lines.push(format!("  <joint name=\"{name}\" type=\"{kind}\">"));
        lines.push(format!(
            "    <origin xyz=\"{}\" rpy=\"{}\"/>",
            triple(&joint.translation),
            triple(&roll_pitch_yaw(&joint.rotation))
        ));
        lines.push(format!(
            "    <parent link=\"{}\"/>",
            escape(parent.as_str())
        ));
        lines.push(format!("    <child link=\"{link}\"/>"));
        lines.push(format!("    <axis xyz=\"{}\"/>", triple(&joint.axis)));
        lines.extend(limit(limits, kind).map(|line| format!("    {line}")));
        let values = [
            ("damping", physical.damping[k]),
            ("friction", physical.friction[k]),
        ];
        lines.push(format!("    {}", dynamics(values)));
        lines.push("  </joint>".to_owned());
        parent.clone_from(&joint.link);
    }
    for (joint, rotor) in robot.joints().iter().zip(&physical.rotor_inertia) {
        let name = escape(&joint.name);
        lines.extend([
            format!("  <transmission name=\"{name}_transmission\">"),
            "    <type>transmission_interface/SimpleTransmission</type>".to_owned(),
            format!("    <joint name=\"{name}\"/>"),
            format!("    <actuator name=\"{name}_motor\">"),
            format!("      <drake:rotor_inertia value=\"{rotor:?}\"/>"),
            "      <drake:gear_ratio value=\"1.0\"/>".to_owned(),
            "    </actuator>".to_owned(),
            "  </transmission>".to_owned(),
        ]);
    }
    lines.push("</robot>".to_owned());
    lines.join("\n") + "\n"
}

/// A `<limit>` as ROS reads it, which wants every number where it wants one: unless a joint turns on for ever, and of such
/// a joint velocity and effort together.
fn limit(limits: &JointLimits, kind: &str) -> Option<String> {
    let JointLimits {
        lower,
        upper,
        velocity,
        effort,
        ..
    } = *limits;
    let turns_on = kind == "continuous";
    if turns_on && velocity.is_infinite() && effort.is_infinite() {
        return None;
    }
    let numbers = [
        ("lower", lower),
        ("upper", upper),
        ("velocity", velocity),
        ("effort", effort),
    ];
    let first = if turns_on { 2 } else { 0 };
    let written = numbers.iter().skip(first).map(|(name, number)| {
        let number = number.clamp(-UNLIMITED, UNLIMITED);
        format!(" {name}=\"{number:?}\"")
    });
    Some(format!("<limit{}/>", written.collect::<String>()))
}

/// `name`, made longer until no link has it.
pub(crate) fn unlike_any(robot: &RobotModel, name: &str) -> String {
    let taken = |name: &str| robot.joints().iter().any(|joint| joint.link == name);
    let mut free = name.to_owned();
    while taken(&free) {
        free.push('_');
    }
    free
}

/// Angles with `R = Rz(yaw) Ry(pitch) Rx(roll)`, exact beside a pitch of 90 degrees too: there yaw alone says little, and
/// roll is taken from what yaw leaves.
fn roll_pitch_yaw(r: &Matrix3<f64>) -> Vector3<f64> {
    let yaw = r[(1, 0)].atan2(r[(0, 0)]);
    let pitch = (-r[(2, 0)]).atan2(r[(0, 0)].hypot(r[(1, 0)]));
    let (sin, cos) = yaw.sin_cos();
    let roll = (sin * r[(0, 2)] - cos * r[(1, 2)]).atan2(cos * r[(1, 1)] - sin * r[(0, 1)]);
    Vector3::new(roll, pitch, yaw)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    #[test]
    fn angles_give_the_rotation_back_at_any_pitch() {
        let quarter = std::f64::consts::FRAC_PI_2;
        for pitch in [
            0.0,
            0.3,
            -1.2,
            quarter,
            -quarter,
            quarter - 4.9e-12,
            quarter - 1e-8,
            3.0,
        ] {
            for (roll, yaw) in [(0.0, 0.0), (0.4, -2.0), (3.1, 1.0), (-1.5, 0.7)] {
                let rotation = Rotation3::from_euler_angles(roll, pitch, yaw).into_inner();
                let rpy = roll_pitch_yaw(&rotation);
                let back = Rotation3::from_euler_angles(rpy.x, rpy.y, rpy.z).into_inner();
                assert!((back - rotation).amax() < 1e-14, "{roll} {pitch} {yaw}");
            }
        }
    }
}
