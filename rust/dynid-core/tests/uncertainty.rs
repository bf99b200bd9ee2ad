//! Thresholds that follow from the state: parameters against models with other parameters, what joints do, what guides.

mod chain;

use std::sync::Arc;

use chain::{case, Case};
use dynid_core::model::TorqueModelParts;
use dynid_core::uncertainty::{Direction, Doing, Tail};
use dynid_core::{
    CoreError, Domain, Effect, EffectTerm, MomentumObserver, ObserverSettings, OnlineEstimator,
    Sample, State, Status, TorqueEstimator, TorqueModel, Uncertainty,
};
use proptest::prelude::*;

const STEP: f64 = 0.001;

/// Rotors, friction and offsets on the links of a case.
fn model(case: &Case, phi: Vec<f64>, coefficients: [Vec<f64>; 3]) -> TorqueModel {
    let n = case.q.len();
    let friction = Effect::friction(&vec![0.0; n], &vec![0.01; n]).unwrap();
    let effects = [Effect::rotor_inertia(), Effect::torque_offset(), friction];
    let terms = effects.into_iter().zip(coefficients);
    TorqueModel::new(TorqueModelParts {
        robot: case.robot.clone(),
        phi,
        torque_scale: (0..n).map(|j| 1.0 + 0.3 * j as f64).collect(),
        effects: terms
            .map(|(effect, own)| EffectTerm::new(effect, own, n).unwrap())
            .collect(),
        residual: None,
        encoder_delay: vec![0.0; n],
        noise_std: vec![0.5; n],
        domain: Domain {
            q: vec![[-9.0, 9.0]; n],
            dq: vec![99.0; n],
            ddq: vec![999.0; n],
        },
        torque_unit: "N*m".into(),
        step: None,
    })
    .unwrap()
}

fn coefficients(n: usize, size: f64) -> [Vec<f64>; 3] {
    [1, 1, 8].map(|width| {
        (0..width * n)
            .map(|k| size * (1.0 + 0.1 * k as f64))
            .collect()
    })
}

fn uncertainty(n: usize, directions: Vec<Direction>) -> Uncertainty {
    Uncertainty {
        moving: vec![0.04; n],
        standing: vec![0.01; n],
        turning: vec![0.09; n],
        torque: vec![0.0; n],
        stops_known: vec![true; n],
        turns_known: vec![true; n],
        directions,
        tails: vec![
            Tail {
                level: 16.0,
                per_hour: 10.0,
                growth: 2.0,
            };
            n
        ],
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// By a direction the torque is off by what it is with these parameters more, less what it is without.
    #[test]
    fn parameters_are_off_by_torques(case in case(7)) {
        let n = case.q.len();
        let own = coefficients(n, 0.3);
        let known = Arc::new(model(&case, case.phi.clone(), own.clone()));
        let directions: Vec<Direction> = (0..3).map(|k| Direction {
            phi: (0..10 * n).map(|i| 0.1 * (1.7 * i as f64 + k as f64).sin()).collect(),
            effects: coefficients(n, 0.05 * (k as f64 - 1.0)).into(),
        }).collect();
        let tau_of = |model: &TorqueModel| {
            let mut estimator = TorqueEstimator::new(Arc::new(model.clone()));
            let mut tau = vec![0.0; n];
            estimator.estimate_into(&State::single(&case.q, &case.dq, &case.ddq), &mut tau).unwrap();
            tau
        };
        let mut expected = vec![0.0; n];
        let (mut scale, tau) = (1.0_f64, tau_of(&known));
        for direction in &directions {
            let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect::<Vec<_>>();
            let own = [0, 1, 2].map(|k| sum(&own[k], &direction.effects[k]));
            let other = tau_of(&model(&case, sum(&case.phi, &direction.phi), own));
            for j in 0..n {
                expected[j] += (other[j] - tau[j]).powi(2);
                scale = scale.max(tau[j].abs()).max(other[j].abs());
            }
        }
        let mut estimator = TorqueEstimator::new(Arc::clone(&known));
        let mut said = vec![0.0; n];
        estimator.estimate_into(&State::single(&case.q, &case.dq, &case.ddq), &mut said).unwrap();
        let observer = MomentumObserver::new(known, ObserverSettings::default()).unwrap();
        let mut observer = observer.with_uncertainty(Arc::new(uncertainty(n, directions))).unwrap();
        observer.step(&estimator, &said, STEP).unwrap();
        let (_, found) = observer.sources().unwrap();
        for j in 0..n {
            prop_assert!((found[j] - expected[j]).abs() < 1e-10 * scale * scale, "{:?} {:?}", found, expected);
        }
    }
}

/// A joint that turns about the vertical: no gravity, no coupling.
fn turntable() -> Case {
    use dynid_core::{Joint, JointKind, JointLimits, RobotModel};
    use nalgebra::{Matrix3, Vector3};
    let phi = [1.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.1, 0.0, 0.0, 0.1];
    let joint = Joint {
        name: "table".into(),
        link: "top".into(),
        kind: JointKind::Revolute,
        rotation: Matrix3::identity(),
        translation: Vector3::zeros(),
        axis: Vector3::z(),
        limits: JointLimits::default(),
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi,
    };
    let robot = RobotModel::new("arm".into(), vec![joint], Vector3::new(0.0, 0.0, -9.81)).unwrap();
    Case {
        robot,
        q: vec![0.0],
        dq: vec![0.0],
        ddq: vec![0.0],
        phi: phi.to_vec(),
    }
}

/// Coulomb's friction of 2 N m.
fn table() -> Arc<TorqueModel> {
    let friction = vec![2.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let own = [vec![0.0], vec![0.0], friction];
    Arc::new(model(&turntable(), turntable().phi, own))
}

fn settings() -> ObserverSettings {
    ObserverSettings {
        time_constant: 0.01,
        false_per_hour: 10.0, // k is 4
        ..ObserverSettings::default()
    }
}

/// A table that stands, turns at a constant speed, and stands again; what it did, its threshold, and what of it is friction.
fn stop_and_go(uncertainty: Uncertainty) -> Vec<(f64, Doing, f64, f64)> {
    let mut estimator = TorqueEstimator::new(table());
    let observer = MomentumObserver::new(table(), settings()).unwrap();
    let mut observer = observer.with_uncertainty(Arc::new(uncertainty)).unwrap();
    let (mut seen, mut tau) = (Vec::new(), [0.0]);
    for k in 0..1500 {
        let t = f64::from(k) * STEP;
        let dq = if (0.5..1.0).contains(&t) { 1.0 } else { 0.0 };
        estimator
            .estimate_into(&State::single(&[0.0], &[dq], &[0.0]), &mut tau)
            .unwrap();
        observer.step(&estimator, &tau, STEP).unwrap();
        let does = observer.sources().unwrap().0[0];
        seen.push((t, does, observer.threshold()[0], observer.rest()[0]));
    }
    seen
}

#[test]
fn a_joint_stands_turns_and_moves() {
    let seen = stop_and_go(uncertainty(1, vec![]));
    let at = |t: f64| seen[(t / STEP).round() as usize];
    for (t, does, deviation) in [
        (0.4, Doing::Standing, 0.1),
        (0.505, Doing::Turning, 0.3),
        (0.9, Doing::Moving, 0.2),
        (1.01, Doing::Turning, 0.3),
        (1.4, Doing::Standing, 0.1),
    ] {
        let (_, did, threshold, rest) = at(t);
        assert_eq!((did, rest), (does, 0.0), "{t}");
        assert!(
            (threshold - 4.0 * deviation).abs() < 1e-6,
            "{t}: {threshold}"
        );
    }
    // The observer remembers what it saw as long as its time constant lets it: turning ended at 0.529.
    let (_, did, threshold, _) = at(0.531);
    assert_eq!(did, Doing::Moving);
    assert!(
        threshold > 4.0 * 0.2 && threshold < 4.0 * 0.3,
        "{threshold}"
    );
}

#[test]
fn what_may_stick_has_room_for_static_friction() {
    let seen = stop_and_go(Uncertainty {
        stops_known: vec![false],
        ..uncertainty(1, vec![])
    });
    for (_, does, _, rest) in &seen[100..] {
        let expected = if *does == Doing::Standing { 2.0 } else { 0.0 };
        assert!((rest - expected).abs() < 0.2, "{does:?}: {rest}");
    }
}

#[test]
fn fewer_false_contacts_cost_higher_thresholds() {
    let tail = uncertainty(1, vec![]).tails[0];
    assert!((tail.factor(10.0) - 4.0).abs() < 1e-12);
    let e_times_less = tail.factor(10.0 / std::f64::consts::E);
    assert!((e_times_less.powi(2) - 18.0).abs() < 1e-9);
    assert!(
        (tail.factor(1e9) - 1.0).abs() < 1e-12,
        "never below one deviation"
    );
    // Each of two joints may do half of what is put up with.
    assert_eq!(uncertainty(2, vec![]).factors(10.0), [tail.factor(5.0); 2]);
}

/// A table that a torque pushes, which is answered `n` times; then what the stream does.
fn guided(push: f64, n: u32) -> OnlineEstimator {
    let online = OnlineEstimator::new(table(), Some(STEP), None).unwrap();
    let online = online.observing(settings()).unwrap();
    let known = online.knowing(Arc::new(uncertainty(1, vec![])));
    let mut online = known.unwrap();
    for k in 0..n {
        let sample = Sample {
            tau: Some(&[2.0 - push]),
            ..sample(f64::from(k) * STEP)
        };
        online.step(&sample).unwrap();
    }
    online
}

fn sample<'a>(time: f64) -> Sample<'a> {
    Sample {
        sequence: None,
        time,
        motion: [Some(&[0.0]), Some(&[1.0]), Some(&[0.0]), None, None, None],
        temperature: None,
        tau: None,
    }
}

#[test]
fn a_hand_guides_beyond_the_threshold_and_smoothly() {
    let said = |push: f64| {
        let online = guided(push, 500);
        let observer = online.observer().unwrap();
        let (guide, r) = (observer.guide()[0], observer.external()[0]);
        (guide, r, observer.threshold()[0])
    };
    let threshold = said(0.0).2;
    let (mut before, mut slope_before) = (0.0, 0.0);
    for k in 0..400 {
        let push = 0.01 * f64::from(k);
        let (guide, r, _) = said(push);
        assert!((r - push).abs() < 1e-6, "{r} {push}");
        assert_eq!(guide > 0.0, r > threshold, "{push}");
        assert!(guide <= (r - threshold).max(0.0));
        // No step in the torque, and none in its slope: w is a quarter of the threshold, so slopes change by 2 h / w at most.
        let slope = (guide - before) / 0.01;
        let most = 2.0 * 0.01 / (0.25 * threshold) + 1e-9;
        assert!(
            slope >= -1e-12 && (slope - slope_before).abs() < most,
            "{push}"
        );
        (before, slope_before) = (guide, slope);
        let mirrored = said(-push).0;
        assert!((mirrored + guide).abs() < 1e-9);
    }
    assert!(
        (before - (3.99 - threshold)).abs() < 0.25 * threshold,
        "{before}"
    );
}

#[test]
fn nothing_guides_where_nothing_was_heard() {
    let mut online = guided(20.0, 500);
    assert!(online.observer().unwrap().guide()[0] > 10.0);
    let status = online.step(&sample(0.5)).unwrap();
    assert!(status.contains(Status::SIGNAL_MISSING));
    assert_eq!(online.observer().unwrap().guide(), [0.0]);

    let mut online = guided(20.0, 500);
    online.hold();
    assert!(
        online.observer().unwrap().guide()[0] > 10.0,
        "one cycle without a state"
    );
    assert!(online.hold().contains(Status::STALE));
    assert_eq!(online.observer().unwrap().guide(), [0.0]);
    assert_eq!(guided(20.0, 0).observer().unwrap().guide(), [0.0]);
}

#[test]
fn what_is_not_of_the_model_is_refused() {
    let good = uncertainty(
        1,
        vec![Direction {
            phi: vec![0.1; 10],
            effects: vec![vec![0.1], vec![0.1], vec![0.1; 8]],
        }],
    );
    assert_eq!(good.check(&table()), Ok(()));
    let with = |change: &dyn Fn(&mut Uncertainty)| {
        let mut other = good.clone();
        change(&mut other);
        other.check(&table())
    };
    let range = |what| Err(CoreError::Range { what });
    assert_eq!(with(&|u| u.moving[0] = 0.0), range("moving"));
    assert_eq!(with(&|u| u.torque[0] = -1.0), range("torque"));
    assert_eq!(with(&|u| u.turning[0] = f64::NAN), range("turning"));
    assert_eq!(with(&|u| u.tails[0].growth = 0.0), range("growth"));
    assert_eq!(with(&|u| u.tails[0].level = f64::INFINITY), range("level"));
    assert_eq!(
        with(&|u| u.directions[0].phi[3] = f64::NAN),
        range("a direction")
    );
    let most = |u: &mut Uncertainty| u.directions = vec![u.directions[0].clone(); 65];
    assert_eq!(with(&most), range("the number of directions"));
    for change in [
        (&|u: &mut Uncertainty| u.standing.push(1.0)) as &dyn Fn(&mut Uncertainty),
        &|u| u.stops_known.clear(),
        &|u| u.turns_known.push(true),
        &|u| u.tails.clear(),
        &|u| u.directions[0].phi.truncate(9),
        &|u| u.directions[0].effects.truncate(2),
        &|u| u.directions[0].effects[2].truncate(7),
    ] {
        assert!(matches!(with(change), Err(CoreError::Length { .. })));
    }
}
