//! No formula in lanes is compiled without the registers of its path: there every instruction on lanes would be a call.
//!
//! That happens to a function that is handed on as a value, and to what stands in a closure that is not compiled into its
//! caller. Friction that was handed on took about ten times as long, to the same bits. The machine code of the release
//! libraries is disassembled, and what calls single instructions is counted.

#![cfg(all(target_os = "linux", target_arch = "x86_64", not(debug_assertions)))]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Calls of single instructions in one function: arguments that are nowhere near any motion take a way of their own, and what
/// is done once a run may.
const FEW: usize = 20;

/// The newest library of a crate beside this test: the one that it is linked with.
fn library(of: &str) -> PathBuf {
    let beside = std::env::current_exe().unwrap();
    let entries = std::fs::read_dir(beside.parent().unwrap()).unwrap();
    let libraries = entries.map(|entry| entry.unwrap()).filter(|entry| {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        name.starts_with(&format!("lib{of}-")) && name.ends_with(".rlib")
    });
    libraries
        .max_by_key(|entry| entry.metadata().unwrap().modified().unwrap())
        .unwrap()
        .path()
}

/// How many functions a library has, and of each how often it calls a single instruction.
fn calls(library: &Path) -> (usize, BTreeMap<String, usize>) {
    let output = Command::new("objdump")
        .args([
            "--disassemble",
            "--reloc",
            "--demangle",
            "--no-show-raw-insn",
        ])
        .arg(library)
        .output()
        .expect("objdump is needed to look at the machine code: install binutils");
    assert!(output.status.success(), "{output:?}");
    let (mut functions, mut inside, mut calls) = (0, String::new(), BTreeMap::new());
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        if line.ends_with(">:") {
            functions += 1;
            inside = format!("{functions}: {line}");
        } else if line.contains("R_X86_64_") && line.contains("core_arch::x86") {
            *calls.entry(inside.clone()).or_insert(0) += 1;
        }
    }
    (functions, calls)
}

#[test]
fn instructions_on_lanes_are_no_calls() {
    for name in ["dynid_core", "dynid_offline"] {
        let (functions, calls) = calls(&library(name));
        assert!(functions > 100, "{name}: {functions} functions");
        let many: Vec<_> = calls.iter().filter(|(_, count)| **count > FEW).collect();
        assert!(many.is_empty(), "{name}: {many:#?}");
    }
}
