//! What is asked of a running estimator: signals, durations, memory that stays in place.

#![cfg(target_os = "linux")]

use std::io::{Read, Write};
use std::process::Command;

use crate::common::{command, Answer, Saved, HEADER};
use crate::live::{state, Pair, Running, PATIENT};

fn heavier() -> dynid_core::TorqueModel {
    let mut parts = crate::common::parts();
    parts.phi.iter_mut().for_each(|x| *x *= 2.0);
    dynid_core::TorqueModel::new(parts).unwrap()
}

#[test]
fn a_hangup_reads_the_model_again_and_disturbs_nothing() {
    let saved = Saved::new();
    let mut pair = Pair::start(&saved, &[PATIENT[0], PATIENT[1], "--watch"]);
    let old = pair.ask(&state(1)).tau();
    // The same file: nobody but the signal asks for it.
    pair.running.signal("HUP");
    pair.running.said("the new model is used from now on");
    // The next answer is that of the next state: the signal was no silence, which is answered as stale.
    assert_eq!(pair.ask(&state(2)).status, 0);
    std::fs::remove_file(saved.path()).unwrap();
    pair.running.signal("HUP");
    let said = pair.running.said("error: ");
    assert!(said.ends_with("; the old model stays"), "{said}");
    dynid_io::save(&heavier(), &saved.path()).unwrap();
    pair.running.signal("HUP");
    pair.running.said("the new model is used from now on");
    let new = pair.ask(&state(1_000)).tau();
    assert_ne!(old, new);
    pair.running.end().good();
}

#[test]
fn without_a_watch_a_hangup_ends_it_in_order() {
    let saved = Saved::new();
    let address = ["--udp", "127.0.0.1:0"];
    let asked_at_rest = ["--rate", "0.5", "--histogram", "--json"];
    for signal in ["HUP", "INT", "TERM"] {
        let mut running = Running::start(&saved, &[address, ["--rate", "0.5"]].concat());
        running.said("listening on ");
        running.signal(signal);
        running.ended().good();
        // Asked for in its sleep: a cycle that did not begin is not counted, and has not taken 2^64 ns.
        let mut running = Running::start(&saved, &[&address[..], &asked_at_rest].concat());
        running.said("listening on ");
        std::thread::sleep(std::time::Duration::from_millis(2300));
        running.signal(signal);
        let report: serde_json::Value = serde_json::from_str(&running.ended().good().out).unwrap();
        for row in ["compute", "wake_up", "end_to_end"] {
            assert_eq!(report[row]["cycles"], 1, "{report}");
            assert!(report[row]["max"].as_f64().unwrap() < 1e6, "{report}");
        }
    }
}

#[test]
fn standard_input_ends_when_it_is_asked_to() {
    let saved = Saved::new();
    for asked in [None, Some("INT"), Some("TERM"), Some("HUP")] {
        let args: &[&str] = &["--histogram", "--duration", "1.5"];
        let args = if asked.is_none() { args } else { &args[..1] };
        let mut child = command(args).arg(saved.path()).spawn().unwrap();
        // Open and silent from here on, after half a line.
        let mut stdin = child.stdin.take().unwrap();
        write!(stdin, "{HEADER}\n0,0,0,0,0,0\n0,0").unwrap();
        let mut out = child.stdout.take().unwrap();
        let mut begun = [0; 1];
        out.read_exact(&mut begun).unwrap();
        if let Some(signal) = asked {
            let id = child.id().to_string();
            let status = Command::new("kill").args(["-s", signal, &id]).status();
            assert!(status.unwrap().success());
        }
        let mut rest = String::new();
        out.read_to_string(&mut rest).unwrap();
        let answer = Answer::from(child.wait_with_output().unwrap()).good();
        assert!(answer.err.contains("p99.99"), "{asked:?}: {answer:?}");
        assert!(rest.lines().count() <= 2, "{asked:?}: {rest}");
        drop(stdin);
    }
}

/// Memory that may not grow, and a file that may: what does not fit would end the loop instead of being refused.
#[test]
fn a_watch_needs_memory_that_may_grow() {
    let saved = Saved::new();
    let mut limited = Command::new("setpriv");
    limited.args([
        "--inh-caps=-ipc_lock",
        "--bounding-set=-ipc_lock",
        "prlimit",
    ]);
    limited.args(["--memlock=8388608:8388608"]);
    let there = limited.arg("true").output();
    if !there.is_ok_and(|output| output.status.success()) {
        println!("skipped: setpriv or prlimit is not here, or may not be used");
        return;
    }
    let mut limited = Command::new("setpriv");
    limited.args([
        "--inh-caps=-ipc_lock",
        "--bounding-set=-ipc_lock",
        "prlimit",
    ]);
    limited.args([
        "--memlock=8388608:8388608",
        env!("CARGO_BIN_EXE_dynid-estimator"),
    ]);
    limited.args([
        "--udp",
        "127.0.0.1:0",
        "--duration",
        "0.1",
        "--mlock",
        "--watch",
    ]);
    let answer = Answer::from(limited.arg(saved.path()).output().unwrap());
    answer.refused(&["--mlock", "ulimit -l unlimited"]);
}
