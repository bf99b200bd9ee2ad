//! What of the compiled step can panic: nothing but failed length checks, whose lengths were fixed when the estimator was made.
//!
//! The machine code of the release library is disassembled, every function that a step can reach is followed (calls, tail calls and
//! addresses taken; the effects' columns, which are reached through the catalogue's pointers, are added by name), and every
//! call into the panic machinery is listed by its kind.
//!
//! * No `unwrap`, `expect`, overflow, failed conversion, borrow, allocation or explicit panic may be among them.
//! * Where the numbers of a stream decide what is indexed (its order, the filter's ring, the observer), there may be none at all.
//! * What is left compares lengths with lengths and loop counters. None of them depends on a measured number, so a first step that
//!   passed them proves the next ones: `dynid-estimator` takes such a step before a model goes into the loop, on a thread whose
//!   panic is a refusal.

#![cfg(all(target_os = "linux", target_arch = "x86_64", not(debug_assertions)))]

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::process::Command;

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

/// Every function with the symbols that it names.
fn references() -> Option<BTreeMap<String, BTreeSet<String>>> {
    let output = Command::new("objdump")
        .args(["-dr", "--no-show-raw-insn", "-C"])
        .arg(library())
        .output()
        .ok()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let mut references: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut current = String::new();
    for line in text.lines() {
        if let Some((_, name)) = line
            .strip_suffix(">:")
            .and_then(|line| line.split_once(" <"))
        {
            current = name.to_owned();
            references.entry(current.clone()).or_default();
        } else if let Some((_, symbol)) = line
            .split_once("R_X86_64_")
            .and_then(|(_, rest)| rest.split_once('\t'))
        {
            let symbol = symbol.trim().trim_start_matches(".text.");
            let end = symbol
                .rfind("-0x")
                .or_else(|| symbol.rfind("+0x"))
                .unwrap_or(symbol.len());
            references
                .entry(current.clone())
                .or_default()
                .insert(symbol[..end].to_owned());
        }
    }
    Some(references)
}

/// Entries of a step: of the estimator, of a stream, and what the catalogue points to.
fn is_entry(name: &str) -> bool {
    let ends = [
        "TorqueEstimator::estimate_into",
        "TorqueEstimator::predicted_std_into",
        "OnlineEstimator::step",
        "OnlineEstimator::swap",
    ];
    ends.iter().any(|end| name.ends_with(end))
        || name.starts_with("dynid_core::effects::") && name.ends_with("::columns")
}

const LENGTH_CHECKS: [&str; 4] = [
    "core::panicking::panic_bounds_check",
    "core::slice::index::slice_index_fail",
    "core::slice::copy_from_slice_impl::len_mismatch_fail",
    "core::panicking::panic_const::panic_const_div_by_zero", // the length of rows of no values
];

/// Modules in which the numbers of a stream decide what is indexed.
const NONE_AT_ALL: [&str; 6] = [
    "dynid_core::differentiator::",
    "dynid_core::momentum::",
    "dynid_core::observer::",
    "dynid_core::online::",
    "dynid_core::slices::",
    "dynid_core::stream::",
];

#[test]
fn a_step_can_only_fail_at_lengths() {
    let Some(references) = references() else {
        println!("skipped: objdump is not here");
        return;
    };
    let mut reached: BTreeSet<&str> = BTreeSet::new();
    let mut open: Vec<&str> = references
        .keys()
        .map(String::as_str)
        .filter(|name| is_entry(name))
        .collect();
    assert!(open.len() >= 20, "the entries are not found: {open:?}");
    while let Some(name) = open.pop() {
        if reached.insert(name) {
            open.extend(
                references[name]
                    .iter()
                    .map(String::as_str)
                    .filter(|name| references.contains_key(*name)),
            );
        }
    }
    let mut counts: BTreeMap<&str, u32> = BTreeMap::new();
    for name in &reached {
        for symbol in &references[*name] {
            let panics =
                symbol.contains("panic") || symbol.contains("fail") || symbol.contains("alloc");
            if !panics || references.contains_key(symbol) || symbol.starts_with('.') {
                continue;
            }
            // `chunks_exact` refuses rows of no values with a message; nothing else in the step has one.
            let allowed =
                LENGTH_CHECKS.contains(&symbol.as_str()) || symbol == "core::panicking::panic_fmt";
            assert!(allowed, "{name} can end in {symbol}");
            let free = NONE_AT_ALL.iter().any(|module| name.contains(module));
            assert!(!free, "{name} can end in {symbol}");
            *counts.entry(symbol).or_default() += 1;
        }
    }
    println!(
        "{} functions, of which so many may end in: {counts:#?}",
        reached.len()
    );
}
