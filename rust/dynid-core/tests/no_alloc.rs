//! The estimator allocates nothing after `new`: a counting allocator watches ten thousand steps.

#![allow(unsafe_code)] // a global allocator cannot be written without

mod every_effect;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::hint::black_box;
use std::sync::Arc;

use dynid_core::adapt::UNKNOWN_MEMORY;
use dynid_core::model::TorqueModelParts;
use dynid_core::uncertainty::{Direction, Tail};
use dynid_core::watch::{Healthy, Watch, WatchSettings};
use dynid_core::{
    AdaptSettings, Adaptation, Domain, Effect, EffectTerm, GaussianMixtureRegression, Joint,
    JointKind, JointLimits, NormalisedRbf, ObserverSettings, OnlineEstimator, Regression, Residual,
    ResidualInputs, RobotModel, Sample, Signal, SignalKind, State, Status, TorqueEstimator,
    TorqueModel, Uncertainty,
};
use every_effect::every_effect;
use nalgebra::{Rotation3, Vector3};

/// The system's allocator, counting this thread's calls (the test harness allocates on others).
struct Counting;

thread_local! {
    static CALLS: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    CALLS.with(|calls| calls.set(calls.get() + 1));
}

// SAFETY: every call is handed to `System` as it came; counting touches a thread-local without destructor, which does
// not allocate.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        System.alloc(layout)
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count();
        System.alloc_zeroed(layout)
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        System.realloc(pointer, layout, size)
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        System.dealloc(pointer, layout);
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const N: usize = 6;
/// All torque channels are late, and some by more than others \[s\].
const LATE: [f64; N] = [0.0123, 0.0123, 0.02, 0.0123, 0.0123, 0.0156];
const STEPS: usize = 10_000;

fn robot() -> RobotModel {
    let joints = (0..N)
        .map(|j| Joint {
            name: format!("joint {j}"),
            link: format!("link {j}"),
            kind: if j == 2 {
                JointKind::Prismatic
            } else {
                JointKind::Revolute
            },
            rotation: Rotation3::from_euler_angles(0.3 * j as f64, -0.2, 0.5).into_inner(),
            translation: Vector3::new(0.1, -0.2, 0.3),
            axis: Vector3::z(),
            limits: JointLimits::default(),
            rotor_inertia: 0.0,
            gear_ratio: None,
            phi: [2.0, 0.3, -0.1, 0.5, 0.7, 0.02, 0.9, -0.05, 0.04, 1.1],
        })
        .collect();
    RobotModel::new("arm".to_owned(), joints, Vector3::new(0.0, 0.0, -9.81)).unwrap()
}

/// Six signals of other joints, the load among them.
fn six_signals() -> ResidualInputs {
    let of = |j: usize| {
        let kinds = SignalKind::ALL[1..].iter().enumerate();
        kinds
            .map(|(k, &kind)| Signal {
                kind,
                joint: (j + k) % N,
            })
            .collect()
    };
    ResidualInputs::Signals((0..N).map(of).collect())
}

fn model(inputs: ResidualInputs, rbf: bool) -> TorqueModel {
    let d = inputs.len(0);
    // Loads are larger than deflections.
    let variance = if d == 2 { 0.2 } else { 1e4 };
    let spread = |width: usize| -> Vec<f64> {
        let cell = |at: usize| {
            if at.is_multiple_of(width + 1) {
                variance
            } else {
                0.01
            }
        };
        (0..width * width).map(cell).collect()
    };
    let wave = |n: usize| -> Vec<f64> { (0..n).map(|k| 0.5 * (2.0 * k as f64).sin()).collect() };
    let regression = if rbf {
        let (weights, variances) = (vec![1.0, -2.0, 0.5], vec![0.1; 3]);
        NormalisedRbf::new(wave(3 * d), vec![1.0 / variance; d], weights, variances)
            .unwrap()
            .into()
    } else {
        let (weights, covariances) = (vec![0.5, 0.3, 0.2], vec![spread(d + 1); 3].concat());
        let mixture =
            GaussianMixtureRegression::new(d, weights, wave(3 * (d + 1)), covariances).unwrap();
        Regression::Mixture(mixture)
    };
    let term = |effect: Effect| {
        let coefficients = vec![0.5; N * effect.n_columns()];
        EffectTerm::new(effect, coefficients, N).unwrap()
    };
    let robot = robot();
    TorqueModel::new(TorqueModelParts {
        phi: robot.phi(),
        robot,
        torque_scale: vec![1.5; N],
        effects: every_effect(N).into_iter().map(term).collect(),
        residual: Some(
            Residual::new(inputs, vec![Some(regression); N])
                .and_then(|residual| residual.with_compliance(vec![1e-5; N]))
                .unwrap(),
        ),
        encoder_delay: vec![0.003; N],
        noise_std: vec![0.1; N],
        domain: Domain {
            q: vec![[-1.0, 1.0]; N],
            dq: vec![1.0; N],
            ddq: vec![1.0; N],
        },
        torque_unit: "N*m".to_owned(),
        step: Some(0.001),
    })
    .unwrap()
}

#[test]
fn ten_thousand_steps_allocate_nothing() {
    let every = || {
        ResidualInputs::PAIRS
            .into_iter()
            .chain([six_signals(), six_signals()])
    };
    for (k, inputs) in every().chain(every()).enumerate() {
        let mut model = model(inputs.clone(), k % 2 == 0);
        if k % 4 == 1 {
            model = model.with_torque_delay(&LATE).unwrap();
        }
        let mut estimator = TorqueEstimator::new(Arc::new(model));
        if k % 4 == 0 {
            estimator = estimator.unlimited();
        }
        let mut seen = [0usize; 5]; // good, bad, outside of the box, faded, without temperature
        let (mut signals, mut tau) = ([[0.0; N]; 6], [0.0; N]);
        let temperature = [31.5; N];

        let before = CALLS.with(Cell::get);
        for step in 0..STEPS {
            for (k, signal) in signals.iter_mut().enumerate() {
                for (j, x) in signal.iter_mut().enumerate() {
                    let phase = 0.01 * step as f64 + (k % 3) as f64 + 0.7 * j as f64;
                    *x = phase.sin() + if k < 3 { 0.0 } else { 0.05 }; // deflection of the motor side
                }
            }
            match step % 50 {
                10 => signals[step / 50 % 6][step % N] = f64::NAN,
                20 => signals[step / 50 % 6][step % N] = f64::INFINITY,
                30 => signals[4][step % N] = 1e300,
                40 => {
                    signals[0][step % N] = 2.0; // outside of the box
                    signals[3][step % N] = 1e6; // far from the mixture's data
                }
                _ => {}
            }
            let [q, dq, ddq, q_motor, dq_motor, ddq_motor] = &signals;
            let state = State {
                q,
                dq,
                ddq,
                q_motor,
                dq_motor,
                ddq_motor,
                temperature: (step % 50 != 5).then_some(&temperature[..]),
            };
            let status = estimator.estimate_into(black_box(&state), &mut tau);
            let status = black_box(status).unwrap_or(Status::NON_FINITE);
            seen[0] += usize::from(status == Status::OK);
            seen[1] += usize::from(status.contains(Status::NON_FINITE));
            seen[2] += usize::from(status.contains(Status::OUTSIDE_DOMAIN));
            seen[3] += usize::from(status.contains(Status::RESIDUAL_FADED));
            seen[4] += usize::from(status.contains(Status::SIGNAL_MISSING));
            // A wrong length is reported without allocating either.
            let _ = black_box(estimator.estimate_into(&state, &mut tau[1..]));
        }
        let after = CALLS.with(Cell::get);

        assert_eq!(after - before, 0, "{inputs:?}");
        assert!(seen.iter().all(|count| *count > 0), "{inputs:?}: {seen:?}");
        assert_eq!(seen[1], STEPS / 50 * 3, "{inputs:?}");
    }
}

/// Every parameter is off by a tenth of itself, in two ways.
fn uncertainty(model: &TorqueModel) -> Uncertainty {
    let terms = model.effects().iter();
    let part = |x: &[f64]| x.iter().map(|x| 0.1 * x).collect::<Vec<_>>();
    let direction = Direction {
        phi: part(model.phi()),
        effects: terms.map(|term| part(term.coefficients())).collect(),
    };
    Uncertainty {
        moving: vec![1e-4; N],
        standing: vec![1e-5; N],
        turning: vec![1e-3; N],
        torque: vec![1e-6; N],
        stops_known: vec![true; N],
        turns_known: vec![false; N],
        directions: vec![direction; 2],
        tails: vec![
            Tail {
                level: 1.0,
                per_hour: 1.0,
                growth: 0.1,
            };
            N
        ],
    }
}

/// Everything that an online estimator says.
fn bits_of(online: &OnlineEstimator) -> impl Iterator<Item = u64> + '_ {
    let heard = online.observer();
    let of_observer = heard.map_or([&[][..]; 3], |own| {
        [own.external(), own.threshold(), own.guide()]
    });
    let added = online.adaptation().map_or(&[][..], Adaptation::added);
    let said = [online.tau(), online.estimator().terms(), added];
    let said = said.into_iter().chain(of_observer);
    said.into_iter().flatten().map(|x| x.to_bits())
}

/// Rows of a few samples, and an alarm at hardly anything: names and sizes come too.
const WATCHFUL: WatchSettings = WatchSettings {
    row: 0.004,
    false_per_day: 1e9,
    friction: 1e-3,
    gain: 1e-3,
    offset: 1e-3,
    load: 1e-3,
    delay: 1e-3,
    slip: 1e-3,
    unknown: 1e-3,
};

/// Moves that are hardly any are said.
const FOLLOWING: AdaptSettings = AdaptSettings {
    friction: true,
    payload: true,
    row: 0.004,
    memory: 0.1,
    factor: [0.5, 2.0],
    mass: 0.1,
    reach: 0.2,
    said: 1e-3,
};

#[test]
fn a_stream_with_faults_and_what_listens_allocates_nothing() {
    let kinds = [
        (true, false, false),
        (false, false, false),
        (true, false, true),
        (false, false, true),
        (true, true, false),
    ];
    for (with_derivatives, watches, knows) in kinds {
        let late = if with_derivatives { LATE } else { [0.0; N] };
        let model = model(ResidualInputs::JointState, false).with_torque_delay(&late);
        let model = Arc::new(model.unwrap());
        let healthy = Healthy {
            frozen_after: vec![0.02; N],
            ..Healthy::untold(N)
        };
        let online = |model: &Arc<TorqueModel>| {
            let online = OnlineEstimator::new(Arc::clone(model), None, Some(11));
            if watches {
                let online = online.and_then(|online| online.watching(WATCHFUL, &healthy));
                online
                    .and_then(|online| online.adapting(FOLLOWING, &[1.0; N], &[UNKNOWN_MEMORY; N]))
            } else {
                online.and_then(|online| online.observing(ObserverSettings::default()))
            }
            .and_then(|online| match knows {
                true => online.knowing(Arc::new(uncertainty(model))),
                false => Ok(online),
            })
            .unwrap()
        };
        let (mut running, mut other) = (online(&model), online(&model));
        let mut twin = running.clone();
        let mut numbers = vec![0.0; running.watch().map_or(0, Watch::n_remembered)];
        let own = running.adaptation().map_or(0, Adaptation::n_remembered);
        let mut of_adaptation = vec![0.0; own];
        let (mut seen, mut remembered) = (0, 0);
        let before = CALLS.with(Cell::get);
        for step in 0..STEPS as u64 {
            let mut signals = [[0.0; N]; 4];
            for (k, signal) in signals.iter_mut().enumerate() {
                for (j, x) in signal.iter_mut().enumerate() {
                    *x = (0.01 * step as f64 + k as f64 + 0.7 * j as f64).sin();
                }
            }
            let mut sequence = step;
            match step % 50 {
                10 => signals[0][3] = f64::NAN,
                20 => signals[0][3] = 1e9,
                25 => sequence -= 5,
                30 => signals[3][0] = f64::INFINITY,
                40 => seen |= running.hold().bits(),
                45 => running.swap(&mut other).unwrap(),
                _ => {}
            }
            let [q, dq, ddq, tau] = &signals;
            let derivative = |signal| Some(signal).filter(|_| with_derivatives);
            let sample = Sample {
                sequence: Some(sequence),
                time: 0.001 * sequence as f64,
                motion: [
                    Some(&q[..]),
                    derivative(&dq[..]),
                    derivative(&ddq[..]),
                    None,
                    None,
                    None,
                ],
                temperature: watches.then_some(&[20.0; N][..]),
                tau: Some(tau),
            };
            twin.mirror(&running);
            let status = running.step(black_box(&sample)).unwrap_or(Status::STALE);
            seen |= black_box(status).bits();
            // The twin says the same to the last bit, whatever came before; the real one does not know of it.
            assert_eq!(twin.step(&sample).ok(), Some(status), "{step}");
            assert!(bits_of(&twin).eq(bits_of(&running)), "{step}");
            if let Some(watch) = running.watch_mut() {
                remembered += u32::from(watch.remember(&mut numbers).unwrap());
            }
            if let Some(own) = running.adaptation_mut() {
                own.remember(&mut of_adaptation).unwrap();
                if step == 7000 {
                    own.reset();
                }
            }
        }
        let after = CALLS.with(Cell::get);
        assert_eq!(after - before, 0);
        let expected = [
            Status::NON_FINITE,
            Status::OUTSIDE_DOMAIN,
            Status::OUT_OF_ORDER,
            Status::REPEATED,
        ];
        for said in [Status::CHANGED, Status::ADAPTED, Status::AT_LIMIT] {
            assert_eq!(seen & said.bits() != 0, watches, "{said:?}");
        }
        assert_eq!(remembered > 100, watches);
        assert!(
            expected.iter().all(|status| seen & status.bits() != 0),
            "{seen}"
        );
    }
}

#[test]
fn the_counter_counts() {
    let before = CALLS.with(Cell::get);
    drop(black_box(vec![1.0; 100]));
    assert_eq!(CALLS.with(Cell::get) - before, 2);
}
