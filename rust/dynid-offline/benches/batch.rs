//! Time per sample of the batch kernels on one thread: inverse dynamics, the regressor stored where it was stored before,
//! and consumed in the cache. The fastest of many short rounds, so that other people's jobs count as little as they can.
//!
//! `cargo bench -p dynid-offline --bench batch`; prints one line of JSON per processor path.

#![allow(clippy::print_stdout, clippy::unwrap_used)]

use std::hint::black_box;
use std::time::Instant;

use dynid_core::lanes::{use_path, Path};
use dynid_core::{
    inverse_dynamics_into, joint_torque_regressor_into, GaussianMixtureRegression, Joint,
    JointKind, JointLimits, RobotModel, Workspace,
};
use dynid_offline::batch;
use nalgebra::{Rotation3, Vector3};

const N: usize = 6;
/// As many as one task takes, so that nothing goes to another thread; their regressors fit into the second cache.
const N_SAMPLES: usize = 256;
const ROUNDS: usize = 400;

fn robot() -> RobotModel {
    let turns = [0.0, 1.0, 0.0, 0.0, 1.0, -1.0].map(|t| t * std::f64::consts::FRAC_PI_2);
    let joints = turns.iter().enumerate().map(|(j, turn)| Joint {
        name: format!("joint {j}"),
        link: format!("link {j}"),
        kind: JointKind::Revolute,
        rotation: Rotation3::from_euler_angles(*turn, 0.1 * j as f64, 0.0).into_inner(),
        translation: Vector3::new(0.1 * j as f64, -0.05, 0.3),
        axis: Vector3::z(),
        limits: JointLimits::default(),
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi: [2.0, 0.3, -0.1, 0.5, 0.7, 0.02, 0.9, -0.05, 0.04, 1.1],
    });
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    RobotModel::new("arm".to_owned(), joints.collect(), gravity).unwrap()
}

/// Nanoseconds per item of the fastest round.
fn fastest(items: usize, mut work: impl FnMut()) -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..ROUNDS {
        let start = Instant::now();
        work();
        best = best.min(start.elapsed().as_nanos() as f64);
    }
    best / items as f64
}

fn main() {
    let robot = robot();
    let phi = robot.phi();
    let signal = |a: f64| -> Vec<f64> {
        let sample = |k: usize| 2.0 * (a * k as f64).sin();
        (0..N * N_SAMPLES).map(sample).collect()
    };
    let (q, dq, ddq) = (signal(1.3), signal(0.7), signal(2.9));
    let mut tau = vec![0.0; N * N_SAMPLES];
    let mut regressor = vec![0.0; 10 * N * N * N_SAMPLES];
    let mixture = {
        let means = (0..30).map(|k| f64::from(k).sin()).collect();
        let covariances = [0.3, 0.02, 0.1, 0.02, 0.4, -0.05, 0.1, -0.05, 0.5].repeat(10);
        GaussianMixtureRegression::new(2, vec![0.1; 10], means, covariances).unwrap()
    };
    let u = &q[..2 * N_SAMPLES];
    let mut answers = [0; 3].map(|_| vec![0.0; N_SAMPLES]);
    for path in Path::ALL.into_iter().filter(|path| path.is_available()) {
        use_path(path);
        let torques = fastest(N_SAMPLES, || {
            batch::inverse_dynamics(&robot, &q, &dq, &ddq, &phi, &mut tau).unwrap();
            black_box(&tau);
        });
        let stored = fastest(N_SAMPLES, || {
            batch::joint_torque_regressor(&robot, &q, &dq, &ddq, &mut regressor).unwrap();
            black_box(&regressor);
        });
        let mut workspace = Workspace::new(&robot);
        let one = |k: usize| [&q, &dq, &ddq].map(|signal| &signal[k * N..(k + 1) * N]);
        let single = fastest(N_SAMPLES, || {
            for (k, tau) in tau.chunks_exact_mut(N).enumerate() {
                let [q, dq, ddq] = one(k);
                inverse_dynamics_into(&robot, &mut workspace, q, dq, ddq, &phi, tau).unwrap();
            }
        });
        let single_regressor = fastest(N_SAMPLES, || {
            for (k, out) in regressor.chunks_exact_mut(10 * N * N).enumerate() {
                let [q, dq, ddq] = one(k);
                joint_torque_regressor_into(&robot, &mut workspace, q, dq, ddq, out).unwrap();
            }
        });
        let [mean, variance, distance] = &mut answers;
        let points = fastest(N_SAMPLES, || {
            mixture.predict_into(u, mean, variance, distance).unwrap();
            black_box(&mean);
        });
        println!(
            "{{\"path\":\"{}\",\"rnea_ns\":{torques:.1},\"regressor_stored_ns\":{stored:.1},\"one_rnea_ns\":{single:.1},\
             \"one_regressor_ns\":{single_regressor:.1},\"mixture_ns\":{points:.1}}}",
            path.name()
        );
    }
}
