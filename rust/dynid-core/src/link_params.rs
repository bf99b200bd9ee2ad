//! The ten inertial parameters of a link, and the one place that fixes their order.
//!
//! `phi_i = [m, hx, hy, hz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz]`  \[kg, kg·m, kg·m²\]
//!
//! `h = m c` is the first moment and `I` the inertia about the **link-frame origin**. The order is Pinocchio's, so that
//! the cross-check needs no permutation. Nothing here divides by the mass: a lifted vector of base parameters, whose
//! masses may be zero or negative, is as good an input as a physical one.

use core::ops::Range;

use nalgebra::{Matrix3, Matrix4, Vector3};

/// Number of parameters of one link.
pub const N_LINK_PARAMS: usize = 10;
/// Index of the mass.
pub const MASS: usize = 0;
/// Indices of `Ixx, Ixy, Iyy, Ixz, Iyz, Izz`.
pub const INERTIA: Range<usize> = 4..10;
/// Names in order, as reports and files show them.
pub const NAMES: [&str; N_LINK_PARAMS] = [
    "m", "hx", "hy", "hz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz",
];

/// Ten parameters of one link.
pub type LinkParams = [f64; N_LINK_PARAMS];

/// Parameters of a body of mass `m` \[kg\] with centre `com` \[m\] and inertia `inertia_com` \[kg·m²\] about that centre,
/// all in the link frame (parallel-axis theorem: `I = I_c + m (c·c 1 - c cᵀ)`).
#[must_use]
pub fn from_centre(mass: f64, com: &Vector3<f64>, inertia_com: &Matrix3<f64>) -> LinkParams {
    let h = com * mass;
    let inertia = inertia_com + (Matrix3::identity() * com.dot(com) - com * com.transpose()) * mass;
    [
        mass,
        h.x,
        h.y,
        h.z,
        inertia[(0, 0)],
        inertia[(0, 1)],
        inertia[(1, 1)],
        inertia[(0, 2)],
        inertia[(1, 2)],
        inertia[(2, 2)],
    ]
}

/// Inertia matrix about the link-frame origin \[kg·m²\].
#[must_use]
pub fn inertia_matrix(phi: &LinkParams) -> Matrix3<f64> {
    let [xx, xy, yy, xz, yz, zz] = [phi[4], phi[5], phi[6], phi[7], phi[8], phi[9]];
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

/// The same body seen from another frame: `p = rotation * p_body + translation` maps body points to that frame.
///
/// Linear in `phi` and free of divisions, so it holds for any ten numbers:
/// `h' = R h + m t`, `I' = R I Rᵀ + 2 (t·Rh) 1 - t (Rh)ᵀ - (Rh) tᵀ + m (t·t 1 - t tᵀ)`.
#[must_use]
pub fn transform(
    phi: &LinkParams,
    rotation: &Matrix3<f64>,
    translation: &Vector3<f64>,
) -> LinkParams {
    let m = phi[MASS];
    let t = translation;
    let h = rotation * Vector3::new(phi[1], phi[2], phi[3]);
    let moved = h + t * m;
    let shift = (Matrix3::identity() * (2.0 * t.dot(&h)) - t * h.transpose() - h * t.transpose())
        + (Matrix3::identity() * t.dot(t) - t * t.transpose()) * m;
    let inertia = rotation * inertia_matrix(phi) * rotation.transpose() + shift;
    [
        m,
        moved.x,
        moved.y,
        moved.z,
        inertia[(0, 0)],
        inertia[(0, 1)],
        inertia[(1, 1)],
        inertia[(0, 2)],
        inertia[(1, 2)],
        inertia[(2, 2)],
    ]
}

/// Mass \[kg\], centre \[m\] and inertia about that centre \[kg·m²\], all in the link frame: the inverse of [`from_centre`].
///
/// `None` where the mass is not positive: such a body has no centre.
#[must_use]
pub fn to_centre(phi: &LinkParams) -> Option<(f64, Vector3<f64>, Matrix3<f64>)> {
    let mass = phi[MASS];
    if mass.is_nan() || mass <= 0.0 {
        return None;
    }
    let com = Vector3::new(phi[1], phi[2], phi[3]) / mass;
    let shift = (Matrix3::identity() * com.dot(&com) - com * com.transpose()) * mass;
    Some((mass, com, inertia_matrix(phi) - shift))
}

/// Pseudo-inertia `[[S, h], [hᵀ, m]]` with the second moments `S = tr(I)/2 1 - I`: linear in `phi`, and positive definite
/// for just those bodies that can be built from points of positive mass (Wensing, Kim and Slotine 2018).
#[must_use]
pub fn pseudo_inertia(phi: &LinkParams) -> Matrix4<f64> {
    let inertia = inertia_matrix(phi);
    let second = Matrix3::identity() * (0.5 * inertia.trace()) - inertia;
    let mut pseudo = Matrix4::zeros();
    pseudo.fixed_view_mut::<3, 3>(0, 0).copy_from(&second);
    for k in 0..3 {
        pseudo[(k, 3)] = phi[1 + k];
        pseudo[(3, k)] = phi[1 + k];
    }
    pseudo[(3, 3)] = phi[MASS];
    pseudo
}

/// The inverse of [`pseudo_inertia`]: `I = tr(S) 1 - S`. Of a matrix that is not symmetric the symmetric part counts.
#[must_use]
pub fn from_pseudo_inertia(pseudo: &Matrix4<f64>) -> LinkParams {
    let even = (pseudo + pseudo.transpose()) * 0.5;
    let second = even.fixed_view::<3, 3>(0, 0).into_owned();
    let inertia = Matrix3::identity() * second.trace() - second;
    [
        even[(3, 3)],
        even[(0, 3)],
        even[(1, 3)],
        even[(2, 3)],
        inertia[(0, 0)],
        inertia[(0, 1)],
        inertia[(1, 1)],
        inertia[(0, 2)],
        inertia[(1, 2)],
        inertia[(2, 2)],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    const BODY: LinkParams = [2.0, 0.3, -0.1, 0.2, 0.4, 0.02, 0.5, -0.03, 0.01, 0.6];

    #[test]
    fn the_centre_and_back_is_the_same_body() {
        let (mass, com, inertia) = to_centre(&BODY).unwrap_or_default();
        for (a, b) in from_centre(mass, &com, &inertia).iter().zip(BODY) {
            assert!((a - b).abs() < 1e-15, "{a} {b}");
        }
        assert!(to_centre(&[0.0; 10]).is_none());
    }

    #[test]
    fn the_pseudo_inertia_of_points_is_the_sum_of_their_squares() {
        let points = [
            (0.5, Vector3::new(0.1, 0.2, -0.3)),
            (1.5, Vector3::new(-0.4, 0.0, 0.2)),
            (2.0, Vector3::new(0.3, -0.6, 0.1)),
        ];
        let mut phi = [0.0; N_LINK_PARAMS];
        let mut expected = Matrix4::zeros();
        for (mass, place) in points {
            for (sum, part) in phi
                .iter_mut()
                .zip(from_centre(mass, &place, &Matrix3::zeros()))
            {
                *sum += part;
            }
            let point = place.push(1.0);
            expected += point * point.transpose() * mass;
        }
        assert!((pseudo_inertia(&phi) - expected).amax() < 1e-15);
        for (a, b) in from_pseudo_inertia(&expected).iter().zip(phi) {
            assert!((a - b).abs() < 1e-15, "{a} {b}");
        }
    }

    #[test]
    fn a_transform_agrees_with_the_parallel_axis_theorem() {
        let com = Vector3::new(0.1, -0.2, 0.3);
        let inertia = Matrix3::new(0.3, 0.01, 0.02, 0.01, 0.4, -0.03, 0.02, -0.03, 0.5);
        let rotation = Rotation3::from_euler_angles(0.3, -0.7, 1.1).into_inner();
        let translation = Vector3::new(-0.5, 0.25, 0.75);
        let moved = transform(&from_centre(2.5, &com, &inertia), &rotation, &translation);
        let direct = from_centre(
            2.5,
            &(rotation * com + translation),
            &(rotation * inertia * rotation.transpose()),
        );
        for (a, b) in moved.iter().zip(direct) {
            assert!((a - b).abs() < 1e-14, "{moved:?} {direct:?}");
        }
    }
}
