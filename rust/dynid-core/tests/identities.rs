//! Identities that hold on any chain, state and parameters: mechanics first, then friction, mixture and estimator.
//!
//! The mechanics is checked by another road: world-frame kinematics, energies and their derivatives, written here.

mod chain;

use std::sync::Arc;

use chain::{case, joint, link_params, rotation, vector3, Case};
use dynid_core::effects::{friction_columns, N_FRICTION};
use dynid_core::link_params::{inertia_matrix, transform, N_LINK_PARAMS};
use dynid_core::model::TorqueModelParts;
use dynid_core::{
    inverse_dynamics_into, joint_torque_regressor_into, CoreError, Domain, Effect, EffectTerm,
    EncoderError, GaussianMixtureRegression, Joint, JointKind, NormalisedRbf, Residual,
    ResidualInputs, RobotModel, Signal, SignalKind, State, Status, TorqueEstimator, TorqueModel,
    Workspace,
};
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Unit, Vector3};
use proptest::collection::vec;
use proptest::prelude::*;

/// Same mathematics, other order of operations; relative to the sum of the magnitudes that are added.
const ALGEBRAIC: f64 = 1e-12;
/// Central differences, step 1e-5: truncation 1e-10, cancellation 1e-11, and room; relative to the same.
const FINITE_DIFFERENCE: f64 = 1e-7;

fn torque(robot: &RobotModel, q: &[f64], dq: &[f64], ddq: &[f64], phi: &[f64]) -> Vec<f64> {
    let mut tau = vec![f64::NAN; q.len()];
    let mut workspace = Workspace::new(robot);
    inverse_dynamics_into(robot, &mut workspace, q, dq, ddq, phi, &mut tau).expect("right lengths");
    tau
}

fn regressor(case: &Case) -> DMatrix<f64> {
    let n = case.q.len();
    let mut y = vec![f64::NAN; n * n * N_LINK_PARAMS];
    let mut workspace = Workspace::new(&case.robot);
    joint_torque_regressor_into(
        &case.robot,
        &mut workspace,
        &case.q,
        &case.dq,
        &case.ddq,
        &mut y,
    )
    .expect("right lengths");
    DMatrix::from_row_slice(n, n * N_LINK_PARAMS, &y)
}

/// Magnitudes that add up to each torque, and never less than one.
fn torque_scale(case: &Case) -> Vec<f64> {
    let phi = DVector::from_iterator(case.phi.len(), case.phi.iter().map(|x| x.abs()));
    (regressor(case).abs() * phi)
        .iter()
        .map(|x| x.max(1.0))
        .collect()
}

fn close(a: &[f64], b: &[f64], scale: &[f64], tolerance: f64) -> Result<(), TestCaseError> {
    for ((a, b), scale) in a.iter().zip(b).zip(scale) {
        prop_assert!(
            (a - b).abs() <= tolerance * scale,
            "{a} and {b} differ by {:e} of {scale}",
            (a - b).abs() / scale
        );
    }
    Ok(())
}

/// A link in the world: pose of its frame, velocity of its origin and angular velocity.
struct WorldLink {
    rotation: Matrix3<f64>,
    origin: Vector3<f64>,
    axis: Vector3<f64>,
    velocity: Vector3<f64>,
    omega: Vector3<f64>,
}

/// Kinematics in world coordinates: products of placements and, for velocities, the columns of the geometric Jacobian.
fn kinematics(robot: &RobotModel, q: &[f64], dq: &[f64]) -> Vec<WorldLink> {
    let mut links: Vec<WorldLink> = Vec::new();
    let (mut rotation, mut origin) = (Matrix3::identity(), Vector3::zeros());
    for (joint, q) in robot.joints().iter().zip(q) {
        origin += rotation * joint.translation;
        rotation *= joint.rotation;
        let axis = rotation * joint.axis;
        match joint.kind {
            JointKind::Revolute => {
                rotation = Rotation3::from_axis_angle(&Unit::new_normalize(axis), *q) * rotation;
            }
            JointKind::Prismatic => origin += axis * *q,
        }
        let (mut velocity, mut omega) = (Vector3::zeros(), Vector3::zeros());
        let before = links.iter().map(|link| (link.axis, link.origin));
        for (((axis, pivot), joint), dq) in
            before.chain([(axis, origin)]).zip(robot.joints()).zip(dq)
        {
            match joint.kind {
                JointKind::Revolute => {
                    omega += axis * *dq;
                    velocity += axis.cross(&(origin - pivot)) * *dq;
                }
                JointKind::Prismatic => velocity += axis * *dq,
            }
        }
        links.push(WorldLink {
            rotation,
            origin,
            axis,
            velocity,
            omega,
        });
    }
    links
}

/// Potential energy `-sum g . (m o + R h)` \[J\].
fn potential_energy(robot: &RobotModel, q: &[f64], phi: &[f64]) -> f64 {
    let still = vec![0.0; q.len()];
    kinematics(robot, q, &still)
        .iter()
        .zip(phi.chunks_exact(N_LINK_PARAMS))
        .map(|(link, phi)| {
            let h = link.rotation * Vector3::new(phi[1], phi[2], phi[3]);
            -robot.gravity().dot(&(link.origin * phi[0] + h))
        })
        .sum()
}

/// Kinetic energy `sum m v.v/2 + v . (w x h) + w . I w/2` \[J\].
fn kinetic_energy(robot: &RobotModel, q: &[f64], dq: &[f64], phi: &[f64]) -> f64 {
    kinematics(robot, q, dq)
        .iter()
        .zip(phi.chunks_exact(N_LINK_PARAMS))
        .map(|(link, phi)| {
            let h = link.rotation * Vector3::new(phi[1], phi[2], phi[3]);
            let phi: &[f64; N_LINK_PARAMS] = phi.try_into().expect("ten numbers");
            let inertia = link.rotation * inertia_matrix(phi) * link.rotation.transpose();
            let (v, w) = (&link.velocity, &link.omega);
            0.5 * phi[0] * v.dot(v) + v.dot(&w.cross(&h)) + 0.5 * w.dot(&(inertia * w))
        })
        .sum()
}

fn central_difference(function: impl Fn(f64) -> f64) -> f64 {
    const STEP: f64 = 1e-5;
    (function(STEP) - function(-STEP)) / (2.0 * STEP)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn regressor_times_parameters_is_inverse_dynamics(case in case(12)) {
        let tau = torque(&case.robot, &case.q, &case.dq, &case.ddq, &case.phi);
        let product = regressor(&case) * DVector::from_column_slice(&case.phi);
        close(product.as_slice(), &tau, &torque_scale(&case), ALGEBRAIC)?;
    }

    #[test]
    fn links_before_a_joint_do_not_load_it(case in case(8)) {
        let y = regressor(&case);
        for j in 0..case.q.len() {
            prop_assert!(y.view((j, 0), (1, j * N_LINK_PARAMS)).iter().all(|x| *x == 0.0));
        }
    }

    #[test]
    fn torque_is_linear_in_the_parameters(
        (case, other) in case(8).prop_flat_map(|case| { let n = case.q.len(); (Just(case), vec(link_params(), n)) }),
        a in -3.0..3.0f64,
        b in -3.0..3.0f64,
    ) {
        let other = other.concat();
        let mixed: Vec<f64> = case.phi.iter().zip(&other).map(|(x, y)| a * x + b * y).collect();
        let at = |phi: &[f64]| torque(&case.robot, &case.q, &case.dq, &case.ddq, phi);
        let sum: Vec<f64> = at(&case.phi).iter().zip(at(&other)).map(|(x, y)| a * x + b * y).collect();
        let magnitudes = case.phi.iter().zip(&other).map(|(x, y)| 3.0 * (x.abs() + y.abs())).collect();
        let scale = torque_scale(&Case { phi: magnitudes, ..case.clone() });
        close(&at(&mixed), &sum, &scale, ALGEBRAIC)?;
    }

    #[test]
    fn torque_at_rest_is_the_gradient_of_the_potential_energy(case in case(8)) {
        let Case { robot, q, phi, .. } = &case;
        let still = vec![0.0; q.len()];
        let tau = torque(robot, q, &still, &still, phi);
        let links = kinematics(robot, q, &still);
        let moments: Vec<(f64, Vector3<f64>)> = links
            .iter()
            .zip(phi.chunks_exact(N_LINK_PARAMS))
            .map(|(link, phi)| (phi[0], link.origin * phi[0] + link.rotation * Vector3::new(phi[1], phi[2], phi[3])))
            .collect();
        // dU/dq_j = -g . (axis x (sum of first moments about the joint)), or -g . axis (sum of masses).
        let closed: Vec<f64> = (0..q.len())
            .map(|j| {
                let mass: f64 = moments[j..].iter().map(|m| m.0).sum();
                let moment: Vector3<f64> = moments[j..].iter().map(|m| m.1).sum();
                let arm = match robot.joints()[j].kind {
                    JointKind::Revolute => links[j].axis.cross(&(moment - links[j].origin * mass)),
                    JointKind::Prismatic => links[j].axis * mass,
                };
                -robot.gravity().dot(&arm)
            })
            .collect();
        let numerical: Vec<f64> = (0..q.len())
            .map(|j| central_difference(|step| {
                let mut q = q.clone();
                q[j] += step;
                potential_energy(robot, &q, phi)
            }))
            .collect();
        let magnitude: f64 = moments.iter().map(|m| m.0.abs() + m.1.norm()).sum();
        let scale = vec![10.0 * (1.0 + magnitude); q.len()];
        close(&tau, &closed, &scale, ALGEBRAIC)?;
        close(&tau, &numerical, &scale, FINITE_DIFFERENCE)?;
    }

    #[test]
    fn power_is_the_rate_of_energy(case in case(7)) {
        // Along the smooth motion q + dq t + ddq t^2/2, through t = 0.
        let Case { robot, q, dq, ddq, phi } = &case;
        let tau = torque(robot, q, dq, ddq, phi);
        let power: f64 = tau.iter().zip(dq).map(|(tau, dq)| tau * dq).sum();
        let energy_at = |t: f64| {
            let at = |k: usize| (q[k] + t * dq[k] + 0.5 * t * t * ddq[k], dq[k] + t * ddq[k]);
            let (q, dq): (Vec<f64>, Vec<f64>) = (0..q.len()).map(at).unzip();
            kinetic_energy(robot, &q, &dq, phi) + potential_energy(robot, &q, phi)
        };
        let magnitude: f64 = torque_scale(&case).iter().zip(dq).map(|(tau, dq)| tau * dq.abs()).sum();
        close(&[power], &[central_difference(energy_at)], &[1.0 + magnitude], FINITE_DIFFERENCE)?;
    }

    #[test]
    fn turning_base_and_gravity_together_changes_nothing(case in case(8), turn in rotation(), shift in vector3(2.0)) {
        let mut joints = case.robot.joints().to_vec();
        joints[0].rotation = turn.matrix() * joints[0].rotation;
        joints[0].translation = turn * joints[0].translation + shift;
        let turned = RobotModel::new("turned".to_owned(), joints, turn * case.robot.gravity()).expect("a valid chain");
        let at = |robot: &RobotModel| torque(robot, &case.q, &case.dq, &case.ddq, &case.phi);
        close(&at(&turned), &at(&case.robot), &torque_scale(&case), ALGEBRAIC)?;
    }

    #[test]
    fn a_locked_joint_adds_its_link_to_the_one_before(case in case(7), last in joint()) {
        let extra = last.phi;
        let merged = transform(&extra, &last.rotation, &last.translation);
        let mut joints = case.robot.joints().to_vec();
        joints.push(last);
        let longer = RobotModel::new("longer".to_owned(), joints, *case.robot.gravity()).expect("a valid chain");
        let held = |signal: &[f64]| [signal, &[0.0]].concat();
        let n = case.q.len();
        let long = Case { q: held(&case.q), dq: held(&case.dq), ddq: held(&case.ddq), phi: longer.phi(), robot: longer };
        let mut phi = case.phi.clone();
        phi[(n - 1) * N_LINK_PARAMS..].iter_mut().zip(merged).for_each(|(a, b)| *a += b);
        let short = torque(&case.robot, &case.q, &case.dq, &case.ddq, &phi);
        let locked = torque(&long.robot, &long.q, &long.dq, &long.ddq, &long.phi);
        close(&short, &locked[..n], &torque_scale(&long), ALGEBRAIC)?;
    }

    #[test]
    fn friction_is_odd_when_sides_are_swapped_and_quadratic_coefficients_negated(
        dq in prop_oneof![-3.0..3.0f64, -1e-3..1e-3f64],
        lambda in prop_oneof![Just(0.0), 0.0..0.5f64],
        eps in 1e-4..0.1f64,
        k in proptest::array::uniform8(-5.0..5.0f64),
    ) {
        let friction = |dq: f64, k: [f64; N_FRICTION]| -> f64 {
            friction_columns(dq, lambda, eps).iter().zip(k).map(|(column, k)| column * k).sum()
        };
        let swapped = [k[1], k[0], k[3], k[2], k[5], k[4], k[7], k[6]];
        let mirrored = [k[1], k[0], k[3], k[2], -k[5], -k[4], k[7], k[6]];
        prop_assert_eq!(friction(-dq, mirrored), -friction(dq, k));
        // Eq. 11 as printed keeps +dq^2 on the negative side: swapping alone leaves twice the quadratic term.
        let quadratic = if dq.abs() < lambda { 0.0 } else { dq * dq * if dq < 0.0 { k[5] } else { k[4] } };
        let left = friction(-dq, swapped) + friction(dq, k);
        prop_assert!((left - 2.0 * quadratic).abs() <= 1e-12 * (1.0 + dq.abs().powi(3) * 5.0), "{left} {quadratic}");
    }

    #[test]
    fn friction_acts_on_one_side_only_and_coulomb_opposes_nothing_but_motion(
        dq in -3.0..3.0f64, lambda in 0.0..0.5f64, eps in 1e-4..0.1f64,
    ) {
        let columns = friction_columns(dq, lambda, eps);
        let other = if dq < 0.0 { 0 } else { 1 };
        prop_assert!((0..4).all(|pair| columns[2 * pair + other] == 0.0));
        let coulomb = columns[1 - other];
        prop_assert!(coulomb * dq >= 0.0 && coulomb.abs() <= 1.0);
        prop_assert!(dq.abs() >= lambda || columns[2..].iter().all(|x| *x == 0.0));
    }

    #[test]
    fn friction_is_zero_at_rest(lambda in prop_oneof![Just(0.0), 0.0..0.5f64], eps in 1e-6..0.1f64) {
        prop_assert_eq!(friction_columns(0.0, lambda, eps), [0.0; N_FRICTION]);
        prop_assert_eq!(friction_columns(-0.0, lambda, eps), [0.0; N_FRICTION]);
    }
}

/// A mixture with `d` inputs: positive weights, covariances `A Aᵀ + 0.1 1`.
fn mixture(d: usize, most: usize) -> impl Strategy<Value = GaussianMixtureRegression> {
    let width = d + 1;
    let component = (
        0.05..1.0f64,
        vec(-2.0..2.0f64, width),
        vec(-1.0..1.0f64, width * width),
    );
    vec(component, 1..=most).prop_map(move |components| {
        let total: f64 = components.iter().map(|c| c.0).sum();
        let weights = components.iter().map(|c| c.0 / total).collect();
        let means = components.iter().flat_map(|c| c.1.clone()).collect();
        let covariances = components
            .iter()
            .flat_map(|c| {
                let a = DMatrix::from_row_slice(width, width, &c.2);
                let s = &a * a.transpose() + DMatrix::identity(width, width) * 0.1;
                s.as_slice().to_vec() // symmetric: either order
            })
            .collect();
        GaussianMixtureRegression::new(d, weights, means, covariances).expect("a valid mixture")
    })
}

/// Eqs. 31-39 as a text book writes them: densities, inverses and determinants; total variance with the spread of means.
fn dense(mixture: &GaussianMixtureRegression, u: &[f64]) -> (Vec<f64>, f64, f64) {
    let (d, width) = (u.len(), u.len() + 1);
    let mut parts = Vec::new();
    for (k, weight) in mixture.weights().iter().enumerate() {
        let mean = &mixture.means()[k * width..(k + 1) * width];
        let s = DMatrix::from_row_slice(
            width,
            width,
            &mixture.covariances()[k * width * width..(k + 1) * width * width],
        );
        let s_u = s.view((0, 0), (d, d)).into_owned();
        let s_fu = s.view((d, 0), (1, d)).into_owned();
        let inverse = s_u.clone().try_inverse().expect("positive definite");
        let off = DVector::from_iterator(d, u.iter().zip(mean).map(|(u, m)| u - m));
        let distance = (off.transpose() * &inverse * &off)[0];
        let two_pi = 2.0 * std::f64::consts::PI;
        let density = (-0.5 * distance).exp() / (two_pi.powi(d as i32) * s_u.determinant()).sqrt();
        let conditional = mean[d] + (&s_fu * &inverse * &off)[0];
        let variance = s[(d, d)] - (&s_fu * &inverse * s_fu.transpose())[0];
        parts.push((weight * density, conditional, variance));
    }
    let total: f64 = parts.iter().map(|p| p.0).sum();
    let h: Vec<f64> = parts.iter().map(|p| p.0 / total).collect();
    let mean: f64 = h.iter().zip(&parts).map(|(h, p)| h * p.1).sum();
    let spread = |p: &(f64, f64, f64)| p.2 + (p.1 - mean) * (p.1 - mean);
    let variance = h.iter().zip(&parts).map(|(h, p)| h * spread(p)).sum();
    (h, mean, variance)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn responsibilities_sum_to_one_at_any_distance(
        mixture in mixture(2, 6), direction in proptest::array::uniform2(-1.0..1.0f64), exponent in -1.0..6.0f64,
    ) {
        let u = direction.map(|x| x * 10f64.powf(exponent));
        let mut h = vec![f64::NAN; mixture.weights().len()];
        mixture.responsibilities_into(&u, &mut h).expect("right lengths");
        prop_assert!(h.iter().all(|h| (0.0..=1.0).contains(h)), "{h:?}");
        prop_assert!((h.iter().sum::<f64>() - 1.0).abs() <= 1e-15 * h.len() as f64);
        let prediction = mixture.predict(&u);
        prop_assert!(prediction.mean.is_finite() && prediction.variance.is_finite());
        prop_assert!(prediction.variance >= 0.0 && prediction.distance_squared >= 0.0);
    }

    #[test]
    fn prediction_is_the_dense_formula_near_the_data(
        (mixture, u) in (1usize..=3).prop_flat_map(|d| (mixture(d, 6), vec(-3.0..3.0f64, d))),
    ) {
        let (h, mean, variance) = dense(&mixture, &u);
        let mut responsibilities = vec![f64::NAN; h.len()];
        mixture.responsibilities_into(&u, &mut responsibilities).expect("right lengths");
        let prediction = mixture.predict(&u);
        // The covariances' smallest eigenvalue is 0.1, so a text-book inverse loses two digits at most.
        let tolerance = 100.0 * ALGEBRAIC;
        close(&responsibilities, &h, &vec![1.0; h.len()], tolerance)?;
        close(&[prediction.mean], &[mean], &[1.0 + mean.abs()], tolerance)?;
        close(&[prediction.variance], &[variance], &[1.0 + mean * mean + variance], tolerance)?;
    }

    #[test]
    fn total_variance_is_not_below_the_smallest_component_variance(
        mixture in mixture(2, 6), u in proptest::array::uniform2(-10.0..10.0f64),
    ) {
        let alone = |k: usize| {
            let (means, covariances) = (&mixture.means()[3 * k..3 * k + 3], &mixture.covariances()[9 * k..9 * k + 9]);
            GaussianMixtureRegression::new(2, vec![1.0], means.to_vec(), covariances.to_vec())
                .expect("a valid mixture")
                .predict(&u)
        };
        let components: Vec<_> = (0..mixture.weights().len()).map(alone).collect();
        let least = components.iter().map(|p| p.variance).fold(f64::INFINITY, f64::min);
        let size = components.iter().map(|p| p.mean * p.mean).fold(1.0, f64::max);
        prop_assert!(mixture.predict(&u).variance >= least - ALGEBRAIC * size);
    }
}

/// Normalised bumps with `d` inputs.
fn rbf(d: usize, most: usize) -> impl Strategy<Value = NormalisedRbf> {
    (1..=most)
        .prop_flat_map(move |n| {
            (
                vec(-2.0..2.0f64, n * d),
                vec(0.1..20.0f64, d),
                vec(-5.0..5.0f64, n),
                vec(0.0..2.0f64, n),
            )
        })
        .prop_map(|(centers, precision, weights, variances)| {
            NormalisedRbf::new(centers, precision, weights, variances).expect("a valid basis")
        })
}

proptest! {
    /// Anywhere: shares sum to one, f and its variance lie between those of the centres, and nothing is NaN.
    #[test]
    fn an_rbf_is_a_weighted_mean_anywhere(
        rbf in rbf(2, 6), direction in proptest::array::uniform2(-1.0..1.0f64), exponent in -1.0..200.0f64,
    ) {
        let u = direction.map(|x| x * 10f64.powf(exponent));
        let mut share = vec![f64::NAN; rbf.weights().len()];
        rbf.shares_into(&u, &mut share).expect("right lengths");
        prop_assert!((share.iter().sum::<f64>() - 1.0).abs() < ALGEBRAIC);
        let prediction = rbf.predict(&u);
        let within = |x: f64, values: &[f64]| {
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            low - ALGEBRAIC <= x && x <= high + ALGEBRAIC
        };
        prop_assert!(within(prediction.mean, rbf.weights()));
        prop_assert!(within(prediction.variance, rbf.variances()));
        let expected: f64 = share.iter().zip(rbf.weights()).map(|(s, w)| s * w).sum();
        prop_assert!((prediction.mean - expected).abs() < ALGEBRAIC);
    }
}

/// Mixtures on some joints, and on every other one of them an RBF in the mixture's place.
fn residual(inputs: ResidualInputs, mixtures: &[Option<GaussianMixtureRegression>]) -> Residual {
    let joints = mixtures
        .iter()
        .enumerate()
        .map(|(j, mixture)| {
            let mixture = mixture.as_ref()?;
            if j % 2 == 0 {
                return Some(mixture.clone().into());
            }
            let means = mixture.means();
            let centers = means.chunks_exact(3).flat_map(|mean| [mean[0], mean[1]]);
            let weights: Vec<f64> = means.chunks_exact(3).map(|mean| mean[2]).collect();
            let variances = vec![0.5; weights.len()];
            let rbf = NormalisedRbf::new(centers.collect(), vec![4.0, 9.0], weights, variances);
            Some(rbf.expect("finite numbers").into())
        })
        .collect();
    Residual::new(inputs, joints)
        .and_then(|residual| residual.with_compliance(vec![1e-3; mixtures.len()]))
        .expect("two inputs each")
}

/// The pairs, and two signals by name for each of `n` joints.
fn every_inputs(n: usize) -> Vec<ResidualInputs> {
    let signals = |j: usize| {
        let kind = |k: usize| SignalKind::ALL[(j + k) % SignalKind::ALL.len()];
        let of = |kind, joint| Signal { kind, joint };
        vec![of(kind(0), j), of(kind(3), (j + 1) % n)]
    };
    let named = ResidualInputs::Signals((0..n).map(signals).collect());
    ResidualInputs::PAIRS.into_iter().chain([named]).collect()
}

/// The same for the first `n` joints.
fn for_joints(inputs: ResidualInputs, n: usize) -> ResidualInputs {
    match inputs {
        ResidualInputs::Signals(_) => every_inputs(n).swap_remove(3),
        pair => pair,
    }
}

/// A model with every effect, two-encoder delays, gains and a mixture on some of the joints.
fn model(most: usize) -> impl Strategy<Value = (Case, Arc<TorqueModel>)> {
    (
        case(most),
        vec(proptest::option::of(mixture(2, 4)), most),
        proptest::sample::select(every_inputs(most)),
        vec(-2.0..2.0f64, most * 10),
        vec(0.5..2.0f64, most),
        vec(0.0..0.004f64, most),
    )
        .prop_map(|(case, mixtures, inputs, numbers, scale, delay)| {
            let n = case.q.len();
            let inputs = for_joints(inputs, n);
            let friction = Effect::friction(&vec![0.05; n], &vec![0.01; n]).unwrap();
            let term = |effect: Effect, first: usize| {
                let count = n * effect.n_columns();
                EffectTerm::new(effect, numbers[first..first + count].to_vec(), n)
                    .expect("a valid term")
            };
            let model = TorqueModel::new(TorqueModelParts {
                robot: case.robot.clone(),
                phi: case.phi.clone(),
                torque_scale: scale[..n].to_vec(),
                effects: vec![
                    term(Effect::rotor_inertia(), 0),
                    term(Effect::torque_offset(), n),
                    term(friction, 2 * n),
                ],
                residual: Some(residual(inputs, &mixtures[..n])),
                encoder_delay: delay[..n].to_vec(),
                noise_std: vec![0.1; n],
                domain: Domain {
                    q: vec![[-2.0, 2.0]; n],
                    dq: vec![1.0; n],
                    ddq: vec![3.0; n],
                },
                torque_unit: "N*m".to_owned(),
                step: None,
            })
            .and_then(|model| model.with_encoder_error(encoder_error(&case.robot, &numbers)))
            .expect("a valid model");
            (case, Arc::new(model))
        })
}

/// Milliradians on every joint that turns; on one of two models the motor side shows them too.
fn encoder_error(robot: &RobotModel, numbers: &[f64]) -> EncoderError {
    let joints = robot.joints().iter().zip(numbers.chunks_exact(2));
    let parts = |(joint, numbers): (&Joint, &[f64])| match joint.kind {
        JointKind::Revolute => [1e-3 * numbers[0], 1e-3 * numbers[1]],
        JointKind::Prismatic => [0.0; 2],
    };
    EncoderError {
        cos_sin: joints.map(parts).collect(),
        both_sides: numbers[0] > 0.0,
    }
}

fn any_float() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(f64::NEG_INFINITY),
        Just(1e300),
        Just(-1e300),
        Just(f64::MAX),
        Just(f64::MIN_POSITIVE),
        any::<f64>(),
        -3.0..3.0f64,
    ]
}

const N: usize = 5;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn terms_sum_to_the_total_to_the_last_bit((case, model) in model(N)) {
        let n = case.q.len();
        let mut estimator = TorqueEstimator::new(model);
        let mut tau = vec![f64::NAN; n];
        let status = estimator.estimate_into(&State::single(&case.q, &case.dq, &case.ddq), &mut tau).expect("right lengths");
        prop_assert!(!status.contains(Status::NON_FINITE));
        for (j, tau) in tau.iter().enumerate() {
            let sum: f64 = estimator.terms().chunks_exact(n).map(|term| term[j]).fold(0.0, |a, b| a + b);
            prop_assert_eq!(sum.to_bits(), tau.to_bits());
        }
    }

    #[test]
    fn outside_domain_is_the_box((case, model) in model(N)) {
        let state = State::single(&case.q, &case.dq, &case.ddq);
        let mut tau = vec![f64::NAN; case.q.len()];
        let status = TorqueEstimator::new(Arc::clone(&model)).estimate_into(&state, &mut tau).expect("right lengths");
        let inside = |signal: &[f64], most: f64| signal.iter().all(|x| x.abs() <= most);
        let inside = inside(&case.q, 2.0) && inside(&case.dq, 1.0) && inside(&case.ddq, 3.0);
        prop_assert_eq!(status.contains(Status::OUTSIDE_DOMAIN), !inside);
    }

    #[test]
    fn after_a_nan_the_last_good_torque_stays_and_the_next_step_is_as_fresh(
        (case, model) in model(N),
        bad in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY)],
        signal in 0usize..6,
        joint in 0usize..N,
    ) {
        let n = case.q.len();
        let mut estimator = TorqueEstimator::new(Arc::clone(&model));
        let mut spoiled = [&case.q, &case.dq, &case.ddq, &case.q, &case.dq, &case.ddq].map(Clone::clone);
        spoiled[signal][joint % n] = bad;
        let [q, dq, ddq, q_motor, dq_motor, ddq_motor] = &spoiled;
        let spoiled = State { q, dq, ddq, q_motor, dq_motor, ddq_motor, temperature: None };
        let (mut before, mut during, mut after, mut fresh) = (vec![1.0; n], vec![1.0; n], vec![1.0; n], vec![1.0; n]);

        // Before any good step: zeros.
        prop_assert_eq!(estimator.estimate_into(&spoiled, &mut during), Ok(Status::NON_FINITE));
        prop_assert!(during.iter().all(|x| *x == 0.0));

        let good = State::single(&case.q, &case.dq, &case.ddq);
        estimator.estimate_into(&good, &mut before).expect("right lengths");
        let terms = estimator.terms().to_vec();
        prop_assert_eq!(estimator.estimate_into(&spoiled, &mut during), Ok(Status::NON_FINITE));
        prop_assert_eq!(bits(&during), bits(&before));
        prop_assert_eq!(bits(estimator.terms()), bits(&terms));

        let next = State::single(&case.dq, &case.q, &case.ddq); // any other good state
        let status = estimator.estimate_into(&next, &mut after).expect("right lengths");
        let mut other = TorqueEstimator::new(model);
        prop_assert_eq!(status, other.estimate_into(&next, &mut fresh).expect("right lengths"));
        prop_assert_eq!(bits(&after), bits(&fresh));
        prop_assert_eq!(bits(estimator.terms()), bits(other.terms()));
    }

    #[test]
    fn output_is_finite_whatever_comes_in(
        (case, model) in model(N), numbers in vec(any_float(), 6 * N * 4),
    ) {
        let n = case.q.len();
        let mut estimator = TorqueEstimator::new(model);
        let mut tau = vec![f64::NAN; n];
        for step in numbers.chunks_exact(6 * N) {
            let signal = |k: usize| &step[k * N..k * N + n];
            let state = State {
                q: signal(0), dq: signal(1), ddq: signal(2),
                q_motor: signal(3), dq_motor: signal(4), ddq_motor: signal(5), temperature: None,
            };
            let status = estimator.estimate_into(&state, &mut tau).expect("right lengths");
            prop_assert!(tau.iter().chain(estimator.terms()).all(|x| x.is_finite()));
            prop_assert!(state.is_finite() || status == Status::NON_FINITE);
        }
    }

    #[test]
    fn an_overflow_repeats_the_last_good_torque((case, model) in model(N), joint in 0usize..N) {
        let n = case.q.len();
        let mut estimator = TorqueEstimator::new(model);
        let (mut before, mut tau) = (vec![0.0; n], vec![0.0; n]);
        estimator.estimate_into(&State::single(&case.q, &case.dq, &case.ddq), &mut before).expect("right lengths");
        let mut dq = case.dq.clone();
        dq[joint % n] = 1e300; // its cube, in friction, is infinite
        let status = estimator.estimate_into(&State::single(&case.q, &dq, &case.ddq), &mut tau).expect("right lengths");
        prop_assert_eq!(status, Status::NON_FINITE);
        prop_assert_eq!(bits(&tau), bits(&before));
    }

    #[test]
    fn every_wrong_length_is_an_error_and_writes_nothing(
        (case, model) in model(N), which in 0usize..7, longer in any::<bool>(),
    ) {
        let n = case.q.len();
        let wrong = if longer { n + 1 } else { n - 1 };
        let numbers = [0.1; N + 1];
        let signal = |k: usize| &numbers[..if k == which { wrong } else { n }];
        let state = State {
            q: signal(0), dq: signal(1), ddq: signal(2),
            q_motor: signal(3), dq_motor: signal(4), ddq_motor: signal(5), temperature: None,
        };
        let mut tau = vec![7.0; if which == 6 { wrong } else { n }];
        let what = ["q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor", "tau"][which];
        let error = CoreError::Length { what, expected: n, actual: wrong };
        prop_assert_eq!(TorqueEstimator::new(model).estimate_into(&state, &mut tau), Err(error));
        prop_assert!(tau.iter().all(|x| *x == 7.0));
    }

    #[test]
    fn wrong_lengths_of_the_dynamics_are_errors(case in case(N), which in 0usize..5, longer in any::<bool>()) {
        let n = case.q.len();
        let mut workspace = Workspace::new(&case.robot);
        let resized = |k: usize, length: usize| {
            let length = if k != which { length } else if longer { length + 1 } else { length - 1 };
            vec![0.1; length]
        };
        let (q, dq, ddq, phi) = (resized(0, n), resized(1, n), resized(2, n), resized(3, 10 * n));
        let mut tau = resized(4, n);
        let error = inverse_dynamics_into(&case.robot, &mut workspace, &q, &dq, &ddq, &phi, &mut tau);
        let is_length = matches!(error, Err(CoreError::Length { .. }));
        prop_assert!(is_length, "{error:?}");
        let mut y = resized(4, 10 * n * n);
        let error = joint_torque_regressor_into(&case.robot, &mut workspace, &q, &dq, &ddq, &mut y);
        prop_assert_eq!(error.is_err(), which != 3);
    }
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|x| x.to_bits()).collect()
}

#[test]
fn a_workspace_of_another_robot_is_an_error() {
    use proptest::strategy::ValueTree;
    use proptest::test_runner::TestRunner;
    let draw = |n: usize| {
        let exact = case(6).prop_filter("length", move |case| case.q.len() == n);
        let mut runner = TestRunner::deterministic();
        exact.new_tree(&mut runner).expect("a chain").current()
    };
    let (short, long) = (draw(2), draw(3));
    let mut workspace = Workspace::new(&long.robot);
    let mut tau = [0.0; 2];
    let error = inverse_dynamics_into(
        &short.robot,
        &mut workspace,
        &short.q,
        &short.dq,
        &short.ddq,
        &short.phi,
        &mut tau,
    );
    assert!(matches!(
        error,
        Err(CoreError::Length {
            what: "workspace",
            expected: 2,
            actual: 3
        })
    ));
}

#[test]
fn mixtures_that_are_none_are_refused() {
    let new = |d, w: &[f64], m: &[f64], c: &[f64]| {
        GaussianMixtureRegression::new(d, w.to_vec(), m.to_vec(), c.to_vec())
    };
    let identity = [1.0, 0.0, 0.0, 1.0];
    assert!(new(1, &[1.0], &[0.0, 0.0], &identity).is_ok());
    for refused in [
        new(0, &[1.0], &[0.0], &[1.0]),
        new(1, &[], &[], &[]),
        new(1, &[1.0], &[0.0], &identity),
        new(1, &[1.0], &[0.0, 0.0], &identity[..3]),
        new(1, &[0.0], &[0.0, 0.0], &identity),
        new(1, &[-1.0], &[0.0, 0.0], &identity),
        new(1, &[f64::NAN], &[0.0, 0.0], &identity),
        new(1, &[1.0], &[f64::NAN, 0.0], &identity),
        new(1, &[1.0], &[0.0, 0.0], &[-1.0, 0.0, 0.0, 1.0]),
        new(1, &[1.0], &[0.0, 0.0], &[0.0, 0.0, 0.0, 1.0]),
        new(1, &[1.0], &[0.0, 0.0], &[1.0, 0.0, 0.0, f64::INFINITY]),
    ] {
        assert!(refused.is_err());
    }
}
