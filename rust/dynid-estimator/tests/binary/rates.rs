//! A stream of another rate than thresholds of contacts were learned at.

use crate::common::Saved;

/// Learned at 1 kHz.
const CONTACT: &str = r#"{"format":"dynid-contact","version":2,"joints":["shoulder","slide"],"torque_unit":"N*m","step":0.001,
"window":15,"time_constant":0.01,"false_contacts_per_hour":1.0,"moving":[1.0,1.0],"standing":[1.0,1.0],"turning":[1.0,1.0],
"torque":[0.0,0.0],"stops_known":[true,true],"turns_known":[true,true],
"tail":{"level":[9.0,9.0],"per_hour":[700.0,700.0],"growth":[2.0,2.0]},"directions":[]}"#;

const NOTE: &str = "note: states come at ";

fn with_contacts(saved: &Saved) -> String {
    let path = saved.path().with_file_name("contact.json");
    std::fs::write(&path, CONTACT).unwrap();
    path.to_str().unwrap().to_owned()
}

fn lines(step: f64, n: u32) -> String {
    let mut text = "t,q_0,q_1,dq_0,dq_1,ddq_0,ddq_1,tau_0,tau_1\n".to_owned();
    for k in 0..n {
        text += &format!("{:?},0,0,0,0,0,0,0,0\n", f64::from(k) * step);
    }
    text
}

#[test]
fn lines_of_another_rate_are_said_once() {
    let saved = Saved::new();
    let contacts = with_contacts(&saved);
    let args = ["--observe", "--contacts", &contacts];
    let slow = saved.run(&args, lines(0.004, 400)).good();
    assert_eq!(slow.err.matches(NOTE).count(), 1, "{slow:?}");
    assert!(
        slow.err
            .contains("come at 250 Hz, the --contacts file was learned at 1000 Hz"),
        "{slow:?}"
    );
    assert!(slow.err.contains("--healthy RUN --save"), "{slow:?}");
    assert_eq!(slow.lines().len(), 401);
    for input in [lines(0.001, 400), lines(0.004, 100)] {
        let same = saved.run(&args, input).good();
        assert!(!same.err.contains(NOTE), "{same:?}");
    }
    let without = saved.run(&["--observe"], lines(0.004, 400)).good();
    assert!(!without.err.contains(NOTE), "{without:?}");
}

#[cfg(target_os = "linux")]
#[test]
fn datagrams_of_another_rate_are_said_while_it_runs() {
    use crate::live::{state_bytes, Pair};

    let saved = Saved::new();
    let contacts = with_contacts(&saved);
    let mut pair = Pair::start(&saved, &["--observe", "--contacts", &contacts]);
    for k in 0..300 {
        pair.ask(&state_bytes(k, 0.002 * k as f64, 0b1000_0111, &[0.0; 8]));
    }
    assert!(pair.running.said(NOTE).starts_with("500 Hz"));
    let answer = pair.running.end().good();
    assert!(!answer.err.contains(NOTE), "{answer:?}");
}
