//! Momentum against inverse dynamics, and the observer on a simulated arm that something pushes.

mod chain;

use std::f64::consts::TAU;
use std::sync::Arc;

use chain::{case, Case};
use dynid_core::model::TorqueModelParts;
use dynid_core::{
    inverse_dynamics_into, momentum_into, Domain, Effect, EffectTerm, Joint, JointKind,
    JointLimits, MomentumObserver, MomentumWorkspace, ObserverSettings, OnlineEstimator,
    RobotModel, Sample, State, Status, TorqueEstimator, TorqueModel, Workspace,
};
use nalgebra::{Rotation3, Vector3};
use proptest::prelude::*;

fn torque(robot: &RobotModel, case: &Case, dq: &[f64], ddq: &[f64]) -> Vec<f64> {
    let mut tau = vec![f64::NAN; case.q.len()];
    let mut workspace = Workspace::new(robot);
    inverse_dynamics_into(robot, &mut workspace, &case.q, dq, ddq, &case.phi, &mut tau).unwrap();
    tau
}

fn momentum(case: &Case, q: &[f64]) -> [Vec<f64>; 2] {
    let (mut p, mut drift) = (vec![f64::NAN; q.len()], vec![f64::NAN; q.len()]);
    let mut workspace = MomentumWorkspace::new(&case.robot);
    momentum_into(
        &case.robot,
        &mut workspace,
        q,
        &case.dq,
        &case.phi,
        &mut p,
        &mut drift,
    )
    .unwrap();
    [p, drift]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    /// `M dq` is the torque that accelerates by dq from rest; `C^T dq = dM/dt dq - C dq`.
    #[test]
    fn momentum_is_what_inverse_dynamics_says(case in case(7)) {
        let n = case.q.len();
        let free = case.robot.with_gravity(Vector3::zeros()).unwrap();
        let zeros = vec![0.0; n];
        let inertial = torque(&free, &case, &zeros, &case.dq);
        let coriolis = torque(&free, &case, &case.dq, &zeros);
        let [p, drift] = momentum(&case, &case.q);
        let h = 1e-5;
        let beside = |sign: f64| -> Vec<f64> {
            let q: Vec<f64> = case.q.iter().zip(&case.dq).map(|(q, dq)| q + sign * h * dq).collect();
            momentum(&case, &q)[0].clone()
        };
        let (ahead, behind) = (beside(1.0), beside(-1.0));
        let size = 1.0 + p.iter().chain(&coriolis).fold(0.0_f64, |most, x| most.max(x.abs()));
        for j in 0..n {
            prop_assert!((p[j] - inertial[j]).abs() < 1e-12 * size * 10.0);
            let expected = (ahead[j] - behind[j]) / (2.0 * h) - coriolis[j];
            prop_assert!((drift[j] - expected).abs() < 1e-6 * size, "{} {}", drift[j], expected);
        }
    }
}

const N: usize = 3;
const STEP: f64 = 0.001;

/// Three joints with rotors, one coupled to another, friction and offsets.
fn model() -> Arc<TorqueModel> {
    let friction = Effect::friction(&[0.0; N], &[0.01; N]).unwrap();
    let coulomb_and_viscous = [5.0, 5.0, 2.0, 2.0, 0.0, 0.0, 0.0, 0.0];
    model_of(EffectTerm::new(friction, coulomb_and_viscous.repeat(N), N).unwrap())
}

fn model_of(friction: EffectTerm) -> Arc<TorqueModel> {
    let joint = |j: usize| Joint {
        name: format!("joint {j}"),
        link: format!("link {j}"),
        kind: JointKind::Revolute,
        rotation: Rotation3::from_euler_angles(1.5 * j as f64, 0.2, -0.4).into_inner(),
        translation: Vector3::new(0.1, 0.0, 0.3),
        axis: Vector3::z(),
        limits: JointLimits::default(),
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi: [4.0, 0.4, 0.1, 0.6, 0.3, 0.02, 0.4, -0.03, 0.01, 0.2],
    };
    let robot = RobotModel::new(
        "arm".into(),
        (0..N).map(joint).collect(),
        Vector3::new(0.0, 0.0, -9.81),
    )
    .unwrap();
    let term =
        |effect: Effect, coefficients: Vec<f64>| EffectTerm::new(effect, coefficients, N).unwrap();
    let coupling = Effect::new("inertial_coupling", &[("partner", [1.0, -1.0, 0.0])]).unwrap();
    let parts = TorqueModelParts {
        phi: robot.phi(),
        robot,
        torque_scale: vec![1.0, 1.3, 0.7],
        effects: vec![
            term(Effect::rotor_inertia(), vec![0.5, 0.4, 0.1]),
            term(Effect::torque_offset(), vec![0.3, -0.2, 0.1]),
            friction,
            term(coupling, vec![0.2, 0.0, 0.1]),
        ],
        residual: None,
        encoder_delay: vec![0.0; N],
        noise_std: vec![0.5; N],
        domain: Domain {
            q: vec![[-2.0, 2.0]; N],
            dq: vec![9.0; N],
            ddq: vec![99.0; N],
        },
        torque_unit: "N*m".into(),
        step: None,
    };
    Arc::new(TorqueModel::new(parts).unwrap())
}

/// q, dq, ddq of a motion that never stands still at once.
fn motion(t: f64) -> [[f64; N]; 3] {
    let angles: [f64; N] = std::array::from_fn(|j| TAU * (0.3 + 0.17 * j as f64));
    [0, 1, 2].map(|order| {
        std::array::from_fn(|j| {
            let w = angles[j];
            let (sin, cos) = (w * t + j as f64).sin_cos();
            [sin, w * cos, -w * w * sin][order]
        })
    })
}

/// Runs the observer along the motion; `push` is what pushes, `noise` what the model leaves.
fn run(
    settings: ObserverSettings,
    seconds: f64,
    push: impl Fn(f64) -> [f64; N],
    mut noise: impl FnMut() -> [f64; N],
    mut see: impl FnMut(f64, &MomentumObserver),
) {
    let mut estimator = TorqueEstimator::new(model());
    let mut observer = MomentumObserver::new(model(), settings).unwrap();
    let mut tau = [0.0; N];
    for k in 0..(seconds / STEP) as usize {
        let t = k as f64 * STEP;
        let [q, dq, ddq] = motion(t);
        let status = estimator
            .estimate_into(&State::single(&q, &dq, &ddq), &mut tau)
            .unwrap();
        assert_eq!(status, Status::OK);
        let (push, noise) = (push(t), noise());
        for j in 0..N {
            tau[j] += noise[j] - push[j];
        }
        observer.step(&estimator, &tau, STEP).unwrap();
        see(t, &observer);
    }
}

const QUIET: [f64; N] = [0.0; N];

#[test]
fn a_constant_push_is_found_with_its_size_and_the_time_constant() {
    for time_constant in [0.01, 0.05] {
        let settings = ObserverSettings {
            time_constant,
            ..ObserverSettings::default()
        };
        let (begin, end) = (1.0, 1.8);
        let push = |t: f64| {
            if (begin..end).contains(&t) {
                [0.0, 30.0, 0.0]
            } else {
                QUIET
            }
        };
        let mut seen = Vec::new();
        run(
            settings,
            2.5,
            push,
            || QUIET,
            |t, observer| {
                seen.push((t, observer.external().to_vec(), observer.contact()));
            },
        );
        for (t, external, contact) in &seen {
            // Half a step: a torque that begins between two samples is in their mean.
            let since = |begin: f64| (t - begin + 0.5 * STEP).max(0.0);
            let rise = 1.0 - (-since(begin) / time_constant).exp();
            let fall = 1.0 - (-since(end) / time_constant).exp();
            let expected = 30.0 * (rise - fall);
            // The motion between two samples is not constant: of order (step w)^2 of the torques.
            assert!(
                (external[1] - expected).abs() < 0.1,
                "{t} {external:?} {expected}"
            );
            assert!(
                external[0].abs() < 0.05 && external[2].abs() < 0.05,
                "{t} {external:?}"
            );
            if *t > begin + 3.0 * time_constant && *t < end {
                assert!(contact, "{t}");
            }
            if *t < begin || *t > end + 5.0 * time_constant {
                assert!(!contact, "{t}");
            }
        }
    }
}

/// Normal numbers by the sum of twelve uniform ones, filtered to forget over `c` seconds.
fn noise(c: f64, std: f64) -> impl FnMut() -> [f64; N] {
    let mut seed = 7_u64;
    let mut uniform = move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (seed >> 11) as f64 / (1_u64 << 53) as f64
    };
    let keep = (-STEP / c).exp();
    let mut state = QUIET;
    move || {
        for x in &mut state {
            let normal: f64 = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
            *x = keep * *x + (1.0 - keep * keep).sqrt() * std * normal;
        }
        state
    }
}

#[test]
fn noise_has_the_deviation_and_the_crossings_that_thresholds_are_made_of() {
    let (c, time_constant) = (0.03, 0.02);
    let settings = ObserverSettings {
        time_constant,
        correlation_time: Some(c),
        ..ObserverSettings::default()
    };
    let expected = 0.5 * settings.noise_gain();
    let level = 2.0 * expected;
    let (mut sum, mut n, mut crossings, mut before) = (0.0, 0, 0, [0.0_f64; N]);
    let seconds = 400.0;
    run(
        settings,
        seconds,
        |_| QUIET,
        noise(c, 0.5),
        |t, observer| {
            assert!(
                !observer.contact(),
                "{t} {:?} {:?}",
                observer.external(),
                observer.threshold()
            );
            for (r, before) in observer.external().iter().zip(&mut before) {
                sum += r * r;
                n += 1;
                crossings += usize::from(r.abs() > level && before.abs() <= level);
                *before = *r;
            }
        },
    );
    let found = (sum / f64::from(n)).sqrt();
    assert!((found / expected - 1.0).abs() < 0.05, "{found} {expected}");
    let per_second = 2.0 * N as f64 / (TAU * (c * time_constant).sqrt()) * (-2.0_f64).exp();
    let found = crossings as f64 / seconds;
    // Samples miss the shortest crossings.
    assert!(
        (found / per_second - 1.0).abs() < 0.15,
        "{found} {per_second}"
    );
    // The factor is the level at which they are as many as asked for.
    let k = settings.threshold_factor(N);
    let per_hour = per_second * (2.0 - 0.5 * k * k).exp() * 3600.0;
    assert!((per_hour / settings.false_per_hour - 1.0).abs() < 1e-9);
}

#[test]
fn a_joint_that_stands_may_hold_what_friction_holds() {
    let mut observer = MomentumObserver::new(model(), ObserverSettings::default()).unwrap();
    let mut estimator = TorqueEstimator::new(model());
    let mut tau = [0.0; N];
    estimator
        .estimate_into(&State::single(&QUIET, &QUIET, &QUIET), &mut tau)
        .unwrap();
    let mut at = |extra: f64| {
        for _ in 0..500 {
            let pushed = [tau[0], tau[1] + extra, tau[2]];
            observer.step(&estimator, &pushed, STEP).unwrap();
        }
        observer.contact()
    };
    let factor = ObserverSettings::default().threshold_factor(N) * 0.5;
    assert!(!at(4.9), "within static friction");
    assert!(!at(4.4 + factor), "and within the noise beside it");
    assert!(at(6.0 + factor));
    assert!(at(0.6 * (5.0 + factor)), "held until half of the threshold");
    assert!(!at(0.3 * (5.0 + factor)));
}

#[test]
fn settings_that_are_none() {
    let good = ObserverSettings::default();
    for bad in [
        ObserverSettings {
            time_constant: 0.0,
            ..good
        },
        ObserverSettings {
            time_constant: f64::NAN,
            ..good
        },
        ObserverSettings {
            correlation_time: Some(-1.0),
            ..good
        },
        ObserverSettings {
            false_per_hour: f64::INFINITY,
            ..good
        },
    ] {
        assert!(MomentumObserver::new(model(), bad).is_err());
    }
}

/// Threshold of every joint for what friction holds at this speed.
fn held(friction: EffectTerm, dq: f64) -> Vec<f64> {
    let model = model_of(friction);
    let mut estimator = TorqueEstimator::new(model.clone());
    let mut observer = MomentumObserver::new(model, ObserverSettings::default()).unwrap();
    let (q, dq, ddq, mut tau) = ([0.1; N], [dq; N], [0.0; N], [0.0; N]);
    for _ in 0..2000 {
        let state = State::single(&q, &dq, &ddq);
        estimator.estimate_into(&state, &mut tau).unwrap();
        observer.step(&estimator, &tau, STEP).unwrap();
    }
    observer.rest().to_vec()
}

/// Of smooth friction it is Coulomb's part, however wide its step is and however much of it is viscous.
#[test]
fn a_joint_that_stands_is_held_by_its_smooth_friction() {
    for (width, sharpness) in [(0.002, 1.0), (0.12, 1.0), (0.01, 2.5), (0.12, 6.0)] {
        let shape = [
            ("transition_width", [width; N]),
            ("sharpness", [sharpness; N]),
        ];
        let term = |viscous: f64| {
            let effect = Effect::new("smooth_friction", &shape).unwrap();
            let own = [5.0, 0.4, viscous, 0.0, 0.0, 0.0];
            EffectTerm::new(effect, own.repeat(N), N).unwrap()
        };
        for viscous in [0.0, 20.0] {
            for rest in held(term(viscous), 0.0) {
                assert!((3.5..=5.0).contains(&rest), "{width} {sharpness}: {rest}");
            }
            assert_eq!(held(term(viscous), 1.5), [0.0; N]);
        }
    }
}

/// A torque that is late by the filter's delay belongs to the filtered motion.
#[test]
fn online_a_push_is_found_with_and_without_derivatives() {
    for with_derivatives in [true, false] {
        let settings = ObserverSettings::default();
        let online = OnlineEstimator::new(model(), Some(STEP), Some(11)).unwrap();
        let mut online = online.observing(settings).unwrap();
        let mut exact = TorqueEstimator::new(model());
        let mut tau = [0.0; N];
        for k in 0..2000_u64 {
            let t = k as f64 * STEP;
            let [q, dq, ddq] = motion(t);
            exact
                .estimate_into(&State::single(&q, &dq, &ddq), &mut tau)
                .unwrap();
            if t >= 1.0 {
                tau[1] -= 30.0;
            }
            let derivative = |signal| Some(signal).filter(|_| with_derivatives);
            let nan = [f64::NAN; N];
            let sample = Sample {
                sequence: Some(k),
                time: t,
                motion: [
                    Some(&q[..]),
                    derivative(&dq[..]),
                    derivative(&ddq[..]),
                    None,
                    None,
                    None,
                ],
                temperature: None,
                tau: match k {
                    500 => Some(&nan),
                    600 => None,
                    _ => Some(&tau),
                },
            };
            let status = online.step(&sample).unwrap();
            let external = online.observer().unwrap().external();
            let settled = k > 700 || (50..500).contains(&k);
            if settled && !(1000..1150).contains(&k) {
                let expected = if k >= 1150 { 30.0 } else { 0.0 };
                assert!(
                    (external[1] - expected).abs() < 0.5,
                    "{with_derivatives} {k} {external:?}"
                );
                assert_eq!(status.contains(Status::CONTACT), k >= 1150, "{k}");
            }
            if k == 600 && with_derivatives {
                assert_eq!(status, Status::SIGNAL_MISSING);
            }
            assert!(external.iter().all(|x| x.is_finite()));
        }
    }
}
