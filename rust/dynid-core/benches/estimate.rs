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
use dynid_core::{
    inverse_dynamics_into, AdaptSettings, Domain, Effect, EffectInput, EffectTerm,
    GaussianMixtureRegression, Load, OnlineEstimator, Residual, ResidualInputs, Sample, State,
    TorqueEstimator, TorqueModel, Workspace,
};

const N: usize = 6;
const COMPONENTS: usize = 10;
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
    println!(
        "{{\"what\":\"{what}\",\"path\":\"{path}\",\"cycles\":{cycles},\"p50_ns\":{p50},\"p99_ns\":{p99},\
         \"p99.9_ns\":{p999},\"p99.99_ns\":{p9999},\"max_ns\":{longest}}}"
    );
}

/// What follows the arm in a stream, by the name of its row.
fn follows() -> [(&'static str, Option<AdaptSettings>); 3] {
    let friction = AdaptSettings::default();
    let both = AdaptSettings {
        payload: true,
        mass: 5.0,
        ..friction
    };
    [
        ("stream", None),
        ("stream, friction follows", Some(friction)),
        ("stream, friction and payload follow", Some(both)),
    ]
}

/// The estimate at the end of a stream of numbered states.
fn stream(
    model: &Arc<TorqueModel>,
    path: Path,
    cycles: u64,
    motion: [&[f64]; 3],
    (name, adapts): (&str, Option<AdaptSettings>),
) {
    let mut online = OnlineEstimator::new(Arc::clone(model), None, None).unwrap();
    if let Some(settings) = adapts {
        online = online.adapting(settings, &[1.0; N], &[1.0; N]).unwrap();
    }
    let tau = [5.0; N];
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
            tau: adapts.map(|_| &tau[..]),
        };
        black_box(online.step(black_box(&sample))).unwrap();
        let estimator = online.estimator();
        estimator.predicted_std_into(&mut std).unwrap();
        black_box(&std);
    });
    report(name, path.name(), cycles, &times);
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
    let mut tau = [0.0; N];
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
        // Joints that never stand: what follows has moved, so that all of it is computed.
        let fast: Vec<f64> = dq.iter().map(|dq| dq.abs() + 0.5).collect();
        for adapts in follows() {
            stream(&model, path, cycles / 10, [&q, &fast, &ddq], adapts);
        }
        parts(&model, path, cycles / 10, [&q, &dq, &ddq]);
    }
}
