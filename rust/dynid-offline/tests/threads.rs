//! The same bits for any number of threads, and rows that are the filter applied to the columns.

#[path = "../../dynid-core/tests/chain/mod.rs"]
mod chain;

#[path = "../../dynid-core/tests/every_effect/mod.rs"]
mod every_effect;

use chain::{case, Case};
use dynid_core::{joint_torque_regressor_into, EffectInput, State, Workspace};
use dynid_offline::base::probing_states;
use dynid_offline::filter::LANES;
use dynid_offline::observation::slice_state;
use dynid_offline::{
    base_parameters, batch, merge, observe, triangular_factor, Observation, OfflineError,
    RunSignals, RunStates, Sampling, ZeroPhase,
};
use every_effect::every_effect;
use proptest::collection::vec;
use proptest::prelude::*;

/// Longer than two chunks of every parallel loop.
const N_SAMPLES: usize = 700;
const N: usize = 4;
const STEP: f64 = 0.004;

fn with_threads<T: Send>(n_threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new()
        .num_threads(n_threads)
        .build()
        .expect("a thread pool")
        .install(work)
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|x| x.to_bits()).collect()
}

/// `scipy.signal.butter(4, 0.2, output="sos")` with `sosfilt_zi`, rounded: any stable filter will do.
fn low_pass(pad: usize) -> ZeroPhase {
    let sections = [
        [
            0.00482434,
            0.00964869,
            0.00482434,
            1.0,
            -1.04859958,
            0.29614036,
        ],
        [1.0, 2.0, 1.0, 1.0, -1.32091343, 0.63273879],
    ];
    let steady = [[0.0731, -0.0182], [0.922, -0.4935]];
    ZeroPhase::new(&sections, &steady, pad).expect("a valid filter")
}

/// Signals of a run with two encoders.
struct Run {
    signals: [Vec<f64>; 10],
}

impl Run {
    fn new(case: &Case, seed: u64) -> Self {
        let (q, dq, ddq) = probing_states(&case.robot, N_SAMPLES, seed);
        let (q_motor, dq_motor, ddq_motor) = probing_states(&case.robot, N_SAMPLES, seed ^ 1);
        let (tau, tau_link, temperature) = probing_states(&case.robot, N_SAMPLES, seed ^ 2);
        let (tau_motor, ..) = probing_states(&case.robot, N_SAMPLES, seed ^ 3);
        Self {
            signals: [
                q,
                dq,
                ddq,
                q_motor,
                dq_motor,
                ddq_motor,
                tau,
                tau_link,
                tau_motor,
                temperature,
            ],
        }
    }

    fn states(&self) -> RunStates<'_> {
        let [q, dq, ddq, q_motor, dq_motor, ddq_motor, tau, tau_link, tau_motor, temperature] =
            &self.signals;
        RunStates {
            signals: RunSignals {
                state: State {
                    q,
                    dq,
                    ddq,
                    q_motor,
                    dq_motor,
                    ddq_motor,
                    temperature: Some(temperature),
                },
                tau_link: Some(tau_link),
                tau_motor: Some(tau_motor),
                step: Some(STEP),
            },
            tau,
        }
    }
}

/// One column through the filter, alone in one lane of eight.
fn filtered(filter: &ZeroPhase, column: &[f64], lane: usize) -> Vec<f64> {
    let mut samples: Vec<[f64; LANES]> = column
        .iter()
        .map(|x| {
            let mut lanes = [0.0; LANES];
            lanes[lane] = *x;
            lanes
        })
        .collect();
    filter.apply(&mut samples, &mut Vec::new());
    samples.iter().map(|lanes| lanes[lane]).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn any_number_of_threads_gives_the_same_bits(case in case(N), seed in any::<u64>()) {
        let n = case.robot.n_joints();
        let run = Run::new(&case, seed);
        let states = run.states();
        let sampling = Sampling { filter: low_pass(15), kept: (0..N_SAMPLES).step_by(3).collect() };
        let results = [1, 2, 3].map(|n_threads| with_threads(n_threads, || {
            let base = base_parameters(&case.robot, seed, 1e-9).expect("a valid robot");
            let mut tau = vec![f64::NAN; N_SAMPLES * n];
            let mut y = vec![f64::NAN; N_SAMPLES * n * 10 * n];
            let State { q, dq, ddq, .. } = states.signals.state;
            batch::inverse_dynamics(&case.robot, q, dq, ddq, &case.phi, &mut tau).expect("right lengths");
            batch::joint_torque_regressor(&case.robot, q, dq, ddq, &mut y).expect("right lengths");
            let observation = observe(&case.robot, &every_effect(n), &base.pivots, &states, &sampling).expect("a valid run");
            let factor = triangular_factor(&y, 10 * n).expect("finite rows");
            let merged = merge(&[&factor, &factor, &factor], 10 * n).expect("two factors");
            let rows: Vec<_> = observation.joints.iter().map(|joint| bits(&joint.rows)).collect();
            (bits(&tau), bits(&y), rows, bits(&factor), bits(&merged), (base.pivots, bits(&base.beta), base.gap.to_bits()))
        }));
        prop_assert!(results[0] == results[1]);
        prop_assert!(results[0] == results[2]);
    }

    #[test]
    fn batches_are_single_states_to_the_last_bit(case in case(N), seed in any::<u64>()) {
        let n = case.robot.n_joints();
        let (q, dq, ddq) = probing_states(&case.robot, N_SAMPLES, seed);
        let (mut tau, mut one) = (vec![f64::NAN; N_SAMPLES * n], vec![f64::NAN; n]);
        batch::inverse_dynamics(&case.robot, &q, &dq, &ddq, &case.phi, &mut tau).expect("right lengths");
        let mut workspace = Workspace::new(&case.robot);
        for (k, tau) in tau.chunks_exact(n).enumerate() {
            let at = k * n..(k + 1) * n;
            dynid_core::inverse_dynamics_into(
                &case.robot, &mut workspace, &q[at.clone()], &dq[at.clone()], &ddq[at], &case.phi, &mut one,
            ).expect("right lengths");
            prop_assert_eq!(bits(tau), bits(&one));
        }
    }

    #[test]
    fn rows_are_the_filter_applied_to_every_column(
        case in case(N), seed in any::<u64>(), stride in 1usize..7, pad in 0usize..40, wanted in vec(any::<bool>(), 10 * N),
    ) {
        let n = case.robot.n_joints();
        let run = Run::new(&case, seed);
        let states = run.states();
        let effects = every_effect(n);
        let pivots: Vec<usize> = (0..10 * n).filter(|&k| wanted[k]).collect();
        let sampling = Sampling { filter: low_pass(pad), kept: (stride..N_SAMPLES - 1).step_by(stride).collect() };
        let Observation { n_rows, joints } =
            observe(&case.robot, &effects, &pivots, &states, &sampling).expect("a valid run");
        prop_assert_eq!(n_rows, sampling.kept.len());
        prop_assert_eq!(joints.len(), n);

        for (j, joint) in joints.iter().enumerate() {
            // Raw columns by hand: effects, base columns of links j and beyond, torque.
            let mut raw: Vec<Vec<f64>> = vec![Vec::new(); joint.width];
            let mut memories: Vec<_> = effects.iter().map(|effect| vec![0.0; effect.memory_len(n)]).collect();
            let mut workspace = Workspace::new(&case.robot);
            let mut y = vec![f64::NAN; n * 10 * n];
            for k in 0..N_SAMPLES {
                let state = slice_state(&states.signals.state, k * n..(k + 1) * n);
                let tau_link = &states.signals.tau_link.expect("a load")[k * n..(k + 1) * n];
                let tau_motor = &states.signals.tau_motor.expect("a torque")[k * n..(k + 1) * n];
                let input = EffectInput { state, tau_link, tau_motor, step: STEP, sign: None };
                joint_torque_regressor_into(&case.robot, &mut workspace, state.q, state.dq, state.ddq, &mut y)
                    .expect("right lengths");
                let mut row = Vec::new();
                for (effect, memory) in effects.iter().zip(&mut memories) {
                    let mut columns = vec![f64::NAN; effect.n_columns()];
                    effect.columns_into(j, &input, memory, &mut columns);
                    row.extend(columns);
                }
                row.extend(pivots.iter().filter(|&&p| p >= 10 * j).map(|&p| y[j * 10 * n + p]));
                row.push(states.tau[k * n + j]);
                prop_assert_eq!(row.len(), joint.width);
                raw.iter_mut().zip(row).for_each(|(column, x)| column.push(x));
            }
            for (c, column) in raw.iter().enumerate() {
                let expected = filtered(&sampling.filter, column, (c + 3) % LANES);
                let expected: Vec<f64> = sampling.kept.iter().map(|&k| expected[k]).collect();
                let actual: Vec<f64> = joint.rows.chunks_exact(joint.width).map(|row| row[c]).collect();
                prop_assert_eq!(bits(&actual), bits(&expected), "joint {} column {}", j, c);
            }
        }
    }

    #[test]
    fn a_tall_factor_keeps_the_norm_of_every_combination(case in case(2), seed in any::<u64>(), x in vec(-1.0..1.0f64, 20)) {
        // 3000 states: more rows than one block takes.
        let n = case.robot.n_joints();
        let (q, dq, ddq) = probing_states(&case.robot, 3000, seed);
        let mut y = vec![f64::NAN; 3000 * n * 10 * n];
        batch::joint_torque_regressor(&case.robot, &q, &dq, &ddq, &mut y).expect("right lengths");
        let r = triangular_factor(&y, 10 * n).expect("finite rows");
        let square = |rows: &[f64]| -> f64 {
            rows.chunks_exact(10 * n).map(|row| row.iter().zip(&x).map(|(a, b)| a * b).sum::<f64>().powi(2)).sum()
        };
        prop_assert!((square(&y) - square(&r)).abs() <= 1e-12 * (1.0 + square(&y)));
        for i in 0..10 * n {
            prop_assert!(r[i * 10 * n + i] >= 0.0 && (0..i).all(|j| r[i * 10 * n + j] == 0.0));
        }
    }

    #[test]
    fn spoiled_runs_are_errors(case in case(N), seed in any::<u64>(), signal in 0usize..7, at in 0usize..N_SAMPLES) {
        let n = case.robot.n_joints();
        let sampling = Sampling { filter: low_pass(15), kept: vec![0, 5] };
        let pivots = [0, 4];
        let refused = |run: &Run, pivots: &[usize], sampling: &Sampling| {
            observe(&case.robot, &every_effect(n), pivots, &run.states(), sampling).err()
        };
        let good = Run::new(&case, seed);
        prop_assert_eq!(refused(&good, &pivots, &sampling), None);

        let mut run = Run::new(&case, seed);
        run.signals[signal][at] = f64::NAN;
        prop_assert_eq!(refused(&run, &pivots, &sampling), Some(OfflineError::NonFinite { what: "run" }));

        let mut run = Run::new(&case, seed);
        run.signals[signal].pop();
        prop_assert!(refused(&run, &pivots, &sampling).is_some());

        let kept = |kept: &[usize]| Sampling { kept: kept.to_vec(), ..sampling.clone() };
        prop_assert!(refused(&good, &[4, 0], &sampling).is_some());
        prop_assert!(refused(&good, &[4, 4], &sampling).is_some());
        prop_assert!(refused(&good, &[10 * n], &sampling).is_some());
        prop_assert!(refused(&good, &pivots, &kept(&[5, 0])).is_some());
        prop_assert!(refused(&good, &pivots, &kept(&[N_SAMPLES])).is_some());
        let long = Sampling { filter: low_pass(N_SAMPLES), ..sampling.clone() };
        let needed = N_SAMPLES + 1;
        let error = OfflineError::TooFewSamples { actual: N_SAMPLES, needed };
        prop_assert_eq!(refused(&good, &pivots, &long), Some(error));
    }

    #[test]
    fn batches_of_unequal_lengths_are_errors(case in case(N), seed in any::<u64>(), which in 0usize..4) {
        let n = case.robot.n_joints();
        let (mut q, mut dq, mut ddq) = probing_states(&case.robot, 300, seed);
        let mut tau = vec![0.0; 300 * n];
        [&mut q, &mut dq, &mut ddq, &mut tau][which].pop();
        prop_assert!(batch::inverse_dynamics(&case.robot, &q, &dq, &ddq, &case.phi, &mut tau).is_err());
        let mut y = vec![0.0; 300 * n * 10 * n - usize::from(which == 3)];
        prop_assert!(batch::joint_torque_regressor(&case.robot, &q, &dq, &ddq, &mut y).is_err());
    }
}
