//! Inverse dynamics and the joint-torque regressor: one forward pass, one kernel, two ways to project.

use nalgebra::{Matrix3, Rotation3, SVector, Unit, Vector3};

use crate::error::CoreError;
use crate::kernel::{body_regressor, BodyMotion};
use crate::link_params::N_LINK_PARAMS;
use crate::robot::{Joint, JointKind, RobotModel};

/// Scratch for one robot. All memory is taken here.
#[derive(Clone, Debug)]
pub struct Workspace {
    links: Vec<LinkState>,
}

/// Where a link is and how it moves.
#[derive(Clone, Copy, Debug)]
struct LinkState {
    /// Link to parent coordinates.
    rotation: Matrix3<f64>,
    /// Link origin in the parent frame \[m\].
    origin: Vector3<f64>,
    motion: BodyMotion,
    force: Vector3<f64>,
    moment: Vector3<f64>,
}

impl LinkState {
    const REST: Self = Self {
        rotation: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        origin: Vector3::new(0.0, 0.0, 0.0),
        motion: BodyMotion {
            omega: Vector3::new(0.0, 0.0, 0.0),
            alpha: Vector3::new(0.0, 0.0, 0.0),
            acc: Vector3::new(0.0, 0.0, 0.0),
        },
        force: Vector3::new(0.0, 0.0, 0.0),
        moment: Vector3::new(0.0, 0.0, 0.0),
    };
}

impl Workspace {
    /// Scratch for `robot`.
    #[must_use]
    pub fn new(robot: &RobotModel) -> Self {
        Self {
            links: vec![LinkState::REST; robot.n_joints()],
        }
    }
}

/// `Ok` if `slice` has `expected` values.
pub(crate) fn check_length(
    what: &'static str,
    slice: &[f64],
    expected: usize,
) -> Result<(), CoreError> {
    if slice.len() == expected {
        Ok(())
    } else {
        Err(CoreError::Length {
            what,
            expected,
            actual: slice.len(),
        })
    }
}

/// Joint placement at `q`: rotation (link to parent) and origin of the link frame in the parent frame.
#[must_use]
pub fn placement(joint: &Joint, q: f64) -> (Matrix3<f64>, Vector3<f64>) {
    match joint.kind {
        JointKind::Revolute => {
            let turn = Rotation3::from_axis_angle(&Unit::new_unchecked(joint.axis), q);
            (joint.rotation * turn.matrix(), joint.translation)
        }
        JointKind::Prismatic => (
            joint.rotation,
            joint.translation + joint.rotation * (joint.axis * q),
        ),
    }
}

/// Forward pass of Newton and Euler: velocities and accelerations of every link in its own frame, gravity as an upward
/// acceleration of the base.
fn forward_pass(robot: &RobotModel, links: &mut [LinkState], q: &[f64], dq: &[f64], ddq: &[f64]) {
    let mut parent = BodyMotion {
        omega: Vector3::zeros(),
        alpha: Vector3::zeros(),
        acc: -robot.gravity(),
    };
    for (i, (joint, link)) in robot.joints().iter().zip(links).enumerate() {
        let (rotation, origin) = placement(joint, q[i]);
        let to_link = rotation.transpose();
        let carried = parent.acc
            + parent.alpha.cross(&origin)
            + parent.omega.cross(&parent.omega.cross(&origin));
        let mut motion = BodyMotion {
            omega: to_link * parent.omega,
            alpha: to_link * parent.alpha,
            acc: to_link * carried,
        };
        match joint.kind {
            JointKind::Revolute => {
                motion.alpha += motion.omega.cross(&joint.axis) * dq[i] + joint.axis * ddq[i];
                motion.omega += joint.axis * dq[i];
            }
            JointKind::Prismatic => {
                motion.acc += motion.omega.cross(&joint.axis) * (2.0 * dq[i]) + joint.axis * ddq[i];
            }
        }
        link.rotation = rotation;
        link.origin = origin;
        link.motion = motion;
        parent = motion;
    }
}

/// Inverse dynamics `tau = M(q) ddq + C(q, dq) + G(q)` of the links alone (Eq. 1 without friction, contact and residual).
/// `C(q, dq)` is the torque, even in dq (Eq. 3).
///
/// `q, dq, ddq`: n values \[rad, rad/s, rad/s²; m for prismatic joints\]; `phi`: 10 n values in the order of
/// [`crate::link_params`]; `tau`: n values \[N·m; N\]. Linear in `phi`, which need not be physical.
///
/// # Errors
/// [`CoreError::Length`] if a slice has the wrong length.
pub fn inverse_dynamics_into(
    robot: &RobotModel,
    workspace: &mut Workspace,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
    phi: &[f64],
    tau: &mut [f64],
) -> Result<(), CoreError> {
    let n = robot.n_joints();
    check_state(n, workspace, q, dq, ddq)?;
    check_length("phi", phi, N_LINK_PARAMS * n)?;
    check_length("tau", tau, n)?;

    let links = &mut workspace.links;
    forward_pass(robot, links, q, dq, ddq);
    for (link, phi) in links.iter_mut().zip(phi.chunks_exact(N_LINK_PARAMS)) {
        let wrench =
            body_regressor(&link.motion) * SVector::<f64, N_LINK_PARAMS>::from_column_slice(phi);
        link.force = wrench.fixed_rows::<3>(0).into();
        link.moment = wrench.fixed_rows::<3>(3).into();
    }
    for i in (0..n).rev() {
        let LinkState {
            rotation,
            origin,
            force,
            moment,
            ..
        } = links[i];
        let joint = &robot.joints()[i];
        tau[i] = match joint.kind {
            JointKind::Revolute => joint.axis.dot(&moment),
            JointKind::Prismatic => joint.axis.dot(&force),
        };
        if i > 0 {
            let force = rotation * force;
            links[i - 1].force += force;
            links[i - 1].moment += rotation * moment + origin.cross(&force);
        }
    }
    Ok(())
}

/// Joint-torque regressor `Y` with `tau = Y phi` (Eq. 2 for one state).
///
/// `regressor`: n rows of 10 n values, row-major; row j is zero for the links before joint j. Units follow
/// [`inverse_dynamics_into`].
///
/// # Errors
/// [`CoreError::Length`] if a slice has the wrong length.
pub fn joint_torque_regressor_into(
    robot: &RobotModel,
    workspace: &mut Workspace,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
    regressor: &mut [f64],
) -> Result<(), CoreError> {
    let n = robot.n_joints();
    let width = N_LINK_PARAMS * n;
    check_state(n, workspace, q, dq, ddq)?;
    check_length("regressor", regressor, n * width)?;

    let links = &mut workspace.links;
    forward_pass(robot, links, q, dq, ddq);
    regressor.fill(0.0);
    for (i, link) in links.iter().enumerate() {
        let body = body_regressor(&link.motion);
        // Power of link i's wrench on a unit motion of joint j, for every joint that moves the link: walk the twist
        // of each joint outwards instead of the wrench of each link inwards.
        for j in 0..=i {
            let twist = unit_twist(&robot.joints()[j], &links[j + 1..=i]);
            let row = body.tr_mul(&twist);
            let start = j * width + i * N_LINK_PARAMS;
            regressor[start..start + N_LINK_PARAMS].copy_from_slice(row.as_slice());
        }
    }
    Ok(())
}

/// Velocity \[linear; angular\] of the last link of `outward` at unit speed of `joint`, in that link's frame.
/// `outward` are the links after the joint's own; empty for the joint's own link.
fn unit_twist(joint: &Joint, outward: &[LinkState]) -> SVector<f64, 6> {
    let (mut linear, mut angular) = match joint.kind {
        JointKind::Revolute => (Vector3::zeros(), joint.axis),
        JointKind::Prismatic => (joint.axis, Vector3::zeros()),
    };
    for link in outward {
        linear = link
            .rotation
            .tr_mul(&(linear + angular.cross(&link.origin)));
        angular = link.rotation.tr_mul(&angular);
    }
    SVector::<f64, 6>::new(
        linear.x, linear.y, linear.z, angular.x, angular.y, angular.z,
    )
}

fn check_state(
    n: usize,
    workspace: &Workspace,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
) -> Result<(), CoreError> {
    check_length("q", q, n)?;
    check_length("dq", dq, n)?;
    check_length("ddq", ddq, n)?;
    if workspace.links.len() == n {
        Ok(())
    } else {
        Err(CoreError::Length {
            what: "workspace",
            expected: n,
            actual: workspace.links.len(),
        })
    }
}
