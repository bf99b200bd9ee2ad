//! Newton and Euler along a chain, in rows, in the frames of [`Frames`]: inverse dynamics.

use crate::chain::JointState;
use crate::frames::{Frame, Frames, LinkNumbers};
use crate::lanes::{Lanes, Matrix, Vector};
use crate::robot::JointKind;

/// Force and moment about the origin that move a link, in its own frame.
pub type WrenchRow<R> = [[R; 3]; 2];

/// A moving link: angular velocity and acceleration, acceleration of the origin minus gravity, and the acceleration of a
/// point per unit of its place, `[alpha]x + [omega]x [omega]x`.
#[derive(Clone, Copy)]
struct Motion<L> {
    omega: Vector<L>,
    alpha: Vector<L>,
    acc: Vector<L>,
    spread: Matrix<L>,
}

impl<L: Lanes> Motion<L> {
    #[inline(always)]
    fn new(omega: Vector<L>, alpha: Vector<L>, acc: Vector<L>) -> Self {
        let ([wx, wy, wz], [ax, ay, az]) = (omega.0, alpha.0);
        let zero = L::splat(0.0);
        let (less_zz, less_yy) = (wz.mul_sub_from(wz, zero), wy.mul_sub_from(wy, zero));
        let spread = Matrix([
            [
                wy.mul_sub_from(wy, less_zz),
                wx.mul_add(wy, -az),
                wx.mul_add(wz, ay),
            ],
            [
                wx.mul_add(wy, az),
                wx.mul_sub_from(wx, less_zz),
                wy.mul_add(wz, -ax),
            ],
            [
                wx.mul_add(wz, -ay),
                wy.mul_add(wz, ax),
                wx.mul_sub_from(wx, less_yy),
            ],
        ]);
        Self {
            omega,
            alpha,
            acc,
            spread,
        }
    }

    /// The first joint's link; the base is at rest.
    #[inline(always)]
    fn first(frames: &Frames, frame: &Frame, state: &JointState<L::Raw>) -> Self {
        let angle = frame.angle(L::from_raw(state.sin), L::from_raw(state.cos));
        let (dq, ddq) = (L::from_raw(state.dq), L::from_raw(state.ddq));
        let [acc] = frame.to_link(angle, [Vector::splat(&frames.up)]);
        let (zero, still) = (L::splat(0.0), Vector::zero());
        match frame.kind {
            JointKind::Revolute => {
                let square = dq.mul_sub_from(dq, zero);
                Self {
                    omega: Vector([zero, zero, dq]),
                    alpha: Vector([zero, zero, ddq]),
                    acc,
                    spread: Matrix([[square, -ddq, zero], [ddq, square, zero], [zero; 3]]),
                }
            }
            JointKind::Prismatic => Self {
                omega: still,
                alpha: still,
                acc: Vector([acc.0[0], acc.0[1], acc.0[2] + ddq]),
                spread: Matrix([[zero; 3]; 3]),
            },
        }
    }

    /// The next link.
    #[inline(always)]
    fn next(&self, frame: &Frame, state: &JointState<L::Raw>) -> Self {
        let angle = frame.angle(L::from_raw(state.sin), L::from_raw(state.cos));
        let (dq, ddq) = (L::from_raw(state.dq), L::from_raw(state.ddq));
        let [s0, s1, s2] = self.spread.0.map(Vector);
        let origin = frame.origin(L::from_raw(state.q));
        let [ax, ay, az] = self.acc.0;
        let acc = Vector([
            s0.dot_add(origin, ax),
            s1.dot_add(origin, ay),
            s2.dot_add(origin, az),
        ]);
        let [omega, alpha, acc] = frame.to_link(angle, [self.omega, self.alpha, acc]);
        let [wx, wy, wz] = omega.0;
        match frame.kind {
            JointKind::Revolute => {
                let [ax, ay, az] = alpha.0;
                Self::new(
                    Vector([wx, wy, wz + dq]),
                    Vector([wy.mul_add(dq, ax), wx.mul_sub_from(dq, ay), az + ddq]),
                    acc,
                )
            }
            JointKind::Prismatic => {
                let ([ax, ay, az], twice) = (acc.0, dq + dq);
                let acc = [wy.mul_add(twice, ax), wx.mul_sub_from(twice, ay), az + ddq];
                Self::new(omega, alpha, Vector(acc))
            }
        }
    }

    /// What moves the link: `f = m a + S h`, and `n = h x a` with the sum of `r x (S r)` over the link's mass.
    #[inline(always)]
    fn wrench(&self, link: &LinkNumbers) -> [Vector<L>; 2] {
        let [m, hx, hy, hz, xx, xy, yy, xz, yz, zz] = link.map(L::splat);
        let [[s00, s01, s02], [s10, s11, s12], [s20, s21, s22]] = self.spread.0;
        let ([ax, ay, az], h) = (self.acc.0, Vector([hx, hy, hz]));
        let force = Vector([
            Vector([s00, s01, s02]).dot_add(h, m * ax),
            Vector([s10, s11, s12]).dot_add(h, m * ay),
            Vector([s20, s21, s22]).dot_add(h, m * az),
        ]);
        let [x, y, z] = [
            Vector([xx, xy, xz]),
            Vector([xy, yy, yz]),
            Vector([xz, yz, zz]),
        ];
        // Rows of S against columns of the second moments, those to be taken away last.
        let plus = h.cross(self.acc).0;
        let plus = [
            Vector([s20, s21, s22]).dot_add(y, plus[0]),
            Vector([s00, s01, s02]).dot_add(z, plus[1]),
            Vector([s10, s11, s12]).dot_add(x, plus[2]),
        ];
        let moment = Vector([
            dot_from(Vector([s10, s11, s12]), z, plus[0]),
            dot_from(Vector([s20, s21, s22]), x, plus[1]),
            dot_from(Vector([s00, s01, s02]), y, plus[2]),
        ]);
        [force, moment]
    }
}

/// `minuend - a . b`.
#[inline(always)]
fn dot_from<L: Lanes>(a: Vector<L>, b: Vector<L>, minuend: L) -> L {
    let ([a, b, c], [x, y, z]) = (a.0, b.0);
    c.mul_sub_from(z, b.mul_sub_from(y, a.mul_sub_from(x, minuend)))
}

/// Inverse dynamics of rows: `links`, `states`, `wrenches` and `tau` hold one entry per joint. Sines and cosines of the
/// states are those of the position and the joint's offset together.
#[inline(always)]
pub fn inverse_dynamics<L: Lanes>(
    frames: &Frames,
    links: &[LinkNumbers],
    states: &[JointState<L::Raw>],
    wrenches: &mut [WrenchRow<L::Raw>],
    tau: &mut [L::Raw],
) {
    let own = outwards::<L>(frames, links, states, wrenches);
    inwards(frames, states, wrenches, own, tau);
}

/// The first half of [`inverse_dynamics`]: what moves every link but the first, and what the first joint feels of its own.
#[inline(always)]
pub fn outwards<L: Lanes>(
    frames: &Frames,
    links: &[LinkNumbers],
    states: &[JointState<L::Raw>],
    wrenches: &mut [WrenchRow<L::Raw>],
) -> L {
    let along = frames.frames.iter().zip(states);
    let mut joints = along.zip(links).zip(wrenches.iter_mut());
    let Some((((frame, state), link), _)) = joints.next() else {
        return L::splat(0.0);
    };
    let base = frame;
    let mut motion = Motion::<L>::first(frames, frame, state);
    // What the base carries is not asked for, and the first link turns about one axis only.
    let own = match base.kind {
        JointKind::Revolute => {
            let [ax, ay, _] = motion.acc.0;
            let [_, hx, hy, _, xx, _, yy, ..] = *link;
            let turned = motion.alpha.0[2] * L::splat(xx + yy);
            L::splat(hy).mul_sub_from(ax, L::splat(hx).mul_add(ay, turned))
        }
        JointKind::Prismatic => L::splat(link[0]) * motion.acc.0[2],
    };
    for (((frame, state), link), wrench) in joints {
        motion = motion.next(frame, state);
        let [force, moment] = motion.wrench(link);
        force.put(&mut wrench[0]);
        moment.put(&mut wrench[1]);
    }
    own
}

/// The second half: the torques of what the first one found.
#[inline(always)]
pub fn inwards<L: Lanes>(
    frames: &Frames,
    states: &[JointState<L::Raw>],
    wrenches: &[WrenchRow<L::Raw>],
    own: L,
    tau: &mut [L::Raw],
) {
    let along = frames.frames.iter().zip(states);
    let (mut force, mut moment) = (Vector::<L>::zero(), Vector::<L>::zero());
    let mut joints = along.zip(wrenches).zip(tau.iter_mut());
    let first = joints.next();
    for (((frame, state), wrench), tau) in joints.rev() {
        force = force + Vector::from_raw(&wrench[0]);
        moment = moment + Vector::from_raw(&wrench[1]);
        *tau = along_joint(frame, force, moment).raw();
        let angle = frame.angle(L::from_raw(state.sin), L::from_raw(state.cos));
        [force, moment] = frame.to_parent(angle, [force, moment]);
        let origin = frame.origin(L::from_raw(state.q));
        moment = origin.cross_add(force, moment);
    }
    if let Some((((base, _), _), tau)) = first {
        *tau = (own + along_joint(base, force, moment)).raw();
    }
}

/// What the joint feels of a wrench.
#[inline(always)]
fn along_joint<L: Lanes>(frame: &Frame, force: Vector<L>, moment: Vector<L>) -> L {
    match frame.kind {
        JointKind::Revolute => moment.0[2],
        JointKind::Prismatic => force.0[2],
    }
}
