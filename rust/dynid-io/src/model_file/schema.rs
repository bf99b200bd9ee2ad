//! The shape of `model.json`, and the way between it and a [`TorqueModel`].
//!
//! Primary facts only. Unknown fields are refused; infinite limits are written as null; everything else is finite.

use dynid_core::model::TorqueModelParts;
use dynid_core::{
    Domain, EncoderError, ErrorBand, Joint, JointKind, JointLimits, PhysicalSet, RobotModel,
    TorqueModel,
};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::effect_part::EffectPart;
use super::residual_part::ResidualPart;
use super::OF_MOTOR;

/// The whole file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    format: String,
    version: u32,
    checksum: String,
    torque_unit: String,
    robot: RobotPart,
    phi: Vec<[f64; 10]>,
    torque_scale: Vec<f64>,
    effects: Vec<EffectPart>,
    residual: Option<ResidualPart>,
    encoder_delay: Vec<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    encoder_error: Option<EncoderErrorPart>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    torque_delay: Option<DelayPart>,
    noise_std: Vec<f64>,
    domain: DomainPart,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    step: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    band: Option<BandPart>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    physical: Option<PhysicalPart>,
}

/// Where errors are told; absent in files of version 1.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BandPart {
    cutoff: f64,
    rate: f64,
    standstill: bool,
}

/// How late torque channels are: all together, or since version 5 each.
#[derive(Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "torque_delay is no number and no list of one per joint"
)]
enum DelayPart {
    All(f64),
    Each(Vec<f64>),
}

impl DelayPart {
    /// Absent where no channel is late or early.
    fn from_delays(delays: &[f64]) -> Option<Self> {
        let first = *delays.first()?;
        if delays.iter().any(|delay| *delay != first) {
            return Some(Self::Each(delays.to_vec()));
        }
        (first != 0.0).then_some(Self::All(first))
    }

    fn into_delays(self, n: usize) -> Vec<f64> {
        match self {
            Self::All(delay) => vec![delay; n],
            Self::Each(delays) => delays,
        }
    }
}

/// What encoders show too much; absent where they are right.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct EncoderErrorPart {
    sides: SidesPart,
    /// Cosine and sine part per joint.
    cos_sin: Vec<[f64; 2]>,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum SidesPart {
    Link,
    Both,
}

/// A physically consistent set; absent in most files.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PhysicalPart {
    phi: Vec<[f64; 10]>,
    rotor_inertia: Vec<f64>,
    damping: Vec<f64>,
    friction: Vec<f64>,
    drive_gain: Vec<f64>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RobotPart {
    name: String,
    gravity: [f64; 3],
    joints: Vec<JointPart>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct JointPart {
    name: String,
    link: String,
    kind: KindPart,
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
    axis: [f64; 3],
    lower: Option<f64>,
    upper: Option<f64>,
    velocity: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    acceleration: Option<f64>,
    effort: Option<f64>,
    rotor_inertia: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    gear_ratio: Option<f64>,
    phi: [f64; 10],
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum KindPart {
    Revolute,
    Prismatic,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct DomainPart {
    q: Vec<[f64; 2]>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
}

impl ModelFile {
    /// What is written for `model`.
    pub fn from_model(model: &TorqueModel, format: &str, version: u32, checksum: String) -> Self {
        Self {
            format: format.to_owned(),
            version,
            checksum,
            torque_unit: model.torque_unit().to_owned(),
            robot: RobotPart::from_robot(model.robot()),
            phi: tens(model.phi()),
            torque_scale: model.torque_scale().to_vec(),
            effects: model.effects().iter().map(EffectPart::from_term).collect(),
            residual: model.residual().map(ResidualPart::from_residual),
            encoder_delay: model.encoder_delay().to_vec(),
            encoder_error: model.encoder_error().map(|error| EncoderErrorPart {
                sides: if error.both_sides {
                    SidesPart::Both
                } else {
                    SidesPart::Link
                },
                cos_sin: error.cos_sin.clone(),
            }),
            torque_delay: DelayPart::from_delays(model.torque_delay()),
            noise_std: model.noise_std().to_vec(),
            domain: DomainPart {
                q: model.domain().q.clone(),
                dq: model.domain().dq.clone(),
                ddq: model.domain().ddq.clone(),
            },
            step: model.step(),
            band: model.band().map(|band| BandPart {
                cutoff: band.cutoff,
                rate: band.rate,
                standstill: band.standstill,
            }),
            physical: model.physical().map(|set| PhysicalPart {
                phi: tens(&set.phi),
                rotor_inertia: set.rotor_inertia.clone(),
                damping: set.damping.clone(),
                friction: set.friction.clone(),
                drive_gain: set.drive_gain.clone(),
            }),
        }
    }

    /// # Errors
    /// A sentence if the file holds an effect that meant something else when it was written.
    pub fn check_meaning(&self) -> Result<(), String> {
        let mut kinds = self.effects.iter().map(EffectPart::kind);
        if self.version < 3 && kinds.any(|kind| kind == OF_MOTOR) {
            return Err(format!(
                "{OF_MOTOR} in a file of version {} follows the rigid body's torque alone, and here it follows the motor's \
                 whole torque; fit the model to its runs again",
                self.version
            ));
        }
        Ok(())
    }

    /// The model, every length and number checked.
    pub fn into_model(self) -> Result<TorqueModel, String> {
        for (name, there) in [
            ("torque_delay", self.torque_delay.is_some()),
            ("band", self.band.is_some()),
        ] {
            if self.version < 2 && there {
                return Err(format!("a file of version 1 has no {name}"));
            }
        }
        if self.version < 5 && matches!(self.torque_delay, Some(DelayPart::Each(_))) {
            return Err(format!(
                "a file of version {} has one torque_delay for all joints",
                self.version
            ));
        }
        let newer =
            |part: &EffectPart| Some((part.kind().to_owned(), part.since_version_6()?.to_owned()));
        if let (1..6, Some((kind, name))) = (self.version, self.effects.iter().find_map(newer)) {
            return Err(format!(
                "a file of version {} has no {name} in {kind}",
                self.version
            ));
        }
        let robot = self.robot.into_robot()?;
        let n = robot.n_joints();
        let effects = self
            .effects
            .into_iter()
            .map(|effect| effect.into_term(n))
            .collect::<Result<_, _>>()?;
        let residual = self.residual.map(ResidualPart::into_residual).transpose()?;
        let model = TorqueModel::new(TorqueModelParts {
            robot,
            phi: self.phi.into_iter().flatten().collect(),
            torque_scale: self.torque_scale,
            effects,
            residual,
            encoder_delay: self.encoder_delay,
            noise_std: self.noise_std,
            domain: Domain {
                q: self.domain.q,
                dq: self.domain.dq,
                ddq: self.domain.ddq,
            },
            torque_unit: self.torque_unit,
            step: self.step,
        })
        .map_err(|e| e.to_string())?;
        let model = match self.encoder_error {
            None => model,
            Some(part) => model
                .with_encoder_error(EncoderError {
                    cos_sin: part.cos_sin,
                    both_sides: matches!(part.sides, SidesPart::Both),
                })
                .map_err(|e| e.to_string())?,
        };
        let model = match self.torque_delay {
            None => model,
            Some(part) => model
                .with_torque_delay(&part.into_delays(n))
                .map_err(|e| e.to_string())?,
        };
        let model = match self.band {
            None => model,
            Some(part) => model
                .with_band(ErrorBand {
                    cutoff: part.cutoff,
                    rate: part.rate,
                    standstill: part.standstill,
                })
                .map_err(|e| e.to_string())?,
        };
        match self.physical {
            None => Ok(model),
            Some(part) => model
                .with_physical(PhysicalSet {
                    phi: part.phi.into_iter().flatten().collect(),
                    rotor_inertia: part.rotor_inertia,
                    damping: part.damping,
                    friction: part.friction,
                    drive_gain: part.drive_gain,
                })
                .map_err(|e| e.to_string()),
        }
    }
}

fn tens(phi: &[f64]) -> Vec<[f64; 10]> {
    phi.as_chunks::<10>().0.to_vec()
}

fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}

impl RobotPart {
    pub(super) fn from_robot(robot: &RobotModel) -> Self {
        Self {
            name: robot.name().to_owned(),
            gravity: (*robot.gravity()).into(),
            joints: robot.joints().iter().map(JointPart::from_joint).collect(),
        }
    }

    pub(super) fn into_robot(self) -> Result<RobotModel, String> {
        let joints = self.joints.into_iter().map(JointPart::into_joint).collect();
        RobotModel::new(self.name, joints, Vector3::from(self.gravity))
            .map_err(|e| format!("robot: {e}"))
    }
}

impl JointPart {
    fn from_joint(joint: &Joint) -> Self {
        Self {
            name: joint.name.clone(),
            link: joint.link.clone(),
            kind: match joint.kind {
                JointKind::Revolute => KindPart::Revolute,
                JointKind::Prismatic => KindPart::Prismatic,
            },
            rotation: joint.rotation.transpose().into(), // rows in the file
            translation: joint.translation.into(),
            axis: joint.axis.into(),
            lower: finite(joint.limits.lower),
            upper: finite(joint.limits.upper),
            velocity: finite(joint.limits.velocity),
            acceleration: finite(joint.limits.acceleration),
            effort: finite(joint.limits.effort),
            rotor_inertia: joint.rotor_inertia,
            gear_ratio: joint.gear_ratio,
            phi: joint.phi,
        }
    }

    fn into_joint(self) -> Joint {
        Joint {
            name: self.name,
            link: self.link,
            kind: match self.kind {
                KindPart::Revolute => JointKind::Revolute,
                KindPart::Prismatic => JointKind::Prismatic,
            },
            rotation: Matrix3::from(self.rotation).transpose(),
            translation: Vector3::from(self.translation),
            axis: Vector3::from(self.axis),
            limits: JointLimits {
                lower: self.lower.unwrap_or(f64::NEG_INFINITY),
                upper: self.upper.unwrap_or(f64::INFINITY),
                velocity: self.velocity.unwrap_or(f64::INFINITY),
                acceleration: self.acceleration.unwrap_or(f64::INFINITY),
                effort: self.effort.unwrap_or(f64::INFINITY),
            },
            rotor_inertia: self.rotor_inertia,
            gear_ratio: self.gear_ratio,
            phi: self.phi,
        }
    }
}
