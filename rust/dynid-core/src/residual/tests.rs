#![allow(clippy::unwrap_used)]

use super::*;
use crate::signal::Signal;

fn rbf(d: usize) -> Regression {
    // One bump: its weight is the torque anywhere, its width 1.
    NormalisedRbf::new(vec![0.0; d], vec![1.0; d], vec![2.0], vec![0.0])
        .unwrap()
        .into()
}

fn signals(named: &[(&str, usize)]) -> Vec<Signal> {
    let named = named.iter();
    named
        .map(|(name, j)| Signal::named(name, *j).unwrap())
        .collect()
}

const NUMBERS: [[f64; 2]; 7] = [
    [0.1, 0.2],
    [1.1, 1.2],
    [2.1, 2.2],
    [3.1, 3.2],
    [4.1, 4.2],
    [5.1, 5.2],
    [6.1, 6.2],
];

fn state() -> State<'static> {
    let [q, dq, ddq, q_motor, dq_motor, ddq_motor, _] = &NUMBERS;
    State {
        q,
        dq,
        ddq,
        q_motor,
        dq_motor,
        ddq_motor,
        temperature: None,
    }
}

#[test]
fn signals_are_read_by_name_and_joint() {
    let names = [
        "q",
        "dq",
        "ddq",
        "q_motor",
        "dq_motor",
        "ddq_motor",
        "tau_link",
    ];
    for (k, name) in names.into_iter().enumerate() {
        for (j, expected) in NUMBERS[k].into_iter().enumerate() {
            let signal = Signal::named(name, j).unwrap();
            assert_eq!(signal.at(&state(), &NUMBERS[6]), expected, "{name}");
        }
    }
    let named = signals(&[("tau_link", 1), ("q", 0), ("dq_motor", 1)]);
    let inputs = ResidualInputs::Signals(vec![named, vec![]]);
    let u = inputs.at(0, &state(), 9.0, &NUMBERS[6]);
    assert_eq!(u[..inputs.len(0)], [6.2, 0.1, 4.2]);
    assert_eq!(inputs.len(1), 0);
}

#[test]
fn a_signal_of_another_name_is_refused_with_the_names_there_are() {
    let words = Signal::named("tau", 0).unwrap_err().to_string();
    assert!(words.contains("there is no signal \"tau\", expected one of q, dq, ddq, q_motor"));
}

#[test]
fn signals_that_do_not_fit_are_refused() {
    let two = [("q", 0), ("dq", 1)];
    let good = vec![signals(&two), vec![]];
    let new = |joints, regressions| {
        let residual = Residual::new(ResidualInputs::Signals(joints), regressions);
        residual.map_err(|error| error.to_string())
    };
    assert!(new(good.clone(), vec![Some(rbf(2)), None]).is_ok());
    let six = vec![Signal::named("q", 0).unwrap(); MAX_INPUTS];
    assert!(new(vec![vec![], six.clone()], vec![None, Some(rbf(6))]).is_ok());
    let seven = [six, signals(&[("q", 0)])].concat();
    for (joints, regressions, words) in [
        (
            good.clone(),
            vec![Some(rbf(3)), None],
            "the residual of joint 0 has 3 inputs, expected 2",
        ),
        (
            good.clone(),
            vec![None, Some(rbf(1))],
            "the residual of joint 1 has 1 inputs, expected 0",
        ),
        (
            good.clone(),
            vec![None],
            "residual signals has 2 values, expected 1",
        ),
        (
            vec![seven, vec![]],
            vec![Some(rbf(7)), None],
            "number of signals of a joint's residual is outside its range",
        ),
        (
            vec![signals(&[("q", 2)]), vec![]],
            vec![Some(rbf(1)), None],
            "the residual of joint 0 names a signal of joint 2, which the chain does not have",
        ),
    ] {
        assert_eq!(new(joints, regressions).unwrap_err(), words);
    }
}

#[test]
fn two_encoders_are_needed_where_both_sides_of_a_gear_are_named() {
    let need =
        |named: &[(&str, usize)]| ResidualInputs::Signals(vec![signals(named)]).two_encoders();
    assert!(need(&[("q_motor", 1), ("tau_link", 0), ("q", 1)]));
    assert!(need(&[("dq", 0), ("dq_motor", 0)]));
    assert!(!need(&[("q_motor", 0), ("dq_motor", 0)]));
    assert!(!need(&[("q", 0), ("q_motor", 1)]));
}

/// Of a normal cloud the part that is not fully trusted does not depend on how many inputs there are.
#[test]
fn trust_reaches_as_far_in_any_dimension() {
    // Distances beyond which a normal cloud of d dimensions has 3.35e-4 of its samples, from tables of chi square.
    for (d, distance) in [
        (1, 3.587),
        (2, 4.0),
        (3, 4.303),
        (4, 4.568),
        (5, 4.805),
        (6, 5.023),
    ] {
        let trusted = |radius: f64| {
            let mut u = [0.0; 2];
            u[0] = radius;
            let named = [signals(&[
                ("q", 0),
                ("q", 1),
                ("dq", 1),
                ("ddq", 1),
                ("dq", 0),
                ("ddq", 0),
            ])];
            let inputs = ResidualInputs::Signals(vec![named[0][..d].to_vec(), vec![]]);
            let residual = Residual::new(inputs, vec![Some(rbf(d)), None]).unwrap();
            let state = State::single(&u, &[0.0; 2], &[0.0; 2]);
            let load = Load {
                tau_link: &[0.0; 2],
                scaled: &[0.0; 2],
            };
            let (mut tau, mut variance) = ([0.0; 2], [0.0; 2]);
            !residual.torque_into(&state, load, &mut tau, &mut variance)
        };
        assert!(trusted(0.95 * distance), "{d}");
        assert!(!trusted(1.06 * distance), "{d}");
    }
}
