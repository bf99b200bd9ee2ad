//! The regressor of one state: joints stand in lanes while their twists go outwards, and parameters while a link's entries
//! are summed, so that these leave in the order in which they are stored.

use crate::chain::{from_base, outwards, placed, JointState};
use crate::kernel::Body;
use crate::lanes::{Lanes, Vector};
use crate::link_params::N_LINK_PARAMS;
use crate::placement::Placement;
use crate::robot::RobotModel;
use crate::turn::Turn;

/// Joints side by side.
const SIDE: usize = 4;

/// Twists of four joints side by side: three numbers of the linear and three of the angular velocity. Lanes of joints that
/// are still to come hold what the state before left there, which nobody reads.
pub(crate) type FourTwists = [[f64; SIDE]; 6];

/// Negative in one lane.
const ONLY: [[f64; SIDE]; SIDE] = [
    [-1.0, 0.0, 0.0, 0.0],
    [0.0, -1.0, 0.0, 0.0],
    [0.0, 0.0, -1.0, 0.0],
    [0.0, 0.0, 0.0, -1.0],
];

/// [`crate::chain::joint_torque_regressor`] of one state, to the same bits; `regressor` is row-major, `twists` has one entry for
/// every four joints.
#[inline(always)]
pub(crate) fn joint_torque_regressor<S: Lanes<Raw = [f64; 1]>>(
    robot: &RobotModel,
    states: &[JointState<[f64; 1]>],
    twists: &mut [FourTwists],
    regressor: &mut [f64],
) {
    let places = robot.placements();
    let width = N_LINK_PARAMS * places.len();
    let mut joints = places.iter().zip(states).enumerate();
    let Some((_, (place, state))) = joints.next() else {
        return;
    };
    let mut parent = from_base::<S>(robot, place, state);
    carry::<S::Four>(place, None, 0, twists);
    put_link(&parent, place, 0, twists, blocks(0, width, regressor));
    for (i, (place, state)) in joints {
        let placed = placed(place, state);
        // First, because the entries wait for it.
        let of_four = (place.turn_of_four(&placed.0), placed.1.of_four());
        carry(place, Some(of_four), i, twists);
        parent = outwards(place, &placed, state, &parent);
        put_link(&parent, place, i, twists, blocks(i, width, regressor));
    }
}

/// Angular velocity and acceleration of a link, and the acceleration of its origin less gravity.
pub(crate) type Moving = [[[f64; 1]; 3]; 3];

/// The first half of the last link's columns: how that link moves, and the twists that move it.
#[inline(always)]
pub(crate) fn last_link<S: Lanes<Raw = [f64; 1]>>(
    robot: &RobotModel,
    states: &[JointState<[f64; 1]>],
    twists: &mut [FourTwists],
) -> Moving {
    let mut joints = robot.placements().iter().zip(states).enumerate();
    let Some((_, (place, state))) = joints.next() else {
        return Moving::default();
    };
    let mut body = from_base::<S>(robot, place, state);
    carry::<S::Four>(place, None, 0, twists);
    for (i, (place, state)) in joints {
        let placed = placed(place, state);
        let of_four = (place.turn_of_four(&placed.0), placed.1.of_four());
        carry(place, Some(of_four), i, twists);
        body = outwards(place, &placed, state, &body);
    }
    [body.omega, body.alpha, body.acc].map(Vector::raw)
}

/// The second half: ten columns for every joint.
#[inline(always)]
pub(crate) fn last_link_columns<S: Lanes<Raw = [f64; 1]>>(
    robot: &RobotModel,
    moving: &Moving,
    twists: &[FourTwists],
    columns: &mut [[f64; N_LINK_PARAMS]],
) {
    let [omega, alpha, acc] = moving.each_ref().map(Vector::from_raw);
    let body = Body::<S>::new(omega, alpha, acc);
    if let Some((last, place)) = robot.placements().iter().enumerate().next_back() {
        put_link(&body, place, last, twists, columns.iter_mut());
    }
}

/// Link `i`'s entries of every joint.
#[inline(always)]
fn blocks(
    i: usize,
    width: usize,
    regressor: &mut [f64],
) -> impl Iterator<Item = &mut [f64; N_LINK_PARAMS]> {
    regressor
        .chunks_exact_mut(width)
        .filter_map(move |row| row.get_mut(i * N_LINK_PARAMS..)?.first_chunk_mut())
}

/// Twists of the joints before joint `i` into its link's frame, and its own beside them.
#[inline(always)]
fn carry<F: Lanes>(
    place: &Placement,
    placed: Option<(Turn<F>, Vector<F>)>,
    i: usize,
    twists: &mut [FourTwists],
) {
    let own = place.own_twist::<F>();
    for (group, twists) in twists.iter_mut().enumerate().take(i / SIDE + 1) {
        let [vx, vy, vz, ux, uy, uz] = twists;
        let mut linear = Vector([F::load(vx), F::load(vy), F::load(vz)]);
        let mut angular = Vector([F::load(ux), F::load(uy), F::load(uz)]);
        if let Some((turn, origin)) = &placed {
            let there = angular.cross_add(*origin, linear);
            [linear, angular] = place.to_link(turn, [there, angular]);
        }
        if group == i / SIDE {
            let only = F::load(&ONLY[i % SIDE]);
            linear = own[0].where_signed(only, linear);
            angular = own[1].where_signed(only, angular);
        }
        for (to, x) in twists
            .iter_mut()
            .zip([linear, angular].map(|v| v.0).as_flattened())
        {
            x.store(to);
        }
    }
}

/// The rows of a body's regressor: the power of its wrench per unit of each parameter, on a unit motion along and about each
/// axis. Four parameters side by side; along an axis only the first four have any.
struct Rows<F> {
    along: [F; 3],
    about: [[F; 3]; 3],
}

impl<F: Lanes> Rows<F> {
    #[inline(always)]
    fn new<S: Lanes<Four = F>>(body: &Body<S>) -> Self {
        Self {
            along: [
                S::four(body.power_along(0)),
                S::four(body.power_along(1)),
                S::four(body.power_along(2)),
            ],
            about: [
                Self::side_by_side(body.power_about(0)),
                Self::side_by_side(body.power_about(1)),
                Self::side_by_side(body.power_about(2)),
            ],
        }
    }

    #[inline(always)]
    fn side_by_side<S: Lanes<Four = F>>(row: [S; N_LINK_PARAMS]) -> [F; 3] {
        let [a, b, c, d, e, f, g, h, i, j] = row;
        [
            S::four([a, b, c, d]),
            S::four([e, f, g, h]),
            S::four([i, j, j, j]),
        ]
    }

    /// [`Body::power`], in the same order of sums.
    #[inline(always)]
    fn power(&self, [vx, vy, vz, ux, uy, uz]: [F; 6]) -> [F; 3] {
        let [x, y, z] = &self.about;
        let zero = F::splat(0.0);
        let first = z[0].mul_add(uz, y[0].mul_add(uy, x[0].mul_add(ux, zero)));
        let along = &self.along;
        [
            along[2].mul_add(vz, along[1].mul_add(vy, along[0].mul_add(vx, first))),
            z[1].mul_add(uz, y[1].mul_add(uy, x[1].mul_add(ux, zero))),
            z[2].mul_add(uz, y[2].mul_add(uy, x[2].mul_add(ux, zero))),
        ]
    }
}

/// Ten entries to their place.
#[inline(always)]
fn put<F: Lanes>([first, second, third]: [F; 3], to: &mut [f64; N_LINK_PARAMS]) {
    first.store(&mut to[..SIDE]);
    second.store(&mut to[SIDE..2 * SIDE]);
    third.store_some(&mut to[2 * SIDE..]);
}

/// The columns of link `i`.
#[inline(always)]
fn put_link<'a, S: Lanes<Raw = [f64; 1]>>(
    body: &Body<S>,
    place: &Placement,
    i: usize,
    twists: &[FourTwists],
    mut blocks: impl Iterator<Item = &'a mut [f64; N_LINK_PARAMS]>,
) {
    let rows = Rows::new(body);
    let mut left = i;
    for twists in twists {
        for lane in 0..SIDE {
            if left == 0 {
                break;
            }
            let Some(block) = blocks.next() else {
                return;
            };
            put(rows.power(of_joint(twists, lane)), block);
            left -= 1;
        }
    }
    let Some(block) = blocks.next() else {
        return;
    };
    let own = match place.turns_about() {
        Some(0) => rows.about[0],
        Some(1) => rows.about[1],
        Some(_) => rows.about[2],
        None => {
            let [linear, angular] = place.own_twist::<S::Four>();
            let ([vx, vy, vz], [ux, uy, uz]) = (linear.0, angular.0);
            rows.power([vx, vy, vz, ux, uy, uz])
        }
    };
    put(own, block);
    for block in blocks {
        // No link before joint j is moved by it.
        let zero = S::Four::splat(0.0);
        put([zero; 3], block);
    }
}

/// One joint's twist in every lane.
#[inline(always)]
fn of_joint<F: Lanes>(twists: &FourTwists, lane: usize) -> [F; 6] {
    let mut all = [F::splat(0.0); 6];
    for (number, row) in all.iter_mut().zip(twists) {
        *number = F::splat(row[lane]);
    }
    all
}
