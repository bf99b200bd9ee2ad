//! Time of the parts of identification and excitation on an arm of six joints (36 base parameters), one thread.
//!
//! `cargo bench -p dynid-offline --bench parts`; prints one line per part: the least time over the rounds.

#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "../../dynid-core/benches/common/arm.rs"]
mod arm;

use std::hint::black_box;
use std::time::Instant;

use arm::arm;
use dynid_core::{Effect, State};
use dynid_offline::base::probing_states;
use dynid_offline::{
    base_parameters, batch, fold, weighted_fit, Criterion, Excitation, RunSignals, RunStates,
};

const SAMPLES: usize = 10_000;
/// Samples of a motion that excites.
const SHORT: usize = 200;

fn time<T>(what: &str, rounds: usize, mut work: impl FnMut() -> T) {
    if std::env::args()
        .nth(1)
        .is_some_and(|part| part != "--bench" && !what.contains(&part))
    {
        return;
    }
    let least = (0..rounds)
        .map(|_| {
            let start = Instant::now();
            black_box(work());
            start.elapsed()
        })
        .min();
    println!("{what:<44}{:>10.1} us", least.unwrap().as_secs_f64() * 1e6);
}

fn main() {
    let robot = arm(0.0);
    let base = base_parameters(&robot, 0, 1e-9).unwrap();
    let (q, dq, ddq) = probing_states(&robot, SAMPLES, 1);
    let mut tau = vec![0.0; q.len()];
    batch::inverse_dynamics(&robot, &q, &dq, &ddq, &robot.phi(), &mut tau).unwrap();
    for (k, tau) in tau.iter_mut().enumerate() {
        *tau += (k as f64 * 1.7).sin();
    }
    let run = RunStates {
        signals: RunSignals {
            state: State::single(&q, &dq, &ddq),
            tau_link: None,
            tau_motor: None,
            step: None,
        },
        tau: &tau,
    };
    let effects = [Effect::torque_offset()];
    let folded = || fold(&robot, &effects, &base.pivots, &run, None).unwrap();
    println!("{} base parameters", base.pivots.len());
    time("base parameters of the robot", 200, || {
        base_parameters(&robot, 0, 1e-9).unwrap()
    });
    time(&format!("fold {SAMPLES} samples"), 50, folded);
    let factors = folded();
    let slices: Vec<&[f64]> = factors.iter().map(Vec::as_slice).collect();
    time("weighted fit on the factors", 200, || {
        weighted_fit(&slices, &base.pivots, SAMPLES, 2).unwrap()
    });

    let excitation = Excitation::new(&robot, &base.pivots, None, 0, 1e-9).unwrap();
    let short = [&q, &dq, &ddq].map(|signal| &signal[..SHORT * robot.n_joints()]);
    let mut gradient = [(); 3].map(|()| vec![0.0; short[0].len()]);
    for (name, criterion) in [
        ("condition", Criterion::Condition),
        ("block", Criterion::Block([1.0, 1.0, 1.0])),
    ] {
        time(&format!("{name} of {SHORT} samples"), 500, || {
            excitation.evaluate(criterion, short, None).unwrap()
        });
        time(&format!("{name} of {SHORT} samples, gradient"), 500, || {
            let [a, b, c] = &mut gradient;
            excitation
                .evaluate(criterion, short, Some([&mut a[..], &mut b[..], &mut c[..]]))
                .unwrap()
        });
    }
}
