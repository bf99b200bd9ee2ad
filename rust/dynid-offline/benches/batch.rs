//! Time per sample of the batch kernels on one thread: inverse dynamics, the regressor stored where it was stored before,
//! stored in memory, and consumed in the cache, single calls, mixture regression. The fastest of many short rounds, so that other people's
//! jobs count as little as they can. Beside them what this machine can do, and how many operations the kernels consist of.
//!
//! `cargo bench -p dynid-offline --bench batch`; prints one line of JSON per processor path.

#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "../../dynid-core/benches/common/arm.rs"]
mod arm;
#[path = "../../dynid-core/benches/common/counted.rs"]
mod counted;
#[path = "../../dynid-core/benches/common/limits.rs"]
mod limits;

use std::hint::black_box;
use std::time::Instant;

use arm::arm;
use counted::{counted, Count, Counted};
use dynid_core::chain::{self, JointState};
use dynid_core::lanes::{self, use_path, Kernel, Lanes, Path};
use dynid_core::newton;
use dynid_core::{
    inverse_dynamics_into, joint_torque_regressor_into, GaussianMixtureRegression, RobotModel,
    Workspace,
};
use dynid_offline::batch;

const N: usize = 6;
/// As many as one task takes, so that nothing goes to another thread; their regressors fit into the second cache.
const N_SAMPLES: usize = 256;
const ROUNDS: usize = 400;
/// Regressors of so many times as many samples are 1 GiB: more than any cache holds.
const IN_MEMORY: usize = (1 << 30) / (8 * 10 * N * N * N_SAMPLES);
const ROUNDS_IN_MEMORY: usize = 8;

/// States of [`N`] joints, sines and all, of the samples from `first` on; signals have one row per joint. Of angles that
/// begin at `offsets`.
#[inline(always)]
fn states<L: Lanes>(motion: [&[f64]; 3], first: usize, offsets: &[f64]) -> [JointState<L::Raw>; N] {
    let zero = L::ZERO;
    let mut states = [JointState {
        q: zero,
        sin: zero,
        cos: zero,
        dq: zero,
        ddq: zero,
    }; N];
    for (j, state) in states.iter_mut().enumerate() {
        let at = j * N_SAMPLES + first;
        let q = L::load(&motion[0][at..]);
        let (sin, cos) = lanes::sin_cos(q + L::splat(offsets[j]));
        *state = JointState {
            q: q.raw(),
            sin: sin.raw(),
            cos: cos.raw(),
            dq: L::load(&motion[1][at..]).raw(),
            ddq: L::load(&motion[2][at..]).raw(),
        };
    }
    states
}

/// Inverse dynamics of signals that lie joint by joint, so that nothing is turned over.
struct InLanes<'a> {
    robot: &'a RobotModel,
    motion: [&'a [f64]; 3],
    phi: &'a [f64],
    tau: &'a mut [f64],
}

impl Kernel for InLanes<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
        let frames = self.robot.frames();
        let links = frames.links(self.phi);
        let (mut wrenches, mut tau) = ([[[L::ZERO; 3]; 2]; N], [L::ZERO; N]);
        for first in (0..N_SAMPLES).step_by(L::LEN) {
            let states = states::<L>(self.motion, first, &frames.offsets);
            newton::inverse_dynamics::<L>(frames, &links, &states, &mut wrenches, &mut tau);
            for (j, tau) in tau.iter().enumerate() {
                L::from_raw(*tau).store(&mut self.tau[j * N_SAMPLES + first..]);
            }
        }
    }
}

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
        let mut twists = [[[zero; 3]; 2]; N];
        let mut regressor = [zero; 10 * N * N];
        for first in (0..N_SAMPLES).step_by(L::LEN) {
            let states = states::<L>(self.motion, first, &[0.0; N]);
            chain::joint_torque_regressor::<L>(self.robot, &states, &mut twists, &mut regressor);
            for (j, row) in regressor.chunks_exact(10 * N).enumerate() {
                // Side by side, so that none waits for the one before it.
                let mut sums = [L::splat(0.0); 5];
                let own = row[10 * j..]
                    .chunks_exact(5)
                    .zip(self.phi[10 * j..].chunks_exact(5));
                for (entries, phi) in own {
                    for ((sum, entry), phi) in sums.iter_mut().zip(entries).zip(phi) {
                        *sum = L::from_raw(*entry).mul_add(L::splat(*phi), *sum);
                    }
                }
                let [a, b, c, d, e] = sums;
                ((a + b) + (c + d) + e).store(&mut self.tau[j * N_SAMPLES + first..]);
            }
        }
    }
}

/// Nanoseconds per item of the fastest round.
fn fastest(items: usize, work: impl FnMut()) -> f64 {
    fastest_of(ROUNDS, items, work)
}

/// The same of so many rounds.
fn fastest_of(rounds: usize, items: usize, mut work: impl FnMut()) -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..rounds {
        let start = Instant::now();
        work();
        best = best.min(start.elapsed().as_nanos() as f64);
    }
    best / items as f64
}

/// Operations per sample of inverse dynamics and of the regressor, sines and all.
fn operations(robot: &RobotModel, phi: &[f64]) -> [Count; 2] {
    let state = JointState {
        q: [0.3],
        sin: [0.3],
        cos: [0.9],
        dq: [0.3],
        ddq: [0.3],
    };
    let (states, mut rows, mut tau) = ([state; N], [[[[0.0]; 3]; 2]; N], [[0.0]; N]);
    let mut regressor = [[0.0]; 10 * N * N];
    let frames = robot.frames();
    let links = frames.links(phi);
    let sines = || {
        for _ in 0..N {
            black_box(lanes::sin_cos(Counted::splat(0.3)));
        }
    };
    let torques = counted(|| {
        sines();
        newton::inverse_dynamics::<Counted>(frames, &links, &states, &mut rows, &mut tau);
    });
    let columns = counted(|| {
        sines();
        chain::joint_torque_regressor::<Counted>(robot, &states, &mut rows, &mut regressor);
    });
    [torques, columns]
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
    let [torque_count, column_count] = operations(&robot, &phi);
    let u = &q[..2 * N_SAMPLES];
    let mut answers = [0; 3].map(|_| vec![0.0; N_SAMPLES]);
    for path in Path::ALL.into_iter().filter(|path| path.is_available()) {
        use_path(path);
        let torques = fastest(N_SAMPLES, || {
            batch::inverse_dynamics(&robot, &q, &dq, &ddq, &phi, &mut tau).unwrap();
            black_box(&tau);
        });
        let in_lanes = fastest(N_SAMPLES, || {
            lanes::run(InLanes {
                robot: &robot,
                motion: [&q, &dq, &ddq],
                phi: &phi,
                tau: &mut tau,
            });
            black_box(&tau);
        });
        let stored = fastest(N_SAMPLES, || {
            batch::joint_torque_regressor(&robot, &q, &dq, &ddq, &mut regressor).unwrap();
            black_box(&regressor);
        });
        let in_memory = {
            let mut all = vec![0.0; IN_MEMORY * regressor.len()];
            fastest_of(ROUNDS_IN_MEMORY, IN_MEMORY * N_SAMPLES, || {
                for part in all.chunks_exact_mut(regressor.len()) {
                    batch::joint_torque_regressor(&robot, &q, &dq, &ddq, part).unwrap();
                }
                black_box(&all);
            })
        };
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
        let limits = limits::measured();
        println!(
            "{{\"path\":\"{}\",\"rnea_ns\":{torques:.1},\"rnea_in_lanes_ns\":{in_lanes:.1},\"regressor_stored_ns\":{stored:.1},\
             \"regressor_in_memory_ns\":{in_memory:.1},\
             \"regressor_consumed_ns\":{consumed:.1},\"one_rnea_ns\":{single:.1},\
             \"one_regressor_ns\":{single_regressor:.1},\"mixture_ns\":{points:.1},\
             \"multiply_adds\":{:.2},\"arithmetic\":{:.2},\"read\":{:.1?},\"written\":{:.1?},\"clock\":{:.2},\
             \"rnea_operations\":[{},{}],\"regressor_operations\":[{},{}]}}",
            path.name(),
            limits.multiply_adds,
            limits.arithmetic,
            limits.read,
            limits.written,
            limits.clock,
            torque_count.products,
            torque_count.others,
            column_count.products,
            column_count.others,
        );
    }
}
