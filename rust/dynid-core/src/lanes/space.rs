//! Three-dimensional algebra of lanes.

use core::ops::{Add, Mul, Sub};

use super::Lanes;

/// A vector in space.
#[derive(Clone, Copy, Debug)]
pub struct Vector<L>(pub [L; 3]);

/// A 3×3 matrix, by rows.
#[derive(Clone, Copy, Debug)]
pub struct Matrix<L>(pub [[L; 3]; 3]);

impl<L: Lanes> Vector<L> {
    /// The same vector in every lane.
    #[inline(always)]
    pub fn splat(v: &[f64; 3]) -> Self {
        Self([L::splat(v[0]), L::splat(v[1]), L::splat(v[2])])
    }

    /// Zeros.
    #[inline(always)]
    pub fn zero() -> Self {
        Self([L::splat(0.0); 3])
    }

    /// From memory.
    #[inline(always)]
    pub fn from_raw(raw: &[L::Raw; 3]) -> Self {
        Self([
            L::from_raw(raw[0]),
            L::from_raw(raw[1]),
            L::from_raw(raw[2]),
        ])
    }

    /// To memory.
    #[inline(always)]
    pub fn raw(self) -> [L::Raw; 3] {
        let [x, y, z] = self.0;
        [x.raw(), y.raw(), z.raw()]
    }

    /// To this place in memory. Number by number: a copy of the whole would wait for its parts.
    #[inline(always)]
    pub fn put(self, to: &mut [L::Raw; 3]) {
        to[0] = self.0[0].raw();
        to[1] = self.0[1].raw();
        to[2] = self.0[2].raw();
    }

    /// The same vector in each of four lanes.
    #[inline(always)]
    pub fn of_four(self) -> Vector<L::Four>
    where
        L: Lanes<Raw = [f64; 1]>,
    {
        let [x, y, z] = self.0;
        Vector([x.of_four(), y.of_four(), z.of_four()])
    }

    /// This vector in lanes where `sign` has its bit set, `other` elsewhere.
    #[inline(always)]
    pub fn where_signed(self, sign: L, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([
            sign.if_signed(a, x),
            sign.if_signed(b, y),
            sign.if_signed(c, z),
        ])
    }

    /// Inner product.
    #[inline(always)]
    pub fn dot(self, other: Self) -> L {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        c.mul_add(z, b.mul_add(y, a * x))
    }

    /// `addend + self . other`.
    #[inline(always)]
    pub fn dot_add(self, other: Self, addend: L) -> L {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        c.mul_add(z, b.mul_add(y, a.mul_add(x, addend)))
    }

    /// `self x other`.
    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([
            c.mul_sub_from(y, b * z),
            a.mul_sub_from(z, c * x),
            b.mul_sub_from(x, a * y),
        ])
    }

    /// `addend + self x other`.
    #[inline(always)]
    pub fn cross_add(self, other: Self, addend: Self) -> Self {
        let ([a, b, c], [x, y, z], [u, v, w]) = (self.0, other.0, addend.0);
        Self([
            c.mul_sub_from(y, b.mul_add(z, u)),
            a.mul_sub_from(z, c.mul_add(x, v)),
            b.mul_sub_from(x, a.mul_add(y, w)),
        ])
    }

    /// `addend + self * factor`.
    #[inline(always)]
    pub fn mul_add(self, factor: L, addend: Self) -> Self {
        let ([a, b, c], [u, v, w]) = (self.0, addend.0);
        Self([
            a.mul_add(factor, u),
            b.mul_add(factor, v),
            c.mul_add(factor, w),
        ])
    }
}

impl<L: Lanes> Add for Vector<L> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([a + x, b + y, c + z])
    }
}

impl<L: Lanes> Sub for Vector<L> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([a - x, b - y, c - z])
    }
}

impl<L: Lanes> Mul<L> for Vector<L> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: L) -> Self {
        let [a, b, c] = self.0;
        Self([a * factor, b * factor, c * factor])
    }
}

impl<L: Lanes> Matrix<L> {
    /// From memory.
    #[inline(always)]
    pub fn from_raw(raw: &[[L::Raw; 3]; 3]) -> Self {
        Self([
            Vector::from_raw(&raw[0]).0,
            Vector::from_raw(&raw[1]).0,
            Vector::from_raw(&raw[2]).0,
        ])
    }

    /// To memory.
    #[inline(always)]
    pub fn raw(self) -> [[L::Raw; 3]; 3] {
        let [a, b, c] = self.0;
        [Vector(a).raw(), Vector(b).raw(), Vector(c).raw()]
    }

    /// To this place in memory, as [`Vector::put`].
    #[inline(always)]
    pub fn put(self, to: &mut [[L::Raw; 3]; 3]) {
        Vector(self.0[0]).put(&mut to[0]);
        Vector(self.0[1]).put(&mut to[1]);
        Vector(self.0[2]).put(&mut to[2]);
    }

    /// The transpose times `v`.
    #[inline(always)]
    pub fn tr_mul(self, v: Vector<L>) -> Vector<L> {
        let [a, b, c] = self.0;
        let [x, y, z] = v.0;
        Vector(c).mul_add(z, Vector(b).mul_add(y, Vector(a) * x))
    }
}

impl<L: Lanes> Mul<Vector<L>> for Matrix<L> {
    type Output = Vector<L>;

    #[inline(always)]
    fn mul(self, v: Vector<L>) -> Vector<L> {
        let [a, b, c] = self.0;
        Vector([Vector(a).dot(v), Vector(b).dot(v), Vector(c).dot(v)])
    }
}
