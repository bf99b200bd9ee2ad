//! Files that mean harm, and files that are merely broken: a sentence, quickly, and never a panic.

use std::io::{Seek, Write};
use std::time::{Duration, Instant};

use dynid_io::urdf::{load, parse, parse_with_notes, UrdfOptions};
use proptest::prelude::*;

/// Well under a second on an idle machine; a machine that is busy, or code that is not optimised, gets more. What grows
/// with the square takes minutes.
const QUICK: Duration = Duration::from_secs(if cfg!(debug_assertions) { 60 } else { 10 });
const ARM: &str = include_str!("urdf_hostile/arm.urdf");

fn refused(text: impl AsRef<[u8]>) -> String {
    let start = Instant::now();
    let error = parse(text, "f", &UrdfOptions::default())
        .expect_err("hostile")
        .to_string();
    assert!(start.elapsed() < QUICK, "{:?}: {error}", start.elapsed());
    assert!(error.len() < 1000, "{} bytes of error", error.len());
    error
}

#[test]
fn a_megabyte_of_nested_tags() {
    assert!(refused("<a>".repeat(350_000)).contains("expected <robot>"));
    assert!(refused(format!("<robot>{}", "<a>".repeat(350_000)))
        .contains("f:1:101: <a>: nested deeper than 32"));
    assert!(
        refused(format!("<robot>{}", "<link name='a'>".repeat(70_000)))
            .contains("does not count at this place")
    );
}

#[test]
fn entities_that_multiply() {
    let mut text = "<?xml version=\"1.0\"?>\n<!DOCTYPE robot [\n<!ENTITY a0 \"lol\">\n".to_owned();
    for i in 1..12 {
        text += &format!(
            "<!ENTITY a{i} \"{}\">\n",
            format!("&a{};", i - 1).repeat(10)
        );
    }
    text += "]>\n<robot name=\"&a11;\"/>";
    assert!(refused(text).contains("f:2:1: <!DOCTYPE>"));
    assert!(
        refused("<!DOCTYPE r [<!ENTITY x SYSTEM 'file:///etc/passwd'>]><robot>&x;</robot>")
            .contains("<!DOCTYPE>")
    );
    assert!(refused("<robot>&x;</robot>").contains("unknown entity"));
}

#[test]
fn files_beyond_the_limit() {
    assert!(refused(vec![b' '; 16 * 1024 * 1024 + 1]).contains("larger than 16 MiB"));
    let path = std::env::temp_dir().join(format!("dynid_large_{}.urdf", std::process::id()));
    let mut file = std::fs::File::create(&path).expect("temporary file");
    file.seek(std::io::SeekFrom::Start(1 << 33))
        .expect("sparse");
    file.write_all(b"x").expect("sparse");
    let error = load(&path, &UrdfOptions::default())
        .expect_err("8 GiB")
        .to_string();
    std::fs::remove_file(&path).expect("own file");
    assert!(error.contains("larger than 16 MiB"), "{error}");
}

#[cfg(unix)]
#[test]
fn a_device_without_an_end() {
    let error = load("/dev/zero".as_ref(), &UrdfOptions::default())
        .expect_err("endless")
        .to_string();
    assert!(error.contains("larger than 16 MiB"), "{error}");
}

/// A chain of `n` joints of a type.
fn chain(n: usize, kind: &str) -> String {
    let mut text = "<robot name='long'><link name='l0'/>\n".to_owned();
    for i in 1..=n {
        let parent = i - 1;
        text += &format!(
            "<link name='l{i}'/><joint name='j{i}' type='{kind}'><parent link='l{parent}'/><child link='l{i}'/></joint>\n"
        );
    }
    text + "</robot>"
}

#[test]
fn nothing_grows_with_the_square() {
    for kind in ["fixed", "revolute"] {
        assert!(refused(chain(100_000, kind)).contains("more than 2000 links"));
        assert!(refused(chain(1_900, kind)).contains(if kind == "fixed" {
            "no joint moves"
        } else {
            "1900 joints move"
        }));
    }
    let attributes: String = (0..300_000).map(|i| format!(" a{i}='1'")).collect();
    assert!(refused(format!("<robot{attributes}/>")).contains("more than 64 attributes"));
    assert!(refused(format!("<robot><visual{attributes}/></robot>"))
        .contains("more than 64 attributes"));
    let star: String = (1..2_000)
        .map(|i| format!("<link name='l{i}'/><joint name='j{i}' type='revolute'><parent link='b'/><child link='l{i}'/></joint>"))
        .collect();
    let loaded = parse_with_notes(
        format!("<robot><link name='b'/>{star}</robot>"),
        "f",
        &UrdfOptions::default(),
    );
    let choice = loaded.expect("one of many").choice.expect("many");
    assert!(
        choice.contains("other tips: \"l2\", \"l3\"") && choice.contains("and 1990 more"),
        "{choice}"
    );
    // Each follows the next, and the last one the first: every one of them is held.
    let ring: String = (1..1_999)
        .map(|i| {
            let master = i % 1_998 + 1;
            format!("<link name='l{i}'/><joint name='j{i}' type='revolute'><parent link='b'/><child link='l{i}'/><mimic joint='j{master}' multiplier='1e9'/></joint>")
        })
        .collect();
    let arm = "<link name='a'/><link name='b'/><joint name='j' type='revolute'><parent link='a'/><child link='b'/></joint>";
    let robot = parse(
        format!("<robot>{arm}{ring}</robot>"),
        "f",
        &UrdfOptions::default(),
    );
    assert_eq!(robot.expect("held").joints().len(), 1);
    assert!(refused(format!(
        "<robot>{}</robot>",
        "<link name='a'/>".repeat(9_000)
    ))
    .contains("is taken by the link"));
    assert!(refused(format!("<robot>{}</robot>", "x<b/>".repeat(1_000_000))).contains("no <link>"));
    assert!(
        refused(format!("<robot>{}</robot>", "\n&#120;".repeat(1_000_000))).contains("no <link>")
    );
    let kinds: String = (0..500_000).map(|i| format!("<k{i}/>")).collect();
    assert!(refused(format!("<robot>{kinds}</robot>")).contains("no <link>"));
    let rotors = "<transmission><joint name='j'/><drake:rotor_inertia value='1'/></transmission>"
        .repeat(100_000);
    refused(format!("<robot>{rotors}</robot>"));
    let name = "n".repeat(5_000_000);
    assert!(refused(format!("<robot><{name}/></robot>")).contains("does not start a tag"));
    assert!(refused(format!("<robot><link name='{name}'/></robot>"))
        .contains("expected at most 256 bytes"));
    assert!(refused(format!("<robot><link {name}='1'/></robot>"))
        .contains("is not the name of an attribute"));
    assert!(
        refused(format!("<robot><joint name='j' type='{name}'/></robot>")).contains("is unknown")
    );
}

#[test]
fn a_large_sound_file_is_quick_too() {
    let text = chain(1_999, "fixed").replacen("type='fixed'", "type='revolute'", 1);
    let start = Instant::now();
    parse(text, "f", &UrdfOptions::default()).expect("sound");
    assert!(start.elapsed() < QUICK, "{:?}", start.elapsed());
}

/// An error with a place inside the text, or a model of finite numbers.
fn survives(bytes: &[u8]) {
    match parse_with_notes(bytes, "f", &UrdfOptions::default()) {
        Err(error) => {
            let text = error.to_string();
            assert!(text.starts_with("f:"), "{text}");
        }
        Ok(loaded) => {
            for joint in loaded.robot.joints() {
                let numbers = joint
                    .rotation
                    .iter()
                    .chain(&joint.translation)
                    .chain(&joint.axis)
                    .chain(&joint.phi);
                assert!(
                    numbers.chain([&joint.rotor_inertia]).all(|x| x.is_finite()),
                    "{joint:?}"
                );
                assert!(joint.limits.lower <= joint.limits.upper, "{joint:?}");
            }
        }
    }
}

#[test]
fn every_truncation() {
    for end in 0..ARM.len() {
        survives(&ARM.as_bytes()[..end]);
        survives(&ARM.as_bytes()[end..]);
    }
}

#[test]
fn every_byte_lost_or_replaced() {
    for at in 0..ARM.len() {
        for byte in [
            None,
            Some(b'<'),
            Some(b'>'),
            Some(b'"'),
            Some(b'&'),
            Some(b'/'),
            Some(b'9'),
        ] {
            let mut bytes = ARM.as_bytes().to_vec();
            match byte {
                None => drop(bytes.remove(at)),
                Some(byte) => bytes[at] = byte,
            }
            survives(&bytes);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_edits(edits in prop::collection::vec((0..ARM.len(), 0..ARM.len(), any::<u8>(), 0..5_u8), 1..6)) {
        let mut bytes = ARM.as_bytes().to_vec();
        for (a, b, byte, kind) in edits {
            let (a, b) = (a.min(bytes.len()), b.min(bytes.len()));
            let (from, to) = (a.min(b), a.max(b));
            match kind {
                0 if a < bytes.len() => bytes[a] = byte,
                1 => bytes.insert(a, byte),
                2 => drop(bytes.drain(from..to.min(from + 40))),
                3 => {
                    let copy = bytes[from..to.min(from + 60)].to_vec();
                    let place = usize::from(byte) * bytes.len() / 256;
                    bytes.splice(place..place, copy);
                }
                _ => bytes.truncate(bytes.len() - bytes.len() / 50 * usize::from(byte > 200)),
            }
        }
        survives(&bytes);
    }

    #[test]
    fn random_markup(parts in prop::collection::vec(prop::sample::select(vec![
        "<", ">", "</", "/>", "<!", "<!--", "-->", "<![CDATA[", "]]>", "<?", "?>", "<?xml", "&", ";", "&#", "\"", "'", "=", " ", "\n",
        "robot", "link", "joint", "<robot>", "</robot>", "<link name='a'/>", "<joint name='j' type='revolute'>", "</joint>",
        "name='b'", "é", "\u{feff}", "<!DOCTYPE", "[", "]", "\0",
    ]), 0..40)) {
        survives(parts.concat().as_bytes());
    }

    #[test]
    fn random_numbers(text in "[-+0-9.eEinfa ]{0,24}") {
        for from in ["value=\"2.5\"", "xyz=\"0 0 0.3\"", "rpy=\"0.1 0.2 0.3\"", "xyz=\"0 2 0\"", "upper=\"2.5\"", "ixx=\"0.02\"", "value=\"2e-5\""] {
            let name = from.split('=').next().unwrap_or_default();
            survives(ARM.replace(from, &format!("{name}=\"{text}\"")).as_bytes());
        }
    }
}
