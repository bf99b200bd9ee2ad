//! Criteria of exciting motions: their gradients by differences, the same bits for any number of threads.

#[path = "../../dynid-core/tests/chain/mod.rs"]
mod chain;

use chain::{case, Case};
use dynid_core::{inverse_dynamics_into, Workspace};
use dynid_offline::adjoint::inverse_dynamics_gradient;
use dynid_offline::base::probing_states;
use dynid_offline::points::{point_gradient, point_places, LinkPoint};
use dynid_offline::{base_parameters, Criterion, Excitation, OfflineError};
use nalgebra::Vector3;
use proptest::collection::vec;
use proptest::prelude::*;

const N: usize = 4;
const N_SAMPLES: usize = 40;
const STEP: f64 = 1e-6;
const CRITERIA: [Criterion; 4] = [
    Criterion::Block([0.2, 0.5, 0.3]),
    Criterion::Condition,
    Criterion::D,
    Criterion::A,
];

fn torque(case: &Case, [q, dq, ddq]: [&[f64]; 3]) -> Vec<f64> {
    let mut tau = vec![f64::NAN; q.len()];
    let mut workspace = Workspace::new(&case.robot);
    inverse_dynamics_into(&case.robot, &mut workspace, q, dq, ddq, &case.phi, &mut tau)
        .expect("right lengths");
    tau
}

fn moved(signal: &[f64], j: usize, step: f64) -> Vec<f64> {
    let mut moved = signal.to_vec();
    moved[j] += step;
    moved
}

/// Value, and gradient with respect to q, dq, ddq one after the other.
fn evaluated(excitation: &Excitation, criterion: Criterion, motion: [&[f64]; 3]) -> Vec<f64> {
    let mut gradient = [(); 3].map(|()| vec![f64::NAN; motion[0].len()]);
    let value = excitation
        .evaluate(
            criterion,
            motion,
            Some(gradient.each_mut().map(Vec::as_mut_slice)),
        )
        .expect("a finite motion");
    std::iter::once(value)
        .chain(gradient.into_iter().flatten())
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn the_torque_gradient_is_a_difference(case in case(N), direction in vec(-1.0..1.0f64, N)) {
        let n = case.robot.n_joints();
        let direction = &direction[..n];
        let along = |tau: Vec<f64>| tau.iter().zip(direction).map(|(t, d)| t * d).sum::<f64>();
        let mut gradient = [(); 3].map(|()| vec![f64::NAN; n]);
        let motion = [&case.q[..], &case.dq, &case.ddq];
        inverse_dynamics_gradient(
            &case.robot, motion, &case.phi, direction, gradient.each_mut().map(Vec::as_mut_slice),
        ).expect("right lengths");
        for (signal, gradient) in gradient.iter().enumerate() {
            for (j, found) in gradient.iter().enumerate() {
                let [ahead, behind] = [STEP, -STEP].map(|step| {
                    let changed = moved(motion[signal], j, step);
                    let mut motion = motion;
                    motion[signal] = &changed;
                    along(torque(&case, motion))
                });
                let difference = (ahead - behind) / (2.0 * STEP);
                let size = 1.0 + ahead.abs() + difference.abs();
                prop_assert!((found - difference).abs() < 1e-7 * size, "{signal} {j}");
            }
        }
    }

    #[test]
    fn slopes_of_points_are_differences(case in case(N), places in vec(chain::vector3(1.0), N), weight in chain::vector3(1.0)) {
        let n = case.robot.n_joints();
        let points: Vec<LinkPoint> = (0..n).map(|link| LinkPoint { link, place: places[link] }).collect();
        let weights: Vec<f64> = (0..n).flat_map(|_| weight.iter().copied().collect::<Vec<_>>()).collect();
        let value = |q: &[f64]| {
            let mut out = vec![f64::NAN; 3 * n];
            point_places(&case.robot, &points, q, &mut out).expect("right lengths");
            out.iter().zip(&weights).map(|(x, w)| x * w).sum::<f64>()
        };
        let mut gradient = vec![f64::NAN; n];
        point_gradient(&case.robot, &points, &case.q, &weights, &mut gradient).expect("right lengths");
        for (j, found) in gradient.iter().enumerate() {
            let difference = (value(&moved(&case.q, j, STEP)) - value(&moved(&case.q, j, -STEP))) / (2.0 * STEP);
            prop_assert!((found - difference).abs() < 1e-7 * (1.0 + difference.abs()));
        }
    }

    #[test]
    fn reused_memory_and_other_threads_change_no_bit(case in case(N), seed in any::<u64>()) {
        let n = case.robot.n_joints();
        let base = base_parameters(&case.robot, seed, 1e-9).expect("a valid robot");
        let make = || Excitation::new(&case.robot, &base.pivots, None, seed, 1e-9).expect("base columns");
        let used = make();
        let motions: Vec<_> = (0..4).map(|k| probing_states(&case.robot, N_SAMPLES + 7 * k, seed ^ k as u64)).collect();
        let all = |excitation: &Excitation| -> Vec<Vec<u64>> {
            motions.iter().flat_map(|(q, dq, ddq)| {
                CRITERIA.map(|criterion| evaluated(excitation, criterion, [q, dq, ddq]).iter().map(|x| x.to_bits()).collect())
            }).collect()
        };
        let first = all(&used);
        prop_assert!(first == all(&used));
        let together: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..3).map(|_| scope.spawn(|| all(&used))).collect();
            threads.into_iter().map(|thread| thread.join().expect("no panic")).collect()
        });
        for other in together {
            prop_assert!(first == other);
        }
        let fresh = make();
        let (q, dq, ddq) = &motions[3];
        let alone = fresh.evaluate(CRITERIA[0], [q, dq, ddq], None).expect("a finite motion");
        prop_assert_eq!(alone.to_bits(), first[12][0]);
        prop_assert_eq!(used.ranks()[0], base.pivots.len());
        prop_assert!(q.len() == (N_SAMPLES + 21) * n);
    }

    #[test]
    fn spoiled_input_is_an_error(case in case(N), seed in any::<u64>(), which in 0usize..3) {
        let base = base_parameters(&case.robot, seed, 1e-9).expect("a valid robot");
        let n = case.robot.n_joints();
        let excitation = Excitation::new(&case.robot, &base.pivots, None, seed, 1e-9).expect("base columns");
        let (q, dq, ddq) = probing_states(&case.robot, N_SAMPLES, seed);
        let shape = |what| Some(OfflineError::Shape { what });
        let mut short = [q.clone(), dq.clone(), ddq.clone()];
        short[which].pop();
        let [a, b, c] = &short;
        prop_assert_eq!(excitation.conditions([a, b, c]).err(), shape("motion"));
        prop_assert_eq!(excitation.blocks([a, b, c]).err(), shape("motion"));
        prop_assert_eq!(excitation.evaluate(Criterion::D, [&[], &[], &[]], None).err(), shape("motion"));
        let mut spoiled = [q.clone(), dq.clone(), ddq.clone()];
        spoiled[which][3 % q.len()] = f64::NAN;
        let [a, b, c] = &spoiled;
        prop_assert_eq!(
            excitation.evaluate(Criterion::D, [a, b, c], None).err(), Some(OfflineError::NonFinite { what: "motion" })
        );
        let new = |pivots: &[usize], whitening: Option<&[f64]>| {
            Excitation::new(&case.robot, pivots, whitening, seed, 1e-9).err()
        };
        prop_assert_eq!(new(&[], None), shape("pivots"));
        prop_assert_eq!(new(&[10 * n], None), shape("pivots"));
        prop_assert_eq!(new(&base.pivots, Some(&[1.0])), if n == 1 { None } else { shape("whitening") });
        prop_assert_eq!(
            new(&base.pivots, Some(&vec![f64::INFINITY; n * n])), Some(OfflineError::NonFinite { what: "whitening" })
        );
        let nowhere = [LinkPoint { link: n, place: Vector3::zeros() }];
        prop_assert_eq!(point_places(&case.robot, &nowhere, &case.q, &mut [0.0; 3]).err(), shape("points"));
    }
}
