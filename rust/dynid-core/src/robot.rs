//! A serial chain: what a robot *is*, without state and without scratch.

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::chain::Placement;
use crate::error::CoreError;
use crate::frames::Frames;
use crate::link_params::LinkParams;

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Turns about its axis; `q` in rad.
    Revolute,
    /// Slides along its axis; `q` in m.
    Prismatic,
}

/// Limits of a joint; infinite where the source gives none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointLimits {
    /// Least position \[rad, m\].
    pub lower: f64,
    /// Greatest position \[rad, m\].
    pub upper: f64,
    /// Greatest speed \[rad/s, m/s\].
    pub velocity: f64,
    /// Greatest acceleration \[rad/s², m/s²\].
    pub acceleration: f64,
    /// Greatest torque or force \[N·m, N\].
    pub effort: f64,
}

impl Default for JointLimits {
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

/// One moving joint and the link behind it. Joint `i` carries link `i`; its parent is link `i - 1`, or the base.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name in the robot file.
    pub name: String,
    /// Name of the link it carries.
    pub link: String,
    /// Revolute or prismatic.
    pub kind: JointKind,
    /// Rotation of the joint frame in the parent link's frame at `q = 0` (maps joint to parent coordinates).
    pub rotation: Matrix3<f64>,
    /// Origin of the joint frame in the parent link's frame \[m\].
    pub translation: Vector3<f64>,
    /// Unit axis in the joint frame.
    pub axis: Vector3<f64>,
    /// Position, speed and effort limits.
    pub limits: JointLimits,
    /// Declared rotor inertia, reflected to the link side (gear ratio squared times the rotor's own) \[kg·m², kg\].
    pub rotor_inertia: f64,
    /// Motor turns per joint turn (rad/m for a sliding joint), positive; `None` where the robot file gives none. No formula
    /// needs it: everything here is on the link side. It is for readers of files whose motor positions are not reduced.
    pub gear_ratio: Option<f64>,
    /// The inertial parameters that the robot file declares for the link; zeros where it declares none.
    pub phi: LinkParams,
}

/// A serial chain of moving joints under gravity. Immutable; shared freely between threads.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotModel {
    name: String,
    joints: Vec<Joint>,
    gravity: Vector3<f64>,
    placements: Vec<Placement>,
    frames: Frames,
}

/// More joints than any arm has; keeps a hostile file from asking for memory.
pub const MAX_JOINTS: usize = 256;

impl RobotModel {
    /// Checks and stores. `gravity` is the acceleration of free fall in the base frame \[m/s²\], e.g. `[0, 0, -9.81]`.
    ///
    /// # Errors
    /// [`CoreError`] if there is no joint, there are more than [`MAX_JOINTS`], a number is not finite (limits may be
    /// infinite), an axis is not of unit length or a rotation is not orthonormal and right-handed to 1e-9.
    pub fn new(name: String, joints: Vec<Joint>, gravity: Vector3<f64>) -> Result<Self, CoreError> {
        if joints.is_empty() || joints.len() > MAX_JOINTS {
            return Err(CoreError::JointCount {
                count: joints.len(),
            });
        }
        if !gravity.iter().all(|x| x.is_finite()) {
            return Err(CoreError::NonFiniteParameter);
        }
        for (index, joint) in joints.iter().enumerate() {
            let numbers = joint
                .translation
                .iter()
                .chain(joint.phi.iter())
                .chain([&joint.rotor_inertia])
                .chain(&joint.gear_ratio);
            if !numbers.into_iter().all(|x| x.is_finite()) {
                return Err(CoreError::NonFiniteParameter);
            }
            let defect = (joint.rotation * joint.rotation.transpose() - Matrix3::identity()).amax();
            // Written so that a NaN fails too.
            let rotation_good = defect <= 1e-9 && joint.rotation.determinant() > 0.0;
            let axis_good = (joint.axis.norm() - 1.0).abs() <= 1e-9;
            if !(rotation_good && axis_good) {
                return Err(CoreError::Geometry { joint: index });
            }
        }
        Ok(Self {
            name,
            placements: joints.iter().map(Placement::new).collect(),
            frames: Frames::new(&joints, &gravity),
            joints,
            gravity,
        })
    }

    /// Name in the robot file.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Joints in chain order.
    #[must_use]
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Where every joint puts its link, prepared for the recursions.
    #[must_use]
    pub fn placements(&self) -> &[Placement] {
        &self.placements
    }

    /// The frames in which inverse dynamics is done.
    #[must_use]
    pub fn frames(&self) -> &Frames {
        &self.frames
    }

    /// Number of moving joints, which is also the number of moving links.
    #[must_use]
    pub fn n_joints(&self) -> usize {
        self.joints.len()
    }

    /// Acceleration of free fall in the base frame \[m/s²\].
    #[must_use]
    pub fn gravity(&self) -> &Vector3<f64> {
        &self.gravity
    }

    /// The same robot under another gravity \[m/s²\]: mounted on a wall, on a ceiling, on the Moon.
    ///
    /// # Errors
    /// [`CoreError::NonFiniteParameter`] if a component is not finite.
    pub fn with_gravity(&self, gravity: Vector3<f64>) -> Result<Self, CoreError> {
        Self::new(self.name.clone(), self.joints.clone(), gravity)
    }

    /// The same robot with one joint frame elsewhere: `offset` \[m\] in the parent link's frame, then turned by
    /// `rotation_vector` \[rad\] in its own frame.
    ///
    /// # Errors
    /// [`CoreError::NonFiniteParameter`] if there is no such joint or a number is not finite.
    pub fn with_joint_moved(
        &self,
        joint: usize,
        offset: Vector3<f64>,
        rotation_vector: Vector3<f64>,
    ) -> Result<Self, CoreError> {
        let mut joints = self.joints.clone();
        let moved = joints
            .get_mut(joint)
            .filter(|_| rotation_vector.iter().all(|x| x.is_finite()))
            .ok_or(CoreError::NonFiniteParameter)?;
        moved.translation += offset;
        moved.rotation *= Rotation3::new(rotation_vector).into_inner();
        Self::new(self.name.clone(), joints, self.gravity)
    }

    /// Declared inertial parameters, ten per link in chain order, length `10 n`.
    #[must_use]
    pub fn phi(&self) -> Vec<f64> {
        self.joints.iter().flat_map(|joint| joint.phi).collect()
    }
}
