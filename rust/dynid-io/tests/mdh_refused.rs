//! One sound table, one thing spoiled per case: every refusal names its place, its key and the mend; and hostile files.

use std::time::{Duration, Instant};

use dynid_io::mdh::{parse, MdhError, MdhOptions};

const ARM: &str = r#"name = "arm"
angle = "deg"
gravity = [0.0, 0.0, -9.81]

[base]
xyz = [0.1, 0.2, 0.3]
rpy = [0.0, 10.0, 0.0]

[[joint]]
name = "shoulder"
link = "upper"
kind = "revolute"
alpha = 0.0
a = 0.25
d = 0.5
theta = -90.0
lower = -170.0
upper = 160.0
velocity = 180.0
acceleration = 720.0
effort = 250.0
gear_ratio = 121.0
rotor_inertia = 3.2e-4
mass = 12.0
com = [0.1, 0.0, -0.02]
inertia_com = { xx = 0.05, yy = 0.21, zz = 0.2 }
inertia_rpy = [0.0, 0.0, 45.0]

[[joint]]
name = "elbow"
alpha = 90.0
a = 0.35
d = 0.0
theta = 15.0

[tool]
xyz = [0.3, 0.0, 0.0]
mass = 1.5
com = [0.0, 0.0, 0.05]
inertia_origin = { xx = 0.004, yy = 0.004, zz = 0.002, xy = 0.001 }
"#;

/// `from` becomes `to`; the refusal of `key` points at the first `at` from there on, or else before it.
type Case = (
    &'static str,
    &'static str,
    &'static str,
    &'static str,
    &'static str,
);

fn refusal(text: &[u8]) -> (usize, usize, String, String) {
    match parse(text, "arm.toml", &MdhOptions::default()) {
        Err(MdhError::Invalid {
            file,
            line,
            column,
            place,
            message,
        }) => {
            assert_eq!(file, "arm.toml");
            (line, column, place, message)
        }
        other => panic!(
            "{}: {other:?}",
            String::from_utf8_lossy(&text[..text.len().min(400)])
        ),
    }
}

/// Line and column of an offset, counted the slow way.
fn count(text: &str, at: usize) -> (usize, usize) {
    let start = text[..at].rfind('\n').map_or(0, |newline| newline + 1);
    (
        text[..at].matches('\n').count() + 1,
        text[start..at].chars().count() + 1,
    )
}

fn check(cases: &[Case]) {
    for &(from, to, at, key, says) in cases {
        assert_eq!(ARM.matches(from).count(), 1, "{from:?} must stand once");
        let text = ARM.replace(from, to);
        let start = ARM.find(from).expect("counted");
        let found = text[start..]
            .find(at)
            .map(|found| start + found)
            .or_else(|| text.find(at))
            .unwrap_or_else(|| panic!("{at:?} is not in the text"));
        let (line, column, place, message) = refusal(text.as_bytes());
        assert_eq!((line, column), count(&text, found), "{to}: {message}");
        assert_eq!(place, key, "{to}: {message}");
        assert!(message.contains(says), "{to}: {message}\nexpected: {says}");
    }
}

#[test]
fn the_arm_itself_is_sound() {
    let robot = parse(ARM, "arm.toml", &MdhOptions::default()).expect("sound");
    assert_eq!(robot.n_joints(), 2);
}

#[test]
fn a_refusal_reads_as_one_line() {
    let text = ARM.replace("a = 0.35", "a = \"0.35\"");
    let error = parse(text, "robot.toml", &MdhOptions::default()).expect_err("spoiled");
    assert_eq!(
        error.to_string(),
        "robot.toml:32:5: a of joint \"elbow\": must be a number, found the text \"0.35\""
    );
}

#[test]
fn keys() {
    check(&[
        (
            "alpha = 90.0",
            "aplha = 90.0",
            "aplha",
            "aplha of joint 2",
            "is alpha meant?",
        ),
        (
            "lower = -170.0",
            "low = -170.0",
            "low",
            "low of joint 1",
            "is lower meant?",
        ),
        (
            "velocity",
            "vel",
            "vel",
            "vel of joint 1",
            "is velocity meant?",
        ),
        (
            "gear_ratio",
            "gear",
            "gear",
            "gear of joint 1",
            "is gear_ratio meant?",
        ),
        (
            "inertia_origin",
            "inertia",
            "inertia",
            "inertia of tool",
            "is inertia_",
        ),
        (
            "inertia_origin = { xx",
            "inertia_origin = { ixx",
            "ixx",
            "ixx of inertia_origin of tool",
            "is xx meant?",
        ),
        ("[tool]", "[tol]", "tol", "tol", "is tool meant?"),
        (
            "[base]\nxyz",
            "[base]\nxzy",
            "xzy",
            "xzy of base",
            "is xyz meant?",
        ),
        (
            "angle = \"deg\"",
            "angel = \"deg\"",
            "angel",
            "angel",
            "is angle meant?",
        ),
        (
            "d = 0.5",
            "d = 0.5\nfriction = 1",
            "friction",
            "friction of joint 1",
            "expected name, link, kind",
        ),
        (
            "d = 0.5",
            "d = 0.5\nd = 0.5",
            "d = 0.5\ntheta",
            "text",
            "duplicate key",
        ),
    ]);
}

#[test]
fn what_is_missing() {
    check(&[
        (
            "angle = \"deg\"\n",
            "",
            "name = \"arm\"",
            "angle",
            "is missing; write angle = \"deg\" or angle = \"rad\"",
        ),
        (
            "alpha = 90.0\n",
            "",
            "[[joint]]\nname = \"elbow\"",
            "alpha of joint \"elbow\"",
            "is missing; write alpha = 0.0 if there is none",
        ),
        (
            "a = 0.35\n",
            "",
            "[[joint]]\nname = \"elbow\"",
            "a of joint \"elbow\"",
            "is missing",
        ),
        (
            "d = 0.0\n",
            "",
            "[[joint]]\nname = \"elbow\"",
            "d of joint \"elbow\"",
            "is missing",
        ),
        (
            "theta = 15.0\n",
            "",
            "[[joint]]\nname = \"elbow\"",
            "theta of joint \"elbow\"",
            "is missing",
        ),
        (
            "lower = -170.0\n",
            "",
            "[[joint]]\nname = \"shoulder\"",
            "lower of joint \"shoulder\"",
            "beside upper, or neither",
        ),
        (
            "upper = 160.0\n",
            "",
            "[[joint]]\nname = \"shoulder\"",
            "upper of joint \"shoulder\"",
            "beside lower, or neither",
        ),
        (
            "gear_ratio = 121.0\n",
            "",
            "[[joint]]\nname = \"shoulder\"",
            "gear_ratio of joint \"shoulder\"",
            "beside rotor_inertia",
        ),
        (
            "mass = 1.5\n",
            "",
            "[tool]",
            "mass of tool",
            "mass = ... in kg beside com",
        ),
        (
            "com = [0.0, 0.0, 0.05]\n",
            "",
            "[tool]",
            "com of tool",
            "com = [x, y, z] in m beside mass",
        ),
        (
            "inertia_origin = { xx = 0.004, yy = 0.004, zz = 0.002, xy = 0.001 }\n",
            "",
            "[tool]",
            "inertia_com of tool",
            "inertia_com = { xx",
        ),
        (
            "{ xx = 0.05, ",
            "{ ",
            "{ yy",
            "xx of inertia_com of joint \"shoulder\"",
            "is missing; write xx = ... in kg m^2",
        ),
    ]);
    let (line, column, place, message) = refusal(b"angle = 'rad'\n");
    assert_eq!((line, column, place.as_str()), (1, 1, "joint"));
    assert!(
        message.contains("one [[joint]] table per joint"),
        "{message}"
    );
}

#[test]
fn values() {
    check(&[
        (
            "a = 0.25",
            "a = nan",
            "nan",
            "a of joint \"shoulder\"",
            "must be a finite number, found nan",
        ),
        (
            "a = 0.25",
            "a = -inf",
            "-inf",
            "a of joint \"shoulder\"",
            "must be a finite number, found -inf",
        ),
        (
            "a = 0.25",
            "a = 1e999",
            "1e999",
            "a of joint \"shoulder\"",
            "must be a finite number, found 1e999",
        ),
        (
            "a = 0.25",
            "a = 1e13",
            "1e13",
            "a of joint \"shoulder\"",
            "check the exponent",
        ),
        (
            "a = 0.25",
            "a = 99999999999999999999999",
            "9999",
            "a of joint \"shoulder\"",
            "check the exponent",
        ),
        (
            "a = 0.25",
            "a = 0x19",
            "0x19",
            "a of joint \"shoulder\"",
            "must be a number",
        ),
        (
            "a = 0.25",
            "a = true",
            "true",
            "a of joint \"shoulder\"",
            "must be a number, found true",
        ),
        (
            "a = 0.25",
            "a = 1979-05-27",
            "1979",
            "a of joint \"shoulder\"",
            "must be a number, found a date",
        ),
        (
            "a = 0.25",
            "a = [0.25]",
            "[0.25]",
            "a of joint \"shoulder\"",
            "must be a number, found a list of 1",
        ),
        (
            "a = 0.25",
            "a = { m = 1 }",
            "{ m",
            "a of joint \"shoulder\"",
            "must be a number, found a table",
        ),
        (
            "theta = 15.0",
            "theta = 361.0",
            "361",
            "theta of joint \"elbow\"",
            "is 361 deg, more than a turn",
        ),
        (
            "\"deg\"",
            "\"rad\"",
            "[0.0, 10.0, 0.0]",
            "rpy of base",
            "is 10 rad, more than a turn; is angle = \"deg\" meant?",
        ),
        (
            "\"deg\"",
            "\"grad\"",
            "\"grad\"",
            "angle",
            "must be \"deg\" or \"rad\"",
        ),
        ("\"deg\"", "1", "1", "angle", "must be \"deg\" or \"rad\""),
        (
            "\"revolute\"",
            "\"continuous\"",
            "\"continuous\"",
            "kind of joint \"shoulder\"",
            "must be \"revolute\" or \"prismatic\", found \"continuous\"",
        ),
        (
            "lower = -170.0",
            "lower = 170.0",
            "170.0",
            "lower of joint \"shoulder\"",
            "is 170, above upper, 160; swap or correct them",
        ),
        (
            "velocity = 180.0",
            "velocity = -1",
            "-1",
            "velocity of joint \"shoulder\"",
            "expected zero or more: it is a greatest speed",
        ),
        (
            "acceleration = 720.0",
            "acceleration = -1",
            "-1",
            "acceleration of joint \"shoulder\"",
            "a greatest acceleration",
        ),
        (
            "effort = 250.0",
            "effort = -1",
            "-1",
            "effort of joint \"shoulder\"",
            "a greatest torque or force",
        ),
        (
            "gear_ratio = 121.0",
            "gear_ratio = -121.0",
            "-121.0",
            "gear_ratio of joint \"shoulder\"",
            "a direction belongs into [signs]",
        ),
        (
            "gear_ratio = 121.0",
            "gear_ratio = 0",
            "0",
            "gear_ratio of joint \"shoulder\"",
            "above zero",
        ),
        (
            "rotor_inertia = 3.2e-4",
            "rotor_inertia = -1e-4",
            "-1e-4",
            "rotor_inertia of joint \"shoulder\"",
            "the motor's own inertia",
        ),
        (
            "mass = 12.0",
            "mass = -12.0",
            "-12.0",
            "mass of joint \"shoulder\"",
            "a mass in kg",
        ),
        (
            "com = [0.1, 0.0, -0.02]",
            "com = [0.1, 0.0]",
            "[0.1, 0.0]",
            "com of joint \"shoulder\"",
            "must be three numbers, written as [x, y, z], found a list of 2",
        ),
        (
            "com = [0.1, 0.0, -0.02]",
            "com = [0.1, \"0\", 0]",
            "\"0\"",
            "com of joint \"shoulder\"",
            "must be three numbers, found the text \"0\"",
        ),
        (
            "com = [0.1, 0.0, -0.02]",
            "com = { x = 1 }",
            "{ x",
            "com of joint \"shoulder\"",
            "must be three numbers",
        ),
        (
            "inertia_com = { xx = 0.05, yy = 0.21, zz = 0.2 }",
            "inertia_com = [1, 2, 3]",
            "[1, 2",
            "inertia_com of joint \"shoulder\"",
            "must be a table of xx, yy, zz, xy, xz, yz",
        ),
        (
            "mass = 12.0",
            "mass = 12.0\ninertia_origin = { xx = 1, yy = 1, zz = 1 }",
            "{ xx = 1,",
            "inertia_origin of joint \"shoulder\"",
            "says the same; keep one",
        ),
        (
            "mass = 1.5",
            "mass = 1.5\ninertia_rpy = [0, 0, 1]",
            "[0, 0, 1]",
            "inertia_rpy of tool",
            "turns inertia_com only",
        ),
        (
            "gravity = [0.0, 0.0, -9.81]",
            "gravity = -9.81",
            "-9.81",
            "gravity",
            "must be three numbers",
        ),
        (
            "name = \"arm\"",
            "name = \"\"",
            "\"\"",
            "name",
            "must be a name of at most 256 bytes on one line",
        ),
        (
            "name = \"elbow\"",
            "name = \"el\\nbow\"",
            "\"el\\nbow\"",
            "name of joint 2",
            "found \"el\\nbow\"",
        ),
        (
            "name = \"elbow\"",
            "name = 7",
            "7",
            "name of joint 2",
            "must be a name in quotes, found 7",
        ),
        (
            "name = \"elbow\"",
            "name = \"shoulder\"",
            "\"shoulder\"\nalpha",
            "name of joint \"shoulder\"",
            "joint 1 has this name already; rename one",
        ),
        (
            "[base]",
            "[[base]]",
            "[[base]]",
            "base",
            "must be a table of xyz, rpy, found a list of 1",
        ),
    ]);
}

#[test]
fn the_joints_are_a_list_of_tables() {
    for (text, says) in [
        (
            "angle = 'rad'\n[joint]\na = 1\n",
            "must be a list of tables, each written as [[joint]], found a table",
        ),
        ("angle = 'rad'\njoint = 3\n", "must be a list of tables"),
        (
            "angle = 'rad'\njoint = [1, 2]\n",
            "must be a list of tables, each written as [[joint]], found 1",
        ),
    ] {
        let (_, _, place, message) = refusal(text.as_bytes());
        assert_eq!(place, "joint");
        assert!(message.contains(says), "{message}");
    }
}

#[test]
fn what_is_no_toml() {
    for (text, says) in [
        (
            &b"<?xml version='1.0'?><robot name='r'/>"[..],
            "this looks like a URDF",
        ),
        (b"angle = \"deg", "is not valid TOML"),
        (b"[[joint]\n", "is not valid TOML"),
        (
            b"a = \xFF",
            "this byte is not UTF-8; save the file as UTF-8",
        ),
        (b"\xFF\xFEa\0", "this byte is not UTF-8"),
        (b"a = 1\0", "is not valid TOML"),
    ] {
        let (.., message) = refusal(text);
        assert!(message.contains(says), "{message}");
    }
    assert!(refusal(b"").3.contains("is missing"));
}

#[test]
fn hostile_files_are_refused_quickly_and_without_a_panic() {
    let row = "[[joint]]\nalpha = 0\na = 0\nd = 0\ntheta = 0\n";
    let start = Instant::now();
    for (text, says) in [
        (
            "x = ".to_owned() + &"[".repeat(900_000),
            "is not valid TOML",
        ),
        (
            "x = ".to_owned() + &"{a=".repeat(300_000),
            "is not valid TOML",
        ),
        ("a.".repeat(400_000) + "b = 1", "is not valid TOML"),
        (
            "[".to_owned() + &"a.".repeat(400_000) + "b]",
            "is not valid TOML",
        ),
        (
            format!("{} = 1", "k".repeat(1_000_000)),
            "this key is not known",
        ),
        (
            format!("name = \"{}\"\nangle = 'rad'\n{row}", "n".repeat(1_000_000)),
            "at most 256 bytes",
        ),
        (
            format!("angle = 'rad'\n{}", row.repeat(257)),
            "257 joints, expected at most 256",
        ),
        (
            format!("angle = 'rad'\n{}", "[[joint]]\n".repeat(100_000)),
            "100000 joints, expected at most 256",
        ),
        (
            (0..90_000).map(|k| format!("k{k} = 0\n")).collect(),
            "this key is not known",
        ),
        (
            format!("angle = 'rad'\na = [{}]", "0,".repeat(500_000)),
            "this key is not known",
        ),
        (
            format!("gravity = [{}]\nangle = 'rad'\n{row}", "0,".repeat(500_000)),
            "found a list of 500000",
        ),
        (
            format!(
                "gravity = [{}, 0, 0]\nangle = 'rad'\n{row}",
                "9".repeat(1_000_000)
            ),
            "must be a finite number",
        ),
        ("#".repeat(1_048_577), "larger than 1048576 bytes"),
    ] {
        let (.., message) = refusal(text.as_bytes());
        assert!(message.contains(says), "{message}");
        assert!(message.len() < 400, "{} bytes", message.len());
    }
    assert!(start.elapsed() < Duration::from_secs(10));
    let most = parse(
        format!("angle = 'rad'\n{}", row.repeat(256)),
        "r",
        &MdhOptions::default(),
    );
    assert_eq!(most.expect("sound").n_joints(), 256);
}

/// Cut anywhere, and with any one byte replaced: an error or a robot, never a panic.
#[test]
fn no_cut_and_no_byte_makes_it_panic() {
    for end in 0..ARM.len() {
        let _ = parse(&ARM[..end], "cut", &MdhOptions::default());
        for byte in [b'\0', b'"', b'[', b']', b'{', b'=', b'\n', b'9', 0x80] {
            let mut bytes = ARM.as_bytes().to_vec();
            bytes[end] = byte;
            let _ = parse(&bytes, "spoilt", &MdhOptions::default());
        }
    }
}
