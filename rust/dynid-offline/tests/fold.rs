//! Factors folded in one pass are those of the rows; weighted fits on them are those of the stacked rows.

#[path = "../../dynid-core/benches/common/arm.rs"]
mod arm;
#[path = "../../dynid-core/tests/chain/mod.rs"]
mod chain;

use arm::arm;
use chain::case;
use dynid_core::{Effect, RobotModel, State};
use dynid_offline::base::probing_states;
use dynid_offline::{
    base_parameters, batch, fold, observe, triangular_factor, weighted_fit, OfflineError,
    RunSignals, RunStates, Sampling, ZeroPhase,
};
use proptest::prelude::*;

const N: usize = 3;

fn bits(factors: &[Vec<f64>]) -> Vec<u64> {
    factors.iter().flatten().map(|x| x.to_bits()).collect()
}

fn effects() -> Vec<Effect> {
    let friction = Effect::friction(&[0.2; N], &[0.1; N]).unwrap();
    vec![Effect::torque_offset(), friction, Effect::rotor_inertia()]
}

/// A run with a torque of the links and something on top.
struct Run {
    motion: [Vec<f64>; 3],
    tau: Vec<f64>,
}

impl Run {
    fn new(robot: &RobotModel, phi: &[f64], n_samples: usize, seed: u64, noise: f64) -> Self {
        let (q, dq, ddq) = probing_states(robot, n_samples, seed);
        Self::along([q, dq, ddq], robot, phi, noise)
    }

    fn along(motion: [Vec<f64>; 3], robot: &RobotModel, phi: &[f64], noise: f64) -> Self {
        let [q, dq, ddq] = &motion;
        let mut tau = vec![0.0; q.len()];
        batch::inverse_dynamics(robot, q, dq, ddq, phi, &mut tau).unwrap();
        for (k, tau) in tau.iter_mut().enumerate() {
            *tau += noise * (1.0 + (k % N) as f64) * (k as f64 * 1.7).sin();
        }
        Self { motion, tau }
    }

    fn states(&self) -> RunStates<'_> {
        let [q, dq, ddq] = &self.motion;
        RunStates {
            signals: RunSignals {
                state: State::single(q, dq, ddq),
                tau_link: None,
                tau_motor: None,
                step: None,
            },
            tau: &self.tau,
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn folding_is_factoring_the_rows(case in case(N), seed in any::<u64>(), n_samples in 1..400_usize, step in 1..4_usize) {
        prop_assume!(case.robot.n_joints() == N);
        let run = Run::new(&case.robot, &case.phi, n_samples, seed, 0.1);
        let pivots = base_parameters(&case.robot, 0, 1e-9).unwrap().pivots;
        let sampling = Sampling { filter: ZeroPhase::default(), kept: (0..n_samples).step_by(step).collect() };
        let folded = fold(&case.robot, &effects(), &pivots, &run.states(), Some(&sampling)).unwrap();
        let rows = observe(&case.robot, &effects(), &pivots, &run.states(), &sampling).unwrap();
        for (r, joint) in folded.iter().zip(&rows.joints) {
            let width = joint.width;
            let expected = triangular_factor(&joint.rows, width).unwrap();
            // R'R, because the rows of R that the data do not fill are any.
            let gram = |r: &[f64], i: usize, k: usize| (0..width).map(|m| r[m * width + i] * r[m * width + k]).sum::<f64>();
            for i in 0..width {
                prop_assert!(r[i * width + i] >= 0.0);
                for k in 0..width {
                    let size = (gram(&expected, i, i) * gram(&expected, k, k)).sqrt();
                    let (a, b) = (gram(r, i, k), gram(&expected, i, k));
                    prop_assert!((a - b).abs() <= 1e-12 * (1e-300 + size), "{i} {k} {a:e} {b:e} {size:e}");
                }
            }
        }
    }
}

#[test]
fn any_number_of_threads_and_any_path_fold_to_the_same_bits() {
    use dynid_core::lanes::{path, use_path, Path};
    let case = fixed_case();
    // More than one wave of tasks, and a tail.
    let run = Run::new(&case.robot, &case.phi, 150_003, 5, 0.1);
    let pivots = base_parameters(&case.robot, 0, 1e-9).unwrap().pivots;
    let folded = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads);
        let work = || fold(&case.robot, &effects(), &pivots, &run.states(), None).unwrap();
        bits(&pool.build().unwrap().install(work))
    };
    let one = folded(1);
    assert!(one == folded(2));
    assert!(one == folded(3));
    // The other tests of this file do not compare bits, so they may run on any path.
    if path() == Path::Avx512 {
        use_path(Path::Avx2);
        assert!(one == folded(2));
        use_path(Path::Avx512);
    }
}

fn fixed_case() -> chain::Case {
    use proptest::strategy::{Strategy, ValueTree};
    use proptest::test_runner::TestRunner;
    let mut runner = TestRunner::deterministic();
    let strategy = case(N).prop_filter("joints", |case| case.robot.n_joints() == N);
    strategy.new_tree(&mut runner).unwrap().current()
}

/// Stacked, weighted, solved by the normal equations in the open: another road to the same numbers.
#[test]
fn a_weighted_fit_is_least_squares_on_the_stacked_rows() {
    let case = fixed_case();
    let n_samples = 500;
    let run = Run::new(&case.robot, &case.phi, n_samples, 7, 0.3);
    let pivots = base_parameters(&case.robot, 0, 1e-9).unwrap().pivots;
    let sampling = Sampling {
        filter: ZeroPhase::default(),
        kept: (0..n_samples).collect(),
    };
    let effects = vec![Effect::torque_offset()];
    let factors = fold(&case.robot, &effects, &pivots, &run.states(), None).unwrap();
    let slices: Vec<&[f64]> = factors.iter().map(Vec::as_slice).collect();
    let rows = observe(&case.robot, &effects, &pivots, &run.states(), &sampling).unwrap();
    let width = pivots.len() + N;
    let mut noise = vec![1.0; N];
    for n_reweightings in 0..3 {
        let fit = weighted_fit(&slices, &pivots, n_samples, n_reweightings).unwrap();
        let mut a = nalgebra::DMatrix::<f64>::zeros(N * n_samples, width);
        let mut b = nalgebra::DVector::<f64>::zeros(N * n_samples);
        for (j, joint) in rows.joints.iter().enumerate() {
            for (k, row) in joint.rows.chunks_exact(joint.width).enumerate() {
                let at = j * n_samples + k;
                a[(at, pivots.len() + j)] = row[0] / noise[j];
                let first = width - N + 2 - joint.width;
                for (c, x) in row[1..joint.width - 1].iter().enumerate() {
                    a[(at, first + c)] = x / noise[j];
                }
                b[at] = row[joint.width - 1] / noise[j];
            }
        }
        let gram = a.transpose() * &a;
        let covariance = gram.try_inverse().expect("independent columns");
        let solution = &covariance * (a.transpose() * &b);
        let left = &b - &a * &solution;
        let freedom = n_samples as f64 - width as f64 / N as f64;
        let own: Vec<f64> = (0..N)
            .map(|j| left.rows(j * n_samples, n_samples).norm() / freedom.sqrt() * noise[j])
            .collect();
        let common = if n_reweightings > 0 {
            1.0
        } else {
            (own.iter().map(|s| s * s).sum::<f64>() / N as f64).sqrt()
        };
        let close = |x: f64, y: f64| (x - y).abs() <= 1e-7 * (1.0 + y.abs());
        for (k, (x, std)) in fit.base.iter().zip(&fit.base_std).enumerate() {
            assert!(close(*x, solution[k]), "{k}: {x} {}", solution[k]);
            assert!(close(*std, common * covariance[(k, k)].sqrt()), "{k}");
        }
        for (j, (x, std)) in fit.effects.iter().zip(&fit.effects_std).enumerate() {
            let at = pivots.len() + j;
            assert!(close(*x, solution[at]), "{j}: {x} {}", solution[at]);
            // The noise of the last round is that behind the effect's own rows.
            let expected = common * covariance[(at, at)].sqrt();
            assert!(
                (std - expected).abs() <= 0.02 * expected,
                "{j}: {std} {expected}"
            );
        }
        for (x, y) in fit.noise_std.iter().zip(&own) {
            assert!(close(*x, *y));
        }
        noise = own;
    }
}

/// In the rows of this arm's second joint a base column follows from others, as only the first joint tells them apart.
#[test]
fn columns_that_a_joint_does_not_tell_apart_come_back() {
    let robot = arm(0.0);
    let n_samples = 500;
    let run = Run::new(&robot, &robot.phi(), n_samples, 3, 0.1);
    let pivots = base_parameters(&robot, 0, 1e-9).unwrap().pivots;
    let sampling = Sampling {
        filter: ZeroPhase::default(),
        kept: (0..n_samples).collect(),
    };
    let effects = [Effect::torque_offset()];
    let folded = fold(&robot, &effects, &pivots, &run.states(), None).unwrap();
    let rows = observe(&robot, &effects, &pivots, &run.states(), &sampling).unwrap();
    let mut following = 0;
    for (r, joint) in folded.iter().zip(&rows.joints) {
        let width = joint.width;
        assert_eq!(r.len(), width * width);
        let expected = triangular_factor(&joint.rows, width).unwrap();
        let product = |r: &[f64], i: usize, k: usize| -> f64 {
            (0..width)
                .map(|m| r[m * width + i] * r[m * width + k])
                .sum()
        };
        let longest = (0..width)
            .map(|i| product(&expected, i, i))
            .fold(0.0, f64::max);
        for i in 0..width {
            let length = product(&expected, i, i).sqrt();
            let left = expected[i * width + i];
            following += usize::from(length > 1e-3 && left < 1e-10 * length);
            for k in 0..width {
                let (a, b) = (product(r, i, k), product(&expected, i, k));
                assert!((a - b).abs() <= 1e-13 * longest, "{i} {k} {a:e} {b:e}");
            }
        }
    }
    assert!(following > 0);
}

/// Slow and small motions excite badly: least squares on the folded factors is that on factors of the rows, which only ever
/// see orthogonal steps. These square the spread of the deviations too, in the rounding of the rows themselves.
#[test]
fn ill_conditioned_motions_fold_as_well_as_their_rows() {
    let case = fixed_case();
    let pivots = base_parameters(&case.robot, 0, 1e-9).unwrap().pivots;
    let n_samples = 2000;
    let effects = vec![Effect::torque_offset()];
    let mut widest = 0.0_f64;
    for exponent in 0..5 {
        let (q, dq, ddq) = probing_states(&case.robot, n_samples, 7);
        let size = 0.1_f64.powi(exponent);
        let motion = [q, dq, ddq].map(|signal| signal.iter().map(|x| size * x).collect());
        let run = Run::along(motion, &case.robot, &case.phi, 0.1);
        let sampling = Sampling {
            filter: ZeroPhase::default(),
            kept: (0..n_samples).collect(),
        };
        let folded = fold(&case.robot, &effects, &pivots, &run.states(), None).unwrap();
        let rows = observe(&case.robot, &effects, &pivots, &run.states(), &sampling).unwrap();
        let joints = rows.joints.iter();
        let reflected: Vec<Vec<f64>> = joints
            .map(|joint| triangular_factor(&joint.rows, joint.width).unwrap())
            .collect();
        let fit = |factors: &[Vec<f64>]| {
            let slices: Vec<&[f64]> = factors.iter().map(Vec::as_slice).collect();
            weighted_fit(&slices, &pivots, n_samples, 2).unwrap()
        };
        let (own, expected) = (fit(&folded), fit(&reflected));
        let stds = || expected.base_std.iter().copied();
        let spread = stds().fold(0.0, f64::max) / stds().fold(f64::MAX, f64::min);
        widest = widest.max(spread);
        let tolerance = 1e-9 + 1e-18 * spread * spread;
        let pairs = own.base.iter().zip(&expected.base);
        for ((x, y), std) in pairs.zip(stds()) {
            assert!(
                (x - y).abs() <= tolerance * std,
                "{exponent}: {x} {y} {std}"
            );
        }
        let stds = own.base_std.iter().zip(&expected.base_std);
        for (x, y) in stds.chain(own.noise_std.iter().zip(&expected.noise_std)) {
            assert!((x - y).abs() <= tolerance * y, "{exponent}: {x} {y}");
        }
    }
    assert!(widest > 1e7, "{widest:e}");
}

#[test]
fn spoiled_factors_are_errors() {
    let one = [1.0, 2.0, 0.0, 3.0];
    assert!(weighted_fit(&[], &[], 10, 0).is_err());
    assert!(weighted_fit(&[&one[..3]], &[0], 10, 0).is_err());
    assert!(weighted_fit(&[&[f64::NAN; 4]], &[0], 10, 0).is_err());
    assert!(matches!(
        weighted_fit(&[&one], &[0], 1, 0),
        Err(OfflineError::TooFewSamples { .. })
    ));
    assert!(matches!(
        weighted_fit(&[&[0.0, 2.0, 0.0, 3.0]], &[0], 10, 0),
        Err(OfflineError::Dependent { .. })
    ));
    let fit = weighted_fit(&[&one], &[0], 10, 1).unwrap();
    assert_eq!(fit.base, [2.0]);
    assert!((fit.noise_std[0] - 1.0).abs() < 1e-12); // 3 / sqrt(10 - 1)
}
