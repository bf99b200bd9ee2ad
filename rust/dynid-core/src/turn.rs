//! Rotations and vectors whose axes have been renamed, so that the axis of a joint is called z.

use crate::lanes::{Lanes, Matrix, Vector};

/// The axis that joints turn about, as it is called here.
pub(crate) const Z: usize = 2;

/// The axes of a frame in the order in which they stand where axis k is called z.
pub(crate) const RENAMED: [[usize; 3]; 3] = [[1, 2, 0], [2, 0, 1], [0, 1, 2]];

/// A joint's rotation, in the names of its [`Placement`](crate::chain::Placement).
#[derive(Clone, Copy, Debug)]
pub struct Turn<L>(pub(crate) Matrix<L>);

impl<L: Lanes> Turn<L> {
    /// No rotation at all.
    #[inline(always)]
    pub fn zero() -> Self {
        Self(Matrix([[L::splat(0.0); 3]; 3]))
    }
}

/// Vectors with the axes renamed so that axis `k` is called z. All at once: it is one branch then.
#[inline(always)]
pub(crate) fn renamed<L: Lanes, const M: usize>(mut v: [Vector<L>; M], k: usize) -> [Vector<L>; M] {
    match k {
        0 => {
            for Vector([x, y, z]) in &mut v {
                (*x, *y, *z) = (*y, *z, *x);
            }
        }
        1 => {
            for Vector([x, y, z]) in &mut v {
                (*x, *y, *z) = (*z, *x, *y);
            }
        }
        _ => {}
    }
    v
}

/// [`renamed`], undone.
#[inline(always)]
pub(crate) fn called<L: Lanes, const M: usize>(v: [Vector<L>; M], k: usize) -> [Vector<L>; M] {
    // Renamed three times an axis has its name again.
    renamed(v, if k < Z { 1 - k } else { Z })
}
