//! Frames of a chain in which a rotation is four products: every joint's axis is called z, and x stands square to it and to
//! the axis of the joint that comes next.
//!
//! These are the axes of Denavit and Hartenberg's frames (Craig, *Introduction to Robotics*, section 3.4); origins stay where
//! the robot file puts them, so that parameters are turned and not moved: the numbers of an arm whose axes all lie along
//! each other's are the file's own, in another order and with other signs.

use std::hash::{DefaultHasher, Hasher};

use nalgebra::{Matrix3, Vector3};

use crate::lanes::{Lanes, Vector, MOST_LANES};
use crate::link_params::{LinkParams, N_LINK_PARAMS};
use crate::robot::{Joint, JointKind};
use crate::slices::copy;

/// A right angle that was read from a file is one to the last bit: the cosine of pi / 2 is 6e-17.
const ROUNDED: f64 = 4.0 * f64::EPSILON;

/// The frames of a chain.
#[derive(Clone, Debug, PartialEq)]
pub struct Frames {
    /// One per joint.
    pub frames: Vec<Frame>,
    /// What is added to every joint's position before its sine and cosine are taken: the angle at which it stands in its
    /// frame when the robot file calls it zero. Zero for a sliding joint, and up to whole rows.
    pub offsets: Vec<f64>,
    /// Gravity as an upward acceleration, in the base's frame.
    pub up: [f64; 3],
    /// Stands for the axes of all frames: what was computed for the same ones holds.
    stamp: u64,
}

/// One link's frame. Rotation (link to parent coordinates): by `tilt` about x, then by the joint's angle about z.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Revolute or prismatic.
    pub kind: JointKind,
    tilt: Tilt,
    /// Cosine and sine of the tilt.
    cos: f64,
    sin: f64,
    /// Sine and cosine of the angle at which a sliding joint stands.
    still: [f64; 2],
    /// Origin in the parent's frame \[m\].
    origin: [f64; 3],
    /// The frame's axes, in the frame of the robot file.
    axes: Matrix3<f64>,
}

/// What is known of the tilt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Tilt {
    None,
    Quarter,
    Free,
}

/// Parameters of a link in its [`Frame`]: mass, first moments, and in place of the moments of inertia the second moments
/// `xx, xy, yy, xz, yz, zz` of the mass about the origin \[kg, kg·m, kg·m²\].
pub type LinkNumbers = [f64; N_LINK_PARAMS];

/// The nearest whole numbers, where all entries are whole but for rounding.
fn snapped(matrix: Matrix3<f64>) -> Matrix3<f64> {
    let whole = matrix.map(f64::round);
    if (matrix - whole).amax() <= ROUNDED {
        whole
    } else {
        matrix
    }
}

/// Cosine and sine of the angle from `(1, 0)` to `(x, y)`.
fn direction(x: f64, y: f64) -> (f64, f64) {
    let length = x.hypot(y);
    let (x, y) = (x / length, y / length);
    if x.abs() <= ROUNDED {
        (0.0, y.signum())
    } else if y.abs() <= ROUNDED {
        (x.signum(), 0.0)
    } else {
        (x, y)
    }
}

/// A turn about x by the angle with this cosine and sine.
fn about_x((cos, sin): (f64, f64)) -> Matrix3<f64> {
    Matrix3::new(1.0, 0.0, 0.0, 0.0, cos, -sin, 0.0, sin, cos)
}

/// A frame of this z, with x as near to `x` as can be.
fn frame_of(z: Vector3<f64>, x: Vector3<f64>) -> Matrix3<f64> {
    let x = (x - z * z.dot(&x)).normalize();
    snapped(Matrix3::from_columns(&[x, z.cross(&x), z]))
}

impl Frames {
    pub(crate) fn new(joints: &[Joint], gravity: &Vector3<f64>) -> Self {
        let rotations: Vec<_> = joints.iter().map(|joint| snapped(joint.rotation)).collect();
        let axes: Vec<_> = joints.iter().map(|joint| joint.axis.normalize()).collect();
        let mut frames = Vec::with_capacity(joints.len());
        let mut offsets = vec![0.0; joints.len().next_multiple_of(MOST_LANES)];
        let mut base = Matrix3::identity();
        let mut parent: Option<Matrix3<f64>> = None;
        for (i, joint) in joints.iter().enumerate() {
            let (rotation, z) = (rotations[i], axes[i]);
            let tilt = match parent {
                Some(parent) => {
                    let along = parent.transpose() * rotation * z;
                    direction(along.z, along.x.hypot(along.y))
                }
                None => (1.0, 0.0),
            };
            // Where this frame's x would be if the joint's angle were zero in it.
            let straight = match parent {
                Some(parent) => rotation.transpose() * parent * about_x(tilt),
                None => frame_of(z, Vector3::ith(z.iamin(), 1.0)),
            };
            let next = joints.get(i + 1).map(|_| rotations[i + 1] * axes[i + 1]);
            let across = next.map_or(Vector3::zeros(), |next| z.cross(&next));
            let x = if across.norm() <= ROUNDED {
                straight.column(0).into_owned()
            } else {
                across
            };
            let axes = frame_of(z, x);
            let turned = straight.transpose() * axes;
            let angle = direction(turned[(0, 0)], turned[(1, 0)]);
            let turns = joint.kind == JointKind::Revolute;
            // The first joint's angle is the base's.
            let (angle, parent_axes) = match parent {
                Some(parent) => (angle, parent),
                None => {
                    base = snapped(rotation * axes);
                    ((1.0, 0.0), base)
                }
            };
            if turns {
                offsets[i] = angle.1.atan2(angle.0);
            }
            frames.push(Frame {
                kind: joint.kind,
                tilt: match tilt {
                    (1.0, 0.0) => Tilt::None,
                    (0.0, 1.0) => Tilt::Quarter,
                    _ => Tilt::Free,
                },
                cos: tilt.0,
                sin: tilt.1,
                still: [angle.1, angle.0],
                origin: (parent_axes.transpose() * joint.translation).into(),
                axes,
            });
            parent = Some(axes);
        }
        let mut stamp = DefaultHasher::new();
        for x in frames
            .iter()
            .flat_map(|frame: &Frame| frame.axes.as_slice())
        {
            stamp.write_u64(x.to_bits());
        }
        Self {
            frames,
            offsets,
            up: (base.transpose() * -gravity).into(),
            stamp: stamp.finish(),
        }
    }

    /// `phi` (ten numbers per link) in these frames.
    #[must_use]
    pub fn links(&self, phi: &[f64]) -> Vec<LinkNumbers> {
        let mut links = vec![[0.0; N_LINK_PARAMS]; self.frames.len()];
        self.links_into(phi, &mut links);
        links
    }

    fn links_into(&self, phi: &[f64], links: &mut [LinkNumbers]) {
        let (phi, _) = phi.as_chunks();
        for ((frame, phi), link) in self.frames.iter().zip(phi).zip(links) {
            *link = frame.link(phi);
        }
    }
}

/// Links in their frames, computed again only where the parameters or the robot are others than before.
#[derive(Clone, Debug)]
pub(crate) struct Links {
    stamp: u64,
    phi: Vec<f64>,
    numbers: Vec<LinkNumbers>,
}

impl Links {
    /// Memory for the links of `frames`; without parameters.
    pub(crate) fn new(frames: &Frames) -> Self {
        let n = frames.frames.len();
        Self {
            stamp: frames.stamp,
            phi: vec![0.0; N_LINK_PARAMS * n],
            numbers: vec![[0.0; N_LINK_PARAMS]; n],
        }
    }

    /// Those of a robot with as many joints, with these parameters.
    #[inline(always)]
    pub(crate) fn of(&mut self, frames: &Frames, phi: &[f64]) -> &[LinkNumbers] {
        // Without a way out on the way: eight at a time.
        let pairs = self.phi.iter().zip(phi);
        let same = pairs.fold(true, |all, (a, b)| all & (a.to_bits() == b.to_bits()));
        if !same || self.stamp != frames.stamp {
            self.renew(frames, phi);
        }
        &self.numbers
    }

    #[cold]
    fn renew(&mut self, frames: &Frames, phi: &[f64]) {
        self.stamp = frames.stamp;
        copy(phi, &mut self.phi);
        frames.links_into(phi, &mut self.numbers);
    }
}

impl Frame {
    /// A link's parameters of the robot file's frame in this one.
    fn link(&self, phi: &LinkParams) -> LinkNumbers {
        let [m, hx, hy, hz, ixx, ixy, iyy, ixz, iyz, izz] = *phi;
        let half = 0.5 * (ixx + iyy + izz);
        let moments = Matrix3::new(
            half - ixx,
            -ixy,
            -ixz,
            -ixy,
            half - iyy,
            -iyz,
            -ixz,
            -iyz,
            half - izz,
        );
        let h = self.axes.tr_mul(&Vector3::new(hx, hy, hz));
        let s = self.axes.tr_mul(&(moments * self.axes));
        [m, h.x, h.y, h.z, s.m11, s.m12, s.m22, s.m13, s.m23, s.m33]
    }

    /// Sine and cosine of the joint's angle: those of the state, or a sliding joint's own.
    #[inline(always)]
    pub(crate) fn angle<L: Lanes>(&self, sin: L, cos: L) -> [L; 2] {
        match self.kind {
            JointKind::Revolute => [sin, cos],
            JointKind::Prismatic => [L::splat(self.still[0]), L::splat(self.still[1])],
        }
    }

    /// Vectors of the parent's frame in the link's.
    #[inline(always)]
    pub(crate) fn to_link<L: Lanes, const M: usize>(
        &self,
        [sin, cos]: [L; 2],
        mut v: [Vector<L>; M],
    ) -> [Vector<L>; M] {
        match self.tilt {
            Tilt::None => {}
            Tilt::Quarter => {
                for Vector([_, y, z]) in &mut v {
                    (*y, *z) = (*z, -*y);
                }
            }
            Tilt::Free => {
                let (c, s) = (L::splat(self.cos), L::splat(self.sin));
                for Vector([_, y, z]) in &mut v {
                    (*y, *z) = (s.mul_add(*z, c * *y), s.mul_sub_from(*y, c * *z));
                }
            }
        }
        for Vector([x, y, _]) in &mut v {
            (*x, *y) = (sin.mul_add(*y, cos * *x), sin.mul_sub_from(*x, cos * *y));
        }
        v
    }

    /// Vectors of the link's frame in the parent's.
    #[inline(always)]
    pub(crate) fn to_parent<L: Lanes, const M: usize>(
        &self,
        [sin, cos]: [L; 2],
        mut v: [Vector<L>; M],
    ) -> [Vector<L>; M] {
        for Vector([x, y, _]) in &mut v {
            (*x, *y) = (sin.mul_sub_from(*y, cos * *x), sin.mul_add(*x, cos * *y));
        }
        match self.tilt {
            Tilt::None => {}
            Tilt::Quarter => {
                for Vector([_, y, z]) in &mut v {
                    (*y, *z) = (-*z, *y);
                }
            }
            Tilt::Free => {
                let (c, s) = (L::splat(self.cos), L::splat(self.sin));
                for Vector([_, y, z]) in &mut v {
                    (*y, *z) = (s.mul_sub_from(*z, c * *y), s.mul_add(*y, c * *z));
                }
            }
        }
        v
    }

    /// Origin of the link's frame in the parent's \[m\].
    #[inline(always)]
    pub(crate) fn origin<L: Lanes>(&self, q: L) -> Vector<L> {
        let [x, y, z] = self.origin.map(L::splat);
        match self.kind {
            JointKind::Revolute => Vector([x, y, z]),
            JointKind::Prismatic => Vector([
                x,
                q.mul_sub_from(L::splat(self.sin), y),
                q.mul_add(L::splat(self.cos), z),
            ]),
        }
    }
}
