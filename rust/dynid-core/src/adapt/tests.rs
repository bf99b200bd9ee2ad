#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::{adapted_model, AdaptSettings, Adapted, Part, Reason, N_PAYLOAD, UNKNOWN_MEMORY};
use crate::effects::EffectTerm;
use crate::model::{Domain, TorqueModelParts};
use crate::{
    Effect, Joint, JointKind, JointLimits, ObserverSettings, OnlineEstimator, RobotModel, Sample,
    Status, TorqueModel,
};

const N: usize = 2;
/// A power of two: times between samples are the same to the bit, also after a beginning, of which there is none before.
const STEP: f64 = 1.0 / 128.0;

/// Of an arm of two joints with friction.
fn model() -> Arc<TorqueModel> {
    let joint = |name: &str| Joint {
        name: name.to_owned(),
        link: format!("{name}_link"),
        kind: JointKind::Revolute,
        rotation: Matrix3::identity(),
        translation: Vector3::new(0.3, 0.0, 0.0),
        axis: Vector3::y(),
        limits: JointLimits::default(),
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi: [0.0; 10],
    };
    let joints = vec![joint("a"), joint("b")];
    let robot = RobotModel::new("arm".to_owned(), joints, Vector3::new(0.0, 0.0, -9.81)).unwrap();
    let friction = Effect::friction(&[0.01; N], &[0.02; N]).unwrap();
    let coefficients = [5.0, 5.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0].repeat(N);
    Arc::new(
        TorqueModel::new(TorqueModelParts {
            robot,
            phi: vec![0.5; 10 * N],
            torque_scale: vec![1.0; N],
            effects: vec![EffectTerm::new(friction, coefficients, N).unwrap()],
            residual: None,
            encoder_delay: vec![0.0; N],
            noise_std: vec![0.5; N],
            domain: Domain {
                q: vec![[-3.0, 3.0]; N],
                dq: vec![3.0; N],
                ddq: vec![9.0; N],
            },
            torque_unit: "N*m".to_owned(),
            step: Some(STEP),
        })
        .unwrap(),
    )
}

const BOTH: AdaptSettings = AdaptSettings {
    friction: true,
    payload: true,
    row: 0.2,
    memory: 10.0,
    factor: [0.5, 2.0],
    mass: 3.0,
    reach: 0.2,
    said: 0.05,
};

const FRICTION: AdaptSettings = AdaptSettings {
    payload: false,
    mass: 0.0,
    ..BOTH
};

fn online(settings: AdaptSettings) -> OnlineEstimator {
    let online = OnlineEstimator::new(model(), None, None).unwrap();
    online
        .adapting(settings, &[1.0; N], &[UNKNOWN_MEMORY; N])
        .unwrap()
}

/// q, dq, ddq at sample k; the second joint stands where `stands`.
fn motion(k: usize, stands: bool) -> [[f64; N]; 3] {
    let t = STEP * k as f64;
    let (a, b) = ((1.3 * t).sin_cos(), (0.9 * t + 1.0).sin_cos());
    let still = f64::from(u8::from(!stands));
    [
        [a.0, b.0 * still],
        [1.3 * a.1, 0.9 * b.1 * still],
        [-1.69 * a.0, -0.81 * b.0 * still],
    ]
}

/// One step at sample k with what the model says, and what `more` adds of it: friction's torque, and a load's.
struct Arm {
    truth: OnlineEstimator,
    factor: [f64; N],
    stands: bool,
}

impl Arm {
    fn new(factor: [f64; N]) -> Self {
        Self {
            truth: OnlineEstimator::new(model(), None, None).unwrap(),
            factor,
            stands: false,
        }
    }

    fn tau(&mut self, k: usize) -> [f64; N] {
        let [q, dq, ddq] = motion(k, self.stands);
        self.truth.step(&sample(k, &[q, dq, ddq], None)).unwrap();
        let terms = self.truth.estimator().terms();
        std::array::from_fn(|j| terms[j] + self.factor[j] * terms[N + j])
    }

    fn run(&mut self, online: &mut OnlineEstimator, steps: std::ops::Range<usize>) -> Vec<Adapted> {
        let mut told = Vec::new();
        for k in steps {
            let tau = self.tau(k);
            let motion = motion(k, self.stands);
            online.step(&sample(k, &motion, Some(&tau))).unwrap();
            told.extend(online.adapted());
        }
        told
    }
}

fn sample<'a>(k: usize, motion: &'a [[f64; N]; 3], tau: Option<&'a [f64]>) -> Sample<'a> {
    let [q, dq, ddq] = motion.each_ref().map(|signal| Some(&signal[..]));
    Sample {
        sequence: Some(k as u64),
        time: STEP * k as f64,
        motion: [q, dq, ddq, None, None, None],
        temperature: None,
        tau,
    }
}

fn bits(x: &[f64]) -> Vec<u64> {
    x.iter().map(|x| x.to_bits()).collect()
}

fn known(online: &OnlineEstimator) -> Vec<u64> {
    let own = online.adaptation().unwrap();
    let mut numbers = vec![0.0; own.n_remembered()];
    own.remember(&mut numbers).unwrap();
    bits(&numbers)
}

#[test]
fn friction_is_followed_and_the_model_stays() {
    let (mut online, mut arm) = (online(FRICTION), Arm::new([1.3, 0.8]));
    let told = arm.run(&mut online, 0..9000);
    for (j, factor) in [1.3, 0.8].into_iter().enumerate() {
        let (used, estimate, std) = online.adaptation().unwrap().factor(j);
        assert!((used - factor).abs() < 0.01 && (estimate - factor).abs() < 1.96 * std);
    }
    assert!(told.len() >= 8 && told.len() < 20, "{}", told.len());
    assert!(told
        .iter()
        .all(|one| one.part == Part::Friction && one.reason == Reason::Followed));
    let moves: Vec<f64> = told.iter().map(|one| (one.to - one.from).abs()).collect();
    assert!(
        moves.iter().all(|by| *by >= 0.05 && *by < 0.06),
        "{moves:?}"
    );
    // What is answered is the arm's, terms are the model's, and a model with it in it says the same.
    let own = online.adaptation().unwrap();
    let factors: Vec<f64> = (0..N).map(|j| own.factor(j).0).collect();
    let changed = adapted_model(&model(), &factors, &[0.0; N_PAYLOAD]).unwrap();
    let mut other = OnlineEstimator::new(Arc::new(changed), None, None).unwrap();
    let motion = motion(9000, false);
    other.step(&sample(9000, &motion, None)).unwrap();
    let tau = arm.tau(9000);
    online.step(&sample(9000, &motion, Some(&tau))).unwrap();
    assert_eq!(online.estimator().terms(), arm.truth.estimator().terms());
    for ((own, tau), other) in online.tau().iter().zip(tau).zip(other.tau()) {
        assert!((own - tau).abs() < 0.1);
        assert!((own - other).abs() < 1e-9);
    }
}

#[test]
fn a_torque_never_jumps() {
    let (mut online, mut arm) = (online(BOTH), Arm::new([2.0, 2.0]));
    let mut before = [0.0; N];
    for k in 0..4000 {
        let (tau, motion) = (arm.tau(k), motion(k, false));
        online.step(&sample(k, &motion, Some(&tau))).unwrap();
        let own = online.adaptation().unwrap();
        let now: [f64; N] = std::array::from_fn(|j| own.factor(j).0 - 1.0);
        for (now, before) in now.iter().zip(before) {
            // Its whole range within the memory, and no faster.
            assert!((now - before).abs() <= 1.5 / 10.0 * STEP + 1e-12, "{k}");
        }
        before = now;
    }
    assert!(before[0] > 0.5);
}

#[test]
fn limits_stop_it_and_are_said_and_left_at_once() {
    let (mut online, mut arm) = (online(FRICTION), Arm::new([3.0, 1.0]));
    let told = arm.run(&mut online, 0..6000);
    let reasons: Vec<Reason> = told
        .iter()
        .filter(|one| one.joint == 0)
        .map(|one| one.reason)
        .collect();
    assert_eq!(reasons.last(), Some(&Reason::Limit));
    assert_eq!(
        reasons.iter().filter(|one| **one == Reason::Limit).count(),
        1
    );
    let own = online.adaptation().unwrap();
    assert_eq!(own.factor(0).0, 2.0);
    assert!(own.is_at_limit() && online.hold().contains(Status::AT_LIMIT));
    let unheard = online.step(&sample(6000, &motion(6000, false), None));
    assert!(unheard.unwrap().contains(Status::AT_LIMIT));
    arm.factor = [1.4, 1.0];
    // Within a memory: what was beyond the limit has not piled up.
    let told = arm.run(&mut online, 6001..7500);
    assert!(told.iter().any(|one| one.reason == Reason::Within));
    let own = online.adaptation().unwrap();
    assert!(
        !own.is_at_limit() && own.factor(0).0 < 1.75,
        "{:?}",
        own.factor(0)
    );
}

#[test]
fn a_load_that_is_hung_on_is_found_with_its_centre() {
    let load = [1.5, 0.1, 0.0, -0.2];
    let changed = adapted_model(&model(), &[1.0; N], &load).unwrap();
    let (mut online, mut arm) = (online(BOTH), Arm::new([1.0; N]));
    arm.run(&mut online, 0..2000);
    assert!(online.adaptation().unwrap().load().0[0] < 0.05);
    arm.truth = OnlineEstimator::new(Arc::new(changed), None, None).unwrap();
    let told = arm.run(&mut online, 2000..12_000);
    let own = online.adaptation().unwrap();
    let ([mass, x, _, z], ..) = own.load();
    // The arm moves in a plane, so nothing is seen of the moment across it.
    assert!((mass - 1.5).abs() < 0.15, "{mass}");
    assert!((x - 0.1).abs() < 0.03 && (z + 0.2).abs() < 0.03, "{x} {z}");
    assert!(own.is_at_limit() || (0..N).all(|j| (own.factor(j).0 - 1.0).abs() < 0.03));
    assert!(told
        .iter()
        .any(|one| one.part == Part::Payload && one.joint == N - 1));
}

#[test]
fn what_the_arm_cannot_carry_is_not_believed() {
    let changed = adapted_model(&model(), &[1.0; N], &[9.0, 0.0, 0.0, 0.0]).unwrap();
    let (mut online, mut arm) = (online(BOTH), Arm::new([1.0; N]));
    arm.truth = OnlineEstimator::new(Arc::new(changed), None, None).unwrap();
    let told = arm.run(&mut online, 0..6000);
    let own = online.adaptation().unwrap();
    let ([mass, x, y, z], ..) = own.load();
    assert!(mass <= 3.0 && (x * x + y * y + z * z).sqrt() <= 0.2 * mass + 1e-12);
    assert!(own.is_at_limit());
    assert!(told
        .iter()
        .any(|one| one.reason == Reason::Limit && one.part == Part::Payload));
}

/// What is done to motion and torque of a sample.
type Spoil = dyn Fn(&mut [[f64; N]; 3], &mut Vec<f64>);

/// At rest, outside, pushed, without a torque, with one that is none: nothing is learnt, nothing moves.
#[test]
fn what_says_nothing_changes_nothing() {
    let (mut online, mut arm) = (online(BOTH), Arm::new([1.4, 1.4]));
    arm.run(&mut online, 0..2000);
    let quiet = |online: &mut OnlineEstimator, change: &Spoil| {
        // The row that was begun before ends first.
        for k in 2000..2040 {
            let (mut motion, mut tau) = (motion(k, false), vec![1.0; N]);
            change(&mut motion, &mut tau);
            let tau = Some(&tau[..]).filter(|tau| !tau.is_empty());
            online.step(&sample(k, &motion, tau)).unwrap();
        }
        let before = known(online);
        for k in 2040..2500 {
            let (mut motion, mut tau) = (motion(k, false), vec![1.0; N]);
            change(&mut motion, &mut tau);
            let tau = Some(&tau[..]).filter(|tau| !tau.is_empty());
            online.step(&sample(k, &motion, tau)).unwrap();
        }
        assert_eq!(known(online), before);
    };
    quiet(&mut online.clone(), &|motion, _| {
        (motion[1], motion[2]) = ([1e-6; N], [0.0; N]);
    });
    quiet(&mut online.clone(), &|motion, _| motion[0] = [3.5; N]);
    quiet(&mut online.clone(), &|_, tau| tau.clear());
    quiet(&mut online.clone(), &|_, tau| tau[1] = f64::NAN);
    quiet(&mut online.clone(), &|_, tau| tau[0] = 1e300);
    let mut pushed = online
        .clone()
        .observing(ObserverSettings::default())
        .unwrap();
    quiet(&mut pushed, &|_, tau| tau.fill(200.0));
    assert!(pushed.hold().contains(Status::CONTACT));
}

#[test]
fn a_joint_that_stands_for_an_hour_is_as_sure_as_before() {
    let (mut online, mut arm) = (online(FRICTION), Arm::new([1.2, 1.2]));
    arm.run(&mut online, 0..6000);
    let before = online.adaptation().unwrap().factor(1);
    arm.stands = true;
    arm.factor = [0.9, 5.0];
    arm.run(&mut online, 6000..366_000);
    let own = online.adaptation().unwrap();
    assert_eq!(own.factor(1).1.to_bits(), before.1.to_bits());
    assert_eq!(own.squares.variance(1).to_bits(), {
        let mut again = super::tests::online(FRICTION);
        let mut arm = Arm::new([1.2, 1.2]);
        arm.run(&mut again, 0..6000);
        // The last rows before it stood were taken after them.
        let mut stands = Arm::new([0.9, 5.0]);
        stands.stands = true;
        stands.run(&mut again, 6000..6100);
        again.adaptation().unwrap().squares.variance(1).to_bits()
    });
    assert!((own.factor(0).0 - 0.9).abs() < 0.01);
}

/// A row counts as what the limits allow, one of the three hundred of a minute.
#[test]
fn one_sample_beyond_all_bounds_moves_nothing_much() {
    let settings = AdaptSettings {
        memory: 60.0,
        ..FRICTION
    };
    let (mut online, mut arm) = (online(settings), Arm::new([1.2, 1.2]));
    arm.run(&mut online, 0..20_000);
    for (k, beyond) in [1e99, -9e99, -1e50].into_iter().enumerate() {
        let before = online.adaptation().unwrap().factor(0).1;
        let k = 20_000 + 40 * k;
        arm.run(&mut online, k..k + 20);
        let motion = motion(k + 20, false);
        online
            .step(&sample(k + 20, &motion, Some(&[beyond, 0.0])))
            .unwrap();
        arm.run(&mut online, k + 21..k + 40);
        let after = online.adaptation().unwrap().factor(0).1;
        assert!(
            (after - before).abs() < 1.5 / 60.0 * 0.4,
            "{before} {after}"
        );
    }
    assert!(online.tau().iter().all(|x| x.abs() < 1e3));
}

#[test]
fn reset_gives_the_bits_of_the_beginning_and_is_said() {
    let (mut used, mut arm) = (online(BOTH), Arm::new([1.4, 0.7]));
    arm.run(&mut used, 0..3000);
    assert_ne!(bits(used.tau()), bits(arm.truth.tau()));
    used.adaptation_mut().unwrap().reset();
    let mut fresh = online(BOTH);
    let mut plain = OnlineEstimator::new(model(), None, None).unwrap();
    let (mut told, mut same) = (Vec::<Adapted>::new(), 0);
    for k in 3000..6000 {
        let (tau, motion) = (arm.tau(k), motion(k, false));
        let sample = sample(k, &motion, Some(&tau));
        used.step(&sample).unwrap();
        fresh.step(&sample).unwrap();
        plain.step(&sample).unwrap();
        assert_eq!(bits(used.tau()), bits(fresh.tau()), "{k}");
        if fresh
            .adaptation()
            .unwrap()
            .added()
            .iter()
            .all(|x| *x == 0.0)
        {
            // Until something has moved the answer is that of an estimator without.
            assert_eq!(bits(fresh.tau()), bits(plain.tau()), "{k}");
            same += 1;
        }
        told.extend(used.adapted().filter(|one| one.reason == Reason::Reset));
    }
    assert_eq!(known(&used), known(&fresh));
    assert!((20..3000).contains(&same));
    assert!(told.len() >= N && told.iter().all(|one| one.from != 1.0));
}

#[test]
fn what_was_known_goes_on_after_a_restart() {
    let (mut first, mut arm) = (online(BOTH), Arm::new([1.4, 0.7]));
    arm.run(&mut first, 0..3000);
    let own = first.adaptation().unwrap();
    assert!(own.is_between_rows());
    let mut numbers = vec![0.0; own.n_remembered()];
    assert!(own.remember(&mut numbers).unwrap());
    let mut second = online(BOTH);
    second.adaptation_mut().unwrap().recall(&numbers).unwrap();
    let own = first.adaptation().unwrap();
    let again = second.adaptation().unwrap();
    assert_eq!(own.factor(0), again.factor(0));
    assert_eq!(own.load(), again.load());
    // Numbers that are none are refused, whichever they are.
    for k in 0..numbers.len() {
        for wrong in [f64::NAN, f64::NEG_INFINITY, 1e101, -1e9] {
            let mut spoiled = numbers.clone();
            spoiled[k] = wrong;
            let refused = second.adaptation_mut().unwrap().recall(&spoiled);
            assert!(refused.is_err(), "{k} {wrong}");
        }
    }
    assert_eq!(known(&second), bits(&numbers));
    assert!(second
        .adaptation_mut()
        .unwrap()
        .recall(&numbers[1..])
        .is_err());
}

#[test]
fn what_stood_at_a_limit_goes_on_too() {
    // 0.1 less one and one again is less than 0.1.
    let settings = AdaptSettings {
        factor: [0.1, 2.0],
        ..FRICTION
    };
    let (mut first, mut arm) = (online(settings), Arm::new([-1.0, 3.0]));
    arm.run(&mut first, 0..6000);
    let own = first.adaptation().unwrap();
    assert!(own.is_at_limit() && own.factor(0).0 < 0.1 && own.factor(1).0 == 2.0);
    let mut numbers = vec![0.0; own.n_remembered()];
    // Between rows only.
    let k = (6000..6100).find(|k| {
        arm.run(&mut first, *k..*k + 1);
        first.adaptation().unwrap().is_between_rows()
    });
    assert!(k.is_some());
    let own = first.adaptation().unwrap();
    assert!(own.remember(&mut numbers).unwrap());
    let mut second = online(settings);
    second.adaptation_mut().unwrap().recall(&numbers).unwrap();
    assert_eq!(known(&second), bits(&numbers));
}

#[test]
fn limits_that_are_none_are_refused() {
    let wrong = [
        AdaptSettings {
            friction: false,
            payload: false,
            ..BOTH
        },
        AdaptSettings { mass: 0.0, ..BOTH },
        AdaptSettings {
            mass: f64::NAN,
            ..BOTH
        },
        AdaptSettings {
            factor: [1.1, 2.0],
            ..BOTH
        },
        AdaptSettings {
            factor: [0.5, f64::INFINITY],
            ..BOTH
        },
        AdaptSettings {
            memory: 0.1,
            ..BOTH
        },
        AdaptSettings {
            reach: -1.0,
            ..BOTH
        },
        AdaptSettings { said: 0.0, ..BOTH },
        AdaptSettings {
            row: f64::NAN,
            ..BOTH
        },
    ];
    for settings in wrong {
        let online = OnlineEstimator::new(model(), None, None).unwrap();
        assert!(
            online.adapting(settings, &[1.0; N], &[1.0; N]).is_err(),
            "{settings:?}"
        );
    }
    let online = || OnlineEstimator::new(model(), None, None).unwrap();
    for (inflation, memory) in [
        (vec![1.0], vec![1.0; N]),
        (vec![0.0; N], vec![1.0; N]),
        (vec![1.0; N], vec![0.5; N]),
    ] {
        assert!(online().adapting(BOTH, &inflation, &memory).is_err());
    }
}

#[test]
fn another_model_begins_anew_from_the_torque_that_stood() {
    let (mut running, mut arm) = (online(FRICTION), Arm::new([1.5, 1.5]));
    arm.run(&mut running, 0..3000);
    let stood = running.tau().to_vec();
    let mut new = online(FRICTION);
    running.swap(&mut new).unwrap();
    assert_eq!(running.tau(), stood);
    assert_eq!(running.adaptation().unwrap().factor(0).0, 1.0);
    assert!(new.adaptation().unwrap().factor(0).0 > 1.2);
    let mut plain = OnlineEstimator::new(model(), None, None).unwrap();
    let stood = new.tau().to_vec();
    new.swap(&mut plain).unwrap();
    assert_eq!(new.tau(), stood);
}
