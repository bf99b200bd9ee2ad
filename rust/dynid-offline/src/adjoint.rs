//! Exact derivatives of the regressor with respect to the motion, by one reverse sweep over the chain.
//!
//! Link i's block in row j of the regressor is `twist_ji' B(motion_i)`: the power of link i's wrench on a unit motion of
//! joint j, where `B` is the core's kernel. A function of the regressor with gradient `C` (n × 10 n) therefore moves with
//! the motion as
//!
//! ```text
//! L = sum over links i and joints j <= i of  twist_ji' B(motion_i) c_ji
//! ```
//!
//! Twists and motions follow recursions outwards; this file runs them forward, keeps what it needs, and runs them back.
//!
//! The kernel is linear in (alpha, acc) and the quadratic rest depends on omega alone, so a motion splits into parts that
//! add up: what ddq does, what dq does, what gravity does. These are the blocks of Eq. 14, and the recursion carries them
//! side by side (`P = 3`) or summed (`P = 1`).

use dynid_core::dynamics::placement;
use dynid_core::kernel::{body_regressor, BodyMotion, BodyRegressor};
use dynid_core::link_params::{inertia_matrix, LinkParams, N_LINK_PARAMS};
use dynid_core::{JointKind, RobotModel};
use nalgebra::{Matrix3, SVector, Vector3};
use rayon::prelude::*;

use crate::error::OfflineError;

/// All parts summed.
pub(crate) const SUMMED: usize = 1;
/// Acceleration, velocity, gravity.
pub(crate) const SPLIT: usize = 3;

type Vec3 = Vector3<f64>;

/// Linear and angular velocity.
#[derive(Clone, Copy, Debug)]
struct Twist {
    linear: Vec3,
    angular: Vec3,
}

impl Twist {
    const ZERO: Self = Self {
        linear: Vec3::new(0.0, 0.0, 0.0),
        angular: Vec3::new(0.0, 0.0, 0.0),
    };
}

/// Angular velocity, and `P` parts of the accelerations. Also holds their gradients.
#[derive(Clone, Copy, Debug)]
struct Motion<const P: usize> {
    omega: Vec3,
    alpha: [Vec3; P],
    acc: [Vec3; P],
}

impl<const P: usize> Motion<P> {
    const ZERO: Self = Self {
        omega: Vec3::new(0.0, 0.0, 0.0),
        alpha: [Vec3::new(0.0, 0.0, 0.0); P],
        acc: [Vec3::new(0.0, 0.0, 0.0); P],
    };
}

#[derive(Clone, Debug)]
struct Link<const P: usize> {
    /// Link to parent coordinates.
    rotation: Matrix3<f64>,
    /// Link origin in the parent frame, and how it moves with q (prismatic joints).
    origin: Vec3,
    slide: Vec3,
    /// The parent's motion at the link origin, in link coordinates: before the joint adds its own.
    carried: Motion<P>,
    motion: Motion<P>,
    body: [BodyRegressor; P],
    gradient: Motion<P>,
}

/// One robot's scratch for forward and reverse sweeps. All memory is taken in `new`.
#[derive(Clone, Debug)]
pub(crate) struct Sweep<const P: usize> {
    n: usize,
    links: Vec<Link<P>>,
    /// Twist of joint j in link i's frame at `j * n + i`, and its gradient.
    twists: Vec<Twist>,
    twist_gradients: Vec<Twist>,
}

impl<const P: usize> Sweep<P> {
    /// What ddq does.
    pub(crate) const ACCELERATION: usize = 0;
    /// What dq does.
    pub(crate) const VELOCITY: usize = P / 2;
    /// What gravity does.
    pub(crate) const GRAVITY: usize = P - 1;

    pub(crate) fn new(robot: &RobotModel) -> Self {
        let n = robot.n_joints();
        let link = Link {
            rotation: Matrix3::identity(),
            origin: Vec3::zeros(),
            slide: Vec3::zeros(),
            carried: Motion::ZERO,
            motion: Motion::ZERO,
            body: [BodyRegressor::zeros(); P],
            gradient: Motion::ZERO,
        };
        Self {
            n,
            links: vec![link; n],
            twists: vec![Twist::ZERO; n * n],
            twist_gradients: vec![Twist::ZERO; n * n],
        }
    }

    /// Forward: motions, twists and body regressors at one state (n values each).
    pub(crate) fn forward(&mut self, robot: &RobotModel, q: &[f64], dq: &[f64], ddq: &[f64]) {
        let n = self.n;
        let mut parent = Motion::<P>::ZERO;
        parent.acc[Self::GRAVITY] = -robot.gravity();
        for (i, joint) in robot.joints().iter().enumerate() {
            let (rotation, origin) = placement(joint, q[i]);
            let to_link = rotation.transpose();
            let mut carried = Motion {
                omega: to_link * parent.omega,
                ..Motion::ZERO
            };
            for part in 0..P {
                let mut acc = parent.acc[part] + parent.alpha[part].cross(&origin);
                if part == Self::VELOCITY {
                    acc += parent.omega.cross(&parent.omega.cross(&origin));
                }
                carried.alpha[part] = to_link * parent.alpha[part];
                carried.acc[part] = to_link * acc;
            }
            let mut motion = carried;
            let turned = carried.omega.cross(&joint.axis) * dq[i];
            let own = match joint.kind {
                JointKind::Revolute => {
                    motion.omega += joint.axis * dq[i];
                    motion.alpha[Self::VELOCITY] += turned;
                    motion.alpha[Self::ACCELERATION] += joint.axis * ddq[i];
                    Twist {
                        linear: Vec3::zeros(),
                        angular: joint.axis,
                    }
                }
                JointKind::Prismatic => {
                    motion.acc[Self::VELOCITY] += turned * 2.0;
                    motion.acc[Self::ACCELERATION] += joint.axis * ddq[i];
                    Twist {
                        linear: joint.axis,
                        angular: Vec3::zeros(),
                    }
                }
            };
            for j in 0..i {
                let inner = self.twists[j * n + i - 1];
                self.twists[j * n + i] = Twist {
                    linear: to_link * (inner.linear + inner.angular.cross(&origin)),
                    angular: to_link * inner.angular,
                };
            }
            self.twists[i * n + i] = own;

            let link = &mut self.links[i];
            for part in 0..P {
                link.body[part] = body_regressor(&BodyMotion {
                    omega: if part == Self::VELOCITY {
                        motion.omega
                    } else {
                        Vec3::zeros()
                    },
                    alpha: motion.alpha[part],
                    acc: motion.acc[part],
                });
            }
            link.rotation = rotation;
            link.origin = origin;
            link.slide = match joint.kind {
                JointKind::Revolute => Vec3::zeros(),
                JointKind::Prismatic => joint.rotation * joint.axis,
            };
            link.carried = carried;
            link.motion = motion;
            parent = motion;
        }
    }

    /// Row j of the regressor in the columns of link i, one part of it; `j <= i`.
    pub(crate) fn row(&self, part: usize, j: usize, i: usize) -> SVector<f64, N_LINK_PARAMS> {
        let Twist { linear, angular } = self.twists[j * self.n + i];
        let twist = SVector::<f64, 6>::new(
            linear.x, linear.y, linear.z, angular.x, angular.y, angular.z,
        );
        self.links[i].body[part].tr_mul(&twist)
    }

    /// Reverse, after `forward`: gradient of `sum of parts <C_part, Y_part>` with respect to q, dq and ddq (n values each).
    ///
    /// `weights`: `P` matrices C, n × 10 n, row-major; what stands below the links that a joint moves is not read.
    pub(crate) fn reverse(
        &mut self,
        robot: &RobotModel,
        dq: &[f64],
        weights: &[f64],
        gradient: [&mut [f64]; 3],
    ) {
        let n = self.n;
        let [gradient_q, gradient_dq, gradient_ddq] = gradient;
        self.twist_gradients.fill(Twist::ZERO);
        for link in &mut self.links {
            link.gradient = Motion::ZERO;
        }
        for (i, joint) in robot.joints().iter().enumerate().rev() {
            self.collect(i, weights);
            let link = &self.links[i];
            let Motion { omega, alpha, acc } = link.gradient;
            let a = joint.axis;

            // The joint's own terms.
            let mut carried_omega = omega;
            match joint.kind {
                JointKind::Revolute => {
                    let bar = alpha[Self::VELOCITY];
                    gradient_dq[i] = a.dot(&omega) + bar.dot(&link.carried.omega.cross(&a));
                    gradient_ddq[i] = a.dot(&alpha[Self::ACCELERATION]);
                    carried_omega += a.cross(&bar) * dq[i];
                }
                JointKind::Prismatic => {
                    let bar = acc[Self::VELOCITY];
                    gradient_dq[i] = 2.0 * bar.dot(&link.carried.omega.cross(&a));
                    gradient_ddq[i] = a.dot(&acc[Self::ACCELERATION]);
                    carried_omega += a.cross(&bar) * (2.0 * dq[i]);
                }
            }

            // Into the parent's frame: x' = R(q)' x, and d(R' x)/dq = -axis x (R' x) for a turning joint.
            let (rotation, origin) = (link.rotation, link.origin);
            let mut turning = link.carried.omega.cross(&carried_omega);
            let mut moved = Vec3::zeros(); // gradient with respect to the origin
            let mut up = Motion::<P>::ZERO;
            up.omega = rotation * carried_omega;
            let parent = if i > 0 {
                self.links[i - 1].motion
            } else {
                Motion::ZERO
            };
            for part in 0..P {
                turning += link.carried.alpha[part].cross(&alpha[part])
                    + link.carried.acc[part].cross(&acc[part]);
                let bar = rotation * acc[part];
                up.acc[part] = bar;
                up.alpha[part] = rotation * alpha[part] + origin.cross(&bar);
                moved += bar.cross(&parent.alpha[part]);
                if part == Self::VELOCITY {
                    up.omega += centripetal_gradient(&parent.omega, &origin, &bar);
                    moved += parent.omega.cross(&parent.omega.cross(&bar));
                }
            }
            for j in 0..i {
                let (twist, bar) = (self.twists[j * n + i], self.twist_gradients[j * n + i]);
                turning += twist.linear.cross(&bar.linear) + twist.angular.cross(&bar.angular);
                let linear = rotation * bar.linear;
                moved += linear.cross(&self.twists[j * n + i - 1].angular);
                let inner = &mut self.twist_gradients[j * n + i - 1];
                inner.linear += linear;
                inner.angular += rotation * bar.angular + origin.cross(&linear);
            }
            gradient_q[i] = match joint.kind {
                JointKind::Revolute => -a.dot(&turning),
                JointKind::Prismatic => link.slide.dot(&moved),
            };
            if i > 0 {
                let gradient = &mut self.links[i - 1].gradient;
                gradient.omega += up.omega;
                for part in 0..P {
                    gradient.alpha[part] += up.alpha[part];
                    gradient.acc[part] += up.acc[part];
                }
            }
        }
    }

    /// Gradients of link i's own terms `twist_ji' B c_ji` with respect to its motion and the twists of joints j.
    fn collect(&mut self, i: usize, weights: &[f64]) {
        let (n, width) = (self.n, N_LINK_PARAMS * self.n);
        let link = &mut self.links[i];
        for part in 0..P {
            for j in 0..=i {
                let start = (part * n + j) * width + i * N_LINK_PARAMS;
                let mut c: LinkParams = [0.0; N_LINK_PARAMS];
                c.copy_from_slice(&weights[start..start + N_LINK_PARAMS]);
                let wrench = link.body[part] * SVector::<f64, N_LINK_PARAMS>::from(c);
                let bar = &mut self.twist_gradients[j * n + i];
                bar.linear += wrench.fixed_rows::<3>(0);
                bar.angular += wrench.fixed_rows::<3>(3);

                // v . (m a + alpha x h + w x (w x h)) + u . (h x a + I alpha + w x (I w)) for the twist (v, u).
                let Twist { linear, angular } = self.twists[j * n + i];
                let h = Vec3::new(c[1], c[2], c[3]);
                let inertia = inertia_matrix(&c);
                link.gradient.acc[part] += linear * c[0] + angular.cross(&h);
                link.gradient.alpha[part] += h.cross(&linear) + inertia * angular;
                if part == Self::VELOCITY {
                    let omega = link.motion.omega;
                    link.gradient.omega += centripetal_gradient(&omega, &h, &linear)
                        + (inertia * omega).cross(&angular)
                        + inertia * angular.cross(&omega);
                }
            }
        }
    }
}

/// Gradient of `b . (w x (w x p))` with respect to `w`.
fn centripetal_gradient(w: &Vec3, p: &Vec3, b: &Vec3) -> Vec3 {
    b * w.dot(p) + p * w.dot(b) - w * (2.0 * b.dot(p))
}

/// Gradient of `sum over samples of direction . tau` with respect to q, dq and ddq, where tau is the torque of the links
/// with parameters `phi`. Signals and gradients are row-major, n_samples × n; `gradient` holds q, dq, ddq.
///
/// # Errors
/// [`OfflineError::Shape`] if lengths disagree.
pub fn inverse_dynamics_gradient(
    robot: &RobotModel,
    [q, dq, ddq]: [&[f64]; 3],
    phi: &[f64],
    direction: &[f64],
    gradient: [&mut [f64]; 3],
) -> Result<(), OfflineError> {
    let n = robot.n_joints();
    let width = N_LINK_PARAMS * n;
    let length = direction.len();
    let [out_q, out_dq, out_ddq] = gradient;
    if !length.is_multiple_of(n) || phi.len() != width {
        return Err(OfflineError::Shape { what: "direction" });
    }
    let outputs = [out_q.len(), out_dq.len(), out_ddq.len()];
    if [q.len(), dq.len(), ddq.len()] != [length; 3] || outputs != [length; 3] {
        return Err(OfflineError::Shape { what: "motion" });
    }
    out_q
        .par_chunks_mut(n)
        .zip(out_dq.par_chunks_mut(n))
        .zip(out_ddq.par_chunks_mut(n))
        .enumerate()
        .for_each_init(
            || (Sweep::<SUMMED>::new(robot), vec![0.0; n * width]),
            |(sweep, weights), (k, ((out_q, out_dq), out_ddq))| {
                let at = k * n..(k + 1) * n;
                sweep.forward(robot, &q[at.clone()], &dq[at.clone()], &ddq[at.clone()]);
                for (row, along) in weights.chunks_exact_mut(width).zip(&direction[at.clone()]) {
                    for (weight, phi) in row.iter_mut().zip(phi) {
                        *weight = along * phi;
                    }
                }
                sweep.reverse(robot, &dq[at], weights, [out_q, out_dq, out_ddq]);
            },
        );
    Ok(())
}
