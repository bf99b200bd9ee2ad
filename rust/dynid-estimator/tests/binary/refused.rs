//! Broken input, wrong use, unreadable models: exit 2 and one sentence. Whatever the bytes, nothing worse.

use std::fs;

use crate::common::{command, run, Answer, Saved, HEADER};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};

#[test]
fn headers_that_do_not_fit() {
    let saved = Saved::new();
    for (header, words) in [
        (
            "q_0,q_1,dq_0,ddq_0,ddq_1",
            &["line 1", "\"dq_1\"", "\"slide\""][..],
        ),
        (
            "q_0,q_1,dq_0,dq_1,ddq_0,ddq_1,q_0",
            &["line 1", "\"q_0\"", "repeats"],
        ),
        (
            "q_0,q_1,dq_0,dq_1,ddq_0,ddq_1,q_slide",
            &["\"q_slide\"", "\"q_1\""],
        ),
        (
            "q_0,q_1,dq_0,dq_1,ddq_0,ddq_1,q_motor_1",
            &["\"q_motor_0\"", "all joints or for none"],
        ),
        (
            "q_0,q_1,q_2,dq_0,dq_1,dq_2,ddq_0,ddq_1,ddq_2",
            &["\"q_2\"", "2 joints"],
        ),
        ("0,0,0,0,0,0", &["line 1", "found numbers", "header"]),
        ("a robot's diary", &["\"q_0\"", "missing"]),
        ("\"q_0", &["quote"]),
    ] {
        let answer = saved.run(&[], format!("{header}\n0,0,0,0,0,0\n"));
        answer.refused(words);
        assert_eq!(answer.out, "");
    }
}

#[test]
fn currents_are_no_torque_of_a_model_in_newton_meters() {
    let saved = Saved::new();
    let row = "0,0,0,0,0,0,7,7";
    let currents = format!("{HEADER},current_0,current_1\n{row}\n");
    let answer = saved.run(&["--observe"], currents);
    answer.refused(&["in the model's unit, tau_0 and so on"]);
    // A log that has both is read by the one.
    let both = format!("{HEADER},current_0,current_1,tau_0,tau_1\n{row},1,1\n");
    let torque = format!("{HEADER},tau_0,tau_1\n0,0,0,0,0,0,1,1\n");
    let [both, torque] = [both, torque].map(|text| saved.run(&["--observe"], text).good().out);
    assert_eq!(both, torque);
}

#[test]
fn a_temperature_that_only_a_later_model_may_want_may_hold_anything() {
    let saved = Saved::new();
    let input = |more: &str, row: &str| format!("{HEADER}{more}\n0,0,0,0,0,0{row}\n");
    let plain = saved.run(&["--watch"], input("", "")).good().out;
    for row in [",hot,", ",n/a,40", ",,"] {
        let log = input(",temperature_0,temperature_1", row);
        assert_eq!(saved.run(&["--watch"], log).good().out, plain);
    }
    let object = r#"{"q":[0,0],"dq":[0,0],"ddq":[0,0],"temperature":40}"#;
    saved.run(&["--watch"], format!("{object}\n")).good();
}

#[test]
fn rows_that_are_broken() {
    let saved = Saved::new();
    for (row, words) in [
        (
            "0,0,zero,0,0,0",
            &["line 3", "\"dq_0\"", "\"zero\"", "a number"][..],
        ),
        ("0,,0,0,0,0", &["line 3", "\"q_1\"", "empty"]),
        ("0,0,0", &["line 3", "\"dq_1\"", "3 cells, expected 6"]),
        ("0,0,0,0,0,0,0", &["line 3", "more than 6 cells"]),
        ("0,0,0,0,0,\"0", &["line 3", "quote"]),
        (HEADER, &["line 3", "\"q_0\"", "a number"]),
        ("\u{1b}[31m,0,0,0,0,0", &["\\u{1b}"]),
    ] {
        let answer = saved.run(&[], format!("{HEADER}\n0,0,0,0,0,0\n{row}\n0,0,0,0,0,0\n"));
        answer.refused(words);
        assert_eq!(
            answer.lines().len(),
            2,
            "the good line before is answered, the ones after are not"
        );
    }
}

#[test]
fn objects_that_are_broken() {
    let saved = Saved::new();
    let good = r#"{"q":[0,0],"dq":[0,0],"ddq":[0,0],"q_motor":[0,0],"dq_motor":[0,0]}"#;
    for (line, words) in [
        (
            r#"{"q":[0,0]}"#,
            &["line 2", "\"dq\"", "the first state has it"][..],
        ),
        (r#"{"q":[0,0,0]}"#, &["line 2", "\"q\"", "more than 2"]),
        (r#"{"q":[0]}"#, &["line 2", "\"q\"", "1 values, expected 2"]),
        (r#"{"q":["0",0]}"#, &["line 2", "q[0]", "a number"]),
        (r#"{"q":[0,0],"q":[0,0]}"#, &["line 2", "\"q\"", "twice"]),
        (
            r#"{"q":[0,0],"dq":[0,0],"ddq":[0,0]}"#,
            &["line 2", "\"q_motor\"", "the first state has it"],
        ),
        (&good[..20], &["line 2", "not a JSON object", "EOF"]),
        ("0,0,0,0,0,0", &["line 2"]),
        (HEADER, &["line 2", "not a JSON object"]),
    ] {
        let answer = saved.run(&[], format!("{good}\n{line}\n{good}\n"));
        answer.refused(words);
        assert_eq!(answer.lines().len(), 1);
    }
    let deep = format!("{{\"x\":{}1", "[".repeat(500_000));
    saved.run(&[], &deep).refused(&["line 1"]);
    let deep = deep.replace("\"x\"", "\"q\"");
    saved.run(&[], &deep).refused(&["line 1", "q[0]"]);
}

#[test]
fn empty_input() {
    let saved = Saved::new();
    for format in ["auto", "csv", "jsonl"] {
        for input in ["", "\n \n"] {
            saved
                .run(&["--input-format", format], input)
                .refused(&["empty"]);
        }
    }
    let answer = saved.run(&[], format!("{HEADER}\n")).good();
    assert_eq!(
        answer.lines().len(),
        1,
        "a header alone is a run without samples"
    );
}

#[test]
fn a_huge_line_is_refused_unread() {
    let saved = Saved::new();
    let mut input = format!("{HEADER}\n").into_bytes();
    input.resize(64 << 20, b'1');
    saved.run(&[], &input).refused(&["line 2", "1048576"]);
    input.fill(b'{');
    saved.run(&[], &input).refused(&["line 1", "1048576"]);
}

#[test]
fn a_format_that_is_told_wrongly() {
    let saved = Saved::new();
    let json = r#"{"q":[0,0],"dq":[0,0],"ddq":[0,0]}"#;
    saved
        .run(&["--input-format", "csv"], json)
        .refused(&["line 1", "header"]);
    saved
        .run(&["--input-format", "jsonl"], format!("{HEADER}\n"))
        .refused(&["line 1", "JSON"]);
}

#[test]
fn wrong_use() {
    let saved = Saved::new();
    let path = saved.path();
    let path = path.to_str().unwrap();
    for (args, words) in [
        (&[][..], &["no model"][..]),
        (&["--formt", "csv", path], &["--formt"]),
        (&["--format", "xml", path], &["xml", "csv or jsonl"]),
        (&["--format", "auto", path], &["auto"]),
        (
            &["--observe", "--false-contacts", "0/hour", path],
            &["--false-contacts: expected", "above 0, got \"0/hour\""],
        ),
        (
            &["--adapt", "friction,friction", path],
            &["--adapt: expected", "each once", "friction,friction"],
        ),
        (
            &["--adapt", "payload", "--adapt-mass", "0", path],
            &["--adapt-mass: expected kg, 0.001 to 100000, got \"0\""],
        ),
        (
            &["--adapt", "friction", "--adapt-mass", "3", path],
            &["limits of a payload"],
        ),
        (&["--format"], &["--format"]),
        (&["--json", path], &["--info"]),
        (
            &["--info", "--observe", "--contacts", "none.json", path],
            &["--info reads nothing", "--contacts; leave it out"],
        ),
        (&["--step", "0", path], &["positive number of seconds"]),
        (&["--step", "4ms", path], &["positive number of seconds"]),
        (&["--step", "1e-300", path], &["0.00001 to 100"]),
        (&["--step", "1e300", path], &["0.00001 to 100"]),
        (&["--observer-time", "1e-300", path], &["0.00001 to 100"]),
        (&[path, path], &["model.json"]),
    ] {
        let answer = Answer::from(command(args).output().unwrap());
        answer.refused(words);
        answer.refused(&["--help"]);
    }
}

#[test]
fn models_that_are_no_models() {
    let saved = Saved::new();
    let good = fs::read(saved.path()).unwrap();
    let other = saved.path().with_file_name("other.json");
    let refuse = |bytes: &[u8]| {
        fs::write(&other, bytes).unwrap();
        let answer = run(&other, &[], format!("{HEADER}\n0,0,0,0,0,0\n").as_bytes());
        answer.refused(&["other.json"]);
        assert_eq!(answer.out, "");
        run(&other, &["--info"], b"").refused(&["other.json"]);
    };
    for part in 0..8 {
        refuse(&good[..part * good.len() / 8]);
    }
    for at in (0..good.len()).step_by(good.len() / 20) {
        let mut changed = good.clone();
        changed[at] ^= 1;
        refuse(&changed);
    }
    run(&saved.path().with_file_name("none.json"), &[], b"").refused(&["none.json"]);
    run(saved.path().parent().unwrap(), &[], b"").refused(&[]);
}

/// Nobody writes into the pipe: whoever opened it would wait.
#[cfg(target_os = "linux")]
#[test]
fn pipes_are_no_files() {
    let saved = Saved::new();
    let pipe = saved.path().with_file_name("pipe.json");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    let words = ["pipe.json", "this is a device or a pipe"];
    run(&pipe, &[], b"").refused(&words);
    let changes = ["--changes", pipe.to_str().unwrap()];
    saved.run(&changes, "").refused(&words);
}

#[cfg(target_os = "linux")]
#[test]
fn an_answer_that_has_nowhere_to_go_is_said() {
    let saved = Saved::new();
    for arguments in ["--info", "--info --json", "--help", ""] {
        let line = format!(
            "exec {} {} {arguments} >&- </dev/null",
            env!("CARGO_BIN_EXE_dynid-estimator"),
            saved.path().display()
        );
        let mut shell = std::process::Command::new("sh");
        let answer = Answer::from(shell.args(["-c", &line]).output().unwrap());
        answer.refused(&["stdout: it is closed"]);
    }
}

#[test]
fn the_facts_of_a_model() {
    let saved = Saved::new();
    let text = saved.run(&["--info"], "").good().out;
    for word in [
        "arm, 2 joints",
        "N*m",
        "rigid_body + rotor_inertia",
        "shoulder",
        "prismatic",
        "3.0000 ms",
    ] {
        assert!(text.contains(word), "{word}: {text}");
    }
    let json = saved.run(&["--info", "--json"], "").good().out;
    let info: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(info["robot"], "arm");
    assert_eq!(info["terms"][3], "friction");
    assert_eq!(info["joints"][0]["domain"]["q"][1], 1.0);
    assert_eq!(info["residual"]["joints"][0], "shoulder");
    for (option, word) in [
        ("--help", "Usage"),
        ("-h", "Usage"),
        ("--version", "dynid-estimator "),
    ] {
        let answer = Answer::from(command(&[option]).output().unwrap()).good();
        assert!(answer.out.contains(word));
    }
}

/// Anything at all, and things that are nearly right.
fn bytes() -> impl Strategy<Value = Vec<u8>> {
    let csv = format!(
        "t,{HEADER},qm_0,qm_1\n{}",
        "0,1,-2.5,nan,4e-3,5,6,7,8\n".repeat(3)
    );
    let json = r#"{"t":0,"q":[0,1.5],"dq":[null,NaN],"ddq":[0,0],"x":{"y":["\"\u00e9"]}}"#;
    let json = format!("{json}\n").repeat(3);
    let spoiled =
        prop_oneof![Just(csv.into_bytes()), Just(json.into_bytes())].prop_flat_map(|text| {
            let n = text.len();
            let edits = proptest::collection::vec((0..n, any::<u8>(), any::<bool>()), 0..4);
            (Just(text), edits, 0..n).prop_map(|(mut text, edits, end)| {
                for (at, byte, ascii) in edits {
                    text[at] = if ascii {
                        b"\",\n[]{}:eN-\\#\t"[usize::from(byte) % 14]
                    } else {
                        byte
                    };
                }
                if end % 3 == 0 {
                    text.truncate(end);
                }
                text
            })
        });
    prop_oneof![proptest::collection::vec(any::<u8>(), 0..300), spoiled]
}

#[test]
fn no_bytes_end_it_worse_than_with_a_sentence() {
    let saved = Saved::new();
    let formats = prop_oneof![Just("auto"), Just("csv"), Just("jsonl")];
    TestRunner::new(Config::with_cases(400))
        .run(&(bytes(), formats), |(bytes, format)| {
            let answer = saved.run(&["--input-format", format], &bytes);
            prop_assert!(matches!(answer.code, Some(0 | 2)), "{answer:?}");
            prop_assert!(!answer.err.contains("panicked"), "{answer:?}");
            let errors = answer
                .err
                .lines()
                .filter(|line| line.starts_with("error: "))
                .count();
            prop_assert_eq!(errors, usize::from(answer.code == Some(2)));
            Ok(())
        })
        .unwrap();
}
