//! One sound arm, one thing spoiled per case: every refusal names its place, its element and the mend.

use dynid_io::urdf::{parse, UrdfError, UrdfOptions};

const ARM: &str = include_str!("urdf_hostile/arm.urdf");

/// `from` becomes `to`; the refusal points at the first `at` from there on, or else before it.
struct Case {
    from: &'static str,
    to: &'static str,
    at: &'static str,
    element: &'static str,
    says: &'static str,
}

const fn case(
    from: &'static str,
    to: &'static str,
    at: &'static str,
    element: &'static str,
    says: &'static str,
) -> Case {
    Case {
        from,
        to,
        at,
        element,
        says,
    }
}

fn spoil(from: &str, to: &str) -> String {
    assert_eq!(
        ARM.matches(from).count(),
        1,
        "{from:?} must stand once in the arm"
    );
    ARM.replace(from, to)
}

/// Line and column of `needle`, counted the slow way.
fn place(text: &str, case: &Case) -> (usize, usize) {
    let spoiled = ARM.find(case.from).expect("spoil has checked it");
    let found = text[spoiled..]
        .find(case.at)
        .map(|at| spoiled + at)
        .or_else(|| text.find(case.at));
    let found = found.unwrap_or_else(|| panic!("{:?} is not in the text", case.at));
    let (mut line, mut column) = (1, 1);
    for c in text[..found].chars() {
        (line, column) = if c == '\n' {
            (line + 1, 1)
        } else {
            (line, column + 1)
        };
    }
    (line, column)
}

fn check(cases: &[Case]) {
    for case in cases {
        let text = spoil(case.from, case.to);
        let error = parse(&text, "arm.urdf", &UrdfOptions::default()).expect_err(case.to);
        let UrdfError::Invalid {
            file,
            line,
            column,
            element,
            message,
        } = &error
        else {
            panic!("{}: {error}", case.to);
        };
        assert_eq!(file, "arm.urdf");
        assert_eq!((*line, *column), place(&text, case), "{}: {error}", case.to);
        assert_eq!(element, case.element, "{}: {error}", case.to);
        assert!(
            message.contains(case.says),
            "{}: {error}\nexpected: {}",
            case.to,
            case.says
        );
    }
}

#[test]
fn the_arm_itself_is_sound() {
    parse(ARM, "arm.urdf", &UrdfOptions::default()).expect("sound");
}

#[test]
fn a_refusal_reads_as_one_line() {
    let text = spoil("xyz=\"0 0 0.3\"", "xyz=\"1 foo 2\"");
    let error = parse(text, "robot.urdf", &UrdfOptions::default()).expect_err("spoiled");
    assert_eq!(
        error.to_string(),
        "robot.urdf:33:13: <origin> of joint \"shoulder\": xyz needs three finite numbers, found \"1 foo 2\"; \
         write xyz=\"x y z\" in metres"
    );
}

#[test]
fn columns_count_characters() {
    let text = spoil(
        "    <axis xyz=\"0 0 1\"/>",
        "<!--äöü--><axis xyz=\"0 0 0\"/>",
    );
    let error = parse(text, "arm", &UrdfOptions::default()).expect_err("spoiled");
    assert!(
        matches!(
            error,
            UrdfError::Invalid {
                line: 36,
                column: 17,
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn numbers() {
    let origin = "<origin> of joint \"shoulder\"";
    let xyz = |to, at| {
        case(
            "xyz=\"0 0 0.3\"",
            to,
            at,
            origin,
            "needs three finite numbers, found",
        )
    };
    let mass = |to, at| {
        case(
            "value=\"2.5\"",
            to,
            at,
            "<mass> of link \"upper\"",
            "value needs one finite number",
        )
    };
    check(&[
        xyz("xyz=\"1 foo 2 3\"", "xyz=\"1 foo"),
        xyz("xyz=\"1 2\"", "xyz=\"1 2\""),
        xyz("xyz=\"1 2 3 4\"", "xyz=\"1 2 3 4\""),
        xyz("xyz=\"1,2,3\"", "xyz=\"1,2,3\""),
        xyz("xyz=\"\"", "xyz=\"\""),
        xyz("xyz=\"nan 0 0\"", "xyz=\"nan"),
        xyz("xyz=\"0 inf 0\"", "xyz=\"0 inf"),
        xyz("xyz=\"0 0 1e999\"", "xyz=\"0 0 1e999"),
        xyz("xyz=\"0 0 0x1\"", "xyz=\"0 0 0x1"),
        xyz("xyz=\"0 0 1\u{2212}\"", "xyz=\"0 0 1\u{2212}"),
        case(
            "xyz=\"0 0 0.3\"",
            "xyz=\"0 0 1e13\"",
            "xyz=\"0 0 1e13",
            origin,
            "check the exponent",
        ),
        case(
            "rpy=\"0.1 0.2 0.3\"",
            "rpy=\"0.1 0.2\"",
            "rpy=\"0.1 0.2\"",
            origin,
            "in radians",
        ),
        case(
            "rpy=\"0.1 0.2 0.3\"",
            "quat_xyzw=\"0 0 0 1\"",
            "quat",
            origin,
            "write the rotation as rpy",
        ),
        case(
            "rpy=\"0.1 0.2 0.3\"",
            "yaw=\"0.3\"",
            "yaw",
            origin,
            "expected xyz, rpy",
        ),
        mass("value=\"heavy\"", "value=\"heavy"),
        mass("value=\"NaN\"", "value=\"NaN"),
        mass("value=\"infinity\"", "value=\"infinity"),
        mass("value=\"1 2\"", "value=\"1 2"),
        mass("value=\"\"", "value=\"\""),
        case(
            "value=\"2.5\"",
            "value=\"-2.5\"",
            "value=\"-2.5",
            "<mass> of link \"upper\"",
            "zero or more",
        ),
        case(
            "value=\"2.5\"",
            "value=\"1e30\"",
            "value=\"1e30",
            "<mass> of link \"upper\"",
            "check the exponent",
        ),
        case(
            "ixy=\"0.001\"",
            "ixy=\"1e-3kg\"",
            "ixy=\"1e-3kg",
            "<inertia> of link \"upper\"",
            "found \"1e-3kg\"",
        ),
        case(
            "upper=\"2.5\"",
            "upper=\"pi\"",
            "upper=\"pi",
            "<limit> of joint \"shoulder\"",
            "found \"pi\"",
        ),
        case(
            "lower=\"-2\"",
            "lower=\"3\"",
            "lower=\"3\"",
            "<limit> of joint \"shoulder\"",
            "above upper",
        ),
        case(
            "velocity=\"3\"",
            "velocity=\"-3\"",
            "velocity=\"-3",
            "<limit> of joint \"shoulder\"",
            "zero or more",
        ),
        case(
            "effort=\"80\"",
            "effort=\"nan\"",
            "effort=\"nan",
            "<limit> of joint \"shoulder\"",
            "one finite number",
        ),
        case(
            "xyz=\"0 2 0\"",
            "xyz=\"0 0 0\"",
            "xyz=\"0 0 0\"/>\n    <limit",
            "<axis> of joint \"rail\"",
            "no length",
        ),
        case(
            "xyz=\"0 2 0\"",
            "xyz=\"0 1e-9 0\"",
            "xyz=\"0 1e-9",
            "<axis> of joint \"rail\"",
            "no length",
        ),
    ]);
    let long = "0".repeat(600);
    let text = spoil("value=\"2.5\"", &format!("value=\"{long}\""));
    let error = parse(text, "arm", &UrdfOptions::default())
        .expect_err("overlong")
        .to_string();
    assert!(
        error.contains("needs one finite number") && error.len() < 200,
        "{error}"
    );
}

#[test]
fn missing_and_misspelt_things() {
    let joint = "<joint name=\"rail\" type=\"prismatic\">";
    check(&[
        case(
            joint,
            "<joint type=\"prismatic\">",
            "<joint type=\"prism",
            "<joint>",
            "the attribute name is missing",
        ),
        case(
            joint,
            "<joint name=\"rail\">",
            "<joint name=\"rail\">",
            "<joint>",
            "the attribute type is missing",
        ),
        case(
            joint,
            "<joint name=\"\" type=\"prismatic\">",
            "name=\"\"",
            "<joint>",
            "name is empty",
        ),
        case(
            joint,
            "<joint name=\"rail\" type=\"sliding\">",
            "type=\"sliding",
            "<joint>",
            "the type \"sliding\" is unknown",
        ),
        case(
            "<link name=\"base\"/>",
            "<link/>",
            "<link/>",
            "<link>",
            "the attribute name is missing",
        ),
        case(
            "<parent link=\"upper\"/>",
            "",
            joint,
            "joint \"rail\"",
            "<parent link=\"...\"/> is missing",
        ),
        case(
            "<child link=\"slider\"/>",
            "",
            joint,
            "joint \"rail\"",
            "<child link=\"...\"/> is missing",
        ),
        case(
            "<parent link=\"upper\"/>",
            "<parent name=\"upper\"/>",
            "name=\"upper\"",
            "<parent> of joint \"rail\"",
            "the attribute name is not read here; expected link",
        ),
        case(
            "<mass value=\"1.5\"/>",
            "",
            "<inertial>\n      \n",
            "link \"slider\"",
            "<mass value=\"...\"/> inside",
        ),
        case(
            "<mass value=\"1.5\"/>",
            "<mass>1.5</mass>",
            "<mass>1.5",
            "<mass> of link \"slider\"",
            "attribute value is missing",
        ),
        case(
            "<inertia ixx=\"0.01\" ixy=\"0\" ixz=\"0\" iyy=\"0.01\" iyz=\"0\" izz=\"0.01\"/>",
            "",
            "<inertial>\n      <mass value=\"1.5",
            "link \"slider\"",
            "<inertia ixx",
        ),
        case(
            "iyy=\"0.03\" iyz=\"0\"",
            "iyy=\"0.03\"",
            "<inertia ixx=\"0.02",
            "<inertia> of link \"upper\"",
            "attribute iyz is missing",
        ),
        case(
            "<axis xyz=\"0 2 0\"/>",
            "<axis/>",
            "<axis/>",
            "<axis> of joint \"rail\"",
            "attribute xyz is missing",
        ),
        case(
            "<axis xyz=\"0 2 0\"/>",
            "<axes xyz=\"0 2 0\"/>",
            "<axes",
            "<axes> of joint \"rail\"",
            "is <axis> meant",
        ),
        case(
            "<origin xyz=\"0 0 0.05\"/>",
            "<Origin xyz=\"0 0 0.05\"/>",
            "<Origin",
            "<Origin> of link \"tool\"",
            "is <origin> meant",
        ),
        case(
            "<link name=\"base\"/>",
            "<links name=\"base\"/>",
            "<links",
            "<links>",
            "is <link> meant",
        ),
    ]);
}

/// A misspelt attribute would silently count as its default.
#[test]
fn attributes_that_are_not_read() {
    let limit = "<limit lower=\"0\" upper=\"0.4\" velocity=\"0.5\" effort=\"200\"/>";
    let of_limit = "<limit> of joint \"rail\"";
    let mass = "<mass value=\"1.5\"/>";
    check(&[
        case(
            limit,
            "<limit low=\"0\" upper=\"0.4\"/>",
            "low=",
            of_limit,
            "the attribute low is not read here; is lower meant?",
        ),
        case(
            limit,
            "<limit lower=\"0\" uper=\"0.4\"/>",
            "uper",
            of_limit,
            "is upper meant?",
        ),
        case(
            limit,
            "<limit lower=\"0\" upper=\"0.4\" vel=\"1\"/>",
            "vel",
            of_limit,
            "is velocity meant?",
        ),
        case(
            limit,
            "<limit Effort=\"0\"/>",
            "Effort",
            of_limit,
            "is effort meant?",
        ),
        case(
            limit,
            "<limit acceleratoin=\"0\"/>",
            "accel",
            of_limit,
            "is acceleration meant?",
        ),
        case(
            limit,
            "<limit acceleration=\"-1\"/>",
            "acceleration",
            of_limit,
            "a greatest acceleration",
        ),
        case(
            limit,
            "<limit min=\"0\" max=\"1\"/>",
            "min",
            of_limit,
            "expected lower, upper, velocity, acceleration, effort",
        ),
        case(
            mass,
            "<mass vale=\"1.5\"/>",
            "vale",
            "<mass> of link \"slider\"",
            "is value meant?",
        ),
        case(
            mass,
            "<mass value=\"1.5\" unit=\"lb\"/>",
            "unit",
            "<mass> of link \"slider\"",
            "expected value; rename or delete it",
        ),
        case(
            limit,
            "<limit lower=\"0\" upper=\"0.4\" velocity=\"0.5\" effort=\"200\" acceleratoin=\"1\"/>",
            "acceleratoin",
            of_limit,
            "is acceleration meant?",
        ),
        case(
            "<inertia ixx=\"0.01\"",
            "<inertia ix=\"0.01\"",
            "ix=",
            "<inertia> of link \"slider\"",
            "is ixx meant?",
        ),
        case(
            "<axis xyz=\"0 2 0\"/>",
            "<axis xzy=\"0 2 0\"/>",
            "xzy",
            "<axis> of joint \"rail\"",
            "is xyz meant?",
        ),
        case(
            "<origin xyz=\"0 0 0.05\"/>",
            "<origin xyz=\"0 0 0.05\" ryp=\"0 0 1\"/>",
            "ryp",
            "<origin> of link \"tool\"",
            "is rpy meant?",
        ),
        case(
            "<parent link=\"upper\"/>",
            "<parent lnik=\"upper\"/>",
            "lnik",
            "<parent> of joint \"rail\"",
            "is link meant?",
        ),
        case(
            "<child link=\"wrist\"/>",
            "<child link=\"wrist\"/><mimic joint=\"rail\" mulitplier=\"2\"/>",
            "mulitplier",
            "<mimic> of joint \"roll\"",
            "is multiplier meant?",
        ),
        case(
            "<link name=\"base\"/>",
            "<link nmae=\"base\"/>",
            "<link nmae",
            "<link>",
            "the attribute name is missing (is nmae meant to be it?)",
        ),
        case(
            "<joint name=\"rail\" type=\"prismatic\">",
            "<joint name=\"rail\" tpye=\"prismatic\">",
            "<joint name=\"rail",
            "<joint>",
            "the attribute type is missing (is tpye meant to be it?)",
        ),
    ]);
}

#[test]
fn duplicates() {
    let twice = "stands here a second time";
    check(&[
        case(
            "<link name=\"wrist\"/>",
            "<link name=\"wrist\"/><link name=\"upper\" />",
            "<link name=\"upper\" />",
            "<link>",
            "taken by the link on line 6",
        ),
        case(
            "<joint name=\"roll\"",
            "<joint name=\"rail\"",
            "<joint name=\"rail\" type=\"continuous",
            "<joint>",
            "taken by the joint on line 40",
        ),
        case(
            "<mass value=\"1.5\"/>",
            "<mass value=\"1.5\"/><mass value=\"1\"/>",
            "<mass value=\"1\"",
            "<mass> of link \"slider\"",
            twice,
        ),
        case(
            "<origin xyz=\"0 0 0.05\"/>",
            "<origin/><origin />",
            "<origin />",
            "<origin> of link \"tool\"",
            twice,
        ),
        case(
            "</inertial>\n    <visual>",
            "</inertial>\n    <inertial />\n    <visual>",
            "<inertial />",
            "<inertial> of link \"upper\"",
            twice,
        ),
        case(
            "<axis xyz=\"0 2 0\"/>",
            "<axis xyz=\"0 2 0\"/><axis xyz=\"0 1 0\"/>",
            "<axis xyz=\"0 1",
            "<axis> of joint \"rail\"",
            twice,
        ),
        case(
            "<parent link=\"upper\"/>",
            "<parent link=\"upper\"/><parent link=\"upper\" />",
            "<parent link=\"upper\" />",
            "<parent> of joint \"rail\"",
            twice,
        ),
        case(
            "<child link=\"slider\"/>",
            "<child link=\"slider\"/><child link=\"base\"/>",
            "<child link=\"base",
            "<child> of joint \"rail\"",
            twice,
        ),
        case(
            "<dynamics damping=\"lots\"/>",
            "<limit effort=\"1\"/>",
            "<limit effort=\"1\"",
            "<limit> of joint \"shoulder\"",
            twice,
        ),
        case(
            "<axis xyz=\"0 2 0\"/>",
            "<origin xyz=\"0 0 9\"/>",
            "<origin xyz=\"0 0 9",
            "<origin> of joint \"rail\"",
            twice,
        ),
        case(
            "<axis xyz=\"0 0 0\"/>",
            "<origin xyz=\"0 0 9\"/>",
            "<origin xyz=\"0 0 9",
            "<origin> of joint \"flange\"",
            twice,
        ),
        case(
            "value=\"2.5\"",
            "value=\"2.5\" value=\"3\"",
            "value=\"3\"/>",
            "<mass>",
            "the attribute value stands twice",
        ),
    ]);
}

#[test]
fn elements_at_the_wrong_place() {
    let misplaced = "does not count at this place";
    check(&[
        case(
            "<link name=\"slider\">",
            "<link name=\"slider\"><origin xyz=\"0 0 7\"/>",
            "<origin xyz=\"0 0 7",
            "link \"slider\"",
            "the <origin> beside <inertial> does not count there",
        ),
        case(
            "<link name=\"wrist\"/>",
            "<link name=\"wrist\"><mass value=\"1\"/></link>",
            "<mass value=\"1\"",
            "<mass> of link \"wrist\"",
            misplaced,
        ),
        case(
            "<link name=\"wrist\"/>",
            "<link name=\"wrist\"/><inertial/>",
            "<inertial/>",
            "<inertial>",
            misplaced,
        ),
        case(
            "<link name=\"wrist\"/>",
            "<link name=\"wrist\"><link name=\"w2\"/></link>",
            "<link name=\"w2\"",
            "<link> of link \"wrist\"",
            misplaced,
        ),
        case(
            "<axis xyz=\"0 2 0\"/>",
            "<mass value=\"1\"/>",
            "<mass value=\"1\"/>",
            "<mass> of joint \"rail\"",
            misplaced,
        ),
        case(
            "<origin xyz=\"0 0 0.05\"/>",
            "<origin xyz=\"0 0 0.05\"><mass value=\"9\"/></origin>",
            "<mass value=\"9\"",
            "<mass> of link \"tool\"",
            misplaced,
        ),
    ]);
}

#[test]
fn other_formats() {
    check(&[
        case(
            "value=\"2.5\"",
            "value=\"${m}\"",
            "value=\"${m}",
            "<mass> of link \"upper\"",
            "xacro in.xacro > out.urdf",
        ),
        case(
            "<link name=\"base\"/>",
            "<link name=\"$(arg p)base\"/>",
            "name=\"$(arg",
            "<link>",
            "xacro in.xacro > out.urdf",
        ),
        case(
            "<link name=\"base\"/>",
            "<xacro:include filename=\"a\"/>",
            "<xacro:",
            "<xacro:include>",
            "expand it first",
        ),
        case(
            "<mu1>0.2</mu1>",
            "<xacro:m/>",
            "<xacro:m",
            "<xacro:m>",
            "expand it first",
        ),
    ]);
    for (text, says) in [
        (
            "<sdf version='1.7'></sdf>",
            "1:1: <sdf>: the root element is <sdf>, expected <robot>; this is SDF",
        ),
        ("<mujoco/>", "MuJoCo"),
        ("<html><body/></html>", "web page"),
        ("<a/>", "no URDF"),
        (
            "version https://git-lfs.github.com/spec/v1\noid sha256:1",
            "git lfs pull",
        ),
        ("", "the file is empty"),
        (" \n ", "the file is empty"),
        ("<!-- nothing -->", "the file is empty"),
        ("<robot/>", "holds no <link>"),
        (
            "<robot><link name='a'/></robot>",
            "no joint moves between \"a\"",
        ),
        ("{\"robot\": 1}", "text before the root element"),
    ] {
        let error = parse(text, "f", &UrdfOptions::default())
            .expect_err(text)
            .to_string();
        assert!(error.contains(says), "{error}");
    }
}

#[test]
fn the_tree() {
    let chain = "<parent link=\"slider\"/>\n    <child link=\"wrist\"/>";
    check(&[
        case(
            "<parent link=\"upper\"/>",
            "<parent link=\"uper\"/>",
            "link=\"uper\"",
            "<parent> of joint \"rail\"",
            "no link is named \"uper\"",
        ),
        case(
            "<child link=\"slider\"/>",
            "<child link=\"nowhere\"/>",
            "link=\"nowhere",
            "<child> of joint \"rail\"",
            "no link is named \"nowhere\"",
        ),
        case(
            chain,
            "<parent link=\"slider\"/>\n    <child link=\"upper\"/>",
            "link=\"upper\"/>\n  </joint>",
            "<child> of joint \"roll\"",
            "child of joint \"shoulder\" already",
        ),
        case(
            "<link name=\"wrist\"/>",
            "<link name=\"wrist\"/><link name=\"lost\"/>",
            "<link name=\"lost",
            "link \"lost\"",
            "2 links hang on no joint: \"base\", \"lost\"",
        ),
    ]);
    let text = spoil("<parent link=\"upper\"/>", "<parent link=\"slider\"/>");
    let error = parse(text, "f", &UrdfOptions::default())
        .expect_err("self loop")
        .to_string();
    assert!(
        error.contains("connects the link \"slider\" to itself"),
        "{error}"
    );
    // A circle with a root beside it, and one without.
    let text = spoil("<parent link=\"upper\"/>", "<parent link=\"tool\"/>");
    let error = parse(text, "f", &UrdfOptions::default())
        .expect_err("circle")
        .to_string();
    assert!(
        error.contains("in a circle through the links") && error.contains("\"wrist\""),
        "{error}"
    );
    let text = spoil("<parent link=\"base\"/>", "<parent link=\"tool\"/>")
        .replace("<link name=\"base\"/>", "");
    let error = parse(text, "f", &UrdfOptions::default())
        .expect_err("circle")
        .to_string();
    assert!(error.contains("in a circle through the links"), "{error}");
}

#[test]
fn joints_that_no_serial_chain_has() {
    let rail = "<joint name=\"rail\" type=\"prismatic\">";
    check(&[
        case(
            rail,
            "<joint name=\"rail\" type=\"floating\">",
            "<joint name=\"rail",
            "joint \"rail\"",
            "choose base=\"slider\"",
        ),
        case(
            rail,
            "<joint name=\"rail\" type=\"planar\">",
            "<joint name=\"rail",
            "joint \"rail\"",
            "is of type \"planar\"",
        ),
        case(
            "<axis xyz=\"0 2 0\"/>",
            "<mimic joint=\"shoulder\"/>",
            "<mimic",
            "<mimic> of joint \"rail\"",
            "delete <mimic>",
        ),
    ]);
    let text = spoil("type=\"revolute\"", "type=\"fixed\"")
        .replace("type=\"prismatic\"", "type=\"fixed\"")
        .replace("type=\"continuous\"", "type=\"fixed\"");
    let error = parse(text, "f", &UrdfOptions::default())
        .expect_err("all fixed")
        .to_string();
    assert!(
        error.contains("f:3:1: <robot>: no joint moves between \"base\""),
        "{error}"
    );
}

/// No gear has one; a rotor inertia, which gives the ratio its use, need not stand beside it.
#[test]
fn a_ratio_of_zero_without_a_rotor_inertia() {
    let without = spoil("<drake:rotor_inertia value=\"2e-5\"/>", "");
    let ratio = "<mechanicalReduction>100</mechanicalReduction>";
    assert!(parse(&without, "f", &UrdfOptions::default()).is_ok());
    for zero in [
        "<mechanicalReduction> -0e3 </mechanicalReduction>",
        "<drake:gear_ratio value=\"0.0\"/>",
    ] {
        let text = without.replace(ratio, zero);
        let before = &text[..text.find(zero).unwrap()];
        let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
        let place = format!(
            "f:{}:{column}: <transmission>: ",
            before.matches('\n').count() + 1
        );
        let error = parse(&text, "f", &UrdfOptions::default())
            .unwrap_err()
            .to_string();
        assert!(error.starts_with(&place), "{error}");
        assert!(
            error.contains(" is zero, expected rotor speed over joint speed; correct it"),
            "{error}"
        );
    }
}

#[test]
fn transmissions() {
    let element = "<transmission>";
    let inertia = "<drake:rotor_inertia value=\"2e-5\"/>";
    let ratio = "<mechanicalReduction>100</mechanicalReduction>";
    check(&[
        case(
            inertia,
            "<drake:rotor_inertia value=\"-1\"/>",
            "<drake:rotor_inertia",
            element,
            "zero or more",
        ),
        case(
            inertia,
            "<drake:rotor_inertia value=\"inf\"/>",
            "<drake:rotor_inertia",
            element,
            "one finite number",
        ),
        case(
            inertia,
            "<drake:rotor_inertia/>",
            "<drake:rotor_inertia",
            element,
            "one finite number",
        ),
        case(
            ratio,
            "<mechanicalReduction>1:100</mechanicalReduction>",
            "<mechanicalR",
            element,
            "found \"1:100\"",
        ),
        case(
            ratio,
            "<drake:gear_ratio value=\"0\"/>",
            "<drake:gear_ratio",
            element,
            "is zero",
        ),
        case(
            ratio,
            "<drake:gear_ratio value=\"nan\"/>",
            "<drake:gear_ratio",
            element,
            "one finite number",
        ),
        case(
            inertia,
            "<drake:gear_ratio value=\"50\"/><drake:rotor_inertia value=\"1\"/>",
            "<mechanicalR",
            element,
            "another ratio",
        ),
        case(
            "<joint name=\"shoulder\"><hard",
            "<joint name=\"shouldr\"><hard",
            "<drake:rotor_inertia",
            "<drake:rotor_inertia>",
            "no joint is named \"shouldr\"",
        ),
        case(
            "<joint name=\"shoulder\"><hard",
            "<joint name=\"should&#10;er\"><hard",
            "<drake:rotor_inertia",
            "<drake:rotor_inertia>",
            "no joint is named \"should\\ner\"",
        ),
        case(
            "<actuator name=\"motor\">",
            "<joint name=\"rail\"/><actuator>",
            "<transmission",
            element,
            "exactly one <joint>",
        ),
    ]);
}

#[test]
fn broken_xml() {
    check(&[
        case("</robot>", "", "<robot", "<robot>", "never closed"),
        case(
            "</gazebo>\n</robot>",
            "",
            "<gazebo",
            "<gazebo>",
            "never closed",
        ),
        case(
            "</inertial>\n    <visual>",
            "<visual>",
            "</link>\n  <link name=\"slider",
            "<inertial>",
            "found </link>, expected </inertial>",
        ),
        case(
            "</robot>",
            "</robot>\n<robot name=\"two\"/>",
            "<robot name=\"two",
            "<robot>",
            "a second root element",
        ),
        case(
            "</robot>",
            "</robot>\nthe end",
            "the end",
            "XML",
            "text after the closing tag",
        ),
        case(
            "<robot name=\"mini\">",
            "stray\n<robot name=\"mini\">",
            "stray",
            "XML",
            "text before the root",
        ),
        case(
            "<link name=\"base\"/>",
            "<link name=base/>",
            "base/>",
            "<link>",
            "has no quotes",
        ),
        case(
            "<link name=\"base\"/>",
            "<link name=\"base/>",
            "<link name=\"base/>",
            "XML",
            "a quote is not closed",
        ),
        case(
            "<link name=\"base\"/>",
            "<link name=\"base/>\n<link name=\"/>",
            "name=\"base/>",
            "<link>",
            "a closing quote is missing",
        ),
        case(
            "<link name=\"base\"/>",
            "<link name=\"base\"id=\"1\"/>",
            "id=\"1",
            "<link>",
            "a blank is missing",
        ),
        case(
            "<link name=\"base\"/>",
            "<link 1=\"base\"/>",
            "1=\"base",
            "<link>",
            "is not the name of an attribute",
        ),
        case(
            "<link name=\"base\"/>",
            "<<<<<<< HEAD",
            "<<<<<<<",
            "XML",
            "does not start a tag",
        ),
        case(
            "<link name=\"base\"/>",
            "< link name=\"base\"/>",
            "< link",
            "XML",
            "does not start a tag",
        ),
        case(
            "<link name=\"base\"/>",
            "<link name=\"&base;\"/>",
            "name=\"&base",
            "<link>",
            "unknown entity",
        ),
        case(
            "<link name=\"base\"/>",
            "&lol;",
            "&lol",
            "text",
            "unknown entity",
        ),
        case(
            "<link name=\"base\"/>",
            "<link name=\"a&#0;\"/>",
            "name=\"a&#0",
            "<link>",
            "unknown entity",
        ),
        case(
            "<link name=\"base\"/>",
            "<link name=\"a&#10;b\"/>",
            "name=\"a&#10",
            "<link>",
            "is no name",
        ),
        case(
            "<link name=\"base\"/>",
            "<!ELEMENT a>",
            "<!ELEMENT",
            "XML",
            "not well-formed",
        ),
        case(
            "<link name=\"base\"/>",
            "<!-- open",
            "<!-- open",
            "XML",
            "not well-formed",
        ),
        case(
            "<link name=\"base\"/>",
            "<![CDATA[ open",
            "<![CDATA",
            "XML",
            "not well-formed",
        ),
        case(
            "<robot name=\"mini\">",
            "<!DOCTYPE robot SYSTEM \"a\">\n<robot>",
            "<!DOCTYPE",
            "<!DOCTYPE>",
            "delete the declaration",
        ),
        case(
            "<link name=\"base\"/>",
            "<link name=\"a\0\"/>",
            "\0",
            "text",
            "a zero byte",
        ),
        case(
            "<link name=\"base\"/>",
            "<link name=\"a\u{1b}\"/>",
            "name=\"a\u{1b}",
            "<link>",
            "U+001B",
        ),
        case(
            "<link name=\"base\"/>",
            "<link name=\"a\u{fffe}\"/>",
            "name=\"a\u{fffe}",
            "<link>",
            "U+FFFE",
        ),
    ]);
    let text = spoil("</robot>", "</robot>\n</gazebo>");
    let error = parse(text, "f", &UrdfOptions::default())
        .expect_err("extra end")
        .to_string();
    assert!(
        error.contains("</gazebo>: closes an element that is not open"),
        "{error}"
    );
    let text = spoil("<link name=\"base\"/>", "<link name/>");
    let error = parse(text, "f", &UrdfOptions::default())
        .expect_err("no value")
        .to_string();
    assert!(
        error.contains("f:5:") && error.contains("write name=\"value\""),
        "{error}"
    );
}

#[test]
fn encodings() {
    let options = UrdfOptions::default();
    let utf16: Vec<u8> = [0xFF, 0xFE]
        .into_iter()
        .chain(ARM.bytes().flat_map(|b| [b, 0]))
        .collect();
    let error = parse(utf16, "f", &options).expect_err("UTF-16").to_string();
    assert!(error.contains("f:1:1: text: the file is UTF-16"), "{error}");
    let latin = ARM
        .as_bytes()
        .iter()
        .map(|&b| if b == b'$' { 0xE4 } else { b })
        .collect::<Vec<u8>>();
    let error = parse(latin, "f", &options)
        .expect_err("Latin-1")
        .to_string();
    assert!(
        error.contains("f:16:42: text: this byte is not UTF-8"),
        "{error}"
    );
    let with_mark = [b"\xEF\xBB\xBF", ARM.as_bytes()].concat();
    assert_eq!(
        parse(with_mark, "f", &options).expect("mark"),
        parse(ARM, "f", &options).expect("sound")
    );
    let windows = ARM.replace('\n', "\r\n");
    assert_eq!(
        parse(windows, "f", &options).expect("CRLF"),
        parse(ARM, "f", &options).expect("sound")
    );
}
