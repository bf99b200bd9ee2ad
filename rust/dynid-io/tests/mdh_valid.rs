//! What a sound `robot.toml` becomes, and that it is what the equivalent URDF becomes, to the last digit.

use std::f64::consts::{FRAC_PI_2, PI};

use dynid_core::{Joint, JointKind, JointLimits, RobotModel};
use dynid_io::mdh::{load, parse, MdhError, MdhOptions};
use dynid_io::urdf::{self, UrdfOptions};
use nalgebra::Vector3;
use proptest::prelude::*;

const SIX_AXIS: &str = include_str!("../../../python/dynid_rs/robots/six_axis.toml");

fn read(text: &str) -> RobotModel {
    parse(text, "robot.toml", &MdhOptions::default()).expect("sound")
}

fn read_urdf(text: &str) -> RobotModel {
    urdf::parse(text, "robot.urdf", &UrdfOptions::default()).expect("sound")
}

/// The example of the module's documentation.
fn example() -> String {
    let module = include_str!("../src/mdh/mod.rs");
    let inside = module
        .split("```")
        .nth(1)
        .expect("the documentation has an example");
    let lines = inside.lines().skip(1); // the language
    lines
        .map(|line| line.trim_start_matches("//!").to_owned() + "\n")
        .collect()
}

#[test]
fn the_example_says_what_it_says() {
    let robot = read(&example());
    assert_eq!(robot.name(), "two_axis");
    assert_eq!(*robot.gravity(), Vector3::new(0.0, 0.0, -9.81));
    let [shoulder, elbow] = robot.joints() else {
        panic!("two joints");
    };
    assert_eq!(
        (shoulder.name.as_str(), shoulder.link.as_str()),
        ("shoulder", "upper_arm")
    );
    assert_eq!(
        (elbow.name.as_str(), elbow.link.as_str()),
        ("elbow", "link_2")
    );
    let limits = JointLimits {
        lower: -170f64.to_radians(),
        upper: 170f64.to_radians(),
        velocity: PI,
        acceleration: 4.0 * PI,
        effort: 250.0,
    };
    assert_eq!(shoulder.limits, limits);
    assert_eq!(elbow.limits, JointLimits::default());
    assert_eq!((shoulder.gear_ratio, elbow.gear_ratio), (Some(121.0), None));
    assert_eq!(shoulder.rotor_inertia, 3.2e-4 * (121.0 * 121.0));
    assert_eq!(elbow.rotor_inertia, 0.0);
    assert_eq!(shoulder.axis, Vector3::z());
    // The base is 0.4 m up, d another 0.2 m; theta = -90 degrees turns x to -y.
    let up = shoulder.translation - Vector3::new(0.0, 0.0, 0.6);
    assert!(up.norm() < 1e-15, "{up}");
    let x = shoulder.rotation * Vector3::x();
    assert!((x + Vector3::y()).norm() < 1e-15, "{x}");
    // The elbow is 0.35 m along the upper arm's x and turns about its -y.
    assert_eq!(elbow.translation, Vector3::new(0.35, 0.0, 0.0));
    let z = elbow.rotation * Vector3::z();
    assert!((z + Vector3::y()).norm() < 1e-15, "{z}");
    // m, m c, and about the origin I + m (c.c 1 - c c').
    let phi = shoulder.phi;
    let expected = [
        12.0,
        1.2,
        0.0,
        -0.24,
        0.05 + 12.0 * 0.0004,
        0.001,
        0.21 + 12.0 * 0.0104,
        12.0 * 0.002,
        0.0,
        0.2 + 12.0 * 0.01,
    ];
    for (number, expected) in phi.iter().zip(expected) {
        assert!((number - expected).abs() < 1e-14, "{phi:?}");
    }
    // The tool stands at x = 0.3 with its z along the link's x: its mass lies on that axis, at 0.35 m.
    let phi = elbow.phi;
    assert_eq!(phi[0], 6.5);
    let h = Vector3::new(phi[1], phi[2], phi[3]);
    let expected = Vector3::new(5.0 * 0.2 + 1.5 * 0.35, 0.0, 0.0);
    assert!((h - expected).norm() < 1e-14, "{h}");
    // About x: the tool's own zz, for it turns with it; inertia_rpy leaves xx = yy as they are.
    assert!((phi[4] - (0.01 + 0.002)).abs() < 1e-14, "{phi:?}");
    assert!(
        (phi[6] - (0.24 + 0.004 + 1.5 * 0.35 * 0.35)).abs() < 1e-14,
        "{phi:?}"
    );
}

const ROW: &str = "angle = 'rad'\n[[joint]]\nalpha = 0.5\na = 1\nd = 2\ntheta = -0.25\n";

#[test]
fn only_a_row_is_needed() {
    let robot = read(ROW);
    assert_eq!(robot.name(), "robot");
    let expected = Joint {
        name: "joint_1".to_owned(),
        link: "link_1".to_owned(),
        kind: JointKind::Revolute,
        axis: Vector3::z(),
        limits: JointLimits::default(),
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi: [0.0; 10],
        ..robot.joints()[0].clone()
    };
    assert_eq!(robot.joints(), [expected]);
}

#[test]
fn degrees_and_radians_say_the_same() {
    let rad = ROW.replace("0.5", &format!("{:?}", 30f64.to_radians()));
    let rad = rad.replace("-0.25", &format!("{:?}", (-45f64).to_radians()));
    let deg = ROW
        .replace("'rad'", "'deg'")
        .replace("0.5", "30")
        .replace("-0.25", "-45.0");
    let limits = "lower = -90\nupper = 90\nvelocity = 90\nacceleration = 90\n";
    let in_rad = limits.replace("90", &format!("{FRAC_PI_2:?}"));
    assert_eq!(read(&(deg + limits)), read(&(rad + &in_rad)));
}

#[test]
fn a_prismatic_joint_is_not_counted_in_degrees() {
    let text = ROW.replace("'rad'", "'deg'") + "kind = 'prismatic'\nlower = -0.1\nupper = 0.4\n";
    let joint = read(&text).joints()[0].clone();
    assert_eq!(joint.kind, JointKind::Prismatic);
    assert_eq!((joint.limits.lower, joint.limits.upper), (-0.1, 0.4));
}

#[test]
fn an_inertia_about_the_origin_is_kept_as_it_is() {
    let text = ROW.to_owned()
        + "mass = 2\ncom = [1, 2, 3]\ninertia_origin = { xx = 11, yy = 22, zz = 33, xy = 12, xz = 13, yz = 23 }\n";
    let expected = [2.0, 2.0, 4.0, 6.0, 11.0, 12.0, 22.0, 13.0, 23.0, 33.0];
    assert_eq!(read(&text).joints()[0].phi, expected);
}

#[test]
fn options_replace_what_the_file_says() {
    let text = format!("gravity = [1, 2, 3]\n{ROW}gear_ratio = 10\nrotor_inertia = 0.5\n");
    let robot = read(&text);
    assert_eq!(*robot.gravity(), Vector3::new(1.0, 2.0, 3.0));
    assert_eq!(robot.joints()[0].rotor_inertia, 50.0);
    let with = |options: &MdhOptions| parse(&text, "robot.toml", options);
    let options = MdhOptions {
        gravity: Some([0.0, 1.62, 0.0]),
        rotor_inertia: Some(vec![7.0]),
    };
    let robot = with(&options).expect("sound");
    assert_eq!(*robot.gravity(), Vector3::new(0.0, 1.62, 0.0));
    assert_eq!(robot.joints()[0].rotor_inertia, 7.0);
    for (options, says) in [
        (
            MdhOptions {
                gravity: Some([0.0, f64::NAN, 0.0]),
                ..MdhOptions::default()
            },
            "robot.toml: option `gravity`: is [0.0, NaN, 0.0], expected three finite numbers in m/s^2",
        ),
        (
            MdhOptions {
                rotor_inertia: Some(vec![1.0, 2.0]),
                ..MdhOptions::default()
            },
            "robot.toml: option `rotor_inertia`: has 2 values, expected 1, one per joint",
        ),
        (
            MdhOptions {
                rotor_inertia: Some(vec![-1.0]),
                ..MdhOptions::default()
            },
            "robot.toml: option `rotor_inertia`: holds -1, expected finite numbers of zero or more in kg m^2 (kg)",
        ),
    ] {
        let error = with(&options).expect_err(says);
        assert_eq!(error.to_string(), says);
    }
}

#[test]
fn the_system_says_why_a_file_cannot_be_read() {
    let path = std::path::Path::new("no/such/robot.toml");
    let error = load(path, &MdhOptions::default()).expect_err("missing");
    let MdhError::Io { source, .. } = error else {
        panic!("{error}");
    };
    assert_eq!(source.kind(), std::io::ErrorKind::NotFound);
}

#[test]
fn a_byte_order_mark_and_windows_lines_do_not_matter() {
    let text = format!("\u{FEFF}{}", ROW.replace('\n', "\r\n"));
    assert_eq!(read(&text), read(ROW));
}

/// One row with everything that a URDF can say too.
#[derive(Clone, Debug)]
struct Row {
    slides: bool,
    row: [f64; 4],
    limits: [f64; 5],
    rotor: [f64; 2],
    mass: f64,
    com: [f64; 3],
    rpy: [f64; 3],
    inertia: [f64; 6],
}

fn row() -> impl Strategy<Value = Row> {
    let angle = || prop_oneof![-PI..PI, Just(0.0), Just(FRAC_PI_2), Just(-FRAC_PI_2)];
    let length = || prop_oneof![-0.8..0.8, Just(0.0)];
    (
        any::<bool>(),
        (angle(), length(), length(), angle())
            .prop_map(|(alpha, a, d, theta)| [alpha, a, d, theta]),
        prop::array::uniform5(0.0..10.0),
        [0.0..1e-3, 1.0..200.0],
        0.0..20.0,
        prop::array::uniform3(-0.3..0.3),
        prop::array::uniform3(-PI..PI),
        prop::array::uniform6(-1.0..1.0),
    )
        .prop_map(
            |(slides, row, limits, rotor, mass, com, rpy, inertia)| Row {
                slides,
                row,
                limits,
                rotor,
                mass,
                com,
                rpy,
                inertia,
            },
        )
}

fn triple([x, y, z]: [f64; 3]) -> String {
    format!("{x:?} {y:?} {z:?}")
}

fn toml(rows: &[Row], base: ([f64; 3], [f64; 3])) -> String {
    let mut text = format!(
        "name = 'twin'\nangle = 'rad'\n[base]\nxyz = {:?}\nrpy = {:?}\n",
        base.0, base.1
    );
    for (k, row) in rows.iter().enumerate() {
        let [alpha, a, d, theta] = row.row;
        let [lower, range, velocity, acceleration, effort] = row.limits;
        let [xx, xy, xz, yy, yz, zz] = row.inertia;
        let kind = if row.slides { "prismatic" } else { "revolute" };
        text += &format!(
            "[[joint]]\nname = 'j{k}'\nlink = 'l{k}'\nkind = '{kind}'\nalpha = {alpha:?}\na = {a:?}\nd = {d:?}\n\
             theta = {theta:?}\nlower = {:?}\nupper = {:?}\nvelocity = {velocity:?}\nacceleration = {acceleration:?}\n\
             effort = {effort:?}\nrotor_inertia = {:?}\ngear_ratio = {:?}\nmass = {:?}\ncom = {:?}\ninertia_rpy = {:?}\n\
             inertia_com = {{ xx = {xx:?}, yy = {yy:?}, zz = {zz:?}, xy = {xy:?}, xz = {xz:?}, yz = {yz:?} }}\n",
            -lower,
            range - lower,
            row.rotor[0],
            row.rotor[1],
            row.mass,
            row.com,
            row.rpy,
        );
    }
    text
}

/// The same robot as a URDF: two joints per row, a fixed one for `alpha` and `a`, a moving one for `theta` and `d`.
fn twin(rows: &[Row], base: ([f64; 3], [f64; 3])) -> String {
    let mut text = format!(
        "<robot name='twin'><link name='world'/><link name='b'/><joint name='base' type='fixed'><parent link='world'/>\
         <child link='b'/><origin xyz='{}' rpy='{}'/></joint>",
        triple(base.0),
        triple(base.1)
    );
    let mut parent = "b".to_owned();
    for (k, row) in rows.iter().enumerate() {
        let [alpha, a, d, theta] = row.row;
        let [lower, range, velocity, acceleration, effort] = row.limits;
        let [xx, xy, xz, yy, yz, zz] = row.inertia;
        let kind = if row.slides { "prismatic" } else { "revolute" };
        text += &format!(
            "<link name='f{k}'/><joint name='f{k}' type='fixed'><parent link='{parent}'/><child link='f{k}'/>\
             <origin xyz='{a:?} 0 0' rpy='{alpha:?} 0 0'/></joint>\
             <link name='l{k}'><inertial><origin xyz='{}' rpy='{}'/><mass value='{:?}'/><inertia ixx='{xx:?}' ixy='{xy:?}' \
             ixz='{xz:?}' iyy='{yy:?}' iyz='{yz:?}' izz='{zz:?}'/></inertial></link>\
             <joint name='j{k}' type='{kind}'><parent link='f{k}'/><child link='l{k}'/>\
             <origin xyz='0 0 {d:?}' rpy='0 0 {theta:?}'/><axis xyz='0 0 1'/><limit lower='{:?}' upper='{:?}' \
             velocity='{velocity:?}' acceleration='{acceleration:?}' effort='{effort:?}'/></joint>\
             <transmission name='t{k}'><joint name='j{k}'/><actuator name='m{k}'><drake:rotor_inertia value='{:?}'/>\
             <drake:gear_ratio value='{:?}'/></actuator></transmission>",
            triple(row.com),
            triple(row.rpy),
            row.mass,
            -lower,
            range - lower,
            row.rotor[0],
            row.rotor[1],
        );
        parent = format!("l{k}");
    }
    text + "</robot>"
}

proptest! {
    #[test]
    fn a_table_and_its_urdf_are_one_robot_to_the_last_digit(
        rows in prop::collection::vec(row(), 1..8),
        xyz in prop::array::uniform3(-1.0..1.0f64),
        rpy in prop::array::uniform3(-PI..PI),
        placed in any::<bool>(),
    ) {
        let base = if placed { (xyz, rpy) } else { Default::default() };
        prop_assert_eq!(read(&toml(&rows, base)), read_urdf(&twin(&rows, base)));
    }

    /// With one joint per row, where a URDF can say the placement without loss: theta = 0.
    #[test]
    fn rows_without_theta_need_one_urdf_joint_each(rows in prop::collection::vec(row(), 1..8)) {
        let rows: Vec<Row> = rows
            .into_iter()
            .map(|row| Row { row: [row.row[0], row.row[1], row.row[2], 0.0], ..row })
            .collect();
        let mut urdf = "<robot name='twin'><link name='l'/>".to_owned();
        let mut parent = "l".to_owned();
        for (k, Row { slides, row: [alpha, a, d, _], .. }) in rows.iter().enumerate() {
            let kind = if *slides { "prismatic" } else { "revolute" };
            let place = triple([*a, -alpha.sin() * d, alpha.cos() * d]);
            urdf += &format!(
                "<link name='l{k}'/><joint name='j{k}' type='{kind}'><parent link='{parent}'/><child link='l{k}'/>\
                 <origin xyz='{place}' rpy='{alpha:?} 0 0'/><axis xyz='0 0 1'/></joint>"
            );
            parent = format!("l{k}");
        }
        let urdf = read_urdf(&(urdf + "</robot>"));
        let table = read(&toml(&rows, Default::default()));
        for (one, other) in table.joints().iter().zip(urdf.joints()) {
            prop_assert_eq!(one.rotation, other.rotation);
            prop_assert_eq!(one.translation, other.translation);
            prop_assert_eq!(one.axis, other.axis);
        }
    }
}

#[test]
fn the_bundled_arm_is_the_bundled_urdf() {
    let (table, urdf) = (
        read(SIX_AXIS),
        read_urdf(include_str!(
            "../../../python/dynid_rs/robots/six_axis.urdf"
        )),
    );
    assert_eq!(table.name(), urdf.name());
    for (one, other) in table.joints().iter().zip(urdf.joints()) {
        assert_eq!((&one.name, &one.link), (&other.name, &other.link));
        assert_eq!((one.kind, one.limits), (other.kind, other.limits));
        assert_eq!(
            (one.gear_ratio, one.rotor_inertia),
            (other.gear_ratio, other.rotor_inertia)
        );
    }
}
