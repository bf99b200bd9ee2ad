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
//! side by side (`P = 3`) or summed (`P = 1`). Samples stand in lanes.

use dynid_core::chain::{JointState, Turn};
use dynid_core::kernel::Body;
use dynid_core::lanes::{self, Kernel, Lanes, Matrix, Vector};
use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::{JointKind, RobotModel};
use rayon::prelude::*;

use crate::error::OfflineError;
use crate::rows::{gather, lane_samples, put, StateRows};

/// All parts summed.
pub(crate) const SUMMED: usize = 1;
/// Acceleration, velocity, gravity.
pub(crate) const SPLIT: usize = 3;

/// Linear and angular velocity.
#[derive(Clone, Copy)]
struct Twist<L> {
    linear: Vector<L>,
    angular: Vector<L>,
}

impl<L: Lanes> Twist<L> {
    #[inline(always)]
    fn zero() -> Self {
        Self {
            linear: Vector::zero(),
            angular: Vector::zero(),
        }
    }
}

/// Angular velocity, and `P` parts of the accelerations. Also holds their gradients.
#[derive(Clone, Copy)]
struct Motion<L, const P: usize> {
    omega: Vector<L>,
    alpha: [Vector<L>; P],
    acc: [Vector<L>; P],
}

impl<L: Lanes, const P: usize> Motion<L, P> {
    #[inline(always)]
    fn zero() -> Self {
        Self {
            omega: Vector::zero(),
            alpha: [Vector::zero(); P],
            acc: [Vector::zero(); P],
        }
    }
}

#[derive(Clone, Copy)]
struct Link<L, const P: usize> {
    /// Link to parent coordinates.
    turn: Turn<L>,
    /// Link origin in the parent frame.
    origin: Vector<L>,
    dq: L,
    /// The parent's motion at the link origin, in link coordinates: before the joint adds its own.
    carried: Motion<L, P>,
    motion: Motion<L, P>,
    body: [Body<L>; P],
    gradient: Motion<L, P>,
}

/// One robot's scratch for forward and reverse sweeps. All memory is taken in `new`.
pub(crate) struct Sweep<L, const P: usize> {
    n: usize,
    links: Vec<Link<L, P>>,
    /// Twist of joint j in link i's frame at `j * n + i`, and its gradient.
    twists: Vec<Twist<L>>,
    twist_gradients: Vec<Twist<L>>,
}

impl<L: Lanes, const P: usize> Sweep<L, P> {
    /// What ddq does.
    pub(crate) const ACCELERATION: usize = 0;
    /// What dq does.
    pub(crate) const VELOCITY: usize = P / 2;
    /// What gravity does.
    pub(crate) const GRAVITY: usize = P - 1;

    #[inline(always)]
    pub(crate) fn new(robot: &RobotModel) -> Self {
        let n = robot.n_joints();
        let zero = Vector::zero();
        let link = Link {
            turn: Turn::zero(),
            origin: zero,
            dq: L::splat(0.0),
            carried: Motion::zero(),
            motion: Motion::zero(),
            body: [Body::new(zero, zero, zero); P],
            gradient: Motion::zero(),
        };
        Self {
            n,
            links: vec![link; n],
            twists: vec![Twist::zero(); n * n],
            twist_gradients: vec![Twist::zero(); n * n],
        }
    }

    /// Forward: motions, twists and bodies at one row of states (one entry per joint).
    #[inline(always)]
    pub(crate) fn forward(&mut self, robot: &RobotModel, states: &[JointState<L::Raw>]) {
        let n = self.n;
        let mut parent = Motion::<L, P>::zero();
        let g = robot.gravity();
        parent.acc[Self::GRAVITY] = Vector::splat(&[-g.x, -g.y, -g.z]);
        for (i, (place, state)) in robot.placements().iter().zip(states).enumerate() {
            let turn = place.turn(L::from_raw(state.sin), L::from_raw(state.cos));
            let origin = place.origin(L::from_raw(state.q));
            let (dq, ddq) = (L::from_raw(state.dq), L::from_raw(state.ddq));
            let mut carried = Motion::zero();
            [carried.omega] = place.to_link(&turn, [parent.omega]);
            for part in 0..P {
                let mut acc = parent.alpha[part].cross_add(origin, parent.acc[part]);
                if part == Self::VELOCITY {
                    acc = parent.omega.cross_add(parent.omega.cross(origin), acc);
                }
                [carried.alpha[part], carried.acc[part]] =
                    place.to_link(&turn, [parent.alpha[part], acc]);
            }
            let mut motion = carried;
            let turned = place.cross_axis(carried.omega);
            match place.kind {
                JointKind::Revolute => {
                    motion.omega = place.along_axis(motion.omega, dq);
                    let alpha = &mut motion.alpha;
                    alpha[Self::VELOCITY] = turned.mul_add(dq, alpha[Self::VELOCITY]);
                    alpha[Self::ACCELERATION] = place.along_axis(alpha[Self::ACCELERATION], ddq);
                }
                JointKind::Prismatic => {
                    let acc = &mut motion.acc;
                    acc[Self::VELOCITY] = turned.mul_add(dq + dq, acc[Self::VELOCITY]);
                    acc[Self::ACCELERATION] = place.along_axis(acc[Self::ACCELERATION], ddq);
                }
            }
            for j in 0..i {
                let inner = self.twists[j * n + i - 1];
                let linear = inner.angular.cross_add(origin, inner.linear);
                let [linear, angular] = place.to_link(&turn, [linear, inner.angular]);
                self.twists[j * n + i] = Twist { linear, angular };
            }
            let [linear, angular] = place.own_twist();
            self.twists[i * n + i] = Twist { linear, angular };

            let link = &mut self.links[i];
            for part in 0..P {
                let omega = if part == Self::VELOCITY {
                    motion.omega
                } else {
                    Vector::zero()
                };
                link.body[part] = Body::new(omega, motion.alpha[part], motion.acc[part]);
            }
            link.turn = turn;
            link.origin = origin;
            link.dq = dq;
            link.carried = carried;
            link.motion = motion;
            parent = motion;
        }
    }

    /// Row j of the regressor in the columns of link i, one part of it; `j <= i`.
    #[inline(always)]
    pub(crate) fn row(&self, part: usize, j: usize, i: usize) -> [L; N_LINK_PARAMS] {
        let Twist { linear, angular } = self.twists[j * self.n + i];
        self.links[i].body[part].power(linear, angular)
    }

    /// Reverse, after `forward`: gradient of `sum of parts <C_part, Y_part>` with respect to q, dq and ddq (n rows each).
    ///
    /// `weights`: `P` matrices C, n × 10 n, row-major; what stands below the links that a joint moves is not read.
    #[inline(always)]
    pub(crate) fn reverse(
        &mut self,
        robot: &RobotModel,
        weights: &[L::Raw],
        gradient: [&mut [L::Raw]; 3],
    ) {
        let n = self.n;
        let [gradient_q, gradient_dq, gradient_ddq] = gradient;
        self.twist_gradients.fill(Twist::zero());
        for link in &mut self.links {
            link.gradient = Motion::zero();
        }
        for (i, place) in robot.placements().iter().enumerate().rev() {
            self.collect(i, weights);
            let link = &self.links[i];
            let (Motion { omega, alpha, acc }, dq) = (link.gradient, link.dq);
            let a = Vector::splat(&place.axis);

            // The joint's own terms.
            let turned = place.cross_axis(link.carried.omega);
            let (of_dq, of_ddq, carried_omega) = match place.kind {
                JointKind::Revolute => {
                    let bar = alpha[Self::VELOCITY];
                    (
                        bar.dot_add(turned, a.dot(omega)),
                        a.dot(alpha[Self::ACCELERATION]),
                        a.cross(bar).mul_add(dq, omega),
                    )
                }
                JointKind::Prismatic => {
                    let bar = acc[Self::VELOCITY];
                    let once = bar.dot(turned);
                    (
                        once + once,
                        a.dot(acc[Self::ACCELERATION]),
                        a.cross(bar).mul_add(dq + dq, omega),
                    )
                }
            };
            gradient_dq[i] = of_dq.raw();
            gradient_ddq[i] = of_ddq.raw();

            // Into the parent's frame: x' = R(q)' x, and d(R' x)/dq = -axis x (R' x) for a turning joint.
            let (turn, origin) = (link.turn, link.origin);
            let mut turning = link.carried.omega.cross(carried_omega);
            let mut moved = Vector::zero(); // gradient with respect to the origin
            let mut up = Motion::<L, P>::zero();
            [up.omega] = place.to_parent(&turn, [carried_omega]);
            let parent = if i > 0 {
                self.links[i - 1].motion
            } else {
                Motion::zero()
            };
            for part in 0..P {
                turning = link.carried.alpha[part].cross_add(alpha[part], turning);
                turning = link.carried.acc[part].cross_add(acc[part], turning);
                let [bar, turned] = place.to_parent(&turn, [acc[part], alpha[part]]);
                up.acc[part] = bar;
                up.alpha[part] = origin.cross_add(bar, turned);
                moved = bar.cross_add(parent.alpha[part], moved);
                if part == Self::VELOCITY {
                    up.omega = up.omega + centripetal_gradient(parent.omega, origin, bar);
                    moved = parent.omega.cross_add(parent.omega.cross(bar), moved);
                }
            }
            for j in 0..i {
                let (twist, bar) = (self.twists[j * n + i], self.twist_gradients[j * n + i]);
                turning = twist.linear.cross_add(bar.linear, turning);
                turning = twist.angular.cross_add(bar.angular, turning);
                let [linear, angular] = place.to_parent(&turn, [bar.linear, bar.angular]);
                moved = linear.cross_add(self.twists[j * n + i - 1].angular, moved);
                let inner = &mut self.twist_gradients[j * n + i - 1];
                inner.linear = inner.linear + linear;
                inner.angular = inner.angular + origin.cross_add(linear, angular);
            }
            gradient_q[i] = match place.kind {
                JointKind::Revolute => -a.dot(turning),
                JointKind::Prismatic => place.slide().dot(moved),
            }
            .raw();
            if i > 0 {
                let gradient = &mut self.links[i - 1].gradient;
                gradient.omega = gradient.omega + up.omega;
                for part in 0..P {
                    gradient.alpha[part] = gradient.alpha[part] + up.alpha[part];
                    gradient.acc[part] = gradient.acc[part] + up.acc[part];
                }
            }
        }
    }

    /// Gradients of link i's own terms `twist_ji' B c_ji` with respect to its motion and the twists of joints j.
    #[inline(always)]
    fn collect(&mut self, i: usize, weights: &[L::Raw]) {
        let (n, width) = (self.n, N_LINK_PARAMS * self.n);
        let link = &mut self.links[i];
        for part in 0..P {
            for j in 0..=i {
                let start = (part * n + j) * width + i * N_LINK_PARAMS;
                let mut c = [L::splat(0.0); N_LINK_PARAMS];
                for (c, raw) in c.iter_mut().zip(&weights[start..start + N_LINK_PARAMS]) {
                    *c = L::from_raw(*raw);
                }
                let (force, moment) = link.body[part].wrench_of(&c);
                let bar = &mut self.twist_gradients[j * n + i];
                bar.linear = bar.linear + force;
                bar.angular = bar.angular + moment;

                // v . (m a + alpha x h + w x (w x h)) + u . (h x a + I alpha + w x (I w)) for the twist (v, u).
                let Twist { linear, angular } = self.twists[j * n + i];
                let h = Vector([c[1], c[2], c[3]]);
                let inertia = inertia_matrix(&c);
                let Motion { omega, alpha, acc } = &mut link.gradient;
                acc[part] = acc[part] + angular.cross_add(h, linear * c[0]);
                alpha[part] = alpha[part] + h.cross_add(linear, inertia * angular);
                if part == Self::VELOCITY {
                    let own = link.motion.omega;
                    let turned = (inertia * own).cross_add(angular, inertia * angular.cross(own));
                    *omega = *omega + centripetal_gradient(own, h, linear) + turned;
                }
            }
        }
    }
}

/// Inertia about the origin of ten parameters.
#[inline(always)]
fn inertia_matrix<L: Lanes>(c: &[L; N_LINK_PARAMS]) -> Matrix<L> {
    let [_, _, _, _, xx, xy, yy, xz, yz, zz] = *c;
    Matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
}

/// Gradient of `b . (w x (w x p))` with respect to `w`.
#[inline(always)]
fn centripetal_gradient<L: Lanes>(w: Vector<L>, p: Vector<L>, b: Vector<L>) -> Vector<L> {
    let twice = b.dot(p) * L::splat(-2.0);
    w.mul_add(twice, p.mul_add(w.dot(b), b * w.dot(p)))
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
        .par_chunks_mut(n * CHUNK)
        .zip(out_dq.par_chunks_mut(n * CHUNK))
        .zip(out_ddq.par_chunks_mut(n * CHUNK))
        .enumerate()
        .for_each(|(chunk, ((out_q, out_dq), out_ddq))| {
            let at = chunk * CHUNK * n..chunk * CHUNK * n + out_q.len();
            lanes::run(Along {
                robot,
                motion: [q, dq, ddq].map(|signal| &signal[at.clone()]),
                phi,
                direction: &direction[at],
                gradient: [out_q, out_dq, out_ddq],
            });
        });
    Ok(())
}

/// Samples per task.
const CHUNK: usize = 256;

/// [`inverse_dynamics_gradient`] of some samples.
struct Along<'a> {
    robot: &'a RobotModel,
    motion: [&'a [f64]; 3],
    phi: &'a [f64],
    direction: &'a [f64],
    gradient: [&'a mut [f64]; 3],
}

impl Kernel for Along<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
        let n = self.robot.n_joints();
        let n_samples = self.direction.len() / n;
        let mut sweep = Sweep::<L, SUMMED>::new(self.robot);
        let mut states = StateRows::<L>::new(n);
        let mut weights = vec![L::ZERO; n * N_LINK_PARAMS * n];
        let mut rows = [vec![L::ZERO; n], vec![L::ZERO; n], vec![L::ZERO; n]];
        let [out_q, out_dq, out_ddq] = self.gradient;
        for k in 0..n_samples.div_ceil(L::LEN) {
            let samples = lane_samples::<L>(k, n_samples);
            states.take_samples(self.motion, &samples[..L::LEN]);
            sweep.forward(self.robot, states.rows());
            for (j, row) in weights.chunks_exact_mut(N_LINK_PARAMS * n).enumerate() {
                let along = gather::<L>(self.direction, &samples[..L::LEN], n, j);
                for (weight, phi) in row.iter_mut().zip(self.phi) {
                    *weight = (along * L::splat(*phi)).raw();
                }
            }
            let [q, dq, ddq] = &mut rows;
            sweep.reverse(self.robot, &weights, [q, dq, ddq]);
            let start = k * L::LEN * n;
            put::<L>(&rows[0], &mut out_q[start..], n);
            put::<L>(&rows[1], &mut out_dq[start..], n);
            put::<L>(&rows[2], &mut out_ddq[start..], n);
        }
    }
}
