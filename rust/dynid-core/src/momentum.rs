//! Generalised momentum of the links, and what changes it besides torques: what a momentum observer needs, without
//! acceleration.

use nalgebra::{SVector, Vector3};

use crate::dynamics::{check_length, placed};
use crate::error::CoreError;
use crate::kernel::{body_regressor, BodyMotion};
use crate::link_params::N_LINK_PARAMS;
use crate::robot::{JointKind, RobotModel};
use crate::slices::{mirror_fields, Mirror};

/// Twist or momentum of one link in its own frame: the part along the axes and the part about them.
#[derive(Clone, Copy, Debug)]
struct Pair {
    linear: Vector3<f64>,
    angular: Vector3<f64>,
}

impl Pair {
    const ZERO: Self = Self {
        linear: Vector3::new(0.0, 0.0, 0.0),
        angular: Vector3::new(0.0, 0.0, 0.0),
    };

    /// Power of a momentum (or wrench) on a twist.
    fn dot(&self, other: &Self) -> f64 {
        self.linear.dot(&other.linear) + self.angular.dot(&other.angular)
    }
}

/// Twists and momenta of every link; taken once.
#[derive(Clone, Debug)]
pub struct MomentumWorkspace {
    twists: Vec<Pair>,
    momenta: Vec<Pair>,
}

impl MomentumWorkspace {
    /// Scratch for `robot`.
    #[must_use]
    pub fn new(robot: &RobotModel) -> Self {
        Self {
            twists: vec![Pair::ZERO; robot.n_joints()],
            momenta: vec![Pair::ZERO; robot.n_joints()],
        }
    }
}

/// `p = M(q) dq` and `C(q, dq)^T dq`, the derivative of the kinetic energy along q, written to `momentum` and `drift` (n values
/// each) \[N·m·s and N·m; N·s and N\]. Linear in `phi`, which need not be physical.
///
/// With S_i the joint's unit twist, v_i the link's twist and h_i the momentum of all that the joint carries, in the link's
/// frame: `p_i = S_i · h_i`, and because turning all that the joint carries is seen from there as turning its base back,
/// `(C^T dq)_i = (v_i x S_i) · h_i`.
///
/// # Errors
/// [`CoreError::Length`] if a slice has the wrong length.
pub fn momentum_into(
    robot: &RobotModel,
    workspace: &mut MomentumWorkspace,
    q: &[f64],
    dq: &[f64],
    phi: &[f64],
    momentum: &mut [f64],
    drift: &mut [f64],
) -> Result<(), CoreError> {
    let n = robot.n_joints();
    check_length("q", q, n)?;
    check_length("dq", dq, n)?;
    check_length("phi", phi, N_LINK_PARAMS * n)?;
    check_length("momentum", momentum, n)?;
    check_length("drift", drift, n)?;
    let MomentumWorkspace { twists, momenta } = workspace;

    let mut parent = Pair::ZERO;
    let links = twists.iter_mut().zip(momenta.iter_mut());
    let joints = robot.joints().iter().zip(robot.placements());
    let state = joints.zip(q.iter().zip(dq));
    let phi = phi.as_chunks::<N_LINK_PARAMS>().0;
    for ((((joint, place), (q, dq)), (twist, momentum)), phi) in state.zip(links).zip(phi) {
        let (rotation, origin) = placed(place, *q);
        *twist = Pair {
            linear: rotation.tr_mul(&(parent.linear + parent.angular.cross(&origin))),
            angular: rotation.tr_mul(&parent.angular),
        };
        match joint.kind {
            JointKind::Revolute => twist.angular += joint.axis * *dq,
            JointKind::Prismatic => twist.linear += joint.axis * *dq,
        }
        // Momentum is to velocity what the wrench is to acceleration, for a body that starts from rest.
        let start = BodyMotion {
            omega: Vector3::zeros(),
            alpha: twist.angular,
            acc: twist.linear,
        };
        let h = body_regressor(&start) * SVector::<f64, N_LINK_PARAMS>::from(*phi);
        *momentum = Pair {
            linear: Vector3::new(h.x, h.y, h.z),
            angular: Vector3::new(h.w, h.a, h.b),
        };
        parent = *twist;
    }

    let mut carried = Pair::ZERO; // by the joint behind, in this link's frame
    let links = twists.iter().zip(momenta.iter());
    let outputs = momentum.iter_mut().zip(drift.iter_mut());
    let joints = robot.joints().iter().zip(robot.placements()).zip(q);
    for ((((joint, place), q), (twist, own)), (momentum, drift)) in
        joints.zip(links).zip(outputs).rev()
    {
        let whole = Pair {
            linear: own.linear + carried.linear,
            angular: own.angular + carried.angular,
        };
        let (unit, crossed) = match joint.kind {
            JointKind::Revolute => (
                Pair {
                    angular: joint.axis,
                    ..Pair::ZERO
                },
                Pair {
                    linear: twist.linear.cross(&joint.axis),
                    angular: twist.angular.cross(&joint.axis),
                },
            ),
            JointKind::Prismatic => (
                Pair {
                    linear: joint.axis,
                    ..Pair::ZERO
                },
                Pair {
                    linear: twist.angular.cross(&joint.axis),
                    ..Pair::ZERO
                },
            ),
        };
        *momentum = unit.dot(&whole);
        *drift = crossed.dot(&whole);
        let (rotation, origin) = placed(place, *q);
        let linear = rotation * whole.linear;
        carried = Pair {
            linear,
            angular: rotation * whole.angular + origin.cross(&linear),
        };
    }
    Ok(())
}

impl Mirror for MomentumWorkspace {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(self, of; twists, momenta; copied; kept);
    }
}
