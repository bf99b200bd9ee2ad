//! What goes in as a state comes out as the torques of the estimator, bit for bit and without waiting.

use std::io::{BufRead, BufReader, Write};
use std::sync::Arc;

use crate::common::{command, Saved, HEADER};
use dynid_core::{State, TorqueEstimator};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};

/// Six signals of two joints.
type Row = [f64; 12];

/// One line of numbers: total, terms, deviation, status.
type Numbers = Vec<f64>;

fn expected(saved: &Saved, rows: &[Row]) -> Vec<Numbers> {
    answers(TorqueEstimator::new(Arc::clone(&saved.model)), rows)
}

/// The same of states beyond the model's limits as they come.
fn unlimited(saved: &Saved, rows: &[Row]) -> Vec<Numbers> {
    answers(
        TorqueEstimator::new(Arc::clone(&saved.model)).unlimited(),
        rows,
    )
}

fn answers(mut estimator: TorqueEstimator, rows: &[Row]) -> Vec<Numbers> {
    let mut tau = [0.0; 2];
    rows.iter()
        .map(|row| {
            let state = State {
                q: &row[0..2],
                dq: &row[2..4],
                ddq: &row[4..6],
                q_motor: &row[6..8],
                dq_motor: &row[8..10],
                ddq_motor: &row[10..12],
                temperature: None,
            };
            let status = estimator.estimate_into(&state, &mut tau).unwrap();
            let mut std = [0.0; 2];
            estimator.predicted_std_into(&mut std).unwrap();
            let status = f64::from(status.bits());
            [&tau[..], estimator.terms(), &std, &[status]].concat()
        })
        .collect()
}

fn csv_input(rows: &[Row]) -> String {
    let mut text =
        format!("{HEADER},q_motor_0,q_motor_1,dq_motor_0,dq_motor_1,ddq_motor_0,ddq_motor_1\n");
    for row in rows {
        let cells: Vec<String> = row.iter().map(|x| format!("{x:?}")).collect();
        text += &(cells.join(",") + "\n");
    }
    text
}

fn json_input(rows: &[Row]) -> String {
    let array = |x: &[f64]| format!("{x:?}");
    rows.iter()
        .map(|r| {
            format!(
                "{{\"q\":{},\"dq\":{},\"ddq\":{},\"q_motor\":{},\"dq_motor\":{},\"ddq_motor\":{}}}\n",
                array(&r[0..2]),
                array(&r[2..4]),
                array(&r[4..6]),
                array(&r[6..8]),
                array(&r[8..10]),
                array(&r[10..12])
            )
        })
        .collect()
}

fn from_csv(text: &str) -> Vec<Numbers> {
    text.lines()
        .skip(1)
        .map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect())
        .collect()
}

fn from_json(text: &str) -> Vec<Numbers> {
    let flat = |value: &serde_json::Value| -> Numbers {
        value
            .as_array()
            .unwrap()
            .iter()
            .map(|x| x.as_f64().unwrap())
            .collect()
    };
    text.lines()
        .map(|line| {
            let object: serde_json::Value = serde_json::from_str(line).unwrap();
            let mut numbers = flat(&object["tau"]);
            for name in [
                "rigid_body",
                "rotor_inertia",
                "torque_offset",
                "friction",
                "residual",
            ] {
                numbers.extend(flat(&object["terms"][name]));
            }
            numbers.extend(flat(&object["std"]));
            numbers.push(object["status"].as_f64().unwrap());
            numbers
        })
        .collect()
}

fn bits(rows: &[Numbers]) -> Vec<Vec<u64>> {
    rows.iter()
        .map(|row| row.iter().map(|x| x.to_bits()).collect())
        .collect()
}

#[test]
fn both_formats_give_the_bits_of_the_estimator() {
    let saved = Saved::new();
    let number = prop_oneof![
        -3.0..3.0,
        any::<f64>().prop_filter("JSON", |x| x.is_finite())
    ];
    let rows = proptest::collection::vec(proptest::array::uniform12(number), 1..40);
    TestRunner::new(Config::with_cases(30))
        .run(&rows, |rows| {
            let expected = bits(&expected(&saved, &rows));
            let (csv, json) = (csv_input(&rows), json_input(&rows));
            for input in [&csv, &json] {
                let answer = saved.run(&["--format", "csv"], input).good();
                prop_assert_eq!(&bits(&from_csv(&answer.out)), &expected);
                prop_assert_eq!(&answer.err, "");
                let answer = saved.run(&["--format=jsonl"], input).good();
                prop_assert_eq!(&bits(&from_json(&answer.out)), &expected);
            }
            Ok(())
        })
        .unwrap();
}

#[test]
fn the_output_has_the_format_of_the_input() {
    let saved = Saved::new();
    let answer = saved
        .run(&[], format!("time,{HEADER}\n0.5,0,0,0,0,0,0\n"))
        .good();
    let lines = answer.lines();
    assert_eq!(
        lines[0],
        "t,tau_0,tau_1,rigid_body_0,rigid_body_1,rotor_inertia_0,rotor_inertia_1,torque_offset_0,\
         torque_offset_1,friction_0,friction_1,residual_0,residual_1,std_0,std_1,status"
    );
    assert!(
        lines[1].starts_with("0.5,") && lines[1].ends_with(",0"),
        "{}",
        lines[1]
    );
    assert_eq!(lines.len(), 2);
    let answer = saved
        .run(&[], r#"{"q":[0,0],"dq":[0,0],"ddq":[0,0],"t":0.5}"#)
        .good();
    assert!(
        answer.out.starts_with(r#"{"t":0.5,"tau":["#),
        "{}",
        answer.out
    );
    let answer = saved
        .run(&[], r#"{"q":[0,0],"dq":[0,0],"ddq":[0,0]}"#)
        .good();
    assert!(answer.out.starts_with(r#"{"tau":["#), "{}", answer.out);
}

#[test]
fn a_missing_encoder_is_said() {
    let saved = Saved::new();
    let answer = saved.run(&[], format!("{HEADER}\n0,0,0,0,0,0\n")).good();
    assert!(
        answer.err.contains("no q_motor") && answer.err.contains("no dq_motor"),
        "{}",
        answer.err
    );
    assert!(answer.err.lines().all(|line| line.starts_with("note: ")));
}

#[test]
fn files_of_other_habits_are_read() {
    let saved = Saved::new();
    let plain = saved
        .run(&[], format!("{HEADER}\n1,2,3,4,5,6\n"))
        .good()
        .out;
    for input in [
        "\u{feff}q_0,q_1,dq_0,dq_1,ddq_0,ddq_1\r\n1,2,3,4,5,6\r\n\r\n".to_owned(),
        "q_0;q_1;dq_0;dq_1;ddq_0;ddq_1\n1;2;3;4;5;6".to_owned(),
        "note\tq_0\tq_1\tdq_0\tdq_1\tddq_0\tddq_1\ttau_0\n\t1\t2\t3\t4\t5\t6\t\n".to_owned(),
        "# q_0,q_1,dq_0,dq_1,ddq_0,ddq_1\n1,2,3,4,5,6\n".to_owned(),
        format!("# a comment, with a comma\n{HEADER}\n1,2,3,4,5,6\n"),
        "\"q_slide\", \"q_shoulder\",qd_1,qd_0,qdd_0,qdd_1\n\"2\", 1.0e0,4,+3.,5,6\n".to_owned(),
    ] {
        assert_eq!(saved.run(&[], &input).good().out, plain, "{input}");
    }
}

#[test]
fn a_nan_repeats_the_last_good_torque() {
    let saved = Saved::new();
    for (good, bad) in [
        ("0.1,0,0,0,0,0", "0.1,nan,0,0,0,0"),
        ("0.1,0,0,0,0,0", "-inf,0,0,0,0,0"),
    ] {
        let input = format!("{HEADER}\n{bad}\n{good}\n{bad}\n{good}\n");
        let rows = from_csv(&saved.run(&[], input).good().out);
        let (last, status): (Vec<_>, Vec<_>) = rows.iter().map(|row| (&row[..12], row[14])).unzip();
        assert_eq!(status, [1.0, 0.0, 1.0, 0.0]);
        assert_eq!(last[0], [0.0; 12]);
        assert_eq!(last[1], last[2]);
        assert_eq!(last[1], last[3]);
    }
    for bad in ["null", "NaN", "-Infinity"] {
        let line = |x: &str| format!("{{\"t\":{x},\"q\":[{x},0],\"dq\":[0,0],\"ddq\":[0,0]}}\n");
        let answer = saved
            .run(&[], line("0.1") + &line(bad) + &line("0.1"))
            .good();
        let rows = from_json(&answer.out);
        assert_eq!(rows[0][..12], rows[1][..12]);
        assert_eq!([rows[0][14], rows[1][14], rows[2][14]], [0.0, 1.0, 0.0]);
        assert!(answer.lines()[1].starts_with("{\"t\":null,"));
    }
}

#[test]
fn far_states_are_flagged() {
    let saved = Saved::new();
    let answer = saved
        .run(&[], format!("{HEADER},qm_0,qm_1\n5,0,0,0,0,0,50,0\n"))
        .good();
    assert!(answer.out.ends_with(",6\n"), "{}", answer.out);
}

#[test]
fn every_line_is_answered_before_the_next_is_sent() {
    let saved = Saved::new();
    for (header, line) in [
        (Some(HEADER), "0,0,0,0,0,0"),
        (None, r#"{"q":[0,0],"dq":[0,0],"ddq":[0,0]}"#),
    ] {
        let mut child = command(&[]).arg(saved.path()).spawn().unwrap();
        let mut stdin = child.stdin.take().unwrap();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        let mut answer = String::new();
        if let Some(header) = header {
            writeln!(stdin, "{header}").unwrap();
            stdout.read_line(&mut answer).unwrap();
            assert!(answer.starts_with("tau_0,"));
        }
        // Where an answer waited for more input, this would wait forever.
        for _ in 0..100 {
            writeln!(stdin, "{line}").unwrap();
            answer.clear();
            stdout.read_line(&mut answer).unwrap();
            assert!(answer.ends_with('\n'));
        }
        // Half of a line that waits holds nothing back.
        write!(stdin, "{line}\n{}", &line[..5]).unwrap();
        stdout.read_line(&mut answer).unwrap();
        writeln!(stdin, "{}", &line[5..]).unwrap();
        stdout.read_line(&mut answer).unwrap();
        drop(stdin);
        assert!(child.wait().unwrap().success());
    }
}

#[test]
fn a_reader_that_leaves_ends_it_quietly() {
    let saved = Saved::new();
    let mut child = command(&[]).arg(saved.path()).spawn().unwrap();
    drop(child.stdout.take());
    let mut stdin = child.stdin.take().unwrap();
    let rows = "0,0,0,0,0,0\n".repeat(10_000);
    let _ = stdin.write_all(format!("{HEADER},qm_0,qm_1,qmd_0,qmd_1\n{rows}").as_bytes());
    drop(stdin);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(141));
    assert!(
        output.stderr.is_empty(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// Positions of a slow sine, and the same with exact derivatives.
fn sine(n: usize) -> (String, Vec<Row>) {
    let (w, step) = (6.0, 0.001);
    let mut text = "t,q_0,q_1\n".to_owned();
    let mut rows = Vec::new();
    for k in 0..n {
        let t = k as f64 * step;
        let (sin, cos) = (w * t).sin_cos();
        let link = [
            sin,
            0.5 * sin,
            w * cos,
            0.5 * w * cos,
            -w * w * sin,
            -0.5 * w * w * sin,
        ];
        text += &format!("{t:?},{:?},{:?}\n", link[0], link[1]);
        rows.push(std::array::from_fn(|k| link[k % 6]));
    }
    (text, rows)
}

#[test]
fn positions_alone_are_differentiated_with_the_delay_that_is_said() {
    let saved = Saved::new();
    let (text, rows) = sine(400);
    let exact = unlimited(&saved, &rows);
    for (window, late) in [("7", 3), ("21", 10), ("31", 15)] {
        let answer = saved
            .run(&["--window", window, "--unlimited"], &text)
            .good();
        let said = format!("that of {:.4} ms before", late as f64);
        assert!(answer.err.contains(&said), "{}", answer.err);
        let found = from_csv(&answer.out);
        let settled = found.iter().position(|row| row[15] < 512.0).unwrap();
        assert!(settled > late && settled < 2 * late + 1, "{settled}");
        assert!(found[..settled].iter().all(|row| row[15] == 528.0));
        for k in 2 * late..400 {
            for (torque, expected) in found[k][1..3].iter().zip(&exact[k - late][..2]) {
                // What the window smooths away: of order (w h)^2 / 10 of the acceleration.
                let tolerance = 0.02 * expected.abs() + (6e-3 * late as f64).powi(2) * 40.0;
                assert!(
                    (torque - expected).abs() < tolerance,
                    "{window} {k}: {torque} {expected}"
                );
            }
        }
    }
}

#[test]
fn the_delay_stands_in_the_information() {
    let saved = Saved::new();
    let info = |args: &[&str]| saved.run(args, "").good().out;
    let text = info(&["--info", "--window", "11", "--step", "0.002"]);
    assert!(
        text.contains("positions alone are differentiated over 11 samples, 10 ms late"),
        "{text}"
    );
    let json: serde_json::Value = serde_json::from_str(&info(&["--info", "--json"])).unwrap();
    let found = &json["differentiation"];
    assert_eq!(
        (&found["window"], &found["delay"], &found["first_answer"]),
        (&15.into(), &0.007.into(), &10.into())
    );
}

#[test]
fn a_push_is_observed() {
    let saved = Saved::new();
    let (step, begin) = (0.001, 200);
    let (text, rows) = sine(400);
    let _ = text;
    let exact = unlimited(&saved, &rows);
    let mut input = "t,q_0,q_1,dq_0,dq_1,ddq_0,ddq_1,tau_0,tau_1\n".to_owned();
    for (k, (row, answer)) in rows.iter().zip(&exact).enumerate() {
        let push = if k >= begin { 300.0 } else { 0.0 };
        let cells: Vec<String> = [k as f64 * step]
            .iter()
            .chain(&row[..6])
            .chain(&[answer[0], answer[1] - push])
            .map(|x| format!("{x:?}"))
            .collect();
        input += &(cells.join(",") + "\n");
    }
    let answer = saved
        .run(
            &["--observe", "--observer-time", "0.01", "--unlimited"],
            &input,
        )
        .good();
    assert!(answer.lines()[0].ends_with("std_0,std_1,external_0,external_1,status"));
    let found = from_csv(&answer.out);
    for (k, row) in found.iter().enumerate() {
        let (external, status) = (
            &row[row.len() - 3..row.len() - 1],
            row[row.len() - 1] as u32,
        );
        let expected = if k >= begin { 300.0 } else { 0.0 };
        if !(begin..begin + 100).contains(&k) && k > 0 {
            // Torques here are of the order of a thousand.
            assert!(
                (external[1] - expected).abs() < 10.0 && external[0].abs() < 10.0,
                "{k} {external:?}"
            );
            assert_eq!(status & 2048 != 0, k >= begin, "{k} {external:?}");
        }
    }
    let json = saved
        .run(&["--observe", "--format", "jsonl"], &input)
        .good();
    assert!(
        json.lines()[5].contains(",\"external\":["),
        "{}",
        json.lines()[5]
    );
    saved
        .run(&["--observe"], format!("{HEADER}\n0,0,0,0,0,0\n"))
        .refused(&["--observe", "tau_0"]);
    saved
        .run(&["--observer-time", "1"], "")
        .refused(&["--observer-time", "go with --observe"]);
    saved
        .run(&["--observe", "--observer-time", "0"], "")
        .refused(&["positive number of seconds"]);
    saved
        .run(&["--observe", "--false-contacts", "0"], "")
        .refused(&["false contacts per hour"]);
}
