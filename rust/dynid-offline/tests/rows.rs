//! Samples that go through an effect side by side have the bits that each has alone, as online.

#[path = "../../dynid-core/benches/common/arm.rs"]
mod arm;

use arm::arm;
use dynid_core::effects::CATALOGUE;
use dynid_core::{Effect, EffectInput, State};
use dynid_offline::observation::slice_state;
use dynid_offline::{effect_columns, observe, RunSignals, RunStates, Sampling, ZeroPhase};

const N: usize = 6;
/// No multiple of any number of lanes.
const N_SAMPLES: usize = 43;

type Shape = &'static [(&'static str, [f64; 3])];

/// Kinds with shapes of three joints, and of the next three once more, in which every case of every formula is met.
const KINDS: [(&str, Shape); 10] = [
    ("torque_offset", &[]),
    (
        "smooth_friction",
        &[
            ("transition_width", [0.01, 0.002, 0.5]),
            ("sharpness", [1.0, 2.5, 6.0]),
        ],
    ),
    (
        "stribeck",
        &[
            ("stribeck_velocity", [0.1, 0.3, 1e-300]),
            ("exponent", [1.0, 2.0, 0.7]),
            ("transition_width", [0.01, 0.02, 0.03]),
            ("sharpness", [2.5, 1.2, 0.4]),
        ],
    ),
    (
        "stribeck", // of which one joint has a tanh
        &[
            ("stribeck_velocity", [0.1, 0.3, 1.0]),
            ("exponent", [1.0, 2.0, 0.7]),
            ("transition_width", [0.01, 0.02, 0.03]),
            ("sharpness", [2.5, 0.0, 1.0]),
        ],
    ),
    (
        "counterbalance",
        &[
            ("a", [0.8, 0.3, 1.0]),
            ("b", [0.2, 0.7, 0.5]),
            ("phase", [0.4, -2.0, 3.0]),
            ("gas_length", [0.6, 0.9, -0.3]),
        ],
    ),
    (
        "counterbalance",
        &[
            ("a", [0.8, 0.3, 1.0]),
            ("b", [0.2, 0.7, 0.5]),
            ("phase", [0.4, -2.0, 3.0]),
            ("gas_length", [0.6, 0.9, -0.3]),
            ("held_from", [-0.5, -2.0, 0.1]),
            ("held_to", [0.5, 0.3, 0.1]),
        ],
    ),
    ("torque_ripple", &[("cycles", [4.0, 101.5, 1e4])]),
    (
        "torque_ripple",
        &[
            ("cycles", [4.0, 101.5, 1e4]),
            ("held_from", [-0.5, -2.0, 0.1]),
            ("held_to", [0.5, 0.3, 0.1]),
        ],
    ),
    (
        "position_dependent_friction",
        &[
            ("cycles", [1.0, 2.0, 3.0]),
            ("transition_width", [0.01, 0.02, 0.03]),
            ("sharpness", [1.0, 2.5, 0.5]),
        ],
    ),
    (
        "coupled_friction",
        &[
            ("partner", [1.0, 0.0, -1.0]),
            ("ratio", [-0.7, -1.0 / 0.7, 1.0]),
            ("transition_width", [0.01, 0.02, 0.03]),
            ("sharpness", [1.0, 2.5, 0.5]),
        ],
    ),
];

/// Numbers of all sizes and both signs, and none.
fn signal(seed: usize) -> Vec<f64> {
    let number = |k: usize| match (k + seed) % 11 {
        0 => 0.0,
        1 => -0.0,
        2 => 4e4, // its sine is the library's
        3 => 1e-250,
        _ => 3.0 * ((k * k + 7 * seed) as f64 * 0.37).sin(),
    };
    (0..N_SAMPLES * N).map(number).collect()
}

#[test]
fn samples_side_by_side_are_what_each_is_alone() {
    let robot = arm(0.1);
    let signals: Vec<Vec<f64>> = (0..6).map(signal).collect();
    let state = State {
        q: &signals[0],
        dq: &signals[1],
        ddq: &signals[2],
        q_motor: &signals[3],
        dq_motor: &signals[4],
        ddq_motor: &signals[5],
        temperature: None,
    };
    let run = RunSignals {
        state,
        tau_link: None,
        tau_motor: None,
        step: None,
    };
    let tau = vec![0.0; N_SAMPLES * N];
    let states = RunStates {
        signals: run,
        tau: &tau,
    };
    let sampling = Sampling {
        filter: ZeroPhase::default(),
        kept: (0..N_SAMPLES).collect(),
    };
    for (kind, shape) in KINDS {
        assert!(CATALOGUE.iter().any(|entry| entry.kind == kind));
        let of_all = |values: &[f64; 3]| values.repeat(N / 3);
        let shape: Vec<_> = shape
            .iter()
            .map(|(name, values)| (*name, of_all(values)))
            .collect();
        let effect = Effect::new(kind, &shape).unwrap();
        let width = effect.n_columns();
        let mut alone = vec![0.0; N_SAMPLES * N * width];
        for (k, sample) in alone.chunks_exact_mut(N * width).enumerate() {
            let input = EffectInput {
                state: slice_state(&state, k * N..(k + 1) * N),
                tau_link: &[],
                tau_motor: &[],
                step: 0.0,
                sign: None,
            };
            for (j, columns) in sample.chunks_exact_mut(width).enumerate() {
                effect.columns_into(j, &input, &mut [], columns);
            }
        }
        assert!(alone.iter().all(|x| x.is_finite()), "{kind}");
        assert!(alone.iter().any(|x| *x != 0.0), "{kind}");
        for joints in [vec![0, 1, 2], vec![2], vec![1, 0]] {
            let found = effect_columns(&effect, N, &run, &joints).unwrap();
            for (k, sample) in found.chunks_exact(joints.len() * width).enumerate() {
                for (place, j) in joints.iter().enumerate() {
                    let at = (k * N + j) * width;
                    let own = sample[place * width..(place + 1) * width].iter();
                    for (found, expected) in own.zip(&alone[at..at + width]) {
                        assert_eq!(found.to_bits(), expected.to_bits(), "{kind} {k} {j}");
                    }
                }
            }
        }
        let rows = observe(&robot, &[effect], &[], &states, &sampling).unwrap();
        for (j, joint) in rows.joints.iter().enumerate() {
            for (k, row) in joint.rows.chunks_exact(joint.width).enumerate() {
                let at = (k * N + j) * width;
                for (found, expected) in row.iter().zip(&alone[at..at + width]) {
                    assert_eq!(found.to_bits(), expected.to_bits(), "{kind} {k} {j}");
                }
            }
        }
    }
}
