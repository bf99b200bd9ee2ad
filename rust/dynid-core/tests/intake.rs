//! States that are taken elsewhere before they are evaluated: those of a late torque channel, and those beyond the limits.

use std::sync::Arc;

use dynid_core::limits::believed;
use dynid_core::model::TorqueModelParts;
use dynid_core::{
    Domain, Effect, EffectTerm, Joint, JointKind, JointLimits, OnlineEstimator, RobotModel, Sample,
    State, Status, TorqueEstimator, TorqueModel,
};
use nalgebra::{Rotation3, Vector3};
use proptest::prelude::*;

const N: usize = 2;
const STEP: f64 = 0.001;

fn model() -> TorqueModel {
    let joint = |j: usize| Joint {
        name: format!("joint {j}"),
        link: format!("link {j}"),
        kind: JointKind::Revolute,
        rotation: Rotation3::from_euler_angles(0.7, -0.2, 0.5).into_inner(),
        translation: Vector3::new(0.1, -0.2, 0.3),
        axis: Vector3::z(),
        limits: if j == 0 {
            JointLimits {
                lower: -2.0,
                upper: 2.5,
                velocity: 3.0,
                effort: 80.0,
                ..JointLimits::default()
            }
        } else {
            JointLimits::default()
        },
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi: [2.0, 0.3, -0.1, 0.5, 0.7, 0.02, 0.9, -0.05, 0.04, 1.1],
    };
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let robot = RobotModel::new("arm".into(), (0..N).map(joint).collect(), gravity).unwrap();
    let friction = Effect::friction(&[0.0; N], &[0.01; N]).unwrap();
    let coefficients = vec![0.5; N * friction.n_columns()];
    TorqueModel::new(TorqueModelParts {
        phi: robot.phi(),
        robot,
        torque_scale: vec![1.2; N],
        effects: vec![EffectTerm::new(friction, coefficients, N).unwrap()],
        residual: None,
        encoder_delay: vec![0.0; N],
        noise_std: vec![0.1; N],
        domain: Domain {
            q: vec![[-1.5, 1.5]; N],
            dq: vec![2.0; N],
            ddq: vec![4.0; N],
        },
        torque_unit: "N*m".into(),
        step: Some(STEP),
    })
    .unwrap()
}

/// A smooth motion, always in the box.
fn motion(t: f64) -> [[f64; N]; 3] {
    let (s, c) = (1.3 * t + 0.2).sin_cos();
    [[s, 0.5 * c], [1.3 * c, -0.65 * s], [-1.69 * s, -0.845 * c]]
}

fn torque(estimator: &mut TorqueEstimator, [q, dq, ddq]: &[[f64; N]; 3]) -> ([f64; N], Status) {
    let mut tau = [0.0; N];
    let status = estimator.estimate_into(&State::single(q, dq, ddq), &mut tau);
    (tau, status.unwrap())
}

fn sample(sequence: u64, rows: &[[f64; N]; 3]) -> Sample<'_> {
    let [q, dq, ddq] = rows.each_ref().map(|row| Some(&row[..]));
    Sample {
        sequence: Some(sequence),
        time: f64::NAN,
        motion: [q, dq, ddq, None, None, None],
        temperature: None,
        tau: None,
    }
}

fn close(one: &[f64], other: &[f64]) -> bool {
    one.iter().zip(other).all(|(a, b)| (a - b).abs() < 1e-4)
}

#[test]
fn a_late_channel_shows_the_torque_of_then() {
    let plain = Arc::new(model());
    let together = [0.0075, 0.012, 0.0005].map(|delay| [delay; N]);
    let each = [[0.0, 0.012], [0.0075, 0.0005]];
    for delays in together.into_iter().chain(each) {
        let late = Arc::new(model().with_torque_delay(&delays).unwrap());
        let mut online = OnlineEstimator::new(Arc::clone(&late), None, None).unwrap();
        let mut offline = TorqueEstimator::new(late);
        let mut exact = TorqueEstimator::new(Arc::clone(&plain));
        for k in 0..200_u64 {
            let t = k as f64 * STEP;
            // A few are lost on the way.
            if (90..95).contains(&k) {
                continue;
            }
            let rows = motion(t);
            let status = online.step(&sample(k, &rows)).unwrap();
            let filled = t >= delays[0].max(delays[1]) * (1.0 - 1e-12);
            assert_eq!(status.contains(Status::SETTLING), !filled, "{k}");
            if k < 90 {
                let (tau, status) = torque(&mut offline, &rows);
                assert_eq!(online.tau(), tau, "the same bits");
                assert_eq!(status.contains(Status::SETTLING), !filled);
            }
            // The oldest state stands for what was before it, and of a joint's own line the first step that is not of it.
            let expected: Vec<f64> = (0..N)
                .map(|j| torque(&mut exact, &motion((t - delays[j]).max(0.0))).0[j])
                .collect();
            let off = online.tau().iter().zip(&expected);
            let off = off.map(|(tau, expected)| (tau - expected).abs());
            let off = off.fold(0.0, f64::max);
            assert!(off < if filled { 1e-4 } else { 0.02 }, "{k}: {off}");
            let n = online.tau().len();
            let terms = online.estimator().terms();
            let sum: Vec<f64> = (0..n).map(|j| terms[j] + terms[n + j]).collect();
            assert!(close(online.tau(), &sum));
        }
    }
}

#[test]
fn a_stream_that_begins_again_begins_its_past_anew() {
    let late = Arc::new(model().with_torque_delay(&[0.0045; N]).unwrap());
    let mut online = OnlineEstimator::new(Arc::clone(&late), None, None).unwrap();
    for k in 1000..1100 {
        online.step(&sample(k, &motion(k as f64 * STEP))).unwrap();
    }
    // Believed at its third word; five states reach back far enough.
    let statuses: Vec<Status> = (0..12)
        .map(|k| online.step(&sample(k, &motion(k as f64 * STEP))).unwrap())
        .collect();
    assert!(statuses[2].contains(Status::SETTLING.and(Status::LOST)));
    assert!(statuses[6].contains(Status::SETTLING));
    assert!(
        statuses[7..].iter().all(|status| *status == Status::OK),
        "{statuses:?}"
    );
    let mut fresh = OnlineEstimator::new(late, None, None).unwrap();
    for k in 2..12 {
        fresh.step(&sample(k, &motion(k as f64 * STEP))).unwrap();
    }
    assert_eq!(fresh.tau(), online.tau(), "no trace of before");
}

#[test]
fn what_is_no_state_takes_its_time_all_the_same() {
    let late = Arc::new(model().with_torque_delay(&[0.0045; N]).unwrap());
    let mut online = OnlineEstimator::new(late, None, None).unwrap();
    let mut exact = TorqueEstimator::new(Arc::new(model()));
    for k in 0..60_u64 {
        let mut rows = motion(k as f64 * STEP);
        if (20..23).contains(&k) {
            rows[1][0] = f64::NAN;
        }
        let status = online.step(&sample(k, &rows)).unwrap();
        if (20..23).contains(&k) {
            assert_eq!(status, Status::NON_FINITE);
        } else if k > 4 {
            let (expected, _) = torque(&mut exact, &motion(k as f64 * STEP - 0.0045));
            assert!(close(online.tau(), &expected), "{k}");
        }
    }
}

#[test]
fn another_model_goes_on_with_the_states_of_the_old_one() {
    let late = |delays: [f64; N]| Arc::new(model().with_torque_delay(&delays).unwrap());
    for (old, new) in [
        ([0.0045; N], [0.0025; N]),
        ([0.0045, 0.0125], [0.0025, 0.0075]),
    ] {
        let mut online = OnlineEstimator::new(late(old), None, None).unwrap();
        for k in 0..50 {
            online.step(&sample(k, &motion(k as f64 * STEP))).unwrap();
        }
        let mut next = OnlineEstimator::new(late(new), None, None).unwrap();
        online.swap(&mut next).unwrap();
        let status = online.step(&sample(50, &motion(50.0 * STEP))).unwrap();
        assert_eq!(status, Status::OK);
        // A joint's own terms of before are those that the old model had, whose states were later.
        let mut exact = TorqueEstimator::new(Arc::new(model()));
        let expected = torque(&mut exact, &motion(0.05 - new[0])).0;
        assert!(close(&online.tau()[..1], &expected[..1]));
        for k in 51..80 {
            online.step(&sample(k, &motion(k as f64 * STEP))).unwrap();
        }
        let expected = torque(&mut exact, &motion(79.0 * STEP - new[1])).0;
        assert!(close(&online.tau()[1..], &expected[1..]));
    }
}

#[test]
fn an_early_channel_is_not_foretold() {
    let early = Arc::new(model().with_torque_delay(&[-0.01; N]).unwrap());
    let mut online = OnlineEstimator::new(early, None, None).unwrap();
    let mut plain = OnlineEstimator::new(Arc::new(model()), None, None).unwrap();
    for k in 0..20 {
        let rows = motion(k as f64 * STEP);
        let status = online.step(&sample(k, &rows)).unwrap();
        assert_eq!(status, plain.step(&sample(k, &rows)).unwrap());
        assert_eq!(online.tau(), plain.tau());
    }
}

#[test]
fn delays_that_are_none_are_refused() {
    for delay in [f64::NAN, f64::INFINITY, 0.50001, -0.50001] {
        assert!(model().with_torque_delay(&[0.0, delay]).is_err(), "{delay}");
    }
    assert!(model().with_torque_delay(&[0.0]).is_err(), "one per joint");
    let late = Arc::new(model().with_torque_delay(&[0.4; N]).unwrap());
    assert!(
        OnlineEstimator::new(late, Some(1e-6), None).is_err(),
        "too many states"
    );
}

/// Least and greatest number of a joint's signal.
fn bound(model: &TorqueModel, j: usize, signal: usize) -> [f64; 2] {
    believed(model)[j][signal]
}

#[test]
fn limits_are_the_robots_between_what_training_shows() {
    let model = model();
    // The robot's 3 rad/s lie below twice the trained 2 rad/s; its positions are narrower than one range beyond.
    assert_eq!(bound(&model, 0, 0), [-4.5, 4.5]);
    assert_eq!(bound(&model, 0, 1), [-4.0, 4.0]);
    assert_eq!(bound(&model, 0, 2), [-40.0, 40.0]);
    assert_eq!(bound(&model, 1, 0), [-1.5 - 1e4, 1.5 + 1e4]);
    assert_eq!(bound(&model, 1, 1), [-20.0, 20.0]);
}

proptest! {
    /// Whatever comes in, the torque is that of the nearest state within, and the status says so; within nothing changes.
    #[test]
    fn a_state_beyond_is_evaluated_at_the_limits(
        t in 0.0..5.0f64, joint in 0..N, signal in 0..3_usize, size in -12.0..12.0f64, negative: bool,
    ) {
        let model = Arc::new(model());
        let mut rows = motion(t);
        let value = 10_f64.powf(size) * if negative { -1.0 } else { 1.0 };
        rows[signal][joint] = value;
        let [low, high] = bound(&model, joint, signal);
        let mut held = rows;
        held[signal][joint] = value.clamp(low, high);
        let beyond = held != rows;
        let (tau, status) = torque(&mut TorqueEstimator::new(Arc::clone(&model)), &rows);
        let (at_limit, within) = torque(&mut TorqueEstimator::new(Arc::clone(&model)), &held);
        prop_assert_eq!(tau.map(f64::to_bits), at_limit.map(f64::to_bits));
        prop_assert!(!within.contains(Status::BEYOND_LIMITS));
        prop_assert_eq!(status.contains(Status::BEYOND_LIMITS), beyond);
        prop_assert!(!beyond || status.contains(Status::OUTSIDE_DOMAIN));
        let mut online = OnlineEstimator::new(Arc::clone(&model), None, None).unwrap();
        prop_assert_eq!(online.step(&sample(7, &rows)).unwrap(), status);
        prop_assert_eq!(online.tau(), &tau[..]);
        let (raw, said) = torque(&mut TorqueEstimator::new(model).unlimited(), &rows);
        prop_assert_eq!(said.contains(Status::BEYOND_LIMITS), beyond);
        if beyond && signal > 0 && value.abs() > 1e6 {
            prop_assert!(raw.iter().zip(&tau).any(|(raw, tau)| raw.abs() > 100.0 * tau.abs()));
        }
    }
}

#[test]
fn what_is_not_finite_is_no_limit() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut estimator = TorqueEstimator::new(Arc::new(model()));
        let (good, _) = torque(&mut estimator, &motion(0.3));
        let mut rows = motion(0.3);
        rows[1] = [bad, 1e9];
        let (tau, status) = torque(&mut estimator, &rows);
        assert_eq!((tau, status), (good, Status::NON_FINITE));
    }
}

#[test]
fn input_is_stale_from_the_second_cycle_without_any() {
    let mut online = OnlineEstimator::new(Arc::new(model()), None, None).unwrap();
    let mut stale = || online.hold().contains(Status::STALE);
    assert_eq!([stale(), stale(), stale()], [false, true, true]);
    let [q, dq, ddq] = motion(0.0);
    let mut sample = Sample {
        sequence: None,
        time: 0.0,
        motion: [None; 6],
        temperature: None,
        tau: None,
    };
    for (signal, values) in sample.motion.iter_mut().zip([&q, &dq, &ddq]) {
        *signal = Some(values);
    }
    assert!(!online.step(&sample).unwrap().contains(Status::STALE));
    assert!(!online.hold().contains(Status::STALE));
}
