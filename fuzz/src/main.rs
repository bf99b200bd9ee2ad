//! Fuzzing on stable Rust, with libFuzzer's runtime: `DYNID_TARGET=urdf dynid-fuzz corpus/urdf`. `run.py` builds and starts
//! it; `DYNID_TARGET=seeds` writes inputs to begin with into the folder `DYNID_SEEDS`.
//!
//! One program for all targets, because building costs more than a short run.

#![no_main]

mod arm;
mod limits;
mod seeds;
mod targets;

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;

static TARGET: OnceLock<fn(&[u8])> = OnceLock::new();

fn choose() {
    let name = std::env::var("DYNID_TARGET").unwrap_or_default();
    if name == "seeds" {
        seeds::write_all();
        std::process::exit(0);
    }
    let names = targets::ALL.map(|(name, _)| name);
    let found = targets::ALL.into_iter().find(|(other, _)| *other == name);
    let Some((_, run)) = found else {
        eprintln!("error: DYNID_TARGET is {name:?}, expected one of {names:?}, or seeds");
        std::process::exit(2);
    };
    TARGET.get_or_init(|| run);
}

fuzz_target!(init: choose(), |bytes: &[u8]| {
    if let Some(run) = TARGET.get() {
        run(bytes);
    }
});
