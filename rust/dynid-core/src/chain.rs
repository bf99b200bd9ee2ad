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
}

/// The base: at rest, gravity as an upward acceleration.
#[inline(always)]
fn base<L: Lanes>(robot: &RobotModel) -> Body<L> {
    let g = robot.gravity();
    Body::new(
        Vector::zero(),
        Vector::zero(),
        Vector::splat(&[-g.x, -g.y, -g.z]),
    )
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
    let places = robot.placements();
    let mut parent = base::<L>(robot);
    for (((place, state), link), phi) in places
        .iter()
        .zip(states)
        .zip(links.iter_mut())
        .zip(phi.chunks_exact(N_LINK_PARAMS))
    {
        let (rotation, origin, body) = outwards(place, state, &parent);
        let (force, moment) = body.wrench(phi);
        rotation.put(&mut link.rotation);
        origin.put(&mut link.origin);
        force.put(&mut link.force);
        moment.put(&mut link.moment);
        parent = body;
    }
    let (mut force, mut moment) = (Vector::<L>::zero(), Vector::<L>::zero());
    for ((place, link), tau) in places.iter().zip(links.iter()).zip(tau.iter_mut()).rev() {
        force = force + Vector::from_raw(&link.force);
        moment = moment + Vector::from_raw(&link.moment);
        *tau = match place.kind {
            JointKind::Revolute => place.dot_axis(moment),
            JointKind::Prismatic => place.dot_axis(force),
        }
        .raw();
        let rotation = Matrix::from_raw(&link.rotation);
        force = rotation * force;
        moment = Vector::from_raw(&link.origin).cross_add(force, rotation * moment);
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
    let mut parent = base::<L>(robot);
    for (i, (place, state)) in places.iter().zip(states).enumerate() {
        let (rotation, origin, body) = outwards(place, state, &parent);
        let [linear, angular] = place.own_twist::<L>();
        // Power of link i's wrench on a unit motion of joint j, for every joint that moves the link: the twist of each
        // joint goes outwards instead of the wrench of each link inwards.
        for (j, twist) in twists.iter_mut().take(i + 1).enumerate() {
            let (linear, angular) = if j < i {
                let angular = Vector::<L>::from_raw(&twist[1]);
                let linear = angular.cross_add(origin, Vector::from_raw(&twist[0]));
                (rotation.tr_mul(linear), rotation.tr_mul(angular))
            } else {
                (linear, angular)
            };
            linear.put(&mut twist[0]);
            angular.put(&mut twist[1]);
            let start = j * width + i * N_LINK_PARAMS;
            let row = body.power(linear, angular);
            for (to, x) in regressor[start..start + N_LINK_PARAMS].iter_mut().zip(row) {
                *to = x.raw();
            }
        }
        parent = body;
    }
}
