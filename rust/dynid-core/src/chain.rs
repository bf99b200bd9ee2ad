//! The recursions along the chain, in rows: what the regressor and its derivatives share.

use crate::kernel::Body;
use crate::lanes::{Lanes, Vector};
use crate::link_params::N_LINK_PARAMS;
pub use crate::placement::Placement;
use crate::robot::{JointKind, RobotModel};
pub use crate::turn::Turn;

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

/// The first joint's link on the base, which is at rest; gravity is an upward acceleration. What [`outwards`] would multiply
/// by zeros is left out.
#[inline(always)]
pub(crate) fn from_base<L: Lanes>(
    robot: &RobotModel,
    place: &Placement,
    state: &JointState<L::Raw>,
) -> Body<L> {
    let turn = place.turn(L::from_raw(state.sin), L::from_raw(state.cos));
    let (dq, ddq) = (L::from_raw(state.dq), L::from_raw(state.ddq));
    let g = robot.gravity();
    let still = Vector::zero();
    let [acc] = place.to_link(&turn, [Vector::splat(&[-g.x, -g.y, -g.z])]);
    match place.kind {
        JointKind::Revolute => Body::new(
            place.along_axis(still, dq),
            place.along_axis(still, ddq),
            acc,
        ),
        JointKind::Prismatic => Body::new(still, still, place.along_axis(acc, ddq)),
    }
}

/// A joint's rotation, and where it puts the origin of its link in the parent's frame.
#[inline(always)]
pub(crate) fn placed<L: Lanes>(
    place: &Placement,
    state: &JointState<L::Raw>,
) -> (Turn<L>, Vector<L>) {
    (
        place.turn(L::from_raw(state.sin), L::from_raw(state.cos)),
        place.origin(L::from_raw(state.q)),
    )
}

/// Forward pass of Newton and Euler by one joint: velocities and accelerations of the link in its own frame.
#[inline(always)]
pub(crate) fn outwards<L: Lanes>(
    place: &Placement,
    (turn, origin): &(Turn<L>, Vector<L>),
    state: &JointState<L::Raw>,
    parent: &Body<L>,
) -> Body<L> {
    let (dq, ddq) = (L::from_raw(state.dq), L::from_raw(state.ddq));
    let acc = parent.acc + parent.spread * *origin;
    let [omega, alpha, acc] = place.carried(turn, [parent.omega, parent.alpha, acc], [dq, ddq]);
    Body::new(omega, alpha, acc)
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
    let mut parent = from_base::<L>(robot, place, state);
    put_own(place, &parent, 0, width, twists, regressor);
    for (i, (place, state)) in joints {
        let placed = placed(place, state);
        let body = outwards(place, &placed, state, &parent);
        let (turn, origin) = placed;
        // Power of link i's wrench on a unit motion of joint j, for every joint that moves the link: the twist of each
        // joint goes outwards instead of the wrench of each link inwards.
        for (j, twist) in twists.iter_mut().take(i).enumerate() {
            let angular = Vector::<L>::from_raw(&twist[1]);
            let linear = angular.cross_add(origin, Vector::from_raw(&twist[0]));
            let [linear, angular] = place.to_link(&turn, [linear, angular]);
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
    let block = match place.turns_about() {
        Some(axis) => body.power_about(axis),
        None => body.power(linear, angular),
    };
    put_block(&block, i, i, width, regressor);
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
