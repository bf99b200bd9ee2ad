//! What a watch remembers, as it is written and spoiled.

use dynid_io::remembered::{parse_remembered, VERSION};
use dynid_io::Remembered;

fn known() -> Remembered {
    Remembered {
        of: "ab".repeat(32),
        numbers: vec![0.1, 2.5e-9, -3.0e-7, 1.0 / 3.0],
    }
}

#[test]
fn numbers_come_back_bit_for_bit() {
    let text = known().to_text().unwrap();
    assert_eq!(parse_remembered(text.as_bytes(), "f").unwrap(), known());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("known.json");
    known().save(&path).unwrap();
    assert_eq!(dynid_io::load_remembered(&path).unwrap(), known());
    assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
}

#[test]
fn what_is_none_is_refused_with_a_sentence() {
    let text = known().to_text().unwrap();
    let newer = format!("\"version\":{}", VERSION + 1);
    let cases = [
        (
            "dynid-watch-remembered",
            "dynid-model",
            "not what a watch remembers",
        ),
        ("\"version\":3", newer.as_str(), "of version 4"),
        ("\"numbers\"", "\"figures\"", "unknown field"),
        ("2.5e-9", "\"none\"", "invalid type"),
        ("2.5e-9", "null", "invalid type"),
        ("2.5e-9", "1e999", "number out of range"),
    ];
    for (old, new, said) in cases {
        let spoiled = text.replace(old, new);
        assert_ne!(spoiled, text, "{old}");
        let error = parse_remembered(spoiled.as_bytes(), "known.json").unwrap_err();
        let sentence = error.to_string();
        assert!(sentence.contains(said), "{sentence}");
        assert!(sentence.starts_with("known.json: ") && sentence.contains("remove this one"));
        assert!(sentence.len() < 400, "{sentence}");
    }
    for bytes in [&b""[..], b"[]", b"{", &[0xff; 9], &vec![b' '; 5 << 20]] {
        assert!(parse_remembered(bytes, "f").is_err());
    }
}
