//! The recursions along the chain, in rows: what inverse dynamics, the regressor and its derivatives share.

use crate::kernel::Body;
use crate::lanes::{Lanes, Matrix, Vector};
use crate::link_params::N_LINK_PARAMS;
use crate::robot::{Joint, JointKind, RobotModel};

/// Where a joint puts its link, as numbers that do not move: the rotation (link to parent coordinates) is
/// `constant + cos q * cosine + sin q * sine` for a turning joint (Rodrigues) and `constant` for a sliding one, the
/// origin `translation + q * slide`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Revolute or prismatic.
    pub kind: JointKind,
    /// Unit axis, in the link frame and in the joint frame alike.
    pub axis: [f64; 3],
    /// True if the axis is z, as in most robot files: half the numbers below are zeros then.
    along_z: bool,
    constant: [[f64; 3]; 3],
    cosine: [[f64; 3]; 3],
    sine: [[f64; 3]; 3],
    translation: [f64; 3],
    slide: [f64; 3],
}

impl Placement {
    pub(crate) fn new(joint: &Joint) -> Self {
        let rows = |m: nalgebra::Matrix3<f64>| -> [[f64; 3]; 3] { m.transpose().into() };
        let (axis, rotation) = (joint.axis, joint.rotation);
        let along = axis * axis.transpose();
        let across = nalgebra::Matrix3::identity() - along;
        let zero = [[0.0; 3]; 3];
        let (constant, cosine, sine, slide) = match joint.kind {
            JointKind::Revolute => (
                rows(rotation * along),
                rows(rotation * across),
                rows(rotation * axis.cross_matrix()),
                [0.0; 3],
            ),
            JointKind::Prismatic => (rows(rotation), zero, zero, (rotation * axis).into()),
        };
        Self {
            kind: joint.kind,
            axis: axis.into(),
            along_z: axis == nalgebra::Vector3::z(),
            constant,
            cosine,
            sine,
            translation: joint.translation.into(),
            slide,
        }
    }

    /// Rotation, link to parent coordinates, where `q` has this sine and cosine.
    #[inline(always)]
    pub fn rotation<L: Lanes>(&self, sin: L, cos: L) -> Matrix<L> {
        match self.kind {
            JointKind::Prismatic => Matrix([
                Vector::splat(&self.constant[0]).0,
                Vector::splat(&self.constant[1]).0,
                Vector::splat(&self.constant[2]).0,
            ]),
            JointKind::Revolute => Matrix([
                self.turned_row(0, sin, cos),
                self.turned_row(1, sin, cos),
                self.turned_row(2, sin, cos),
            ]),
        }
    }

    #[inline(always)]
    fn turned_row<L: Lanes>(&self, k: usize, sin: L, cos: L) -> [L; 3] {
        let (constant, cosine, sine) = (&self.constant[k], &self.cosine[k], &self.sine[k]);
        if self.along_z {
            // The same sums without their zeros.
            let (first, second) = (L::splat(cosine[0]), L::splat(cosine[1]));
            return [
                second.mul_add(sin, first * cos),
                first.mul_sub_from(sin, second * cos),
                L::splat(constant[2]),
            ];
        }
        let still = Vector::splat(constant);
        let turned = Vector::splat(cosine).mul_add(cos, still);
        Vector::splat(sine).mul_add(sin, turned).0
    }

    /// `v + axis * by`.
    #[inline(always)]
    pub fn along_axis<L: Lanes>(&self, v: Vector<L>, by: L) -> Vector<L> {
        if self.along_z {
            let [x, y, z] = v.0;
            return Vector([x, y, z + by]);
        }
        Vector::splat(&self.axis).mul_add(by, v)
    }

    /// `v x axis`.
    #[inline(always)]
    pub fn cross_axis<L: Lanes>(&self, v: Vector<L>) -> Vector<L> {
        if self.along_z {
            let [x, y, _] = v.0;
            return Vector([y, -x, L::splat(0.0)]);
        }
        v.cross(Vector::splat(&self.axis))
    }

    /// `axis . v`.
    #[inline(always)]
    pub fn dot_axis<L: Lanes>(&self, v: Vector<L>) -> L {
        if self.along_z {
            return v.0[2];
        }
        Vector::splat(&self.axis).dot(v)
    }

    /// What the joint feels of a wrench.
    #[inline(always)]
    fn along_joint<L: Lanes>(&self, force: Vector<L>, moment: Vector<L>) -> L {
        match self.kind {
            JointKind::Revolute => self.dot_axis(moment),
            JointKind::Prismatic => self.dot_axis(force),
        }
    }

    /// Origin of the link frame in the parent frame \[m\].
    #[inline(always)]
    pub fn origin<L: Lanes>(&self, q: L) -> Vector<L> {
        let translation = Vector::splat(&self.translation);
        match self.kind {
            JointKind::Revolute => translation,
            JointKind::Prismatic => self.slide::<L>().mul_add(q, translation),
        }
    }

    /// How the origin moves with `q`: zero for a turning joint.
    #[inline(always)]
    pub fn slide<L: Lanes>(&self) -> Vector<L> {
        Vector::splat(&self.slide)
    }

    /// Velocity \[linear, angular\] of the link at unit speed of its own joint.
    #[inline(always)]
    pub fn own_twist<L: Lanes>(&self) -> [Vector<L>; 2] {
        let axis = Vector::splat(&self.axis);
        match self.kind {
            JointKind::Revolute => [Vector::zero(), axis],
            JointKind::Prismatic => [axis, Vector::zero()],
        }
    }
}

/// States in rows: of every joint position \[rad, m\], its sine and cosine, velocity and acceleration.
#[derive(Clone, Copy, Debug)]
pub struct JointState<R> {
    /// Position.
    pub q: R,
    /// Sine of the position.
    pub sin: R,
    /// Cosine of the position.
    pub cos: R,
    /// Velocity.
    pub dq: R,
    /// Acceleration.
    pub ddq: R,
}

/// What inverse dynamics keeps of a link on the way out.
#[derive(Clone, Copy, Debug)]
pub struct LinkRow<R> {
    rotation: [[R; 3]; 3],
    origin: [R; 3],
    force: [R; 3],
    moment: [R; 3],
}

impl<R: Copy> LinkRow<R> {
    /// Memory for one link; `zero` is a row of zeros.
    #[must_use]
    pub fn new(zero: R) -> Self {
        Self {
            rotation: [[zero; 3]; 3],
            origin: [zero; 3],
            force: [zero; 3],
            moment: [zero; 3],
        }
    }

    #[inline(always)]
    fn put<L: Lanes<Raw = R>>(
        &mut self,
        rotation: Matrix<L>,
        origin: Vector<L>,
        (force, moment): (Vector<L>, Vector<L>),
    ) {
        rotation.put(&mut self.rotation);
        origin.put(&mut self.origin);
        force.put(&mut self.force);
        moment.put(&mut self.moment);
    }
}

/// The first joint's link on the base, which is at rest; gravity is an upward acceleration. What [`outwards`] would multiply
/// by zeros is left out.
#[inline(always)]
fn from_base<L: Lanes>(
    robot: &RobotModel,
    place: &Placement,
    state: &JointState<L::Raw>,
) -> (Matrix<L>, Vector<L>, Body<L>) {
    let rotation = place.rotation(L::from_raw(state.sin), L::from_raw(state.cos));
    let origin = place.origin(L::from_raw(state.q));
    let (dq, ddq) = (L::from_raw(state.dq), L::from_raw(state.ddq));
    let g = robot.gravity();
    let still = Vector::zero();
    let acc = rotation.tr_mul(Vector::splat(&[-g.x, -g.y, -g.z]));
    let body = match place.kind {
        JointKind::Revolute => Body::new(
            place.along_axis(still, dq),
            place.along_axis(still, ddq),
            acc,
        ),
        JointKind::Prismatic => Body::new(still, still, place.along_axis(acc, ddq)),
    };
    (rotation, origin, body)
}

/// Forward pass of Newton and Euler by one joint: velocities and accelerations of the link in its own frame.
#[inline(always)]
fn outwards<L: Lanes>(
    place: &Placement,
    state: &JointState<L::Raw>,
    parent: &Body<L>,
) -> (Matrix<L>, Vector<L>, Body<L>) {
    let rotation = place.rotation(L::from_raw(state.sin), L::from_raw(state.cos));
    let origin = place.origin(L::from_raw(state.q));
    let (dq, ddq) = (L::from_raw(state.dq), L::from_raw(state.ddq));
    let omega = rotation.tr_mul(parent.omega);
    let alpha = rotation.tr_mul(parent.alpha);
    let acc = rotation.tr_mul(parent.acc + parent.spread * origin);
    let turned = place.cross_axis(omega);
    let body = match place.kind {
        JointKind::Revolute => Body::new(
            place.along_axis(omega, dq),
            place.along_axis(turned.mul_add(dq, alpha), ddq),
            acc,
        ),
        JointKind::Prismatic => Body::new(
            omega,
            alpha,
            place.along_axis(turned.mul_add(dq + dq, acc), ddq),
        ),
    };
    (rotation, origin, body)
}

/// Inverse dynamics of rows: `states`, `links` and `tau` hold one entry per joint, `phi` ten per link.
#[inline(always)]
pub fn inverse_dynamics<L: Lanes>(
    robot: &RobotModel,
    states: &[JointState<L::Raw>],
    links: &mut [LinkRow<L::Raw>],
    phi: &[f64],
    tau: &mut [L::Raw],
) {
    let mut joints = robot
        .placements()
        .iter()
        .zip(states)
        .zip(links.iter_mut())
        .zip(phi.chunks_exact(N_LINK_PARAMS));
    let Some((((place, state), link), phi)) = joints.next() else {
        return;
    };
    let (rotation, origin, mut parent) = from_base::<L>(robot, place, state);
    link.put(rotation, origin, parent.wrench(phi));
    for (((place, state), link), phi) in joints {
        let (rotation, origin, body) = outwards(place, state, &parent);
        link.put(rotation, origin, body.wrench(phi));
        parent = body;
    }
    let (mut force, mut moment) = (Vector::<L>::zero(), Vector::<L>::zero());
    let mut joints = robot.placements().iter().zip(links.iter()).zip(tau);
    let first = joints.next();
    for ((place, link), tau) in joints.rev() {
        force = force + Vector::from_raw(&link.force);
        moment = moment + Vector::from_raw(&link.moment);
        *tau = place.along_joint(force, moment).raw();
        let rotation = Matrix::from_raw(&link.rotation);
        force = rotation * force;
        moment = Vector::from_raw(&link.origin).cross_add(force, rotation * moment);
    }
    if let Some(((place, link), tau)) = first {
        force = force + Vector::from_raw(&link.force);
        moment = moment + Vector::from_raw(&link.moment);
        *tau = place.along_joint(force, moment).raw();
    }
}

/// Velocity \[linear, angular\] of a link per unit speed of a joint before it.
pub type TwistRow<R> = [[R; 3]; 2];

/// Regressor of rows: `regressor` holds n × 10 n entries, row-major; what stands before the links that a joint moves is
/// left as it is. `twists`: one per joint.
#[inline(always)]
pub fn joint_torque_regressor<L: Lanes>(
    robot: &RobotModel,
    states: &[JointState<L::Raw>],
    twists: &mut [TwistRow<L::Raw>],
    regressor: &mut [L::Raw],
) {
    let places = robot.placements();
    let width = N_LINK_PARAMS * places.len();
    let mut joints = places.iter().zip(states).enumerate();
    let Some((_, (place, state))) = joints.next() else {
        return;
    };
    let (_, _, mut parent) = from_base::<L>(robot, place, state);
    put_own(place, &parent, 0, width, twists, regressor);
    for (i, (place, state)) in joints {
        let (rotation, origin, body) = outwards(place, state, &parent);
        // Power of link i's wrench on a unit motion of joint j, for every joint that moves the link: the twist of each
        // joint goes outwards instead of the wrench of each link inwards.
        for (j, twist) in twists.iter_mut().take(i).enumerate() {
            let angular = Vector::<L>::from_raw(&twist[1]);
            let linear = angular.cross_add(origin, Vector::from_raw(&twist[0]));
            let (linear, angular) = (rotation.tr_mul(linear), rotation.tr_mul(angular));
            linear.put(&mut twist[0]);
            angular.put(&mut twist[1]);
            put_block(&body.power(linear, angular), j, i, width, regressor);
        }
        put_own(place, &body, i, width, twists, regressor);
        parent = body;
    }
}

/// What joint `i` does to its own link.
#[inline(always)]
fn put_own<L: Lanes>(
    place: &Placement,
    body: &Body<L>,
    i: usize,
    width: usize,
    twists: &mut [TwistRow<L::Raw>],
    regressor: &mut [L::Raw],
) {
    let [linear, angular] = place.own_twist::<L>();
    linear.put(&mut twists[i][0]);
    angular.put(&mut twists[i][1]);
    if place.along_z && place.kind == JointKind::Revolute {
        put_block(&body.power_about_z(), i, i, width, regressor);
    } else {
        put_block(&body.power(linear, angular), i, i, width, regressor);
    }
}

/// The ten entries of joint `j` and link `i`.
#[inline(always)]
fn put_block<L: Lanes>(
    block: &[L; N_LINK_PARAMS],
    j: usize,
    i: usize,
    width: usize,
    regressor: &mut [L::Raw],
) {
    let start = j * width + i * N_LINK_PARAMS;
    for (to, x) in regressor[start..start + N_LINK_PARAMS]
        .iter_mut()
        .zip(block)
    {
        *to = x.raw();
    }
}
