//! Settings of a watch, as they are written and spoiled.

use dynid_core::watch::{Healthy, WatchSettings};
use dynid_io::watch_file::parse_watch;

const GOOD: &str = r#"{"format":"dynid-watch-settings","version":3,"joints":["a","b"],"row":0.2,
    "false_alarms_per_day":1.0,"tolerated":{"friction":0.1,"gain":0.05,"offset":2.0,"load":0.1,"delay":0.004,"slip":0.005,"unknown":1.0},
    "inflation":[1.0,2.5],"memory":[1.0,12.0],"least_speed":[0.02,null],"frozen_after":[0.05,null],
    "frozen_way":[0.5,0.0]}"#;

#[test]
fn settings_come_as_they_were_written() {
    let file = parse_watch(GOOD.as_bytes(), "watch.json").unwrap();
    assert_eq!(file.settings, WatchSettings::default());
    assert_eq!(file.joints, ["a", "b"]);
    let expected = Healthy {
        inflation: vec![1.0, 2.5],
        memory: vec![1.0, 12.0],
        least_speed: vec![0.02, f64::INFINITY],
        frozen_after: vec![0.05, f64::INFINITY],
        frozen_way: vec![0.5, 0.0],
    };
    assert_eq!(file.healthy, expected);
    assert!(file.healthy.check(2).is_ok() && file.healthy.check(3).is_err());
}

#[test]
fn what_is_none_is_refused_with_a_sentence() {
    let cases = [
        (
            "dynid-watch-settings",
            "dynid-model",
            "not a watch's settings",
        ),
        ("\"version\":3", "\"version\":2", "version 2"),
        // Whatever else another version holds.
        ("\"version\":3,", "\"version\":4,\"new\":1,", "version 4"),
        ("\"row\":0.2", "\"row\":0.0", "row"),
        ("\"gain\":0.05", "\"gain\":-1", "gain"),
        ("[1.0,2.5]", "[1.0]", "1 values of inflation for 2 joints"),
        ("[1.0,2.5]", "[1.0,0.0]", "inflation"),
        ("[1.0,12.0]", "[1.0,0.5]", "memory"),
        ("[0.02,null]", "[0.02,-1]", "least_speed"),
        ("[0.02,null]", "[]", "0 values of least_speed for 2 joints"),
        ("[0.05,null]", "[0,null]", "frozen_after"),
        ("[0.05,null]", "[null]", "1 values of frozen_after"),
        ("[0.5,0.0]", "[null,0.0]", "invalid type"),
        ("[0.5,0.0]", "[-0.5,0.0]", "frozen_way"),
        ("\"slip\":0.005", "\"slip\":0", "slip"),
        ("\"row\"", "\"raw\"", "unknown field"),
    ];
    for (old, new, said) in cases {
        let text = GOOD.replace(old, new);
        assert_ne!(text, GOOD);
        let error = parse_watch(text.as_bytes(), "watch.json").unwrap_err();
        let sentence = error.to_string();
        assert!(sentence.contains(said), "{sentence}");
        assert!(sentence.starts_with("watch.json: ") && sentence.contains("dynid watch"));
    }
    for bytes in [&b""[..], b"[]", b"{", &[0xff; 9], &vec![b' '; 2 << 20]] {
        assert!(parse_watch(bytes, "watch.json").is_err());
    }
    let long = GOOD.replace("\"a\"", &format!("\"a\",\"{}\"", "x".repeat(100_000)));
    let sentence = parse_watch(long.as_bytes(), "w").unwrap_err().to_string();
    assert!(sentence.len() < 400, "{sentence}");
}
