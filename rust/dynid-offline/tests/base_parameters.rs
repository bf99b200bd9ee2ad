//! Base parameters on random chains: regrouping keeps the torque, at states that the search has not seen.

#[path = "../../dynid-core/tests/chain/mod.rs"]
mod chain;

use chain::{case, Case};
use dynid_core::{Joint, RobotModel};
use dynid_offline::base::probing_states;
use dynid_offline::{base_parameters, batch, BaseParameters};
use nalgebra::{DMatrix, DVector, Vector3};
use proptest::prelude::*;

/// Same mathematics through a QR and a least-squares solution; relative to the sum of the magnitudes that are added.
const ALGEBRAIC: f64 = 1e-10;
/// A singular value below this, relative to the largest, counts as zero.
const RANK: f64 = 1e-9;
/// Rank of a random chain is asked with this relative tolerance.
const RTOL: f64 = 1e-9;
const N: usize = 5;

/// Regressor of many states, one row per state and joint.
fn stacked_regressor(robot: &RobotModel, n_samples: usize, seed: u64) -> DMatrix<f64> {
    let n = robot.n_joints();
    let (q, dq, ddq) = probing_states(robot, n_samples, seed);
    let mut rows = vec![f64::NAN; n_samples * n * 10 * n];
    batch::joint_torque_regressor(robot, &q, &dq, &ddq, &mut rows).expect("right lengths");
    DMatrix::from_row_slice(n_samples * n, 10 * n, &rows)
}

fn project(base: &BaseParameters, phi: &[f64]) -> DVector<f64> {
    let width = base.dependent.len();
    let value = |(i, &pivot): (usize, &usize)| {
        let row = &base.beta[i * width..(i + 1) * width];
        let regrouped = row.iter().zip(&base.dependent).map(|(b, &k)| b * phi[k]);
        phi[pivot] + regrouped.sum::<f64>()
    };
    DVector::from_iterator(base.pivots.len(), base.pivots.iter().enumerate().map(value))
}

fn numerical_rank(matrix: DMatrix<f64>) -> usize {
    let values = matrix.singular_values();
    values.iter().filter(|s| **s > RANK * values.max()).count()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn the_torque_of_the_base_parameters_is_the_torque_of_all(case in case(N), seed in any::<u64>()) {
        let base = base_parameters(&case.robot, seed, RTOL).expect("a valid robot");
        let y = stacked_regressor(&case.robot, 20, seed ^ 0x5eed);
        let phi = DVector::from_column_slice(&case.phi);
        let reduced = y.select_columns(&base.pivots) * project(&base, &case.phi);
        let scale = (y.abs() * phi.abs()).add_scalar(1.0);
        let beta = base.beta.iter().fold(1.0, |most: f64, b| most.max(b.abs()));
        for ((a, b), scale) in (y * phi).iter().zip(&reduced).zip(&scale) {
            prop_assert!((a - b).abs() <= ALGEBRAIC * scale * beta, "{a} {b} {scale} {beta}");
        }
    }

    #[test]
    fn their_number_is_the_rank_of_the_regressor(case in case(N), seed in any::<u64>()) {
        let base = base_parameters(&case.robot, seed, RTOL).expect("a valid robot");
        prop_assert_eq!(base.pivots.len(), numerical_rank(stacked_regressor(&case.robot, 60, !seed)));
        prop_assert!(base.gap > 1e3, "gap {:e}", base.gap);
        prop_assert!(base.spread >= 1.0 && base.spread < 1.0 / RTOL);
    }

    #[test]
    fn pivots_and_dependents_are_ascending_and_disjoint_and_the_rest_moves_nothing(case in case(N), seed in any::<u64>()) {
        let base = base_parameters(&case.robot, seed, RTOL).expect("a valid robot");
        prop_assert!(base.pivots.windows(2).all(|pair| pair[0] < pair[1]));
        prop_assert!(base.dependent.windows(2).all(|pair| pair[0] < pair[1]));
        prop_assert!(base.pivots.iter().all(|k| !base.dependent.contains(k)));
        prop_assert_eq!(base.beta.len(), base.pivots.len() * base.dependent.len());
        let y = stacked_regressor(&case.robot, 20, seed ^ 0xbad);
        let length = |k: usize| y.column(k).norm();
        let longest = (0..y.ncols()).map(length).fold(0.0, f64::max);
        let named = |k: &usize| base.pivots.contains(k) || base.dependent.contains(k);
        for k in (0..case.phi.len()).filter(|k| !named(k)) {
            // The search has seen other states, where its tolerance holds.
            prop_assert!(length(k) <= 3.0 * RTOL * longest);
        }
    }

    #[test]
    fn the_seed_decides_everything_but_not_the_number(case in case(N), seed in any::<u64>()) {
        let at = |seed| base_parameters(&case.robot, seed, RTOL).expect("a valid robot");
        prop_assert_eq!(at(seed), at(seed));
        prop_assert_eq!(at(seed).pivots.len(), at(seed.wrapping_add(1)).pivots.len());
    }

    #[test]
    fn probing_states_stay_in_their_ranges(case in case(N), seed in any::<u64>()) {
        let Case { robot, .. } = &case;
        let (q, dq, ddq) = probing_states(robot, 50, seed);
        prop_assert_eq!(q.len(), 50 * robot.n_joints());
        let within = |signal: &[f64], most: f64| signal.iter().all(|x| x.abs() <= most);
        prop_assert!(within(&q, std::f64::consts::PI) && within(&dq, 2.0) && within(&ddq, 5.0));
    }
}

/// A single joint turning about the vertical feels one number; leaning, its centre of mass as well.
#[test]
fn one_revolute_joint_has_one_base_parameter_upright_and_three_leaning() {
    let upright = Joint {
        name: "joint".to_owned(),
        link: "link".to_owned(),
        kind: dynid_core::JointKind::Revolute,
        rotation: nalgebra::Matrix3::identity(),
        translation: Vector3::zeros(),
        axis: Vector3::z(),
        limits: dynid_core::JointLimits::default(),
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi: [0.0; 10],
    };
    let down = Vector3::new(0.0, 0.0, -9.81);
    let robot = |gravity| RobotModel::new("one".to_owned(), vec![upright.clone()], gravity);
    let base = |gravity| {
        base_parameters(&robot(gravity).expect("a valid robot"), 0, RTOL).expect("a valid robot")
    };
    assert_eq!(base(down).pivots, [9]); // Izz
    assert_eq!(base(Vector3::new(9.81, 0.0, 0.0)).pivots, [1, 2, 9]); // hx hy Izz
    assert!(base(down).dependent.is_empty());
    assert!(base(down).gap.is_infinite());
}
