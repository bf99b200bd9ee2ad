//! Datagrams and shared memory, from outside: bits, faults of the sender, another model, refusals.

#![cfg(target_os = "linux")]

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read};
use std::net::UdpSocket;
use std::os::unix::fs::FileExt;
use std::process::{Child, ChildStderr, Command};
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::common::{command, model, Answer, Saved};
use dynid_core::effects::FRICTION_NAMES;
use dynid_core::{Effect, EffectTerm, State, TorqueEstimator};

const REPEATED: u32 = 16;
const OUT_OF_ORDER: u32 = 32;
const TIME_BACKWARDS: u32 = 64;
const STALE: u32 = 128;
const LOST: u32 = 256;
const OUTSIDE: u32 = 2;

/// A state of two joints as bytes: every signal of `signals` with one number per joint.
pub fn state_bytes(sequence: u64, time: f64, mask: u32, numbers: &[f64]) -> Vec<u8> {
    let mut bytes = b"DYNS\x01\0\x02\0".to_vec();
    bytes.extend(u64::from(mask).to_le_bytes());
    bytes.extend(sequence.to_le_bytes());
    bytes.extend(time.to_le_bytes());
    numbers.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
    bytes
}

/// q, dq, ddq at a time; inside of the trained box.
fn numbers(k: u64) -> [f64; 6] {
    let (sin, cos) = (0.01 * k as f64).sin_cos();
    [
        0.5 * sin,
        0.2 * sin,
        0.5 * cos,
        0.2 * cos,
        -0.5 * sin,
        -0.2 * sin,
    ]
}

pub fn state(k: u64) -> Vec<u8> {
    state_bytes(k, 0.001 * k as f64, 0b111, &numbers(k))
}

/// Status, sequence, and all numbers from tau on.
#[derive(Debug)]
pub struct Reply {
    pub status: u32,
    pub sequence: u64,
    pub numbers: Vec<f64>,
}

impl Reply {
    pub fn read(bytes: &[u8]) -> Self {
        assert_eq!(bytes[..8], *b"DYNT\x01\0\x02\0");
        let numbers: Vec<f64> = bytes[32..]
            .chunks_exact(8)
            .map(|bytes| f64::from_le_bytes(bytes.try_into().unwrap()))
            .collect();
        assert!(numbers.iter().all(|x| x.is_finite()));
        Self {
            status: u32::from_le_bytes(bytes[8..12].try_into().unwrap()),
            sequence: u64::from_le_bytes(bytes[16..24].try_into().unwrap()),
            numbers,
        }
    }

    pub fn tau(&self) -> Vec<u64> {
        self.numbers[..2].iter().map(|x| x.to_bits()).collect()
    }
}

fn tau_of(estimator: &mut TorqueEstimator, k: u64) -> Vec<u64> {
    let mut tau = [0.0; 2];
    let x = numbers(k);
    estimator
        .estimate_into(&State::single(&x[..2], &x[2..4], &x[4..]), &mut tau)
        .unwrap();
    tau.iter().map(|x| x.to_bits()).collect()
}

/// The binary, and what it says.
pub struct Running {
    pub child: Child,
    stderr: BufReader<ChildStderr>,
}

impl Running {
    pub fn start(saved: &Saved, args: &[&str]) -> Self {
        let mut child = command(args).arg(saved.path()).spawn().unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        Self { child, stderr }
    }

    /// What follows `words` on the next line that has them.
    pub fn said(&mut self, words: &str) -> String {
        let mut line = String::new();
        loop {
            line.clear();
            assert_ne!(
                self.stderr.read_line(&mut line).unwrap(),
                0,
                "it ended before it said {words:?}"
            );
            if let Some((_, rest)) = line.split_once(words) {
                return rest.trim_end().to_owned();
            }
        }
    }

    /// Sends it a signal.
    pub fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        let asked = Command::new("kill").args(["-s", name, &id]).status();
        assert!(asked.unwrap().success());
    }

    /// Asks it to end.
    pub fn end(self) -> Answer {
        self.signal("TERM");
        self.ended()
    }

    /// Waits for its end.
    pub fn ended(mut self) -> Answer {
        let mut err = String::new();
        self.stderr.read_to_string(&mut err).unwrap();
        let mut answer = Answer::from(self.child.wait_with_output().unwrap());
        answer.err = err;
        answer
    }
}

/// Periods so long that silence is not answered while a test asks.
pub const PATIENT: [&str; 2] = ["--step", "30"];

/// A sender with a running estimator.
pub struct Pair {
    pub running: Running,
    socket: UdpSocket,
}

impl Pair {
    pub fn start(saved: &Saved, args: &[&str]) -> Self {
        let args = [&["--udp", "127.0.0.1:0"], args].concat();
        let mut running = Running::start(saved, &args);
        let address = running.said("listening on ");
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(address).unwrap();
        socket
            .set_read_timeout(Some(Duration::from_secs(20)))
            .unwrap();
        Self { running, socket }
    }

    fn send(&self, bytes: &[u8]) {
        self.socket.send(bytes).unwrap();
    }

    fn receive(&self) -> Reply {
        let mut buffer = [0; 4096];
        let length = self.socket.recv(&mut buffer).unwrap();
        Reply::read(&buffer[..length])
    }

    pub fn ask(&self, bytes: &[u8]) -> Reply {
        self.send(bytes);
        self.receive()
    }
}

#[test]
fn datagrams_are_answered_with_the_bits_of_the_estimator() {
    let saved = Saved::new();
    let pair = Pair::start(&saved, &PATIENT);
    let mut estimator = TorqueEstimator::new(Arc::clone(&saved.model));
    for k in 0..200 {
        let reply = pair.ask(&state(k));
        assert_eq!((reply.status, reply.sequence), (0, k));
        assert_eq!(reply.tau(), tau_of(&mut estimator, k));
        let mut std = [0.0; 2];
        estimator.predicted_std_into(&mut std).unwrap();
        assert_eq!(reply.numbers[2..4], std);
        assert_eq!(&reply.numbers[4..], estimator.terms());
    }
    assert_eq!(pair.running.end().good().out, "");
}

#[test]
fn faults_of_the_sender_are_said_and_pass() {
    let saved = Saved::new();
    let pair = Pair::start(&saved, &PATIENT);
    let mut estimator = TorqueEstimator::new(Arc::clone(&saved.model));
    let first = pair.ask(&state(0));
    let again = pair.ask(&state(0));
    assert_eq!((again.status, again.tau()), (REPEATED, first.tau()));
    // What is no state is not answered.
    for garbage in [
        &b""[..],
        b"DYNS",
        &[0; 100],
        &state(1)[..40],
        &[state(1), vec![0]].concat(),
    ] {
        pair.send(garbage);
    }
    let later = pair.ask(&state(5));
    assert_eq!(
        (later.status, later.tau()),
        (LOST, tau_of(&mut estimator, 5))
    );
    let older = pair.ask(&state(3));
    assert_eq!(older.status, OUT_OF_ORDER | REPEATED);
    assert_eq!(older.tau(), later.tau());
    let back = pair.ask(&state_bytes(6, 0.001, 0b111, &numbers(6)));
    assert!(
        back.status & TIME_BACKWARDS != 0 && back.tau() == later.tau(),
        "{back:?}"
    );
    let mut broken = numbers(7);
    broken[3] = f64::NAN;
    let bad = pair.ask(&state_bytes(7, 0.007, 0b111, &broken));
    assert_eq!(
        (bad.status, bad.tau()),
        (1 | LOST, later.tau()),
        "the one before was not used"
    );
    broken[3] = 1e12;
    assert_eq!(
        pair.ask(&state_bytes(8, 0.008, 0b111, &broken)).status & OUTSIDE,
        OUTSIDE
    );
    let good = pair.ask(&state(9));
    assert_eq!((good.status, good.tau()), (0, tau_of(&mut estimator, 9)));
    // Another sender takes over, counting from 0: believed at its third word.
    let other = UdpSocket::bind("127.0.0.1:0").unwrap();
    other.connect(pair.socket.peer_addr().unwrap()).unwrap();
    let mut statuses = Vec::new();
    for k in 0..5 {
        other.send(&state(k)).unwrap();
        let mut buffer = [0; 4096];
        let length = other.recv(&mut buffer).unwrap();
        statuses.push(Reply::read(&buffer[..length]).status & !STALE);
    }
    assert_eq!(statuses, [48, 48, LOST, 0, 0]);
    let said = pair.running.end().good().err;
    assert!(
        said.contains("5 messages were no states of this robot"),
        "{said}"
    );
}

#[test]
fn silence_is_stale_within_two_periods_and_over_by_itself() {
    let saved = Saved::new();
    for args in [&["--step", "0.02"][..], &["--step", "0.02", "--rate", "50"]] {
        let pair = Pair::start(&saved, args);
        pair.send(&state(0));
        let first = pair.receive();
        // Answers keep coming while the sender is silent; all but the first one or two say so.
        let silent: Vec<Reply> = (0..20).map(|_| pair.receive()).collect();
        assert!(silent[0].status & REPEATED != 0, "{:?}", silent[0]);
        for reply in &silent[1..] {
            assert_eq!(reply.status, REPEATED | STALE);
            assert_eq!(reply.tau(), first.tau());
        }
        pair.send(&state(40));
        let reply = (0..10)
            .map(|_| pair.receive())
            .find(|reply| reply.status & STALE == 0)
            .unwrap();
        assert_eq!((reply.status, reply.sequence), (LOST, 40));
        pair.running.end().good();
    }
}

#[test]
fn another_model_is_taken_between_two_cycles_and_a_bad_one_is_refused() {
    let saved = Saved::new();
    let mut pair = Pair::start(&saved, &[PATIENT[0], PATIENT[1], "--watch"]);
    let old = pair.ask(&state(1)).tau();
    std::fs::write(saved.path(), "{\"format\": \"dynid-model\"").unwrap();
    let said = pair.running.said("error: ");
    assert!(said.ends_with("; the old model stays"), "{said}");
    assert_eq!(pair.ask(&state(2)).status, 0);
    let heavier = {
        let mut parts = crate::common::parts();
        parts.phi.iter_mut().for_each(|x| *x *= 2.0);
        dynid_core::TorqueModel::new(parts).unwrap()
    };
    dynid_io::save(&heavier, &saved.path()).unwrap();
    pair.running.said("the new model is used from now on");
    let mut estimator = TorqueEstimator::new(Arc::new(heavier));
    let new = pair.ask(&state(3));
    assert_eq!((new.status, new.tau()), (0, tau_of(&mut estimator, 3)));
    assert_ne!(old, new.tau());
    let other = dynid_core::TorqueModel::new(dynid_core::model::TorqueModelParts {
        torque_unit: "A".into(),
        ..crate::common::parts()
    });
    dynid_io::save(&other.unwrap(), &saved.path()).unwrap();
    let said = pair.running.said("error: ");
    assert!(said.contains("the torque unit are not those"), "{said}");
    assert_eq!(pair.ask(&state(4)).tau(), tau_of(&mut estimator, 4));
    dynid_io::save(&model(), &saved.path()).unwrap();
    pair.running.end().good();
}

#[test]
fn another_model_may_follow_a_temperature_where_the_old_one_did_not() {
    let saved = Saved::new();
    let mut pair = Pair::start(&saved, &[PATIENT[0], PATIENT[1], "--watch"]);
    let warm = |k| {
        let numbers = [&numbers(k)[..], &[60.0, 60.0]].concat();
        state_bytes(k, 0.001 * k as f64, 0b100_0111, &numbers)
    };
    pair.ask(&warm(1));
    let mut shape = vec![
        ("reference_temperature", vec![20.0; 2]),
        ("transition_width", vec![0.01; 2]),
    ];
    shape.extend(FRICTION_NAMES.map(|name| (name, vec![1.0; 2])));
    let effect = Effect::new("temperature_friction", &shape).unwrap();
    let mut parts = crate::common::parts();
    parts.effects = vec![EffectTerm::new(effect, vec![-0.01; 2], 2).unwrap()];
    let model = dynid_core::TorqueModel::new(parts).unwrap();
    dynid_io::save(&model, &saved.path()).unwrap();
    pair.running.said("the new model is used from now on");
    let mut estimator = TorqueEstimator::new(Arc::new(model));
    let (x, mut tau) = (numbers(2), [0.0; 2]);
    let state = State {
        temperature: Some(&[60.0, 60.0]),
        ..State::single(&x[..2], &x[2..4], &x[4..])
    };
    estimator.estimate_into(&state, &mut tau).unwrap();
    let reply = pair.ask(&warm(2));
    assert_eq!((reply.status, &reply.numbers[..2]), (0, &tau[..]));
    pair.running.end().good();
}

/// The other end of a shared file, by plain reads and writes.
struct Shared(File);

impl Shared {
    fn open(path: &str) -> Self {
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .open(path)
            .unwrap();
        let mut head = [0; 24];
        file.read_exact_at(&mut head, 0).unwrap();
        assert_eq!(head[..8], *b"DYNM\x01\0\x02\0");
        Self(file)
    }

    fn word(&self, at: u64) -> u64 {
        let mut bytes = [0; 8];
        self.0.read_exact_at(&mut bytes, at).unwrap();
        u64::from_le_bytes(bytes)
    }

    fn set(&self, at: u64, value: u64) {
        self.0.write_all_at(&value.to_le_bytes(), at).unwrap();
    }

    fn send(&self, bytes: &[u8]) {
        let slot = self.word(8) & 0xffff_ffff;
        let counter = self.word(slot) | 1;
        self.set(slot, counter);
        self.set(slot + 8, bytes.len() as u64);
        self.0.write_all_at(bytes, slot + 16).unwrap();
        self.set(slot, counter + 1);
    }

    fn receive(&self) -> Reply {
        let slot = self.word(16) & 0xffff_ffff;
        loop {
            let before = self.word(slot);
            let mut bytes = vec![0; self.word(slot + 8) as usize];
            if before > 0 && before.is_multiple_of(2) {
                self.0.read_exact_at(&mut bytes, slot + 16).unwrap();
                if self.word(slot) == before {
                    return Reply::read(&bytes);
                }
            }
        }
    }

    fn wait(&self, what: impl Fn(&Reply) -> bool) -> Reply {
        let begin = Instant::now();
        loop {
            let reply = self.receive();
            if what(&reply) {
                return reply;
            }
            assert!(begin.elapsed() < Duration::from_secs(20), "{reply:?}");
        }
    }
}

#[test]
fn shared_memory_gives_the_bits_of_the_estimator() {
    let saved = Saved::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("slot");
    let path = path.to_str().unwrap();
    let mut estimator = TorqueEstimator::new(Arc::clone(&saved.model));
    // The second one takes over the file that the first one left; the client keeps its end.
    let mut client = None;
    for (start, early) in [(0, "0"), (100, "0.001")] {
        let args = ["--rate", "200", "--shm", path, "--early", early];
        let mut running = Running::start(&saved, &args);
        let said = running.said("sharing ");
        let client = client.get_or_insert_with(|| Shared::open(&said));
        for k in start..start + 50 {
            client.send(&state(k));
            let reply = client.wait(|reply| reply.sequence == k);
            assert_eq!(reply.status & !(LOST | REPEATED | STALE), 0);
            assert_eq!(reply.tau(), tau_of(&mut estimator, k));
        }
        client.wait(|reply| reply.status == REPEATED | STALE);
        client.send(b"no state");
        client.wait(|reply| reply.status == REPEATED | STALE);
        running.end().good();
    }
}

#[cfg(unix)]
/// Whoever may write the file may cut it, at any instant.
#[test]
fn shared_memory_that_is_cut_ends_it_with_a_sentence() {
    let saved = Saved::new();
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("arm");
    let args = ["--rate", "1000", "--shm", place.to_str().unwrap()];
    let mut running = Running::start(&saved, &args);
    running.said("sharing ");
    File::create(&place).unwrap();
    let answer = running.ended();
    answer.refused(&["the shared memory is gone", "cut", "start again"]);
}

#[test]
fn foreign_files_are_not_shared() {
    let saved = Saved::new();
    let folder = tempfile::tempdir().unwrap();
    let (path, link) = (folder.path().join("precious"), folder.path().join("link"));
    std::fs::write(&path, "not yours").unwrap();
    std::os::unix::fs::symlink(&path, &link).unwrap();
    for (place, words) in [
        (&path, "no estimator made this file"),
        (&link, "symbolic link"),
    ] {
        let place = place.to_str().unwrap();
        saved
            .run(&["--rate", "10", "--shm", place], "")
            .refused(&[place, words]);
    }
    assert_eq!(std::fs::read(&path).unwrap(), b"not yours");
}

#[test]
fn what_cannot_be_had_is_refused() {
    let saved = Saved::new();
    let no_folder = "/no/such/folder/slot";
    for (args, words) in [
        (&["--shm", "x"][..], &["--shm", "--rate"][..]),
        (&["--shm", no_folder, "--rate", "10"], &[no_folder]),
        (&["--udp", "nowhere"], &["--udp nowhere", "127.0.0.1:7000"]),
        (&["--udp", "127.0.0.1:0", "--format", "csv"], &["--format"]),
        (&["--rate", "0"], &["cycles per second"]),
        (&["--rate", "inf"], &["cycles per second"]),
        (&["--fifo", "100"], &["priority", "1 to 99"]),
        (&["--core", "-1"], &["number of a core"]),
        (&["--core", "99999"], &["--core 99999", "leave it out"]),
        (&["--core", "1000"], &["--core 1000", "leave it out"]),
        (&["--jitter"], &["--histogram"]),
        (&["--json"], &["--histogram"]),
        (&["--duration", "-1"], &["positive number of seconds"]),
        (&["--window", "8"], &["odd number"]),
        (&["--early", "0.0001"], &["--early", "--rate"]),
        (
            &["--early", "0.002", "--rate", "1000"],
            &["--early", "half a period"],
        ),
        (
            &["--early", "-1", "--rate", "1000"],
            &["seconds, 0 to 0.01"],
        ),
        (
            &["--early", "0.011", "--rate", "1"],
            &["seconds, 0 to 0.01"],
        ),
    ] {
        saved.run(args, "q_0,q_1\n0,0\n").refused(words);
    }
}

#[test]
fn a_paced_replay_says_how_long_it_took() {
    let saved = Saved::new();
    let states = format!("{}\n{}", crate::common::HEADER, "0,0,0,0,0,0\n".repeat(60));
    let answer = saved
        .run(&["--rate", "1000", "--histogram", "--jitter"], &states)
        .good();
    for words in [
        "p99.99",
        "compute",
        "wake-up",
        "end-to-end",
        "sleep only",
        "missed cycles: ",
        "page faults: ",
    ] {
        assert!(answer.err.contains(words), "{}", answer.err);
    }
    let answer = saved
        .run(&["--rate", "1000", "--histogram", "--json"], &states)
        .good();
    let line = answer
        .err
        .lines()
        .find(|line| line.starts_with('{'))
        .unwrap();
    let report: serde_json::Value = serde_json::from_str(line).unwrap();
    assert_eq!(report["compute"]["cycles"], 60);
    assert_eq!(report["wake_up"]["cycles"], 60);
    let part = |name: &str| report["end_to_end"][name].as_f64().unwrap();
    assert!(part("p50") <= part("p99") && part("p99") <= part("max") && part("p50") > 0.0);
    let answer = saved
        .run(&["--rate", "100", "--duration", "0.1"], &states)
        .good();
    assert!((2..13).contains(&answer.lines().len()), "{}", answer.out);
}

#[test]
fn a_rehearsed_replay_says_the_same() {
    let saved = Saved::new();
    let mut states = format!("t,{}\n", crate::common::HEADER);
    for k in 0..300 {
        let mut row: Vec<String> = numbers(k).iter().map(|x| format!("{x:?}")).collect();
        match k % 50 {
            10 => row[1] = "nan".to_owned(),
            20 => row[0] = "1e200".to_owned(),
            _ => {}
        }
        states += &format!("{},{}\n", 0.001 * k as f64, row.join(","));
    }
    let rate = ["--rate", "1000", "--histogram", "--json"];
    let answer = |early: &str| {
        let args = [&rate[..], &["--early", early]].concat();
        let answer = saved.run(&args, &states).good();
        let report = answer
            .err
            .lines()
            .find(|line| line.starts_with('{'))
            .unwrap();
        let report: serde_json::Value = serde_json::from_str(report).unwrap();
        assert_eq!(report["compute"]["cycles"], 300);
        (answer.out, report["rehearsed"].as_u64().unwrap())
    };
    let ((plain, none), (rehearsed, some)) = (answer("0"), answer("0.0005"));
    assert!(none == 0 && some > 0, "{none} {some}");
    assert_eq!(plain, rehearsed);
}
