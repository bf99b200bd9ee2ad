//! Frames of a robot file and the bodies in them: the one way in which all formats put them together.

use dynid_core::link_params::{from_centre, transform, LinkParams, N_LINK_PARAMS};
use nalgebra::{Matrix3, Rotation3, Vector3};

/// A frame in another: `p_outer = rotation * p_inner + translation`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) rotation: Matrix3<f64>,
    pub(crate) translation: Vector3<f64>,
}

impl Frame {
    pub(crate) fn identity() -> Self {
        Self {
            rotation: Matrix3::identity(),
            translation: Vector3::zeros(),
        }
    }

    /// `xyz` \[m\] and fixed-axis roll, pitch, yaw \[rad\]: `R = Rz(yaw) Ry(pitch) Rx(roll)`.
    pub(crate) fn from_xyz_rpy(xyz: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> Self {
        Self {
            rotation: Rotation3::from_euler_angles(roll, pitch, yaw).into_inner(),
            translation: Vector3::from(xyz),
        }
    }

    /// `self` after `inner`. One Newton step keeps long products of rotations orthonormal: `R <- R (3 - RᵀR) / 2`.
    ///
    /// Where one of them does not turn there is no product, and the other rotation keeps its last digit: one placement
    /// written as two gives the same numbers.
    pub(crate) fn compose(&self, inner: &Self) -> Self {
        let rotation = if inner.rotation == Matrix3::identity() {
            self.rotation
        } else if self.rotation == Matrix3::identity() {
            inner.rotation
        } else {
            let product = self.rotation * inner.rotation;
            product * (Matrix3::identity() * 3.0 - product.transpose() * product) * 0.5
        };
        Self {
            rotation,
            translation: self.rotation * inner.translation + self.translation,
        }
    }

    /// Parameters of a body of mass `mass` \[kg\] whose centre is this frame's origin and whose inertia \[kg·m²\] about it
    /// is given along this frame's axes.
    pub(crate) fn centred(&self, mass: f64, inertia: &Matrix3<f64>) -> LinkParams {
        let inertia = self.rotation * inertia * self.rotation.transpose();
        from_centre(mass, &self.translation, &inertia)
    }
}

/// Bodies that move as one, each with its frame in that of the link: their parameters in the frame of the link.
pub(crate) fn lump(parts: impl IntoIterator<Item = (Frame, LinkParams)>) -> LinkParams {
    let mut phi = [0.0; N_LINK_PARAMS];
    for (frame, params) in parts {
        let part = transform(&params, &frame.rotation, &frame.translation);
        for (sum, term) in phi.iter_mut().zip(part) {
            *sum += term;
        }
    }
    phi
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_placement_in_two_steps_is_the_placement_in_one() {
        let turn = Frame::from_xyz_rpy([0.0; 3], [1.2, 0.0, 0.0]);
        let shift = Frame::from_xyz_rpy([0.3, -0.2, 0.7], [0.0; 3]);
        let both = Frame::from_xyz_rpy([0.3, -0.2, 0.7], [1.2, 0.0, 0.0]);
        let steps = Frame::identity().compose(&shift).compose(&turn);
        assert_eq!(steps.rotation, both.rotation);
        assert_eq!(steps.translation, both.translation);
    }

    #[test]
    fn long_products_stay_orthonormal() {
        let step = Frame::from_xyz_rpy([0.1, 0.0, 0.0], [0.7, -0.4, 2.9]);
        let frame = (0..100_000).fold(Frame::identity(), |frame, _| frame.compose(&step));
        let defect = (frame.rotation.transpose() * frame.rotation - Matrix3::identity()).amax();
        assert!(defect < 4e-16, "{defect:e}");
    }
}
