//! No step of the estimator can panic: in the compiled library nothing that a step can reach calls the panic machinery.
//!
//! The machine code of the release library is disassembled and every function that a step can reach is followed: calls, tail
//! calls, addresses taken, tables of addresses. The effects' columns, which are called through the catalogue's pointers,
//! are entries of their own. What is reached outside of the library has to stand in [`HARMLESS`]; everything else (a bounds
//! check, an `unwrap`, an allocation, a destructor) is a failure that names the function it was reached from.
//!
//! Not seen: a stack that is too small, and a fault of the processor. The loops around the step are those of `dynid-estimator` and
//! of the C interface.

#![cfg(all(target_os = "linux", target_arch = "x86_64", not(debug_assertions)))]

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::process::Command;

type References = BTreeMap<String, BTreeSet<String>>;

/// The library that this test is linked with, by being the newest one beside it.
fn library() -> PathBuf {
    let beside = std::env::current_exe().unwrap();
    let entries = std::fs::read_dir(beside.parent().unwrap()).unwrap();
    let libraries = entries.map(|entry| entry.unwrap()).filter(|entry| {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        name.starts_with("libdynid_core-") && name.ends_with(".rlib")
    });
    libraries
        .max_by_key(|entry| entry.metadata().unwrap().modified().unwrap())
        .unwrap()
        .path()
}

fn objdump(arguments: &[&str]) -> String {
    let output = Command::new("objdump")
        .args(arguments)
        .arg(library())
        .output()
        .expect("objdump is needed to look at the machine code: install binutils");
    assert!(output.status.success(), "{output:?}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The symbol of a section that holds one function or one table; other symbols as they are.
fn symbol(name: &str) -> &str {
    let sections = [".text.unlikely.", ".text.", ".data.rel.ro."];
    let name = sections
        .iter()
        .find_map(|section| name.strip_prefix(section));
    name.unwrap_or_default().trim_start_matches(".L")
}

fn target(line: &str) -> Option<String> {
    let (_, rest) = line.split_once("R_X86_64_")?;
    let name = rest.split_whitespace().nth(1)?;
    let end = name.rfind("-0x").or_else(|| name.rfind("+0x"));
    let name = &name[..end.unwrap_or(name.len())];
    let of_section = symbol(name);
    Some(
        if of_section.is_empty() {
            name
        } else {
            of_section
        }
        .to_owned(),
    )
}

/// Every function and every table with the symbols that it names.
fn references() -> References {
    let mut references = References::new();
    let mut current = String::new();
    for line in objdump(&["-dr", "--no-show-raw-insn"]).lines() {
        let header = line
            .strip_suffix(">:")
            .and_then(|line| line.split_once(" <"));
        if let Some((_, name)) = header {
            current = name.to_owned();
            references.entry(current.clone()).or_default();
        } else if let Some(name) = target(line) {
            references.entry(current.clone()).or_default().insert(name);
        }
    }
    let mut of_table = false;
    for line in objdump(&["-r"]).lines() {
        if let Some((_, section)) = line.split_once("RELOCATION RECORDS FOR [") {
            of_table = section.starts_with(".data.rel.ro.");
            current = symbol(section.trim_end_matches("]:")).to_owned();
        } else if let Some(name) = target(line).filter(|_| of_table) {
            references.entry(current.clone()).or_default().insert(name);
        }
    }
    references
}

/// Entries of a step: of the estimator, of a stream, and what the catalogue points to.
fn is_entry(name: &str) -> bool {
    let methods = [
        "15TorqueEstimator13estimate_into17h",
        "15TorqueEstimator18predicted_std_into17h",
        "15OnlineEstimator4step17h",
        "15OnlineEstimator4hold17h",
        "15OnlineEstimator4swap17h",
        "15OnlineEstimator6mirror17h",
        "16MomentumObserver4step17h",
        "5Watch8remember17h",
        "10Adaptation4step17h",
        "10Adaptation7correct17h",
        "10Adaptation5reset17h",
        "10Adaptation8remember17h",
    ];
    methods.iter().any(|method| name.contains(method))
        || name.contains("10dynid_core7effects") && name.contains("7columns17h")
}

/// What a step may call outside: C's memory and mathematics, which have no way to panic, and the question which processor
/// this is, which is asked once.
const HARMLESS: [&str; 14] = [
    "memcpy", "memmove", "memset", "memcmp", "bcmp", "sin", "cos", "sincos", "tanh", "exp",
    "expm1", "log", "log1p", "pow",
];
const WHICH_PROCESSOR: [&str; 2] = ["10std_detect6detect", "10dynid_core5lanes6CHOSEN"];

fn is_harmless(name: &str) -> bool {
    // Numbers and texts; tables of addresses have been followed.
    let plain_data = name.starts_with('.') || name.starts_with("anon.");
    plain_data || HARMLESS.contains(&name) || WHICH_PROCESSOR.iter().any(|part| name.contains(part))
}

#[test]
fn no_step_can_panic() {
    let references = references();
    // From where each was reached first.
    let mut reached: BTreeMap<&str, &str> = BTreeMap::new();
    let entries = references.keys().filter(|name| is_entry(name));
    let mut open: Vec<(&str, &str)> = entries.map(|name| (name.as_str(), "a step")).collect();
    assert!(open.len() >= 26, "the entries are not found: {open:?}");
    let mut outside: BTreeSet<(&str, &str)> = BTreeSet::new();
    while let Some((name, from)) = open.pop() {
        let Some(own) = references.get(name) else {
            outside.insert((name, from));
            continue;
        };
        if reached.insert(name, from).is_none() {
            open.extend(own.iter().map(|next| (next.as_str(), name)));
        }
    }
    let allowed: BTreeSet<&str> = outside.iter().map(|(name, _)| *name).collect();
    println!(
        "{} functions and tables; outside of them: {allowed:?}",
        reached.len()
    );
    let wrong: Vec<String> = outside
        .iter()
        .filter(|(name, _)| !is_harmless(name))
        .map(|(name, from)| format!("{name}\n    from {from}"))
        .collect();
    assert!(
        wrong.is_empty(),
        "a step can end in\n  {}",
        wrong.join("\n  ")
    );
}

/// A check that finds nothing anywhere would be none.
#[test]
fn the_look_finds_what_can_panic() {
    let references = references();
    let panics = |name: &str| name.contains("9panicking") || name.contains("_fail");
    let found = references.values().flatten().filter(|name| panics(name));
    assert!(found.count() > 10);
}
