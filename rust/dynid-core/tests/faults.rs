//! Random streams with every fault there is: finite output, the right status within two cycles, clean within ten, and then the
//! bits of a fresh estimator. `DYNID_STREAMS` says how many streams (a million takes minutes; the default a second or two).

mod every_effect;

use std::sync::Arc;

use dynid_core::model::TorqueModelParts;
use dynid_core::{
    Domain, Effect, EffectTerm, GaussianMixtureRegression, Joint, JointKind, JointLimits,
    OnlineEstimator, Residual, ResidualInputs, RobotModel, Sample, Status, TorqueModel,
};
use every_effect::every_effect;
use nalgebra::{Rotation3, Vector3};

const N: usize = 2;
const STEP: f64 = 0.001;

/// After so many cycles of good input the status is clean again.
const TEN: u64 = 10;

/// What positions alone are differentiated over where nothing else is asked for.
const WINDOW: u64 = 15;

fn model(remembers: bool) -> Arc<TorqueModel> {
    let joint = |j: usize| Joint {
        name: format!("joint {j}"),
        link: format!("link {j}"),
        kind: if j == 1 {
            JointKind::Prismatic
        } else {
            JointKind::Revolute
        },
        rotation: Rotation3::from_euler_angles(0.7, -0.2, 0.5).into_inner(),
        translation: Vector3::new(0.1, -0.2, 0.3),
        axis: Vector3::z(),
        limits: JointLimits::default(),
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi: [2.0, 0.3, -0.1, 0.5, 0.7, 0.02, 0.9, -0.05, 0.04, 1.1],
    };
    let robot = RobotModel::new(
        "arm".into(),
        (0..N).map(joint).collect(),
        Vector3::new(0.0, 0.0, -9.81),
    )
    .unwrap();
    let term = |effect: Effect| {
        let coefficients = vec![0.5; N * effect.n_columns()];
        EffectTerm::new(effect, coefficients, N).unwrap()
    };
    let effects = every_effect(N)
        .into_iter()
        .filter(|effect| remembers || effect.memory_len(N) == 0);
    // The temperature never comes.
    let effects = effects.filter(|effect| !effect.entry().needs("temperature"));
    let covariances = [[0.3, 0.01, 0.02], [0.01, 0.3, 0.01], [0.02, 0.01, 0.3]].concat();
    let mixture = GaussianMixtureRegression::new(2, vec![1.0], vec![0.0; 3], covariances).unwrap();
    let parts = TorqueModelParts {
        phi: robot.phi(),
        robot,
        torque_scale: vec![1.2; N],
        effects: effects.map(term).collect(),
        residual: Some(
            Residual::new(ResidualInputs::JointState, vec![Some(mixture.into()); N]).unwrap(),
        ),
        encoder_delay: vec![0.0; N],
        noise_std: vec![0.1; N],
        domain: Domain {
            q: vec![[-1.5, 1.5]; N],
            dq: vec![2.0; N],
            ddq: vec![4.0; N],
        },
        torque_unit: "N*m".into(),
        step: Some(STEP),
    };
    Arc::new(TorqueModel::new(parts).unwrap())
}

/// A generator of one line: this file needs nothing better.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: u64) -> u64 {
        self.next() % n
    }

    fn part(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    NotANumber,
    Infinite,
    Huge,
    Overflow,
    Stuck,
    Frozen,
    Stale,
    OutOfOrder,
    Duplicated,
    TimeBackwards,
    Lost,
    NoTime,
    Restarted,
}

const FAULTS: [Fault; 13] = [
    Fault::NotANumber,
    Fault::Infinite,
    Fault::Huge,
    Fault::Overflow,
    Fault::Stuck,
    Fault::Frozen,
    Fault::Stale,
    Fault::OutOfOrder,
    Fault::Duplicated,
    Fault::TimeBackwards,
    Fault::Lost,
    Fault::NoTime,
    Fault::Restarted,
];

impl Fault {
    /// Bits of which one has to be set within two cycles.
    fn expected(self) -> Status {
        match self {
            Self::NotANumber | Self::Infinite | Self::NoTime => Status::NON_FINITE,
            Self::Overflow => Status::NON_FINITE.and(Status::OUTSIDE_DOMAIN),
            Self::Huge => Status::OUTSIDE_DOMAIN,
            Self::Stuck | Self::Frozen => Status::STUCK,
            Self::Stale => Status::STALE,
            Self::OutOfOrder => Status::OUT_OF_ORDER,
            Self::Duplicated => Status::REPEATED,
            Self::TimeBackwards => Status::TIME_BACKWARDS,
            Self::Lost => Status::LOST,
            Self::Restarted => Status::OUT_OF_ORDER,
        }
    }
}

/// The motion at cycle k; never at rest, always in the box.
#[derive(Clone, Copy)]
struct Motion {
    speed: [f64; N],
    phase: [f64; N],
}

impl Motion {
    fn at(&self, k: u64) -> [[f64; N]; 6] {
        let mut rows = [[0.0; N]; 6];
        let t = k as f64 * STEP;
        for (j, (w, phase)) in self.speed.iter().zip(&self.phase).enumerate() {
            // Within a tenth of a second, about the middle of the swing.
            let (sin, cos) = (w * t + phase).sin_cos();
            let signals = [sin, w * cos, -w * w * sin];
            for (k, row) in rows.iter_mut().enumerate() {
                row[j] = signals[k % 3] + if k == 3 { 3e-4 } else { 0.0 };
            }
        }
        rows
    }
}

struct Stream {
    online: OnlineEstimator,
    positions_alone: bool,
}

impl Stream {
    fn send(&mut self, sequence: u64, time: f64, rows: &[[f64; N]; 6]) -> Status {
        let derivative = |k: usize| Some(&rows[k][..]).filter(|_| !self.positions_alone);
        let sample = Sample {
            sequence: Some(sequence),
            time,
            motion: [
                Some(&rows[0]),
                derivative(1),
                derivative(2),
                Some(&rows[3]),
                derivative(4),
                derivative(5),
            ],
            temperature: None,
            tau: None,
        };
        let status = self.online.step(&sample).unwrap();
        self.check();
        status
    }

    fn check(&self) {
        let estimator = self.online.estimator();
        let mut std = [0.0; N];
        estimator.predicted_std_into(&mut std).unwrap();
        assert!(self
            .online
            .tau()
            .iter()
            .chain(estimator.terms())
            .chain(&std)
            .all(|x| x.is_finite()));
    }
}

/// One stream: clean, a fault of a few cycles, clean. Says which fault it was.
fn stream(seed: u64, models: &[Arc<TorqueModel>; 2], scratch: &OnlineEstimator) -> Fault {
    let mut random = Random(seed);
    let fault = FAULTS[random.below(FAULTS.len() as u64) as usize];
    let positions_alone = random.below(4) == 0 && !matches!(fault, Fault::Stuck | Fault::Frozen);
    let remembers = random.below(4) == 0;
    let fresh = || {
        let online = if remembers {
            OnlineEstimator::new(Arc::clone(&models[1]), None, None).unwrap()
        } else {
            scratch.clone()
        };
        Stream {
            online,
            positions_alone,
        }
    };
    let motion = Motion {
        // Fast enough to cover, in one cycle, the way after which a position that stands still is stuck.
        speed: [0; N].map(|_| 0.7 + random.part()),
        phase: [0; N].map(|_| random.part() - 0.5),
    };
    let mut stream = fresh();
    let begin = random.below(1 << 40);
    let number = |k: u64| begin + k;
    let time = |k: u64| k as f64 * STEP;
    let before = WINDOW + random.below(4);
    // A few cycles, or longer than everything that the window holds.
    let lasts = 1 + random.below(6) + if random.below(4) == 0 { 2 * WINDOW } else { 0 };
    let mut k = 0;
    for _ in 0..before {
        let status = stream.send(number(k), time(k), &motion.at(k));
        let expected = if positions_alone && k + 1 < TEN {
            Status::SETTLING.and(Status::REPEATED)
        } else {
            Status::OK
        };
        assert_eq!(status, expected, "seed {seed}");
        k += 1;
    }
    let mut seen = Vec::new();
    // A sender that starts again goes on with its own numbers.
    let (mut shift, mut late) = (0, 0.0);
    let held = motion.at(k - 1);
    for cycle in 0..lasts {
        let mut rows = motion.at(k);
        let (row, j) = (
            if positions_alone {
                3 * random.below(2)
            } else {
                random.below(6)
            },
            random.below(2),
        );
        let value = &mut rows[row as usize][j as usize];
        let (mut sequence, mut t) = (number(k), time(k));
        match fault {
            Fault::NotANumber => *value = f64::NAN,
            Fault::Infinite => {
                *value = f64::INFINITY * if random.below(2) == 0 { 1.0 } else { -1.0 }
            }
            // Of a position, because only the link side has a trained box.
            Fault::Huge => rows[0][j as usize] = 10_f64.powi(2 + random.below(9) as i32),
            Fault::Overflow => {
                rows[(row % 3) as usize][j as usize] = 10_f64.powi(160 + random.below(148) as i32)
            }
            Fault::Stuck => rows[0] = held[0],
            Fault::Frozen => rows = held,
            Fault::Stale => {
                seen.push(stream.online.hold());
                stream.check();
                k += 1;
                continue;
            }
            Fault::OutOfOrder => sequence -= 2 + random.below(5),
            Fault::Duplicated => sequence = number(k - cycle - 1),
            Fault::TimeBackwards => {
                t = time(0) - 1e-3 * random.part() - if cycle % 2 == 0 { 1.0 } else { 2.0 }
            }
            Fault::Lost => {
                k += 1 + random.below(3);
                rows = motion.at(k);
                sequence = number(k);
                t = time(k);
            }
            Fault::NoTime => t = f64::NAN,
            Fault::Restarted => {
                shift = begin + before;
                late = time(before);
                sequence = k - before;
                t = time(k) - late;
            }
        }
        seen.push(stream.send(sequence, t, &rows));
        k += 1;
    }
    // What stands still in the sensor shows once it should have moved.
    let wanted = match fault {
        Fault::Stale if lasts < 2 => Status::REPEATED,
        fault => fault.expected(),
    };
    let enough = fault != Fault::Stale || lasts >= 2 || wanted == Status::REPEATED;
    let shown = seen
        .iter()
        .take(2)
        .any(|status| status.only(wanted) != Status::OK);
    assert!(
        enough && shown,
        "seed {seed}: {fault:?} for {lasts} cycles gave {seen:?}"
    );

    // Good input again: clean within ten cycles, and then the bits of an estimator that knows nothing of the past.
    let resumed = k;
    let mut clean = None;
    let mut other = fresh();
    let mut clean_other = 0;
    for cycle in 0..WINDOW + 10 {
        let (sequence, t) = (number(k) - shift, time(k) - late);
        let rows = motion.at(k);
        let status = stream.send(sequence, t, &rows);
        if status == Status::OK {
            clean.get_or_insert(cycle);
        } else {
            assert!(
                cycle < TEN,
                "seed {seed}: {fault:?} gave {status:?} in cycle {cycle} after it"
            );
            clean = None;
        }
        let status = other.send(sequence, t, &rows);
        clean_other += u64::from(status == Status::OK);
        // Both have seen the same once a window is full; before, the one with a past knows more.
        let settled = if positions_alone { WINDOW - 1 } else { 0 };
        if clean.is_some_and(|clean| cycle >= clean.max(settled)) && clean_other > 0 && !remembers {
            assert_eq!(
                stream.online.tau().map_bits(),
                other.online.tau().map_bits(),
                "seed {seed}: {fault:?}, {} cycles after it",
                k - resumed
            );
            assert_eq!(
                stream.online.estimator().terms().map_bits(),
                other.online.estimator().terms().map_bits()
            );
        }
        k += 1;
    }
    assert!(
        clean.is_some_and(|clean| clean < TEN),
        "seed {seed}: {fault:?}"
    );
    fault
}

trait Bits {
    fn map_bits(&self) -> Vec<u64>;
}

impl Bits for [f64] {
    fn map_bits(&self) -> Vec<u64> {
        self.iter().map(|x| x.to_bits()).collect()
    }
}

#[test]
fn faults_are_said_and_leave_no_trace() {
    let count = std::env::var("DYNID_STREAMS").map_or(20_000, |n| n.parse::<u64>().unwrap());
    let models = [model(false), model(true)];
    let scratch = OnlineEstimator::new(Arc::clone(&models[0]), None, None).unwrap();
    let mut counts = [0_u64; FAULTS.len()];
    for seed in 0..count {
        let fault = stream(seed, &models, &scratch);
        counts[FAULTS.iter().position(|other| *other == fault).unwrap()] += 1;
    }
    println!(
        "{count} streams: {:?}",
        FAULTS.iter().zip(counts).collect::<Vec<_>>()
    );
    assert!(counts.iter().all(|n| *n > count / 50));
}

#[test]
fn any_part_of_the_samples_may_be_lost() {
    for (per_cent, positions_alone) in [
        (1, false),
        (5, false),
        (50, false),
        (1, true),
        (5, true),
        (50, true),
    ] {
        let online = OnlineEstimator::new(model(false), None, Some(21)).unwrap();
        let mut stream = Stream {
            online,
            positions_alone,
        };
        let mut exact = Stream {
            online: OnlineEstimator::new(model(false), None, None).unwrap(),
            positions_alone: false,
        };
        let motion = Motion {
            speed: [1.0, 0.7],
            phase: [0.1, -0.3],
        };
        let mut random = Random(per_cent);
        let (mut answered, mut came) = (0, 0);
        for k in 0..20_000 {
            if random.below(100) < per_cent {
                stream.online.hold();
                stream.check();
                continue;
            }
            came += 1;
            let status = stream.send(k, k as f64 * STEP, &motion.at(k));
            if status.only(Status::REPEATED) == Status::OK {
                answered += 1;
                let late = if positions_alone { 10 } else { 0 };
                if k >= late {
                    exact.send(k, (k - late) as f64 * STEP, &motion.at(k - late));
                    for (tau, expected) in stream.online.tau().iter().zip(exact.online.tau()) {
                        // The window smooths (w h)^2 / 10 of the motion; friction's step at a reversal is not smooth.
                        let slow = motion.at(k - late)[1].iter().any(|dq| dq.abs() < 0.05);
                        let tolerance = if positions_alone {
                            // All kinds of friction at once are steep in the speed, and their sum may be small.
                            0.02 * expected.abs() + 0.04
                        } else {
                            0.0
                        };
                        assert!(
                            slow || (tau - expected).abs() <= tolerance,
                            "{per_cent} {k}: {tau} {expected}"
                        );
                    }
                }
            }
        }
        let least = if positions_alone && per_cent == 50 {
            0.95
        } else {
            0.99
        };
        assert!(
            f64::from(answered) > least * f64::from(came),
            "{per_cent} %: {answered} of {came}"
        );
    }
}
