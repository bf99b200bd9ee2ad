//! One state at a time, samples in lanes, on every path of this processor: the same bits on chains of any kind.
//!
//! The path is the whole process's, so there is one test.

#[path = "../../dynid-core/tests/chain/mod.rs"]
mod chain;

use chain::case;
use dynid_core::lanes::{use_path, Path};
use dynid_core::{inverse_dynamics_into, joint_torque_regressor_into, RobotModel, Workspace};
use dynid_offline::base::probing_states;
use dynid_offline::batch;
use proptest::prelude::*;
use proptest::test_runner::TestRunner;

/// Torques and regressors of all samples.
type Answer = (Vec<f64>, Vec<f64>);

fn in_lanes(robot: &RobotModel, motion: [&[f64]; 3], phi: &[f64]) -> Answer {
    let [q, dq, ddq] = motion;
    let mut tau = vec![f64::NAN; q.len()];
    let mut regressor = vec![0.0; q.len() * 10 * robot.n_joints()];
    batch::inverse_dynamics(robot, q, dq, ddq, phi, &mut tau).unwrap();
    batch::joint_torque_regressor(robot, q, dq, ddq, &mut regressor).unwrap();
    (tau, regressor)
}

fn one_by_one(robot: &RobotModel, [q, dq, ddq]: [&[f64]; 3], phi: &[f64]) -> Answer {
    let n = robot.n_joints();
    let mut workspace = Workspace::new(robot);
    let mut tau = vec![0.0; q.len()];
    let mut regressor = vec![0.0; q.len() * 10 * n];
    for (k, (tau, regressor)) in tau
        .chunks_exact_mut(n)
        .zip(regressor.chunks_exact_mut(10 * n * n))
        .enumerate()
    {
        let at = k * n..(k + 1) * n;
        let (q, dq, ddq) = (&q[at.clone()], &dq[at.clone()], &ddq[at]);
        inverse_dynamics_into(robot, &mut workspace, q, dq, ddq, phi, tau).unwrap();
        joint_torque_regressor_into(robot, &mut workspace, q, dq, ddq, regressor).unwrap();
    }
    (tau, regressor)
}

fn bits((tau, regressor): &Answer) -> Vec<u64> {
    tau.iter().chain(regressor).map(|x| x.to_bits()).collect()
}

#[test]
fn lanes_and_single_states_agree_on_every_path() {
    let paths: Vec<Path> = Path::ALL
        .into_iter()
        .filter(|path| path.is_available())
        .collect();
    let mut runner = TestRunner::default();
    let strategy = (case(9), 1..40_usize, any::<u64>());
    let checked = runner.run(&strategy, |(case, n_samples, seed)| {
        let (q, dq, ddq) = probing_states(&case.robot, n_samples, seed);
        let motion = [&q, &dq, &ddq].map(Vec::as_slice);
        let mut answers = Vec::new();
        for path in &paths {
            prop_assert!(use_path(*path));
            let single = one_by_one(&case.robot, motion, &case.phi);
            let lanes = in_lanes(&case.robot, motion, &case.phi);
            prop_assert!(bits(&single) == bits(&lanes), "{}", path.name());
            // Without the first sample every other one stands in another lane.
            let n = case.robot.n_joints();
            let later = in_lanes(&case.robot, motion.map(|signal| &signal[n..]), &case.phi);
            let rest = (lanes.0[n..].to_vec(), lanes.1[10 * n * n..].to_vec());
            prop_assert!(bits(&later) == bits(&rest), "{}", path.name());
            // Y phi = tau, by two recursions.
            for (row, tau) in lanes.1.chunks_exact(10 * n).zip(&lanes.0) {
                let terms = row.iter().zip(&case.phi).map(|(y, phi)| y * phi);
                let size: f64 = terms.clone().map(f64::abs).sum();
                prop_assert!((terms.sum::<f64>() - tau).abs() <= 1e-12 * (1.0 + size));
            }
            answers.push(lanes);
        }
        for pair in answers.windows(2).skip(1) {
            prop_assert!(bits(&pair[0]) == bits(&pair[1]), "fused paths");
        }
        let (first, last) = (&answers[0], &answers[answers.len() - 1]);
        let size = first.1.iter().fold(1.0, |most: f64, y| most.max(y.abs()));
        for (a, b) in first.1.iter().zip(&last.1) {
            prop_assert!((a - b).abs() <= 1e-13 * size);
        }
        Ok(())
    });
    checked.unwrap();
}
