//! What the loop asks of the system: the clock, the sleep, the transport; no page of memory.

#![cfg(target_os = "linux")]

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::net::UdpSocket;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::common::Saved;
use crate::live::state_bytes;

/// Asks a thousand times, with faults among the states.
fn exchange(address: &str, cycles: u64) {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(address).unwrap();
    socket
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    let mut buffer = [0; 4096];
    for k in 0..cycles {
        let x = (0.01 * k as f64).sin();
        let mut numbers = [x, -x, 1.0 - x, x, -x, x, 5.0 * x, -5.0 * x];
        match k % 40 {
            10 => numbers[1] = f64::NAN,
            20 => numbers[0] = 1e200,
            30 => drop(socket.send(b"no state")),
            _ => {}
        }
        let sequence = if k % 40 == 35 { k - 3 } else { k };
        // q, dq, ddq, tau
        socket
            .send(&state_bytes(
                sequence,
                0.001 * k as f64,
                0b1000_0111,
                &numbers,
            ))
            .unwrap();
        receive(&socket, &mut buffer);
    }
}

/// The next datagram. Signals that other tests of this process send end a wait with a limit, whoever they are for.
fn receive(socket: &UdpSocket, buffer: &mut [u8]) {
    loop {
        match socket.recv(buffer) {
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            received => {
                received.unwrap();
                return;
            }
        }
    }
}

/// Address of a loop that says it in a file, because a tracer stands between.
fn wait_for_address(path: &std::path::Path) -> String {
    for _ in 0..2000 {
        let said = fs::read_to_string(path).unwrap_or_default();
        if let Some((_, rest)) = said.split_once("listening on ") {
            if let Some((address, _)) = rest.split_once('\n') {
                return address.to_owned();
            }
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("it did not begin: {:?}", fs::read_to_string(path));
}

fn start(
    program: &str,
    before: &[&str],
    saved: &Saved,
    args: &[&str],
    said: &std::path::Path,
) -> Child {
    let mut command = Command::new(program);
    if !before.is_empty() {
        command
            .args(before)
            .arg(env!("CARGO_BIN_EXE_dynid-estimator"));
    }
    command
        .arg(saved.path())
        .args(["--udp", "127.0.0.1:0", "--step", "0.001", "--observe"])
        .args(args)
        .stdout(Stdio::piped())
        .stderr(fs::File::create(said).unwrap())
        .spawn()
        .unwrap()
}

const ALLOWED: [&str; 5] = [
    "recvfrom",
    "sendto",
    "clock_nanosleep",
    "clock_gettime",
    "restart_syscall",
];

#[test]
fn the_loop_calls_the_system_for_clock_sleep_and_transport_only() {
    if !Command::new("strace")
        .args(["-o", "/dev/null", "true"])
        .status()
        .is_ok_and(|status| status.success())
    {
        println!("skipped: strace is not here, or may not trace");
        return;
    }
    let saved = Saved::new();
    let folder = tempfile::tempdir().unwrap();
    let (trace, said) = (folder.path().join("trace"), folder.path().join("said"));
    for (paced, args) in [
        (true, &["--rate", "1000", "--watch", "--duration", "3"][..]),
        (
            true,
            &[
                "--rate",
                "1000",
                "--early",
                "0.0004",
                "--watch",
                "--duration",
                "3",
            ],
        ),
        (false, &["--duration", "3"]),
    ] {
        let tracer = ["-o", trace.to_str().unwrap()];
        let child = start("strace", &tracer, &saved, args, &said);
        exchange(&wait_for_address(&said), 1000);
        let output = child.wait_with_output().unwrap();
        assert!(
            output.status.success(),
            "{output:?} {}",
            fs::read_to_string(&said).unwrap()
        );
        let trace = fs::read_to_string(&trace).unwrap();
        let calls: Vec<&str> = trace
            .lines()
            .filter_map(|line| Some(line.split_once('(')?.0))
            .collect();
        // From the third answer, the notes of the first state being said, to the last one.
        let begin = calls
            .iter()
            .enumerate()
            .filter(|(_, call)| **call == "sendto")
            .nth(2)
            .unwrap()
            .0;
        let end = calls.iter().rposition(|call| *call == "sendto").unwrap();
        let mut counts: BTreeMap<&str, u32> = BTreeMap::new();
        for call in &calls[begin..=end] {
            *counts.entry(call).or_default() += 1;
        }
        println!("{args:?}: {counts:?}");
        assert!(
            counts.keys().all(|call| ALLOWED.contains(call)),
            "{counts:?}"
        );
        assert!(
            counts["sendto"] > 900 && counts["recvfrom"] > 900,
            "{counts:?}"
        );
        assert_eq!(counts.contains_key("clock_nanosleep"), paced, "{counts:?}");
    }
}

#[test]
fn no_page_is_missing_once_the_first_state_is_answered() {
    let saved = Saved::new();
    let folder = tempfile::tempdir().unwrap();
    let said = folder.path().join("said");
    let probe = saved.run(&["--mlock"], "q_0,q_1\n0,0\n");
    if probe.code != Some(0) {
        probe.refused(&["--mlock", "leave it out"]);
        println!("skipped: memory may not be locked here");
        return;
    }
    for args in [
        &["--rate", "1000"][..],
        &["--rate", "1000", "--early", "0.0004"],
        &[],
    ] {
        let args = [
            args,
            &["--mlock", "--duration", "3", "--histogram", "--json"],
        ]
        .concat();
        let child = start(
            env!("CARGO_BIN_EXE_dynid-estimator"),
            &[],
            &saved,
            &args,
            &said,
        );
        exchange(&wait_for_address(&said), 1000);
        let output = child.wait_with_output().unwrap();
        let report = String::from_utf8(output.stdout).unwrap();
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        println!("{args:?}: {report}");
        assert_eq!(
            report["page_faults"],
            serde_json::json!({"minor": 0, "major": 0})
        );
        assert!(report["compute"]["cycles"].as_u64() >= Some(1000));
        let rehearsed = report["rehearsed"].as_u64();
        assert_eq!(rehearsed > Some(0), args.contains(&"--early"), "{report}");
    }
}
