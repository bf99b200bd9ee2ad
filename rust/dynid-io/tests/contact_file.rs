//! `contact.json`: what is read, and what is refused with a sentence.

use dynid_io::contact_file::{parse_contact, MAX_BYTES};

const GOOD: &str = r#"{"format":"dynid-contact","version":2,"joints":["a","b"],"torque_unit":"N*m","step":0.001,"window":15,"time_constant":0.01,
"false_contacts_per_hour":0.5,"moving":[1.0,0.5],"standing":[0.1,0.2],"turning":[2.0,1.5],"torque":[0.0,1e-4],
"stops_known":[true,false],"turns_known":[false,true],"tail":{"level":[12.0,9.0],"per_hour":[720.0,700.0],"growth":[2.5,2.0]},
"directions":[{"phi":[0.1],"effects":[[0.2,0.3]]}]}"#;

#[test]
fn a_file_is_read() {
    let file = parse_contact(GOOD.as_bytes(), "f").unwrap();
    assert_eq!(file.joints, ["a", "b"]);
    assert_eq!((file.step, file.window), (0.001, Some(15)));
    assert_eq!(
        (file.settings.time_constant, file.settings.false_per_hour),
        (0.01, 0.5)
    );
    let known = file.uncertainty;
    assert_eq!(known.turning, [2.0, 1.5]);
    assert_eq!(
        (known.stops_known, known.turns_known),
        (vec![true, false], vec![false, true])
    );
    assert_eq!(known.tails[1].level, 9.0);
    assert_eq!(known.directions[0].effects, [vec![0.2, 0.3]]);
}

#[test]
fn what_is_none_is_refused_with_the_mend() {
    let long = format!(
        "\"directions\":[{}",
        "{\"phi\":[],\"effects\":[]},".repeat(65)
    );
    for (good, bad, said) in [
        ("dynid-contact", "dynid-model", "expected \"format\""),
        ("\"version\":2", "\"version\":7", "of version 7"),
        ("0.001", "0.0", "step is no time"),
        ("\"window\":15", "\"windows\":15", "unknown field"),
        (
            "\"time_constant\":0.01",
            "\"time_constant\":1e9",
            "time_constant is no time",
        ),
        (":0.5,", ":-0.5,", "false_per_hour"),
        ("[1.0,0.5]", "[1.0]", "1 values of moving for 2 joints"),
        (
            "[12.0,9.0]",
            "[12.0,9.0,1.0]",
            "3 values of level for 2 joints",
        ),
        ("\"directions\":[", long.as_str(), "66 directions"),
        ("[0.2,0.3]", "[0.2,nan]", "not an observer's uncertainty"),
    ] {
        let text = GOOD.replacen(good, bad, 1);
        assert_ne!(text, GOOD, "{bad}");
        let error = parse_contact(text.as_bytes(), "f").unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
        assert!(
            error.contains("write it anew with `dynid contact MODEL"),
            "{error}"
        );
        assert!(error.starts_with("f"), "{error}");
    }
    let huge = vec![b' '; MAX_BYTES as usize + 1];
    assert!(parse_contact(&huge, "f")
        .unwrap_err()
        .to_string()
        .contains("too many"));
}
