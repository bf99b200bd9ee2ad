//! Time of one torque estimate (six turning joints: rigid body, friction, a mixture of ten components per joint),
//! free-running: a histogram over ten million cycles. Every time holds one reading of the clock.
//!
//! `cargo bench -p dynid-core --bench estimate [cycles]`; prints one line of JSON per processor path.

#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "common/arm.rs"]
mod arm;

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use arm::arm;
use dynid_core::lanes::{use_path, Path};
use dynid_core::model::TorqueModelParts;
use dynid_core::uncertainty::{Direction, Tail};
use dynid_core::watch::{Healthy, WatchSettings};
use dynid_core::{
    inverse_dynamics_into, AdaptSettings, Domain, Effect, EffectInput, EffectTerm,
    GaussianMixtureRegression, Load, ObserverSettings, OnlineEstimator, Residual, ResidualInputs,
    Sample, State, TorqueEstimator, TorqueModel, Uncertainty, Workspace,
};

const N: usize = 6;
const COMPONENTS: usize = 10;
/// As many as arms of six joints need.
const DIRECTIONS: usize = 12;
const N_STATES: usize = 1024;
const CYCLES: u64 = 10_000_000;
/// Width of the histogram in nanoseconds; longer times count as this one, their maximum is kept beside it.
const LONGEST: usize = 1_000_000;

/// SplitMix64 on [-1, 1].
struct Uniform(u64);

impl Uniform {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

fn mixture(random: &mut Uniform) -> GaussianMixtureRegression {
    let weights = vec![1.0 / COMPONENTS as f64; COMPONENTS];
    let means = (0..3 * COMPONENTS).map(|_| random.next()).collect();
    let covariances = (0..COMPONENTS).flat_map(|_| {
        let c = 0.05 * random.next();
        [0.3, c, 0.1, c, 0.4, -0.05, 0.1, -0.05, 0.5]
    });
    GaussianMixtureRegression::new(2, weights, means, covariances.collect()).unwrap()
}

fn model(random: &mut Uniform) -> TorqueModel {
    let robot = arm(0.1);
    let friction = Effect::friction(&[0.01; N], &[0.02; N]).unwrap();
    let coefficients = (0..8 * N).map(|_| 1.0 + random.next()).collect();
    let joints = (0..N).map(|_| Some(mixture(random).into())).collect();
    TorqueModel::new(TorqueModelParts {
        phi: robot.phi(),
        torque_scale: vec![1.0; N],
        effects: vec![EffectTerm::new(friction, coefficients, N).unwrap()],
        residual: Some(Residual::new(ResidualInputs::JointState, joints).unwrap()),
        encoder_delay: vec![0.0; N],
        noise_std: vec![0.1; N],
        domain: Domain {
            q: vec![[-3.2, 3.2]; N],
            dq: vec![3.0; N],
            ddq: vec![10.0; N],
        },
        torque_unit: "N*m".to_owned(),
        step: None,
        robot,
    })
    .unwrap()
}

/// Counts per nanosecond, and the longest.
fn histogram(cycles: u64, mut work: impl FnMut(usize)) -> (Vec<u64>, u64) {
    let mut counts = vec![0_u64; LONGEST + 1];
    let mut longest = 0;
    for k in 0..cycles {
        let start = Instant::now();
        work(k as usize % N_STATES);
        let time = start.elapsed().as_nanos() as u64;
        counts[(time as usize).min(LONGEST)] += 1;
        longest = longest.max(time);
    }
    (counts, longest)
}

fn percentile(counts: &[u64], part: f64) -> usize {
    let total: u64 = counts.iter().sum();
    let rank = (part * total as f64).ceil() as u64;
    let mut seen = 0;
    counts
        .iter()
        .position(|count| {
            seen += count;
            seen >= rank
        })
        .unwrap_or(counts.len())
}

fn report(what: &str, path: &str, cycles: u64, (counts, longest): &(Vec<u64>, u64)) {
    let [p50, p99, p999, p9999] = [0.5, 0.99, 0.999, 0.9999].map(|part| percentile(counts, part));
    // Of what was not interrupted: all but the longest thousandth.
    let (mut kept, mut sum) = (0, 0);
    for (time, count) in counts.iter().enumerate().take(p999 + 1) {
        kept += count;
        sum += count * time as u64;
    }
    let mean = sum / kept.max(1);
    println!(
        "{{\"what\":\"{what}\",\"path\":\"{path}\",\"cycles\":{cycles},\"p50_ns\":{p50},\"p99_ns\":{p99},\
         \"p99.9_ns\":{p999},\"p99.99_ns\":{p9999},\"max_ns\":{longest},\"mean_ns\":{mean}}}"
    );
}

/// Every parameter may be off by a hundredth of itself, in [`DIRECTIONS`] ways.
fn uncertainty(model: &TorqueModel) -> Uncertainty {
    let part = |x: &[f64]| x.iter().map(|x| 0.01 * x).collect::<Vec<_>>();
    let terms = model.effects().iter();
    let direction = Direction {
        phi: part(model.phi()),
        effects: terms.map(|term| part(term.coefficients())).collect(),
    };
    let tail = Tail {
        level: 10.0,
        per_hour: 700.0,
        growth: 2.0,
    };
    Uncertainty {
        moving: vec![0.1; N],
        standing: vec![0.1; N],
        turning: vec![0.1; N],
        torque: vec![1e-4; N],
        stops_known: vec![true; N],
        turns_known: vec![true; N],
        directions: vec![direction; DIRECTIONS],
        tails: vec![tail; N],
    }
}

/// The estimate at the end of a stream of numbered states, with torques where something listens to them.
fn stream(
    what: &str,
    mut online: OnlineEstimator,
    path: Path,
    cycles: u64,
    motion: [&[f64]; 3],
    tau: Option<&[f64]>,
) {
    let mut std = [0.0; N];
    let mut sequence = 0;
    let times = histogram(cycles, |k| {
        let [q, dq, ddq] = motion.map(|signal| signal.get(k * N..(k + 1) * N));
        sequence += 1;
        let sample = Sample {
            sequence: Some(sequence),
            time: 0.001 * sequence as f64,
            motion: [q, dq, ddq, None, None, None],
            temperature: None,
            tau: tau.and_then(|tau| tau.get(k * N..(k + 1) * N)),
        };
        black_box(online.step(black_box(&sample))).unwrap();
        let estimator = online.estimator();
        estimator.predicted_std_into(&mut std).unwrap();
        black_box(&std);
    });
    assert!(online
        .watch()
        .is_none_or(|watch| watch.standing().next().is_none()));
    report(what, path.name(), cycles, &times);
}

/// A stream by itself, with an observer, with one whose thresholds follow from the state, and with a watch that nothing
/// disturbs.
fn streams(
    model: &Arc<TorqueModel>,
    path: Path,
    cycles: u64,
    motion: [&[f64]; 3],
    measured: &[f64],
) {
    let online = || OnlineEstimator::new(Arc::clone(model), None, None).unwrap();
    let observing = || online().observing(ObserverSettings::default()).unwrap();
    let tau = Some(measured);
    stream("stream", online(), path, cycles, motion, None);
    stream("stream, observed", observing(), path, cycles, motion, tau);
    let knowing = observing().knowing(Arc::new(uncertainty(model))).unwrap();
    let what = format!("stream, observed, {DIRECTIONS} directions");
    stream(&what, knowing, path, cycles, motion, tau);
    let healthy = Healthy {
        frozen_after: vec![0.05; N],
        ..Healthy::untold(N)
    };
    let watching = online().watching(WatchSettings::default(), &healthy);
    stream(
        "stream, watched",
        watching.unwrap(),
        path,
        cycles,
        motion,
        tau,
    );
}

/// A stream whose answers follow the arm's friction, or its payload as well.
fn following(model: &Arc<TorqueModel>, path: Path, cycles: u64, motion: [&[f64]; 3]) {
    let friction = AdaptSettings::default();
    let both = AdaptSettings {
        payload: true,
        mass: 5.0,
        ..friction
    };
    let measured = vec![5.0; N * N_STATES];
    for (what, settings) in [
        ("stream, friction follows", friction),
        ("stream, friction and payload follow", both),
    ] {
        let online = OnlineEstimator::new(Arc::clone(model), None, None).unwrap();
        let adapting = online.adapting(settings, &[1.0; N], &[1.0; N]).unwrap();
        stream(what, adapting, path, cycles, motion, Some(&measured));
    }
}

/// The terms by themselves.
fn parts(model: &TorqueModel, path: Path, cycles: u64, [q, dq, ddq]: [&[f64]; 3]) {
    let (mut tau, mut variance) = ([0.0; N], [0.0; N]);
    let mut workspace = Workspace::new(model.robot());
    let times = histogram(cycles, |k| {
        let at = k * N..(k + 1) * N;
        let (q, dq, ddq) = (&q[at.clone()], &dq[at.clone()], &ddq[at]);
        inverse_dynamics_into(
            model.robot(),
            &mut workspace,
            q,
            dq,
            ddq,
            model.phi(),
            &mut tau,
        )
        .unwrap();
        black_box(&tau);
    });
    report("rigid body", path.name(), cycles, &times);
    let tau_link = [0.0; N];
    let state = |k: usize| {
        let at = k * N..(k + 1) * N;
        State::single(&q[at.clone()], &dq[at.clone()], &ddq[at])
    };
    let times = histogram(cycles, |k| {
        let input = EffectInput {
            state: state(k),
            tau_link: &tau_link,
            tau_motor: &tau_link,
            step: 0.0,
            sign: None,
        };
        model.effects()[0].torque_into(&input, &mut [], &mut tau);
        black_box(&tau);
    });
    report("friction", path.name(), cycles, &times);
    let times = histogram(cycles, |k| {
        let load = Load {
            tau_link: &tau_link,
            scaled: &tau_link,
        };
        let residual = model.residual().unwrap();
        residual.torque_into(&state(k), load, &mut tau, &mut variance);
        black_box((&tau, &variance));
    });
    report("mixtures", path.name(), cycles, &times);
}

fn main() {
    // Cargo hands `--bench` over.
    let cycles = std::env::args()
        .filter_map(|argument| argument.parse().ok())
        .next()
        .unwrap_or(CYCLES);
    let mut random = Uniform(1);
    let model = Arc::new(model(&mut random));
    let mut signal =
        |scale: f64| -> Vec<f64> { (0..N * N_STATES).map(|_| scale * random.next()).collect() };
    let (q, dq, ddq) = (signal(3.0), signal(2.0), signal(5.0));
    let noise = signal(0.17);
    let mut tau = [0.0; N];
    let mut ideal = TorqueEstimator::new(Arc::clone(&model));
    let mut measured = noise;
    for (k, measured) in measured.chunks_exact_mut(N).enumerate() {
        let at = k * N..(k + 1) * N;
        let state = State::single(&q[at.clone()], &dq[at.clone()], &ddq[at]);
        ideal.estimate_into(&state, &mut tau).unwrap();
        measured
            .iter_mut()
            .zip(tau)
            .for_each(|(measured, tau)| *measured += tau);
    }
    report("clock alone", "-", cycles, &histogram(cycles, |_| {}));
    for path in Path::ALL.into_iter().filter(|path| path.is_available()) {
        use_path(path);
        let mut estimator = TorqueEstimator::new(Arc::clone(&model));
        let times = histogram(cycles, |k| {
            let at = k * N..(k + 1) * N;
            let state = State::single(&q[at.clone()], &dq[at.clone()], &ddq[at]);
            black_box(estimator.estimate_into(black_box(&state), &mut tau)).unwrap();
            black_box(&tau);
        });
        report("estimate", path.name(), cycles, &times);
        streams(&model, path, cycles / 10, [&q, &dq, &ddq], &measured);
        // Joints that never stand: what follows has moved, so that all of it is computed.
        let fast: Vec<f64> = dq.iter().map(|dq| dq.abs() + 0.5).collect();
        following(&model, path, cycles / 10, [&q, &fast, &ddq]);
        parts(&model, path, cycles / 10, [&q, &dq, &ddq]);
    }
}
