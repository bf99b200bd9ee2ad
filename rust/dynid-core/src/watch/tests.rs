#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::judging::{LONGEST, SETTLED};
use super::remembered::{Range, N_PHASE};
use super::rows::product;
use super::sequential::{log_ratio, Evidence, SequentialTest, SIZES};
use super::solve::{mass_in, LoadSums, PLACES};
use super::{Change, Healthy, Kind, Phase, Said, Watch, WatchSettings};
use crate::dynamics::{
    begin_inverse_dynamics, begin_last_link, end_inverse_dynamics_into, end_last_link_into,
    inverse_dynamics_into, joint_torque_regressor_into, Workspace,
};
use crate::model::{Domain, TorqueModelParts};
use crate::{Joint, JointKind, JointLimits, RobotModel, State, TorqueEstimator, TorqueModel};

/// Of an arm of two joints.
fn watch() -> Watch {
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
    let robot = RobotModel::new("arm".to_owned(), joints, Vector3::new(0.0, 0.0, -9.81));
    let model = TorqueModel::new(TorqueModelParts {
        robot: robot.unwrap(),
        phi: vec![1.0; 20],
        torque_scale: vec![1.0; 2],
        effects: vec![],
        residual: None,
        encoder_delay: vec![0.0; 2],
        noise_std: vec![0.5; 2],
        domain: Domain {
            q: vec![[-3.0, 3.0]; 2],
            dq: vec![3.0; 2],
            ddq: vec![9.0; 2],
        },
        torque_unit: "N*m".to_owned(),
        step: None,
    });
    let model = Arc::new(model.unwrap());
    let healthy = Healthy {
        inflation: vec![1.0, 2.0],
        memory: vec![1.0, 3.0],
        frozen_after: vec![0.1, f64::INFINITY],
        frozen_way: vec![1.0, 0.0],
        ..Healthy::untold(2)
    };
    Watch::new(model, WatchSettings::default(), &healthy).unwrap()
}

/// Uniform and normal numbers from a seed.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().max(1e-300).ln()).sqrt()
            * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// Rows until R passes A, at most `most`, with a change of `size` and noise that m rows remember.
fn rows_until(
    random: &mut Random,
    size: f64,
    memory: f64,
    log_a: f64,
    most: usize,
) -> Option<usize> {
    const TOLERATED: f64 = 0.1;
    let mut test = SequentialTest::<{ SIZES.len() }>::new();
    let keep = (memory - 1.0) / (memory + 1.0);
    let mut noise = random.normal();
    (0..most).find(|_| {
        noise = keep * noise + (1.0 - keep * keep).sqrt() * random.normal();
        let per_unit = 4.0 * random.normal();
        let seen = Evidence {
            moment: per_unit * (size * per_unit + noise) / memory,
            information: per_unit * per_unit / memory,
        };
        test.step(SIZES.map(|size| log_ratio(size, TOLERATED, seen)));
        test.mean().ln() > log_a
    })
}

/// The chance to pass A within n rows is at most n / A, at the largest change that is tolerated, with a memory.
#[test]
fn false_alarms_are_as_rare_as_the_threshold_says() {
    let (log_a, n) = (f64::ln(2000.0), 200);
    for (size, memory) in [(0.0, 1.0), (0.1, 1.0), (-0.1, 1.0), (0.1, 4.0)] {
        let mut random = Random(7);
        let trials = 2000;
        let alarms = (0..trials)
            .filter(|_| rows_until(&mut random, size, memory, log_a, n).is_some())
            .count();
        // 200 of 2000 are allowed; five standard deviations more would be chance.
        assert!(alarms <= 270, "{size} {memory}: {alarms}");
    }
}

#[test]
fn a_change_is_seen_soon_and_sooner_if_it_is_larger() {
    let mut random = Random(3);
    let mut mean = |size| {
        let rows = (0..100).map(|_| rows_until(&mut random, size, 1.0, f64::ln(1e7), 5000));
        rows.map(|row| row.unwrap_or(5000)).sum::<usize>() as f64 / 100.0
    };
    let (small, large) = (mean(0.2), mean(0.8));
    assert!(
        large < 30.0 && small < 600.0 && large < small,
        "{small} {large}"
    );
}

#[test]
fn the_threshold_shares_a_day_among_tests() {
    let settings = WatchSettings {
        row: 0.2,
        false_per_day: 2.0,
        ..WatchSettings::default()
    };
    let expected: f64 = 25.0 * 86_400.0 / 0.2 / 2.0;
    assert!((settings.threshold(25) - expected).abs() < 1e-9 * expected);
}

#[test]
fn settings_that_are_none_are_refused() {
    for spoil in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let good = WatchSettings::default();
        for bad in [
            WatchSettings { row: spoil, ..good },
            WatchSettings {
                false_per_day: spoil,
                ..good
            },
            WatchSettings {
                friction: spoil,
                ..good
            },
            WatchSettings {
                gain: spoil,
                ..good
            },
            WatchSettings {
                offset: spoil,
                ..good
            },
            WatchSettings {
                load: spoil,
                ..good
            },
            WatchSettings {
                unknown: spoil,
                ..good
            },
        ] {
            assert!(bad.check().is_err());
        }
        assert!(good.check().is_ok());
    }
}

#[test]
fn a_load_is_solved_from_its_sums() {
    let mut random = Random(11);
    // Mass, first moments, and inertias that are more than those of a point.
    let load = [1.5, 0.1, -0.2, 0.05, 0.04, 0.01, 0.02, -0.004, 0.006, 0.05];
    let mut sums = LoadSums::default();
    for _ in 0..50 {
        let columns: [[f64; 10]; 3] =
            std::array::from_fn(|_| std::array::from_fn(|_| 10.0 * random.normal()));
        let left = columns.map(|columns| product(&columns, &load));
        sums.add_row(&columns, &left, [4.0, 0.0, 1.0].into_iter());
    }
    let solved = sums.solved(0.4);
    assert!((solved.sizes[0] - 1.5).abs() < 1e-3 && solved.std < 0.01);
    for (size, expected) in solved.sizes.iter().zip(load) {
        assert!((size - expected).abs() < 2e-3, "{solved:?}");
    }
    assert!(solved.log_evidence > 1000.0);
    let nothing = LoadSums::default().solved(0.4);
    assert!(nothing.sizes == [0.0; 10] && nothing.log_evidence.abs() < 1e-9);
}

/// They are those of the whole regressor, to the same bits.
#[test]
fn columns_of_the_last_link_end_the_regressor() {
    let watch = watch();
    let robot = watch.rows.model.robot();
    let mut workspace = Workspace::new(robot);
    let (mut whole, mut columns) = (vec![0.0; 40], vec![[0.0; 10]; 2]);
    let mut random = Random(9);
    for _ in 0..20 {
        let motion: [[f64; 2]; 3] = std::array::from_fn(|_| [random.normal(), random.normal()]);
        let [q, dq, ddq] = &motion;
        joint_torque_regressor_into(robot, &mut workspace, q, dq, ddq, &mut whole).unwrap();
        begin_last_link(robot, &mut workspace, [q, dq, ddq]).unwrap();
        end_last_link_into(robot, &workspace, &mut columns).unwrap();
        assert_eq!(
            [&whole[10..20], &whole[30..]].concat(),
            columns.as_flattened()
        );
    }
}

/// Two halves are the whole, to the same bits.
#[test]
fn halves_of_inverse_dynamics_are_the_whole() {
    let watch = watch();
    let (robot, phi) = (watch.rows.model.robot(), watch.rows.model.phi());
    let mut workspace = Workspace::new(robot);
    let (mut whole, mut halves) = ([0.0; 2], [0.0; 2]);
    let mut random = Random(10);
    for _ in 0..20 {
        let motion: [[f64; 2]; 3] = std::array::from_fn(|_| [random.normal(), random.normal()]);
        let [q, dq, ddq] = &motion;
        inverse_dynamics_into(robot, &mut workspace, q, dq, ddq, phi, &mut whole).unwrap();
        begin_inverse_dynamics(robot, &mut workspace, [q, dq, ddq], phi).unwrap();
        end_inverse_dynamics_into(robot, &workspace, &mut halves).unwrap();
        assert_eq!(halves, whole);
    }
}

/// A point mass in one of the places that are tried is found there with its mass.
#[test]
fn a_mass_in_a_place_has_the_inertia_of_a_point() {
    let (mut random, mass) = (Random(4), 0.7);
    let [x, y, z] = PLACES[3];
    let phi = [
        1.0,
        x,
        y,
        z,
        y * y + z * z,
        -x * y,
        x * x + z * z,
        -x * z,
        -y * z,
        x * x + y * y,
    ];
    let columns: [[f64; 10]; 6] = std::array::from_fn(|_| std::array::from_fn(|_| random.normal()));
    let left = columns.map(|columns| mass * product(&columns, &phi));
    let found = mass_in(PLACES[3], &columns, &left, [1.0; 6].into_iter());
    assert!((found.size().0 - mass).abs() < 1e-12);
}

/// What explains the rows best is no name if no arm can have it; all of it lost is one, what was lost before counted.
#[test]
fn no_joint_loses_more_than_all_its_friction_or_gain() {
    for (kind, size, known, is_named) in [
        (Kind::Friction, -0.99, 0.0, true),
        (Kind::Friction, -1.5, 0.0, false),
        (Kind::Friction, -0.6, -0.5, false),
        (Kind::Friction, 4.0, 0.0, true),
        (Kind::Gain, -1.0, 0.0, true),
        (Kind::Gain, -1.3, 0.0, false),
        (Kind::Offset, -30.0, 0.0, true),
    ] {
        let mut watch = watch();
        watch.known.friction[1] = known;
        let information = 1e4;
        let square = size * size * information;
        for named in watch.tests.iter_mut().filter(|named| named.joint == 1) {
            if named.kind == kind {
                named.window = Evidence {
                    moment: size * information,
                    information,
                };
            } else if named.kind == Kind::Unknown {
                named.window = Evidence {
                    moment: square,
                    information: 1.0,
                };
            }
        }
        let (change, _) = watch.likeliest();
        let expected = if is_named { kind } else { Kind::Unknown };
        assert_eq!((change.kind, change.joint), (expected, 1), "{size}");
    }
}

/// Squares forget sooner than what is squared: of an AR(1) with noise that m rows remember 95 % of the intervals hold nothing grown.
#[test]
fn an_interval_of_what_has_no_name_covers() {
    let mut random = Random(13);
    for (joint, memory) in [(0, 1.0_f64), (1, 3.0)] {
        let keep = (memory - 1.0) / (memory + 1.0);
        let (mut watch, mut noise, mut held) = (watch(), random.normal(), 0);
        let (trials, rows) = (3000, 75);
        for _ in 0..trials {
            let mut window = Evidence::default();
            for _ in 0..rows {
                noise = keep * noise + (1.0 - keep * keep).sqrt() * random.normal();
                window.add(Evidence {
                    moment: noise * noise / memory,
                    information: memory.recip(),
                });
            }
            let mut own = watch.tests.iter_mut();
            let unknown = own.find(|own| (own.kind, own.joint) == (Kind::Unknown, joint));
            unknown.unwrap().window = window;
            let change = watch.sized(Change { joint, ..UNKNOWN });
            held += i32::from(change.size.abs() <= 1.96 * change.std);
        }
        let share = f64::from(held) / f64::from(trials);
        assert!((0.93..0.97).contains(&share), "{memory}: {share}");
    }
}

const UNKNOWN: Change = Change {
    kind: Kind::Unknown,
    joint: 0,
    size: 0.0,
    std: 0.0,
    moments: [0.0; 3],
    said: Said::Named,
    or: None,
};

/// A watch that judges one more row, in which everything moves and nothing is left, and whose tests have all passed.
fn passed(phase: Phase) -> Watch {
    let mut watch = watch();
    watch.row.moves = vec![true; 2];
    watch.row.variance = vec![1.0; 2];
    for named in &mut watch.tests {
        named.test.r.fill(1e12);
    }
    (watch.next, watch.phase) = (0, phase);
    watch
}

fn have_passed(watch: &Watch) -> Vec<usize> {
    let own = watch.tests.iter();
    let passed = own.filter(|named| named.test.mean() > watch.threshold);
    passed.map(|named| named.joint).collect()
}

/// A bump would set off one window after the other if what alarmed on another joint stayed as it was.
#[test]
fn what_passes_by_leaves_no_test_passed() {
    let mut watch = passed(Phase::Telling(LONGEST));
    assert!(!have_passed(&watch).is_empty());
    assert_eq!(watch.judge(usize::MAX), None);
    assert!(matches!(watch.phase, Phase::Quiet));
    assert_eq!(have_passed(&watch), []);
}

/// While a load settles no joint's tests go on: if it was friction after all, those of all joints begin anew.
#[test]
fn what_was_taken_for_a_load_leaves_no_test_passed() {
    let load = Change {
        kind: Kind::Load,
        joint: 1,
        ..UNKNOWN
    };
    let mut watch = passed(Phase::Settling(LONGEST, load));
    let (size, information) = (0.5, 1e4);
    for named in watch.tests.iter_mut().filter(|named| named.joint == 1) {
        let moment = match named.kind {
            Kind::Friction => size * information,
            Kind::Unknown => size * size * information,
            _ => continue,
        };
        named.window = Evidence {
            moment,
            information: if named.kind == Kind::Unknown {
                1.0
            } else {
                information
            },
        };
    }
    let settled = watch.judge(usize::MAX).unwrap();
    assert_eq!((settled.kind, settled.joint), (Kind::Friction, 1));
    assert_eq!(settled.said, Said::Settled);
    assert_eq!(have_passed(&watch), []);
}

/// Samples of two channels, of which the first shows what `shown` says, while the model's torque goes up and down.
fn frozen_says(
    shown: impl Fn(usize) -> f64,
    moves: impl Fn(usize) -> bool,
    n: usize,
) -> Vec<(usize, Change)> {
    let mut channels = watch().channels;
    let said = (0..n).filter_map(|k| {
        let model = [3.0 * (0.02 * k as f64).sin(), 0.0];
        channels.take(&[shown(k), 1.0], &model, 0.001, moves(k));
        channels.say().map(|change| (k, change))
    });
    said.collect()
}

#[test]
fn a_channel_that_stands_still_is_named_settles_and_is_over() {
    let stands = |k: usize| {
        if (1000..40_000).contains(&k) {
            0.25
        } else {
            k as f64
        }
    };
    let said = frozen_says(stands, |_| true, 41_000);
    let told: Vec<_> = said.iter().map(|(k, change)| (*k, change.said)).collect();
    let expected = [
        (1100, Said::Named),
        (21_100, Said::Settled),
        (40_000, Said::Withdrawn),
    ];
    assert_eq!(told.len(), 3, "{told:?}");
    for ((k, said), (at, expected)) in told.into_iter().zip(expected) {
        assert!(k.abs_diff(at) <= 1 && said == expected, "{k} {said:?}");
    }
    let (_, named) = said[0];
    assert_eq!(
        (named.kind, named.joint, named.size),
        (Kind::Frozen, 0, 0.25)
    );
}

/// The other channel, which was never told, may show what it wants.
#[test]
fn a_channel_is_not_frozen_at_rest_nor_while_the_torque_stands_nor_if_it_changes_in_between() {
    assert_eq!(frozen_says(|_| 2.0, |_| false, 9000), []);
    let often = frozen_says(|k| (k / 99) as f64, |_| true, 9000);
    assert_eq!(often, []);
    let rests = frozen_says(|_| 2.0, |k| k < 80, 9000);
    assert_eq!(rests, []);
    let mut channels = watch().channels;
    for _ in 0..9000 {
        channels.take(&[2.0; 2], &[1.0, 1.0], 0.001, true);
        assert_eq!(channels.say(), None);
    }
}

/// Steps that the torque takes fast, in forty samples each, and then four times as slowly.
#[test]
fn repeats_of_a_healthy_channel_are_counted() {
    let mut channels = watch().channels;
    let torque = |k: u32| 4.0 * f64::from(k.min(4000)) + f64::from(k.max(4000) - 4000);
    for k in 0..12_000 {
        let model = [0.001 * torque(k), 0.0];
        let shown = [(torque(k) / 160.0).floor(), 0.0];
        channels.take(&shown, &model, 0.001, true);
    }
    let of_first = channels.repeats().next().unwrap();
    assert_eq!(of_first.n, 149);
    assert!((0.03..0.041).contains(&of_first.longest), "{of_first:?}"); // of the fast ones
    assert!((of_first.way - 0.15).abs() < 2e-3, "{of_first:?}"); // from the first mean of a value to its last
    assert!((of_first.time - 11.84).abs() < 1e-9, "{of_first:?}");
}

/// Friction changes its sign with every sample where a joint stands, and then the torque moves.
#[test]
fn noise_of_the_model_goes_no_way() {
    let mut channels = watch().channels;
    let way = |channels: &super::frozen::Channels| channels.repeats().next().unwrap().way;
    for k in 0..400 {
        let chatter = if k % 2 == 0 { 1.0 } else { -1.0 };
        channels.take(&[2.0; 2], &[chatter, 0.0], 0.001, true);
    }
    assert!(way(&channels) < 1e-9, "{}", way(&channels));
    for _ in 0..400 {
        channels.take(&[2.0; 2], &[3.0, 0.0], 0.001, true);
    }
    assert!((way(&channels) - 3.0).abs() < 1e-9, "{}", way(&channels));
}

/// What is remembered is recalled bit by bit, whatever the watch was about.
#[test]
fn a_watch_goes_on_with_what_it_remembered() {
    let mut random = Random(5);
    let change = Change {
        kind: Kind::Load,
        joint: 1,
        size: 1.5,
        std: 0.1,
        moments: [0.1, -0.2, 0.3],
        said: Said::Named,
        or: Some((Kind::Offset, 0)),
    };
    for phase in [
        Phase::Quiet,
        Phase::Telling(7),
        Phase::Telling(LONGEST),
        Phase::Settling(30, change),
        Phase::Settling(SETTLED, Change { or: None, ..change }),
    ] {
        let mut before = watch();
        before.phase = phase;
        before.each_number(|x, range| {
            *x = match range {
                Range::Code => (3.0 * random.uniform()).floor(),
                _ => random.uniform(),
            }
        });
        let mut numbers = vec![0.0; before.n_remembered()];
        assert_eq!(before.remember(&mut numbers), Ok(true));
        let mut after = watch();
        after.recall(&numbers).unwrap();
        let mut again = vec![0.0; numbers.len()];
        assert_eq!(after.remember(&mut again), Ok(true));
        assert_eq!(again, numbers);
        assert_eq!(format!("{:?}", after.phase), format!("{phase:?}"));
        assert_eq!(after.known.friction, before.known.friction);
        assert_eq!(after.load, before.load);
    }
    let mut within = watch();
    within.next = 0;
    let mut numbers = vec![3.0; within.n_remembered()];
    assert_eq!(within.remember(&mut numbers), Ok(false));
    assert!(numbers.iter().all(|x| *x == 3.0));
}

/// However often samples come, and while something is settled too: what is judged late could not be remembered.
#[test]
fn every_row_is_judged_before_the_next_one_ends() {
    let change = Change {
        kind: Kind::Gain,
        joint: 1,
        size: 0.2,
        std: 0.01,
        moments: [0.0; 3],
        said: Said::Named,
        or: None,
    };
    for n in [3, 12, 30, 39, 50, 100, 150, 200, 1000] {
        for phase in [Phase::Quiet, Phase::Settling(0, change)] {
            let mut watch = watch();
            watch.phase = phase;
            let mut estimator = TorqueEstimator::new(Arc::clone(&watch.rows.model));
            let (mut numbers, mut known) = (vec![0.0; watch.n_remembered()], 0);
            for k in 0..6 * n {
                let x = 0.3 * f64::from(k) / f64::from(n);
                let q = [x, -x];
                let state = State::single(&q, &[1.5, -1.5], &[0.0; 2]);
                let mut tau = [0.0; 2];
                estimator.estimate_into(&state, &mut tau).unwrap();
                let before = watch.n_rows;
                let step = 0.2 / f64::from(n);
                watch.step(&estimator, &tau, &tau, step, true).unwrap();
                assert!(watch.n_rows == before || known == before, "{n} {phase:?}");
                if watch.remember(&mut numbers) == Ok(true) {
                    known = watch.n_rows;
                }
            }
            assert!(known >= 4, "{n}");
        }
    }
}

/// A program that was told another step than the samples have begins its rows like one that was told the right one.
#[test]
fn rows_begin_alike_whatever_time_the_first_sample_is_given() {
    let rows_of = |first: f64| {
        let mut watch = watch();
        let mut estimator = TorqueEstimator::new(Arc::clone(&watch.rows.model));
        let mut rows = Vec::new();
        for k in 0..250 {
            let x = 0.002 * f64::from(k);
            let (q, dq) = ([x.sin(), x.cos()], [x.cos(), -x.sin()]);
            let state = State::single(&q, &dq, &[0.0; 2]);
            let mut tau = [0.0; 2];
            estimator.estimate_into(&state, &mut tau).unwrap();
            let step = if k == 0 { first } else { 0.002 };
            let before = watch.n_rows;
            watch.step(&estimator, &tau, &[0.1; 2], step, true).unwrap();
            if watch.n_rows > before {
                rows.push((k, watch.row.load.clone(), watch.row.slip.clone()));
            }
        }
        assert_eq!(rows.len(), 2);
        rows
    };
    assert_eq!(rows_of(0.001), rows_of(0.002));
    assert_eq!(rows_of(0.02), rows_of(0.002));
}

#[test]
fn what_no_watch_remembers_is_refused_and_changes_nothing() {
    let mut good = vec![0.0; watch().n_remembered()];
    watch().remember(&mut good).unwrap();
    let n = good.len();
    for k in 0..n {
        for bad in [f64::NAN, f64::INFINITY, 1e200] {
            let mut numbers = good.clone();
            numbers[k] = bad;
            // Of a quiet watch the rest of the phase is of no interest.
            let told = (2..N_PHASE).contains(&k);
            let mut own = watch();
            assert_eq!(own.recall(&numbers).is_ok(), told, "{k} {bad}");
            let mut after = vec![0.0; n];
            own.remember(&mut after).unwrap();
            assert!(after == good || told);
        }
    }
    assert!(watch().recall(&good[1..]).is_err() && watch().recall(&[]).is_err());
    // A change on a joint that the arm does not have, or in no phase.
    for (k, bad) in [
        (0, 3.0),
        (0, -1.0),
        (1, 1e9),
        (1, 0.5),
        (2, 7.0),
        (3, 2.0),
        (9, 9.0),
        (10, -1.0),
    ] {
        let mut numbers = good.clone();
        [numbers[0], numbers[9]] = [2.0, 0.0];
        assert!(watch().recall(&numbers).is_ok());
        numbers[k] = bad;
        assert!(watch().recall(&numbers).is_err(), "{k}");
    }
}
