//! What a sound URDF becomes: placements, axes, limits, lumped links, rotors, chains.

use dynid_core::link_params::inertia_matrix;
use dynid_core::robot::{JointKind, JointLimits, RobotModel};
use dynid_io::urdf::{load, parse, parse_with_notes, UrdfError, UrdfOptions};
use nalgebra::{Matrix3, Rotation3, Vector3};

const ARM: &str = include_str!("urdf_hostile/arm.urdf");
/// Same mathematics, other order of operations.
const ALGEBRAIC: f64 = 1e-14;

fn arm() -> RobotModel {
    parse(ARM, "arm", &UrdfOptions::default()).expect("sound")
}

fn options(base: Option<&str>, tip: Option<&str>) -> UrdfOptions {
    UrdfOptions {
        base: base.map(str::to_owned),
        tip: tip.map(str::to_owned),
        ..UrdfOptions::default()
    }
}

/// A link of 1 kg at its own origin.
fn link(name: &str) -> String {
    format!(
        "<link name='{name}'><inertial><mass value='1'/>\
         <inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial></link>\n"
    )
}

/// A robot of joints `"parent>child type"`, joints named after their child.
fn robot(joints: &[&str]) -> String {
    let mut names: Vec<&str> = Vec::new();
    let mut text = String::new();
    for joint in joints {
        let (links, kind) = joint.split_once(' ').expect("type");
        let (parent, child) = links.split_once('>').expect("links");
        for name in [parent, child] {
            if !names.contains(&name) {
                names.push(name);
                text += &link(name);
            }
        }
        text += &format!(
            "<joint name='{child}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>\
             <origin xyz='1 0 0'/></joint>\n"
        );
    }
    format!("<robot name='made'>\n{text}</robot>")
}

fn chain(joints: &[&str], options: &UrdfOptions) -> Result<Vec<String>, String> {
    let robot = parse(robot(joints), "made", options).map_err(|error| error.to_string())?;
    Ok(robot
        .joints()
        .iter()
        .map(|joint| joint.name.clone())
        .collect())
}

#[test]
fn names_kinds_and_limits() {
    let arm = arm();
    assert_eq!(arm.name(), "mini");
    assert_eq!(*arm.gravity(), Vector3::new(0.0, 0.0, -9.81));
    let named: Vec<_> = arm
        .joints()
        .iter()
        .map(|j| (j.name.as_str(), j.link.as_str(), j.kind))
        .collect();
    let expected = [
        ("shoulder", "upper", JointKind::Revolute),
        ("rail", "slider", JointKind::Prismatic),
        ("roll", "wrist", JointKind::Revolute),
    ];
    assert_eq!(named, expected);
    let limits: Vec<_> = arm.joints().iter().map(|j| j.limits).collect();
    assert_eq!(
        limits[0],
        JointLimits {
            lower: -2.0,
            upper: 2.5,
            velocity: 3.0,
            effort: 80.0,
            ..JointLimits::default()
        }
    );
    assert_eq!(
        limits[1],
        JointLimits {
            lower: 0.0,
            upper: 0.4,
            velocity: 0.5,
            effort: 200.0,
            ..JointLimits::default()
        }
    );
    assert_eq!(limits[2], JointLimits::default());
    let axes: Vec<_> = arm.joints().iter().map(|j| j.axis).collect();
    assert_eq!(axes, [Vector3::z(), Vector3::y(), Vector3::x()]);
}

#[test]
fn limits_that_are_not_declared_are_infinite() {
    let with = |kind: &str, limit: &str| {
        let text = robot(&[&format!("a>b {kind}")]).replace("<origin", &format!("{limit}<origin"));
        parse(text, "f", &UrdfOptions::default())
            .expect("sound")
            .joints()[0]
            .limits
    };
    let open = JointLimits::default();
    assert_eq!(with("revolute", ""), open);
    assert_eq!(with("prismatic", "<limit/>"), open);
    assert_eq!(
        with("revolute", "<limit velocity='2'/>"),
        JointLimits {
            velocity: 2.0,
            ..open
        }
    );
    assert_eq!(
        with("revolute", "<limit effort='2'/>"),
        JointLimits {
            effort: 2.0,
            ..open
        }
    );
    assert_eq!(
        with("prismatic", "<limit upper='0.3'/>"),
        JointLimits {
            lower: 0.0,
            upper: 0.3,
            ..open
        }
    );
    assert_eq!(
        with("prismatic", "<limit lower='-0.3'/>"),
        JointLimits {
            lower: -0.3,
            upper: 0.0,
            ..open
        }
    );
    assert_eq!(
        with("continuous", "<limit lower='-1' upper='1' effort='5'/>"),
        JointLimits {
            effort: 5.0,
            ..open
        }
    );
    let beyond_any_robot = "<limit lower='-1.7e308' upper='1e30' velocity='1e30' effort='1e13'/>";
    assert_eq!(with("prismatic", beyond_any_robot), open);
}

#[test]
fn rpy_turns_about_fixed_axes() {
    let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle).into_inner();
    let expected = about(Vector3::z_axis(), 0.3)
        * about(Vector3::y_axis(), 0.2)
        * about(Vector3::x_axis(), 0.1);
    let arm = arm();
    let shoulder = &arm.joints()[0];
    assert!((shoulder.rotation - expected).amax() < ALGEBRAIC);
    assert_eq!(shoulder.translation, Vector3::new(0.0, 0.0, 0.3));
    // A quarter turn about y maps x to -z.
    assert!((arm.joints()[1].rotation * Vector3::x() + Vector3::z()).amax() < ALGEBRAIC);
}

#[test]
fn a_fixed_tool_is_lumped_into_the_wrist() {
    // By hand: 0.4 kg at (0, 0.1, 0.05) of the wrist; the quarter turn about z leaves the sphere's inertia as it is.
    let com = Vector3::new(0.0, 0.1, 0.05);
    let m = 0.4;
    let (ixx, iyy, izz) = (
        0.001 + m * (0.01 + 0.0025),
        0.001 + m * 0.0025,
        0.001 + m * 0.01,
    );
    let expected = [
        m,
        0.0,
        m * com.y,
        m * com.z,
        ixx,
        0.0,
        iyy,
        0.0,
        -m * com.y * com.z,
        izz,
    ];
    for (a, b) in arm().joints()[2].phi.iter().zip(expected) {
        assert!(
            (a - b).abs() < ALGEBRAIC,
            "{:?}\n{expected:?}",
            arm().joints()[2].phi
        );
    }
}

#[test]
fn inertia_is_moved_from_the_centre_to_the_link_origin() {
    let phi = arm().joints()[0].phi;
    let com = Vector3::new(0.1, 0.0, 0.2);
    assert_eq!(phi[0], 2.5);
    assert!((Vector3::new(phi[1], phi[2], phi[3]) - com * 2.5).amax() < ALGEBRAIC);
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.3).into_inner();
    let own = Matrix3::new(0.02, 0.001, 0.0, 0.001, 0.03, 0.0, 0.0, 0.0, 0.025);
    let steiner = (Matrix3::identity() * com.dot(&com) - com * com.transpose()) * 2.5;
    let expected = turn * own * turn.transpose() + steiner;
    assert!((inertia_matrix(&phi) - expected).amax() < ALGEBRAIC);
}

#[test]
fn fixed_joints_before_and_between_are_composed() {
    let text = robot(&[
        "world>a fixed",
        "a>b fixed",
        "b>c revolute",
        "c>d fixed",
        "d>e revolute",
        "e>f fixed",
    ]);
    let text = text
        .replace(
            "name='d' type='fixed'><",
            "name='d' type='fixed'><origin xyz='0 0 0' rpy='0 0 1.5707963267948966'/><",
        )
        .replacen(
            "<child link='d'/><origin xyz='1 0 0'/>",
            "<child link='d'/>",
            1,
        );
    let robot = parse(text, "f", &UrdfOptions::default()).expect("sound");
    let [first, second] = robot.joints() else {
        panic!("two joints")
    };
    assert_eq!(first.translation, Vector3::new(3.0, 0.0, 0.0));
    assert!(
        (second.translation - Vector3::y()).amax() < ALGEBRAIC,
        "{}",
        second.translation
    );
    // c and d, d at c's origin; e and f, f one metre along x.
    assert_eq!(first.phi[..4], [2.0, 0.0, 0.0, 0.0]);
    assert_eq!(second.phi[..4], [2.0, 1.0, 0.0, 0.0]);
}

#[test]
fn long_products_of_rotations_stay_orthonormal() {
    let names: Vec<String> = (0..1900)
        .map(|i| format!("l{i}>l{} fixed", i + 1))
        .chain(["l1900>end revolute".to_owned()])
        .collect();
    let text = robot(&names.iter().map(String::as_str).collect::<Vec<_>>())
        .replace("xyz='1 0 0'", "xyz='0 0 0' rpy='1 2 3'");
    let rotation = parse(text, "f", &UrdfOptions::default())
        .expect("sound")
        .joints()[0]
        .rotation;
    assert!((rotation * rotation.transpose() - Matrix3::identity()).amax() < 1e-15);
}

#[test]
fn rotor_inertia_is_reflected() {
    let rotors = |text: &str, options: &UrdfOptions| -> Vec<f64> {
        parse(text, "f", options)
            .expect("sound")
            .joints()
            .iter()
            .map(|j| j.rotor_inertia)
            .collect()
    };
    let declared = rotors(ARM, &UrdfOptions::default());
    assert!(
        (declared[0] - 0.2).abs() < 1e-15 && declared[1..] == [0.0, 0.0],
        "{declared:?}"
    );
    let ratio = "<mechanicalReduction>100</mechanicalReduction>";
    let drake = ARM.replace(ratio, "<drake:gear_ratio value='-50'/>");
    assert!((rotors(&drake, &UrdfOptions::default())[0] - 0.05).abs() < 1e-15);
    assert_eq!(
        rotors(&ARM.replace(ratio, ""), &UrdfOptions::default())[0],
        2e-5
    );
    let own = UrdfOptions {
        rotor_inertia: Some(vec![1.0, 0.0, 3.0]),
        ..UrdfOptions::default()
    };
    assert_eq!(rotors(ARM, &own), [1.0, 0.0, 3.0]);
    // Without a rotor inertia a transmission never matters.
    let idle = ARM
        .replace("<drake:rotor_inertia value=\"2e-5\"/>", "")
        .replace(">100<", ">n/a<");
    assert_eq!(rotors(&idle, &UrdfOptions::default()), [0.0; 3]);
}

#[test]
fn options_that_do_not_fit() {
    for (options, option, says) in [
        (
            options(Some("bse"), None),
            "base",
            "no link is named \"bse\"; the links are \"base\", \"upper\"",
        ),
        (
            options(None, Some("hand")),
            "tip",
            "no link is named \"hand\"",
        ),
        (
            options(Some("slider"), Some("upper")),
            "tip",
            "does not hang on the base",
        ),
        (
            UrdfOptions {
                gravity: [0.0, f64::NAN, 0.0],
                ..options(None, None)
            },
            "gravity",
            "three finite numbers",
        ),
        (
            UrdfOptions {
                rotor_inertia: Some(vec![1.0]),
                ..options(None, None)
            },
            "rotor_inertia",
            "has 1 values, expected 3",
        ),
        (
            UrdfOptions {
                rotor_inertia: Some(vec![0.0, -1.0, 0.0]),
                ..options(None, None)
            },
            "rotor_inertia",
            "holds -1",
        ),
        (
            UrdfOptions {
                rotor_inertia: Some(vec![0.0, f64::INFINITY, 0.0]),
                ..options(None, None)
            },
            "rotor_inertia",
            "holds inf",
        ),
    ] {
        let error = parse(ARM, "arm", &options).expect_err(says);
        assert!(
            matches!(&error, UrdfError::Option { option: o, .. } if *o == option),
            "{error}"
        );
        assert!(error.to_string().contains(says), "{error}");
    }
}

#[test]
fn base_and_tip_cut_the_chain() {
    let none = UrdfOptions::default();
    let two_arms = [
        "world>l1 revolute",
        "l1>l2 revolute",
        "world>r1 revolute",
        "r1>r2 revolute",
        "r2>rt fixed",
    ];
    assert_eq!(
        chain(&two_arms, &options(None, Some("rt"))).as_deref(),
        Ok(&["r1".to_owned(), "r2".to_owned()][..])
    );
    assert_eq!(
        chain(&two_arms, &options(None, Some("l2"))).expect("left"),
        ["l1", "l2"]
    );
    assert_eq!(
        chain(&two_arms, &options(Some("r1"), None)).expect("below"),
        ["r2"]
    );
    // Equally long: the first of the file.
    assert_eq!(chain(&two_arms, &none).expect("left"), ["l1", "l2"]);
    // Fixed frames are no branches, wherever they hang.
    let frames = [
        "b>x fixed",
        "b>l1 revolute",
        "l1>cam fixed",
        "cam>lens fixed",
        "l1>l2 revolute",
        "l2>tool0 fixed",
        "l2>ft fixed",
    ];
    assert_eq!(chain(&frames, &none).expect("one way"), ["l1", "l2"]);
    assert_eq!(
        chain(&frames, &options(None, Some("ft"))).expect("one way"),
        ["l1", "l2"]
    );
    // A gripper that moves.
    let gripper = ["b>l1 revolute", "l1>f1 prismatic", "l1>f2 prismatic"];
    assert_eq!(
        chain(&gripper, &options(None, Some("f2"))).expect("f1 stands"),
        ["l1", "f2"]
    );
    assert_eq!(
        chain(&gripper, &options(None, Some("l1"))).expect("both stand"),
        ["l1"]
    );
    let held = ["b>l1 revolute", "l1>f1 fixed", "l1>f2 fixed"];
    assert_eq!(chain(&held, &none).expect("held"), ["l1"]);
    // A mobile platform.
    let mobile = ["odom>cart floating", "cart>l1 revolute"];
    assert!(chain(&mobile, &none)
        .expect_err("floats")
        .contains("choose base=\"cart\""));
    assert_eq!(
        chain(&mobile, &options(Some("cart"), None)).expect("stands"),
        ["l1"]
    );
}

#[test]
fn up_to_256_joints() {
    let joints = |n: usize| {
        (0..n)
            .map(|i| format!("l{i}>l{} revolute", i + 1))
            .collect::<Vec<_>>()
    };
    let count = |n: usize| {
        chain(
            &joints(n).iter().map(String::as_str).collect::<Vec<_>>(),
            &UrdfOptions::default(),
        )
    };
    assert_eq!(count(256).expect("256").len(), 256);
    assert!(count(257)
        .expect_err("257")
        .contains("257 joints move, expected at most 256"));
}

#[test]
fn notes_say_what_was_passed_over() {
    let notes = parse_with_notes(ARM, "arm.urdf", &UrdfOptions::default())
        .expect("sound")
        .notes;
    let all = notes.join("\n");
    for says in [
        "arm.urdf:44:5: <axis> of joint \"rail\": brought to unit length",
        "<visual> (1)",
        "<gazebo> (1)",
        "<dynamics> (1)",
        "fixed links count as part of \"wrist\": \"tool\"",
    ] {
        assert!(all.contains(says), "{says}\n{all}");
    }
    assert_eq!(notes.len(), 3, "{all}");
    for (from, to, says) in [
        ("rpy=\"0.1 0.2 0.3\"", "rpy=\"0 90 0\"", "read in radians"),
        (
            "velocity=\"3\"",
            "velocity=\"0\"",
            "range of zero is taken literally",
        ),
        ("lower=\"-2\"", "", "only one of lower and upper"),
        (
            "<link name=\"wrist\"/>",
            "<link name=\"wrist\"/>>",
            "text between elements does not count: \">\"",
        ),
        ("<robot name=\"mini\">", "<robot>", "the robot has no name"),
    ] {
        let text = ARM.replace(from, to);
        let notes = parse_with_notes(text, "f", &UrdfOptions::default())
            .expect(to)
            .notes
            .join("\n");
        assert!(notes.contains(says), "{notes}");
    }
}

#[test]
fn a_second_origin_counts_only_where_it_changes_no_torque() {
    let text = |rpy: &str| {
        robot(&["world>base fixed", "base>l1 revolute"]).replacen(
            "<origin xyz='1 0 0'/>",
            &format!("<origin xyz='1 0 0'/><origin xyz='9 0 0' {rpy}/>"),
            1,
        )
    };
    let loaded = parse_with_notes(text(""), "f", &UrdfOptions::default()).expect("placement only");
    assert_eq!(loaded.robot.joints()[0].translation.x, 2.0);
    assert!(
        loaded
            .notes
            .iter()
            .any(|note| note.contains("the first one counts, as in ROS")),
        "{:?}",
        loaded.notes
    );
    let error = parse(text("rpy='1 0 0'"), "f", &UrdfOptions::default())
        .expect_err("gravity")
        .to_string();
    assert!(
        error.contains("readers differ in which one counts"),
        "{error}"
    );
}

#[test]
fn odd_but_sound_spellings() {
    let text = "<robot name='a&amp;b'>\n<link name=\"L &lt;1&gt;\"/><link name='é'></link>\
                <joint type=' revolute ' name='j\"1'><child link='é'/><parent link='L &lt;1&gt;'/>\
                <origin rpy=' 0\n0\t+1e-1 ' xyz='.5 5. -0'/></joint>\n<!-- end --></robot>\n<?end?>\n";
    let robot = parse(text, "f", &UrdfOptions::default()).expect("sound");
    assert_eq!(
        (
            robot.name(),
            robot.joints()[0].name.as_str(),
            robot.joints()[0].link.as_str()
        ),
        ("a&b", "j\"1", "é")
    );
    assert_eq!(robot.joints()[0].translation, Vector3::new(0.5, 5.0, 0.0));
    assert_eq!(robot.joints()[0].phi, [0.0; 10]);
}

#[test]
fn file_errors_keep_their_kind() {
    let options = UrdfOptions::default();
    let missing = load("no/such/robot.urdf".as_ref(), &options).expect_err("missing");
    assert!(
        matches!(&missing, UrdfError::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound),
        "{missing}"
    );
    assert!(
        missing
            .to_string()
            .starts_with("no/such/robot.urdf: cannot be read"),
        "{missing}"
    );
    assert!(matches!(
        load(".".as_ref(), &options),
        Err(UrdfError::Io { .. })
    ));
}

/// Robots of measured data sets, where they are at hand.
#[test]
fn measured_robots_load() {
    let root = std::env::var("DYNID_DATA").unwrap_or_else(|_| {
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data").to_owned()
    });
    let Ok(folders) = std::fs::read_dir(root) else {
        return;
    };
    let files = folders
        .flatten()
        .map(|folder| folder.path().join("robot.urdf"))
        .filter(|path| path.is_file());
    for path in files {
        let robot = load(&path, &UrdfOptions::default()).unwrap_or_else(|error| panic!("{error}"));
        assert!(
            matches!(robot.n_joints(), 6 | 7),
            "{}: {}",
            path.display(),
            robot.n_joints()
        );
    }
}

#[test]
fn gear_ratios_come_with_their_rotors() {
    let ratios = |text: &str| -> Vec<Option<f64>> {
        let arm = parse(text, "f", &UrdfOptions::default()).expect("sound");
        arm.joints().iter().map(|j| j.gear_ratio).collect()
    };
    assert_eq!(ratios(ARM), [Some(100.0), None, None]);
    let ratio = "<mechanicalReduction>100</mechanicalReduction>";
    // The sign is a direction.
    let drake = ARM.replace(ratio, "<drake:gear_ratio value='-50'/>");
    assert_eq!(ratios(&drake), [Some(50.0), None, None]);
    assert_eq!(ratios(&ARM.replace(ratio, "")), [None; 3]);
}

#[test]
fn limits_may_hold_an_acceleration() {
    let text = ARM.replace(
        "velocity=\"3\"",
        "velocity=\"3\" acceleration=\"7\" jerk=\"9\"",
    );
    let arm = parse(text, "f", &UrdfOptions::default()).expect("sound");
    let accelerations: Vec<f64> = arm.joints().iter().map(|j| j.limits.acceleration).collect();
    assert_eq!(accelerations, [7.0, f64::INFINITY, f64::INFINITY]);
}

#[test]
fn what_other_programs_write_is_passed_over() {
    let text = ARM
        .replace(
            "<link name=\"base\"/>",
            "<link name=\"base\" concave=\"no\" type=\"stand\"/>",
        )
        .replace(
            "<mass value=\"1.5\"/>",
            "<mass value=\"1.5\" cad:density=\"2700\"/>",
        )
        .replace(
            "effort=\"200\"/>",
            "effort=\"200\" drake:acceleration=\"4\" xmlns=\"http://x\"/>",
        )
        .replace(
            "<axis xyz=\"0 0 0\"/>",
            "<axis xyz=\"0 0 0\" oddity=\"1\"/><limit low=\"1\"/>",
        );
    let loaded = parse_with_notes(&text, "f", &UrdfOptions::default()).expect("sound");
    assert_eq!(loaded.robot, arm());
    let notes = loaded.notes.join("\n");
    assert!(
        notes.contains("<link> of link \"base\": attributes that do not count here: concave\n"),
        "{notes}"
    );
}

#[test]
fn the_longest_chain_is_proposed_and_said() {
    let humanoid = [
        "b>leg1 revolute",
        "leg1>leg2 revolute",
        "b>waist revolute",
        "waist>head revolute",
        "waist>a1 revolute",
        "a1>a2 prismatic",
        "a2>palm fixed",
        "palm>thumb revolute",
        "thumb>nail revolute",
        "palm>index revolute",
    ];
    let loaded = parse_with_notes(robot(&humanoid), "made", &UrdfOptions::default()).expect("arm");
    let names: Vec<&str> = loaded
        .robot
        .joints()
        .iter()
        .map(|joint| joint.name.as_str())
        .collect();
    assert_eq!(
        names,
        ["waist", "a1", "a2"],
        "the fingers are no part of it"
    );
    let choice = loaded.choice.expect("it branches");
    for says in [
        "the chain of 3 joints from \"b\" to \"a2\" is proposed: \"waist\", \"a1\", \"a2\"",
        "held where they stand: \"head at 0\"",
        "other tips: \"leg2\", \"head\", \"nail\", \"index\"",
    ] {
        assert!(choice.contains(says), "{choice}");
    }
    let mut options = options(None, Some("nail"));
    let loaded = parse_with_notes(robot(&humanoid), "made", &options).expect("with the thumb");
    assert_eq!(loaded.robot.joints().len(), 5);
    let choice = loaded.choice.expect("others are held");
    assert!(
        choice.starts_with("the chain of 5 joints from \"b\" to \"nail\" is taken"),
        "{choice}"
    );
    options.tip = None;
    let plain = ["b>l1 revolute", "l1>l2 revolute", "l2>t fixed"];
    let loaded = parse_with_notes(robot(&plain), "made", &options).expect("one way");
    assert_eq!(loaded.choice, None);
}

/// A branch counts in one posture: what hangs 1 m from a joint that turns by 90 degrees hangs above it, not beside it.
#[test]
fn branches_are_held_at_zero_or_as_near_as_they_may() {
    let made = |limit: &str, mimic: &str| {
        let text = robot(&[
            "b>l1 revolute",
            "l1>f1 revolute",
            "f1>t1 fixed",
            "l1>f2 prismatic",
        ]);
        text.replace(
            "<joint name='f1' type='revolute'>",
            &format!("<joint name='f1' type='revolute'>{limit}<axis xyz='0 -1 0'/>"),
        )
        .replace(
            "<joint name='f2' type='prismatic'>",
            &format!("<joint name='f2' type='prismatic'>{mimic}"),
        )
    };
    let moment = |text: &str| {
        let robot = parse(text, "f", &options(None, Some("l1")))
            .expect("held")
            .joints()[0]
            .phi;
        [robot[1], robot[2], robot[3]]
    };
    let near = |found: [f64; 3], expected: [f64; 3]| {
        for (a, b) in found.iter().zip(expected) {
            assert!(
                (a - b).abs() < ALGEBRAIC,
                "{found:?}, expected {expected:?}"
            );
        }
    };
    // f1 at x = 1, its tip at 2; f2 at 1.
    near(moment(&made("", "")), [4.0, 0.0, 0.0]);
    let quarter = "<limit lower='1.5707963267948966' upper='2'/>";
    near(moment(&made(quarter, "")), [3.0, 0.0, 1.0]);
    // f2 follows: 2 * 1.57 + 0.1 further along x.
    let follows = "<mimic joint='f1' multiplier='2' offset='0.1'/>";
    near(
        moment(&made(quarter, follows)),
        [3.0 + std::f64::consts::PI + 0.1, 0.0, 1.0],
    );
    // Its weight would depend on a joint of the chain.
    let text = made("", "<mimic joint='l1'/>");
    let error = parse(text, "f", &options(None, Some("l1")))
        .expect_err("follows")
        .to_string();
    assert!(
        error.contains("joint \"f2\": follows the joint \"l1\", which moves"),
        "{error}"
    );
    // Followers of each other, and of nobody, stand like others.
    for strange in ["<mimic joint='f2'/>", "<mimic joint='nobody'/>"] {
        near(moment(&made("", strange)), [4.0, 0.0, 0.0]);
    }
}

#[test]
fn a_joint_that_others_follow_drives_a_gripper() {
    let text = robot(&[
        "b>l1 revolute",
        "l1>l2 revolute",
        "l2>f1 prismatic",
        "l2>f2 prismatic",
    ])
    .replace(
        "<joint name='f2' type='prismatic'>",
        "<joint name='f2' type='prismatic'><mimic joint='f1'/>",
    );
    let robot = parse(&text, "f", &UrdfOptions::default()).expect("arm");
    assert_eq!(robot.joints().len(), 2);
    assert_eq!(robot.joints()[1].phi[0], 3.0);
    let error = parse(&text, "f", &options(None, Some("f1")))
        .expect_err("f2 follows")
        .to_string();
    assert!(error.contains("choose a tip before that joint"), "{error}");
    let alone = "<robot name='g'><link name='p'/><link name='f'/><link name='g'/>\
        <joint name='f' type='prismatic'><parent link='p'/><child link='f'/></joint>\
        <joint name='g' type='prismatic'><parent link='p'/><child link='g'/><mimic joint='f'/></joint></robot>";
    let error = parse(alone, "f", &UrdfOptions::default())
        .expect_err("no arm")
        .to_string();
    assert!(
        error.contains("no joint moves that follows no other"),
        "{error}"
    );
}

#[test]
fn strangers_among_whole_limits_and_idle_origins_are_noted() {
    let text = ARM.replace(
        "effort=\"200\"/>",
        "effort=\"200\" command_effort=\"80\" gear_velocity=\"10\"/>",
    );
    let text = text.replace(
        "<link name=\"wrist\"/>",
        "<link name=\"wrist\"><origin xyz=\"0 0 1\"/></link>",
    );
    let loaded = parse_with_notes(&text, "f", &UrdfOptions::default()).expect("sound");
    assert_eq!(loaded.robot, arm());
    let notes = loaded.notes.join("\n");
    for says in [
        "<limit> of joint \"rail\": attributes that do not count here: command_effort, gear_velocity",
        "<origin> of link \"wrist\" does not count",
    ] {
        assert!(notes.contains(says), "{notes}");
    }
}

#[test]
fn links_say_where_they_stand() {
    let loaded = parse_with_notes(
        robot(&["b>l1 revolute", "l1>t fixed", "b>cam fixed"]),
        "f",
        &UrdfOptions::default(),
    )
    .expect("sound");
    let found: Vec<(&str, Option<usize>, f64)> = loaded
        .links
        .iter()
        .map(|l| (l.name.as_str(), l.joint, l.translation.x))
        .collect();
    assert_eq!(
        found,
        [
            ("b", None, 0.0),
            ("cam", None, 1.0),
            ("l1", Some(0), 0.0),
            ("t", Some(0), 1.0)
        ]
    );
}
