//! The one kernel: the wrench of a moving body as a 6×10 matrix times its ten parameters.

use nalgebra::{SMatrix, Vector3};

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

/// Body regressor `B` with wrench about the frame origin = `B phi`:
///
/// ```text
/// f = m a + S h                 S = [alpha]x + [omega]x [omega]x
/// n = h x a + I alpha + omega x (I omega)
/// ```
///
/// Newton and Euler about the link origin, with h = m c and I about that origin.
#[must_use]
pub fn body_regressor(motion: &BodyMotion) -> BodyRegressor {
    let BodyMotion {
        omega: w,
        alpha: al,
        acc: a,
    } = motion;
    let (xx, yy, zz) = (w.x * w.x, w.y * w.y, w.z * w.z);
    let (xy, xz, yz) = (w.x * w.y, w.x * w.z, w.y * w.z);
    let mut b = BodyRegressor::zeros();
    // Force: mass, then S.
    b[(0, 0)] = a.x;
    b[(1, 0)] = a.y;
    b[(2, 0)] = a.z;
    b[(0, 1)] = -(yy + zz);
    b[(0, 2)] = xy - al.z;
    b[(0, 3)] = xz + al.y;
    b[(1, 1)] = xy + al.z;
    b[(1, 2)] = -(xx + zz);
    b[(1, 3)] = yz - al.x;
    b[(2, 1)] = xz - al.y;
    b[(2, 2)] = yz + al.x;
    b[(2, 3)] = -(xx + yy);
    // Moment: h x a.
    b[(3, 2)] = a.z;
    b[(3, 3)] = -a.y;
    b[(4, 1)] = -a.z;
    b[(4, 3)] = a.x;
    b[(5, 1)] = a.y;
    b[(5, 2)] = -a.x;
    // Moment: I alpha + omega x (I omega), columns Ixx Ixy Iyy Ixz Iyz Izz.
    b[(3, 4)] = al.x;
    b[(4, 4)] = xz;
    b[(5, 4)] = -xy;
    b[(3, 5)] = al.y - xz;
    b[(4, 5)] = al.x + yz;
    b[(5, 5)] = xx - yy;
    b[(3, 6)] = -yz;
    b[(4, 6)] = al.y;
    b[(5, 6)] = xy;
    b[(3, 7)] = al.z + xy;
    b[(4, 7)] = zz - xx;
    b[(5, 7)] = al.x - yz;
    b[(3, 8)] = yy - zz;
    b[(4, 8)] = al.z - xy;
    b[(5, 8)] = al.y + xz;
    b[(3, 9)] = yz;
    b[(4, 9)] = -xz;
    b[(5, 9)] = al.z;
    b
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
        for k in 0..3 {
            assert!((wrench[k] - force[k]).abs() < 1e-14);
            assert!((wrench[3 + k] - moment[k]).abs() < 1e-14);
        }
    }
}
