//! Time per sample of the batch kernels on one thread: inverse dynamics, the regressor stored where it was stored before
//! and consumed in the cache, single calls, mixture regression. The fastest of many short rounds, so that other people's
//! jobs count as little as they can.
//!
//! `cargo bench -p dynid-offline --bench batch`; prints one line of JSON per processor path.

#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "../../dynid-core/benches/common/arm.rs"]
mod arm;

use std::hint::black_box;
use std::time::Instant;

use arm::arm;
use dynid_core::chain::{self, JointState};
use dynid_core::lanes::{self, use_path, Kernel, Lanes, Path};
use dynid_core::{
    inverse_dynamics_into, joint_torque_regressor_into, GaussianMixtureRegression, RobotModel,
    Workspace,
};
use dynid_offline::batch;

const N: usize = 6;
/// As many as one task takes, so that nothing goes to another thread; their regressors fit into the second cache.
const N_SAMPLES: usize = 256;
const ROUNDS: usize = 400;

/// `Y phi` with the regressor of a row of samples in the first cache: what an identification does, which never stores it.
/// Signals have one row per joint.
struct Consumed<'a> {
    robot: &'a RobotModel,
    motion: [&'a [f64]; 3],
    phi: &'a [f64],
    tau: &'a mut [f64],
}

impl Kernel for Consumed<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
        let zero = L::ZERO;
        let mut states = [JointState {
            q: zero,
            sin: zero,
            cos: zero,
            dq: zero,
            ddq: zero,
        }; N];
        let mut twists = [[[zero; 3]; 2]; N];
        let mut regressor = [zero; 10 * N * N];
        for first in (0..N_SAMPLES).step_by(L::LEN) {
            for (j, state) in states.iter_mut().enumerate() {
                let at = j * N_SAMPLES + first;
                let q = L::load(&self.motion[0][at..]);
                let (sin, cos) = lanes::sin_cos(q);
                *state = JointState {
                    q: q.raw(),
                    sin: sin.raw(),
                    cos: cos.raw(),
                    dq: L::load(&self.motion[1][at..]).raw(),
                    ddq: L::load(&self.motion[2][at..]).raw(),
                };
            }
            chain::joint_torque_regressor::<L>(self.robot, &states, &mut twists, &mut regressor);
            for (j, row) in regressor.chunks_exact(10 * N).enumerate() {
                let mut sums = [L::splat(0.0); 2];
                let own = row[10 * j..]
                    .chunks_exact(2)
                    .zip(self.phi[10 * j..].chunks_exact(2));
                for (entries, phi) in own {
                    sums[0] = L::from_raw(entries[0]).mul_add(L::splat(phi[0]), sums[0]);
                    sums[1] = L::from_raw(entries[1]).mul_add(L::splat(phi[1]), sums[1]);
                }
                (sums[0] + sums[1]).store(&mut self.tau[j * N_SAMPLES + first..]);
            }
        }
    }
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
    let robot = arm(0.1);
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
        let consumed = fastest(N_SAMPLES, || {
            lanes::run(Consumed {
                robot: &robot,
                motion: [&q, &dq, &ddq],
                phi: &phi,
                tau: &mut tau,
            });
            black_box(&tau);
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
            "{{\"path\":\"{}\",\"rnea_ns\":{torques:.1},\"regressor_stored_ns\":{stored:.1},\
             \"regressor_consumed_ns\":{consumed:.1},\"one_rnea_ns\":{single:.1},\
             \"one_regressor_ns\":{single_regressor:.1},\"mixture_ns\":{points:.1}}}",
            path.name()
        );
    }
}
