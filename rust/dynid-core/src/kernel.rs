//! The one kernel: the wrench of a moving body, linear in its ten parameters.

use nalgebra::{SMatrix, Vector3};

use crate::lanes::{Lanes, Matrix, Portable, Vector};
use crate::link_params::N_LINK_PARAMS;

/// 6×10 body regressor, rows force x y z \[N\] then moment x y z \[N·m\], columns in the order of [`crate::link_params`].
pub type BodyRegressor = SMatrix<f64, 6, N_LINK_PARAMS>;

/// Motion of a body in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyMotion {
    /// Angular velocity \[rad/s\].
    pub omega: Vector3<f64>,
    /// Angular acceleration \[rad/s²\].
    pub alpha: Vector3<f64>,
    /// Acceleration of the frame origin (of the material point, not the spatial one) **minus gravity** \[m/s²\].
    pub acc: Vector3<f64>,
}

/// A moving body, in rows: its motion as in [`BodyMotion`], and what the wrench needs of it.
///
/// ```text
/// f = m a + S h                 S = [alpha]x + [omega]x [omega]x
/// n = h x a + I alpha + omega x (I omega)
/// ```
///
/// Newton and Euler about the link origin, with h = m c and I about that origin.
#[derive(Clone, Copy, Debug)]
pub struct Body<L> {
    /// Angular velocity \[rad/s\].
    pub omega: Vector<L>,
    /// Angular acceleration \[rad/s²\].
    pub alpha: Vector<L>,
    /// Acceleration of the origin minus gravity \[m/s²\].
    pub acc: Vector<L>,
    /// S: acceleration of a point of the body per unit of its place in the frame \[1/s²\].
    pub spread: Matrix<L>,
    /// `wx wy, wx wz, wy wz`.
    mixed: [L; 3],
    /// `wx² - wy², wz² - wx², wy² - wz²`.
    squares: [L; 3],
}

impl<L: Lanes> Body<L> {
    /// The body with this motion.
    #[inline(always)]
    pub fn new(omega: Vector<L>, alpha: Vector<L>, acc: Vector<L>) -> Self {
        let ([wx, wy, wz], [ax, ay, az]) = (omega.0, alpha.0);
        let (xx, yy, zz) = (wx * wx, wy * wy, wz * wz);
        let (xy, xz, yz) = (wx * wy, wx * wz, wy * wz);
        let spread = Matrix([
            [-(yy + zz), xy - az, xz + ay],
            [xy + az, -(xx + zz), yz - ax],
            [xz - ay, yz + ax, -(xx + yy)],
        ]);
        Self {
            omega,
            alpha,
            acc,
            spread,
            mixed: [xy, xz, yz],
            squares: [xx - yy, zz - xx, yy - zz],
        }
    }

    /// Force and moment about the origin for the parameters `phi` (ten numbers).
    #[inline(always)]
    pub fn wrench(&self, phi: &[f64]) -> (Vector<L>, Vector<L>) {
        let mut row = [L::splat(0.0); N_LINK_PARAMS];
        for (row, phi) in row.iter_mut().zip(phi) {
            *row = L::splat(*phi);
        }
        self.wrench_of(&row)
    }

    /// [`Self::wrench`] with parameters of its own in every lane.
    #[inline(always)]
    pub fn wrench_of(&self, phi: &[L; N_LINK_PARAMS]) -> (Vector<L>, Vector<L>) {
        let Matrix([s0, s1, s2]) = self.spread;
        let ([xy, xz, yz], [dxy, dzx, dyz]) = (self.mixed, self.squares);
        let [ax, ay, az] = self.alpha.0;
        let [m, hx, hy, hz, ixx, ixy, iyy, ixz, iyz, izz] = *phi;
        let h = Vector([hx, hy, hz]);
        let [gx, gy, gz] = self.acc.0;
        let force = Vector([
            Vector(s0).dot_add(h, m * gx),
            Vector(s1).dot_add(h, m * gy),
            Vector(s2).dot_add(h, m * gz),
        ]);
        // I alpha + omega x (I omega), by the parameter's columns; the entries of S come again.
        let moment = Vector([
            Vector([ax, s1[0], dyz]).dot(Vector([ixx, ixz, iyz]))
                + Vector([yz, -yz, -s2[0]]).dot(Vector([izz, iyy, ixy])),
            Vector([s2[1], ay, dzx]).dot(Vector([ixy, iyy, ixz]))
                + Vector([xz, -xz, -s0[1]]).dot(Vector([ixx, izz, iyz])),
            Vector([dxy, s0[2], az]).dot(Vector([ixy, iyz, izz]))
                + Vector([xy, -xy, -s1[2]]).dot(Vector([iyy, ixx, ixz])),
        ]);
        (force, h.cross_add(self.acc, moment))
    }

    /// Power of the wrench on a twist of the body, per unit of each parameter: one row of the regressor. `linear` is the
    /// twist's velocity of the origin, `angular` its angular velocity.
    #[inline(always)]
    pub fn power(&self, linear: Vector<L>, angular: Vector<L>) -> [L; N_LINK_PARAMS] {
        let Matrix([s0, s1, s2]) = self.spread;
        let ([xy, xz, yz], [dxy, dzx, dyz]) = (self.mixed, self.squares);
        let ([ax, ay, az], [vx, vy, vz]) = (self.alpha.0, linear.0);
        let ([gx, gy, gz], [ux, uy, uz]) = (self.acc.0, angular.0);
        // Every sum begins with zero and goes through x, y, z about the axes, then along them: the entries of one state are
        // summed side by side, and what one of them leaves out is a product with zero there.
        let zero = L::splat(0.0);
        let [hx, hy, hz] = [
            uz.mul_add(gy, uy.mul_sub_from(gz, zero)),
            uz.mul_sub_from(gx, ux.mul_add(gz, zero)),
            uy.mul_add(gx, ux.mul_sub_from(gy, zero)),
        ];
        [
            self.acc.dot_add(linear, zero),
            vz.mul_add(s2[0], vy.mul_add(s1[0], vx.mul_add(s0[0], hx))),
            vz.mul_add(s2[1], vy.mul_add(s1[1], vx.mul_add(s0[1], hy))),
            vz.mul_add(s2[2], vy.mul_add(s1[2], vx.mul_add(s0[2], hz))),
            uz.mul_sub_from(xy, uy.mul_add(xz, ux.mul_add(ax, zero))),
            uz.mul_add(dxy, uy.mul_add(s2[1], ux.mul_sub_from(s2[0], zero))),
            uz.mul_add(xy, uy.mul_add(ay, ux.mul_sub_from(yz, zero))),
            uz.mul_sub_from(s1[2], uy.mul_add(dzx, ux.mul_add(s1[0], zero))),
            uz.mul_add(s0[2], uy.mul_sub_from(s0[1], ux.mul_add(dyz, zero))),
            uz.mul_add(az, uy.mul_sub_from(xz, ux.mul_add(yz, zero))),
        ]
    }

    /// [`Self::power`] on a motion along axis `k` of the frame, but for the moments of inertia, which have none.
    #[inline(always)]
    pub(crate) fn power_along(&self, k: usize) -> [L; 4] {
        let [x, y, z] = self.spread.0[k];
        [self.acc.0[k], x, y, z]
    }

    /// [`Self::power`] on a turn about axis `k` of the frame, without its zeros.
    #[inline(always)]
    pub fn power_about(&self, k: usize) -> [L; N_LINK_PARAMS] {
        let Matrix([s0, s1, s2]) = self.spread;
        let ([xy, xz, yz], [dxy, dzx, dyz]) = (self.mixed, self.squares);
        let ([gx, gy, gz], [ax, ay, az]) = (self.acc.0, self.alpha.0);
        let zero = L::splat(0.0);
        match k {
            0 => [zero, zero, gz, -gy, ax, -s2[0], -yz, s1[0], dyz, yz],
            1 => [zero, -gz, zero, gx, xz, s2[1], ay, dzx, -s0[1], -xz],
            _ => [zero, gy, -gx, zero, -xy, dxy, xy, -s1[2], s0[2], az],
        }
    }
}

/// Body regressor `B` with wrench about the frame origin = `B phi`: [`Body`] as a matrix, for one motion.
#[must_use]
pub fn body_regressor(motion: &BodyMotion) -> BodyRegressor {
    type One = Portable<1, false>;
    let vector = |v: &Vector3<f64>| Vector::<One>::splat(&[v.x, v.y, v.z]);
    let body = Body::new(
        vector(&motion.omega),
        vector(&motion.alpha),
        vector(&motion.acc),
    );
    let mut regressor = BodyRegressor::zeros();
    for row in 0..6 {
        let mut twist = [0.0; 6];
        twist[row] = 1.0;
        let [vx, vy, vz, ux, uy, uz] = twist;
        let power = body.power(Vector::splat(&[vx, vy, vz]), Vector::splat(&[ux, uy, uz]));
        for (column, x) in power.into_iter().enumerate() {
            [regressor[(row, column)]] = x.raw();
        }
    }
    regressor
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link_params::{inertia_matrix, LinkParams};

    #[test]
    fn the_kernel_is_newton_and_euler_about_the_origin() {
        let motion = BodyMotion {
            omega: Vector3::new(0.3, -1.2, 0.7),
            alpha: Vector3::new(-0.4, 0.9, 2.1),
            acc: Vector3::new(1.5, -0.2, 9.6),
        };
        let phi: LinkParams = [2.0, 0.3, -0.1, 0.5, 0.7, 0.02, 0.9, -0.05, 0.04, 1.1];
        let (w, al, a) = (motion.omega, motion.alpha, motion.acc);
        let h = Vector3::new(phi[1], phi[2], phi[3]);
        let inertia = inertia_matrix(&phi);
        let force = a * phi[0] + al.cross(&h) + w.cross(&w.cross(&h));
        let moment = h.cross(&a) + inertia * al + w.cross(&(inertia * w));
        let wrench = body_regressor(&motion) * SMatrix::<f64, 10, 1>::from(phi);
        let vector = |v: Vector3<f64>| Vector::<Portable<1, false>>::splat(&[v.x, v.y, v.z]);
        let (own_force, own_moment) = Body::new(vector(w), vector(al), vector(a)).wrench(&phi);
        for k in 0..3 {
            assert!((wrench[k] - force[k]).abs() < 1e-14);
            assert!((wrench[3 + k] - moment[k]).abs() < 1e-14);
            assert!((own_force.0[k].raw()[0] - force[k]).abs() < 1e-14);
            assert!((own_moment.0[k].raw()[0] - moment[k]).abs() < 1e-14);
        }
    }
}
