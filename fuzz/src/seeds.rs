//! Inputs to begin with, a folder per target; what fuzzing finds is kept beside them.

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use dynid_core::watch::{Healthy, Watch, WatchSettings};
use dynid_io::model_file::to_text;
use dynid_io::Remembered;

use crate::arm::{arm, models};

const URDF: &[u8] = include_bytes!("../../rust/dynid-io/tests/urdf_hostile/arm.urdf");

/// Writes them into the folder `DYNID_SEEDS`.
///
/// # Panics
/// If there is none.
pub fn write_all() {
    let folder = PathBuf::from(std::env::var_os("DYNID_SEEDS").expect("a folder"));
    let put = |target: &str, name: &str, bytes: &[u8]| {
        let place = folder.join(target);
        fs::create_dir_all(&place).expect("a folder");
        fs::write(place.join(name), bytes).expect("a file");
    };
    put("urdf", "seed_arm", URDF);
    put("robot_toml", "seed_arm", &robot_toml());
    put("watch_file", "seed_two_joints", WATCH);
    put("contact_file", "seed_two_joints", &contact());
    put("remembered", "seed_quiet", &remembered());
    for (k, model) in models().iter().enumerate() {
        put(
            "model",
            &format!("seed_{k}"),
            &blank(&to_text(model).expect("JSON")),
        );
    }
    let n = arm().robot().n_joints();
    let good: Vec<Vec<u8>> = [0b111, 0b1, 0xff, 0b1000_0111, 0b1011]
        .map(|mask| state(n, mask))
        .into();
    let mut datagrams = Vec::new();
    let mut memory = Vec::new();
    for (k, bytes) in good.iter().enumerate() {
        datagrams.extend((bytes.len() as u16).to_le_bytes());
        datagrams.extend(bytes);
        datagrams.extend([0, 0]);
        let mut slot = [2 + 2 * k as u64, bytes.len() as u64]
            .map(u64::to_le_bytes)
            .concat();
        slot.extend(bytes);
        slot.resize(256, 0);
        memory.extend(slot);
    }
    put("datagrams", "seed_all", &datagrams);
    put("memory", "seed_all", &memory);
    put("lines", "seed_csv", CSV);
    put("lines", "seed_quoted", QUOTED);
    put("lines", "seed_json", JSON);
    put("lines", "seed_positions", POSITIONS);
}

/// An observer of the arm that knows it worse by one direction.
fn contact() -> Vec<u8> {
    let arm = arm();
    let zeros = |n: usize| vec!["0.1"; n].join(",");
    let effects = arm.effects().iter();
    let effects: Vec<String> = effects
        .map(|term| format!("[{}]", zeros(term.coefficients().len())))
        .collect();
    let (phi, effects) = (zeros(arm.phi().len()), effects.join(","));
    format!("{CONTACT}\"directions\":[{{\"phi\":[{phi}],\"effects\":[{effects}]}}]}}").into_bytes()
}

/// What the watch of the arm knows before anything has come.
fn remembered() -> Vec<u8> {
    let settings = WatchSettings::default();
    let mut watch = Watch::new(Arc::new(arm()), settings, &Healthy::untold(2)).expect("a watch");
    let mut numbers = vec![0.0; watch.n_remembered()];
    watch.remember(&mut numbers).expect("as many numbers");
    let of = "00".repeat(32);
    let text = Remembered { of, numbers }.to_text();
    text.expect("JSON").into_bytes()
}

const WATCH: &[u8] = br#"{"format":"dynid-watch-settings","version":3,"joints":["a","b"],"row":0.2,"false_alarms_per_day":1.0,
"tolerated":{"friction":0.1,"gain":0.05,"offset":2.0,"load":0.1,"delay":0.004,"slip":0.005,"unknown":1.0},"inflation":[1.0,2.5],"memory":[1.0,12.0],"least_speed":[0.01,null],"frozen_after":[0.05,null],"frozen_way":[0.5,0.0]}"#;
const CONTACT: &str = r#"{"format":"dynid-contact","version":2,"joints":["a","b"],"torque_unit":"N*m","step":0.001,"window":15,"time_constant":0.02,
"false_contacts_per_hour":0.01,"moving":[1.0,0.5],"standing":[0.1,0.2],"turning":[2.0,1.5],"torque":[0.0,1e-4],"stops_known":[true,false],
"turns_known":[false,true],"tail":{"level":[12.0,1.0],"per_hour":[720.0,70.0],"growth":[2.5,2.0]},"#;
const CSV: &[u8] = b"t,q_0,q_1,dq_0,dq_1,ddq_0,ddq_1,tau_0,tau_1\n0,0,0,0,0,0,0,1,1\n.001,1e-3,nan,0,-inf,0,0,1,1\n";
const QUOTED: &[u8] = b"# q_a; q_b ;\"tau_a\";tau_b\n0;1;2;3\n\n1;2;3;4\r\n";
const JSON: &[u8] = b"{\"t\":0,\"q\":[0,1],\"dq\":[0,0],\"ddq\":[0,null],\"tau\":[1,NaN],\"x\":{}}\n{\"time\":1,\"q\":[0,1],\"qd\":[0,0],\"qdd\":[0,0],\"current\":[1,-Infinity]}\n";
const POSITIONS: &[u8] = b"q_0,q_1,tau_0,tau_1\n0,0,0,0\n1e-3,0,0,0\n2e-3,0,0,0\n3e-3,0,0,0\n4e-3,0,0,0\n5e-3,0,0,0\n6e-3,0,0,0\n7e-3,0,0,0\n";

/// The example of the format's own description.
fn robot_toml() -> Vec<u8> {
    let source = include_str!("../../rust/dynid-io/src/mdh/mod.rs");
    let lines = source
        .lines()
        .skip_while(|line| *line != "//! ```toml")
        .skip(1);
    let example = lines.take_while(|line| *line != "//! ```");
    let text: Vec<&str> = example
        .map(|line| line.trim_start_matches("//!").trim_start())
        .collect();
    text.join("\n").into_bytes()
}

/// With zeros for the checksum, which the target puts right.
fn blank(text: &str) -> Vec<u8> {
    let at = text.find("sha256:").expect("a checksum") + 7;
    [&text[..at], &"0".repeat(64), &text[at + 64..]]
        .concat()
        .into_bytes()
}

/// A state with the signals of a mask.
fn state(n: usize, mask: u32) -> Vec<u8> {
    let mut bytes = b"DYNS\x01\0".to_vec();
    bytes.extend((n as u16).to_le_bytes());
    bytes.extend(mask.to_le_bytes());
    bytes.extend([0; 4]);
    bytes.extend(u64::from(mask).to_le_bytes());
    bytes.extend(0.25_f64.to_le_bytes());
    for k in 0..mask.count_ones() as usize * n {
        bytes.extend((k as f64 / 10.0).to_le_bytes());
    }
    bytes
}
