//! Where a joint puts its link, in rows, without multiplying by the zeros that most robots are made of.

use crate::lanes::{Lanes, Matrix, Vector};
use crate::robot::{Joint, JointKind};
use crate::turn::{called, renamed, Turn, RENAMED, Z};

/// Where a joint puts its link, as numbers that do not move: the rotation (link to parent coordinates) is
/// `constant + cos q * cosine + sin q * sine` for a turning joint (Rodrigues) and `constant` for a sliding one, the
/// origin `translation + q * slide`.
///
/// Most joints turn about an axis of their link's frame that lies along an axis of the parent's. With both frames'
/// axes renamed in turn (x, y, z to y, z, x or z, x, y) so that those two are called z, the rotation is a plane one:
/// four numbers that move, four zeros and a sign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Revolute or prismatic.
    pub kind: JointKind,
    /// Unit axis, in the link frame and in the joint frame alike.
    pub axis: [f64; 3],
    form: Form,
    /// The axes of the link's and of the parent's frame that are called z in the matrices below.
    link_z: usize,
    parent_z: usize,
    /// 1 or -1: the sense of the turn about the link's.
    sign: f64,
    constant: [[f64; 3]; 3],
    cosine: [[f64; 3]; 3],
    sine: [[f64; 3]; 3],
    translation: [f64; 3],
    slide: [f64; 3],
}

/// What is known of a rotation's zeros.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// Nothing.
    Free,
    /// It turns about an axis of the link's frame.
    Axis,
    /// And that one lies along an axis of the parent's.
    Plane,
}

/// A right angle that was read from a file is one to the last bit: the cosine of pi / 2 is 6e-17.
const ROUNDED: f64 = 4.0 * f64::EPSILON;

impl Placement {
    pub(crate) fn new(joint: &Joint) -> Self {
        let (axis, rotation) = (joint.axis, joint.rotation);
        let turns = joint.kind == JointKind::Revolute;
        let along = axis * axis.transpose();
        let across = nalgebra::Matrix3::identity() - along;
        let none = nalgebra::Matrix3::zeros();
        let (constant, cosine, sine, slide) = if turns {
            let sine = rotation * axis.cross_matrix();
            (rotation * along, rotation * across, sine, [0.0; 3])
        } else {
            (rotation, none, none, (rotation * axis).into())
        };
        // Exactly: a number that is not there must be nothing. A sliding joint's rotation has no axis.
        let link_z = (0..3).find(|k| turns && axis[*k].abs() == 1.0 && axis.abs().sum() == 1.0);
        let parent_z = link_z.and_then(|z| {
            let lies_along = |k: &usize| (rotation[(*k, z)].abs() - 1.0).abs() <= ROUNDED;
            let others = |k: &usize| {
                RENAMED[*k][..2]
                    .iter()
                    .all(|i| rotation[(*i, z)].abs() <= ROUNDED)
                    && RENAMED[z][..2]
                        .iter()
                        .all(|i| rotation[(*k, *i)].abs() <= ROUNDED)
            };
            (0..3).find(|k| lies_along(k) && others(k))
        });
        let form = match (link_z, parent_z) {
            (Some(_), Some(_)) => Form::Plane,
            (Some(_), None) => Form::Axis,
            _ => Form::Free,
        };
        let (link_z, parent_z) = (link_z.unwrap_or(Z), parent_z.unwrap_or(Z));
        let renamed = |m: nalgebra::Matrix3<f64>| {
            let mut rows = [[0.0; 3]; 3];
            for (to, row) in rows.iter_mut().zip(RENAMED[parent_z]) {
                for (to, column) in to.iter_mut().zip(RENAMED[link_z]) {
                    *to = m[(row, column)];
                }
            }
            rows
        };
        Self {
            kind: joint.kind,
            axis: axis.into(),
            form,
            link_z,
            parent_z,
            sign: axis[link_z].signum(),
            constant: renamed(constant),
            cosine: renamed(cosine),
            sine: renamed(sine),
            translation: joint.translation.into(),
            slide,
        }
    }

    /// Rotation where `q` has this sine and cosine, for [`Self::to_link`] and [`Self::to_parent`] of this joint.
    #[inline(always)]
    pub fn turn<L: Lanes>(&self, sin: L, cos: L) -> Turn<L> {
        Turn(match (self.kind, self.form) {
            (JointKind::Prismatic, _) => Matrix([
                Vector::splat(&self.constant[0]).0,
                Vector::splat(&self.constant[1]).0,
                Vector::splat(&self.constant[2]).0,
            ]),
            (JointKind::Revolute, Form::Plane) => {
                let zero = L::splat(0.0);
                let ([a, b], [c, d]) = (self.moving(0, sin, cos), self.moving(1, sin, cos));
                let sign = L::splat(self.constant[2][2]);
                Matrix([[a, b, zero], [c, d, zero], [zero, zero, sign]])
            }
            (JointKind::Revolute, _) => Matrix([
                self.turned_row(0, sin, cos),
                self.turned_row(1, sin, cos),
                self.turned_row(2, sin, cos),
            ]),
        })
    }

    /// The same turn in each of four lanes.
    #[inline(always)]
    pub(crate) fn turn_of_four<S: Lanes<Raw = [f64; 1]>>(&self, turn: &Turn<S>) -> Turn<S::Four> {
        let rows = turn.0 .0;
        if self.form == Form::Plane {
            let zero = S::Four::splat(0.0);
            let [[a, b, _], [c, d, _], [_, _, sign]] = rows;
            return Turn(Matrix([
                [a.of_four(), b.of_four(), zero],
                [c.of_four(), d.of_four(), zero],
                [zero, zero, sign.of_four()],
            ]));
        }
        Turn(Matrix([
            Vector(rows[0]).of_four().0,
            Vector(rows[1]).of_four().0,
            Vector(rows[2]).of_four().0,
        ]))
    }

    /// The first two entries of row k, where the axis is called z.
    #[inline(always)]
    fn moving<L: Lanes>(&self, k: usize, sin: L, cos: L) -> [L; 2] {
        let (cosine, sine) = (&self.cosine[k], &self.sine[k]);
        [
            L::splat(sine[0]).mul_add(sin, L::splat(cosine[0]) * cos),
            L::splat(sine[1]).mul_add(sin, L::splat(cosine[1]) * cos),
        ]
    }

    #[inline(always)]
    fn turned_row<L: Lanes>(&self, k: usize, sin: L, cos: L) -> [L; 3] {
        if self.form == Form::Axis {
            let [x, y] = self.moving(k, sin, cos);
            return [x, y, L::splat(self.constant[k][2])];
        }
        let still = Vector::splat(&self.constant[k]);
        let turned = Vector::splat(&self.cosine[k]).mul_add(cos, still);
        Vector::splat(&self.sine[k]).mul_add(sin, turned).0
    }

    /// Vectors of the parent's frame in the link's: the transpose of the rotation times each.
    #[inline(always)]
    pub fn to_link<L: Lanes, const M: usize>(
        &self,
        turn: &Turn<L>,
        v: [Vector<L>; M],
    ) -> [Vector<L>; M] {
        called(self.turned(turn, v), self.link_z)
    }

    /// [`Self::to_link`], but for the names of the link's axes.
    #[inline(always)]
    fn turned<L: Lanes, const M: usize>(
        &self,
        turn: &Turn<L>,
        v: [Vector<L>; M],
    ) -> [Vector<L>; M] {
        let rows = turn.0;
        let mut v = renamed(v, self.parent_z);
        if self.form == Form::Plane {
            let [[a, b, _], [c, d, _], [_, _, sign]] = rows.0;
            for v in &mut v {
                let [x, y, z] = v.0;
                *v = Vector([c.mul_add(y, a * x), d.mul_add(y, b * x), sign * z]);
            }
        } else {
            for v in &mut v {
                *v = rows.tr_mul(*v);
            }
        }
        v
    }

    /// Vectors of the link's frame in the parent's: the rotation times each.
    #[inline(always)]
    pub fn to_parent<L: Lanes, const M: usize>(
        &self,
        turn: &Turn<L>,
        v: [Vector<L>; M],
    ) -> [Vector<L>; M] {
        let rows = turn.0;
        let mut v = renamed(v, self.link_z);
        if self.form == Form::Plane {
            let [[a, b, _], [c, d, _], [_, _, sign]] = rows.0;
            for v in &mut v {
                let [x, y, z] = v.0;
                *v = Vector([b.mul_add(y, a * x), d.mul_add(y, c * x), sign * z]);
            }
        } else {
            for v in &mut v {
                *v = rows * *v;
            }
        }
        called(v, self.parent_z)
    }

    /// Angular velocity, angular acceleration and acceleration of the parent at the link's origin, in the link's frame,
    /// with what the joint's own motion adds.
    #[inline(always)]
    pub(crate) fn carried<L: Lanes>(
        &self,
        turn: &Turn<L>,
        parent: [Vector<L>; 3],
        [dq, ddq]: [L; 2],
    ) -> [Vector<L>; 3] {
        let [omega, alpha, acc] = self.turned(turn, parent);
        if self.form == Form::Free {
            let turned = self.cross_axis(omega);
            return match self.kind {
                JointKind::Revolute => [
                    self.along_axis(omega, dq),
                    self.along_axis(turned.mul_add(dq, alpha), ddq),
                    acc,
                ],
                JointKind::Prismatic => [
                    omega,
                    alpha,
                    self.along_axis(turned.mul_add(dq + dq, acc), ddq),
                ],
            };
        }
        // The same about z, before the axes get their names back.
        let sign = L::splat(self.sign);
        let (dq, ddq) = (sign * dq, sign * ddq);
        let ([wx, wy, wz], [ax, ay, az]) = (omega.0, alpha.0);
        let omega = Vector([wx, wy, wz + dq]);
        let alpha = Vector([wy.mul_add(dq, ax), wx.mul_sub_from(dq, ay), az + ddq]);
        called([omega, alpha, acc], self.link_z)
    }

    /// `v + axis * by`.
    #[inline(always)]
    pub fn along_axis<L: Lanes>(&self, v: Vector<L>, by: L) -> Vector<L> {
        Vector::splat(&self.axis).mul_add(by, v)
    }

    /// `v x axis`.
    #[inline(always)]
    pub fn cross_axis<L: Lanes>(&self, v: Vector<L>) -> Vector<L> {
        v.cross(Vector::splat(&self.axis))
    }

    /// The axis of the link's frame about which the joint turns, if it does so in the positive sense.
    #[inline(always)]
    pub(crate) fn turns_about(&self) -> Option<usize> {
        (self.form != Form::Free && self.sign > 0.0).then_some(self.link_z)
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
