use super::names::{check_prefix, comment, string};
use super::numbers::number;
use super::*;

use dynid_core::model::TorqueModelParts;
use dynid_core::{Domain, Effect, EffectTerm, Joint, JointKind, JointLimits, RobotModel};
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;

/// A joint with a ripple of this shape.
fn rippling(shape: &[(&str, [f64; 1])]) -> TorqueModel {
    let joint = Joint {
        name: "a".to_owned(),
        link: "a_link".to_owned(),
        kind: JointKind::Revolute,
        rotation: Matrix3::identity(),
        translation: Vector3::zeros(),
        axis: Vector3::z(),
        limits: JointLimits::default(),
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi: [0.0; 10],
    };
    let robot = RobotModel::new("arm".into(), vec![joint], Vector3::zeros()).unwrap();
    let ripple = Effect::new("torque_ripple", shape).unwrap();
    TorqueModel::new(TorqueModelParts {
        phi: robot.phi(),
        robot,
        torque_scale: vec![1.0],
        effects: vec![EffectTerm::new(ripple, vec![1.0; 4], 1).unwrap()],
        residual: None,
        encoder_delay: vec![0.0],
        noise_std: vec![0.1],
        domain: Domain {
            q: vec![[-1.0, 1.0]],
            dq: vec![1.0],
            ddq: vec![1.0],
        },
        torque_unit: "N*m".into(),
        step: Some(0.001),
    })
    .unwrap()
}

#[test]
fn what_a_model_does_not_need_is_not_in_its_header() {
    let plain = rippling(&[("cycles", [3.0])]);
    let late = plain.clone().with_torque_delay(&[0.0035]).unwrap();
    let ended = rippling(&[("cycles", [3.0]), ("held_from", [-0.5]), ("held_to", [0.5])]);
    for (model, delayed, held) in [
        (plain, false, false),
        (late, true, false),
        (ended, false, true),
    ] {
        let text = c_header(&model, "arm").unwrap();
        assert_eq!(text.contains("arm_look_back(arm_estimator"), delayed);
        assert_eq!(
            text.contains("arm_hold_angle(x, j, arm_shape_1[j] + 1, unheld)"),
            held
        );
        assert_eq!(text.contains("arm_release_angle"), held);
    }
}

#[test]
fn hexadecimal_floats_are_as_c_writes_them() {
    for (x, text) in [
        (0.0, "0x0p+0"),
        (-0.0, "-0x0p+0"),
        (1.0, "0x1p+0"),
        (-1.5, "-0x1.8p+0"),
        (0.1, "0x1.999999999999ap-4"),
        (f64::MAX, "0x1.fffffffffffffp+1023"),
        (f64::MIN_POSITIVE, "0x1p-1022"),
        (5e-324, "0x0.0000000000001p-1022"),
        (f64::from_bits(0x000f_0000_0000_0000), "0x0.fp-1022"),
    ] {
        assert_eq!(number(x), text);
    }
}

proptest! {
    /// Read again digit by digit, every number is the same number.
    #[test]
    fn hexadecimal_floats_lose_nothing(x in proptest::num::f64::NORMAL | proptest::num::f64::SUBNORMAL) {
        let text = number(x);
        let (mantissa, exponent) = text.trim_start_matches('-')[2..].split_once('p').unwrap();
        let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
        let digits = u64::from_str_radix(&format!("{whole}{fraction}"), 16).unwrap() as f64;
        let exponent = exponent.parse::<i32>().unwrap() - 4 * fraction.len() as i32;
        // In two steps, so that neither power leaves the range.
        let size = digits * 2f64.powi(exponent / 2) * 2f64.powi(exponent - exponent / 2);
        prop_assert_eq!(size.to_bits(), x.abs().to_bits());
        prop_assert_eq!(text.starts_with('-'), x < 0.0);
    }

    /// Nothing ends a comment or a string, continues a line or smuggles in the prefix's stand-in.
    #[test]
    fn any_name_stays_where_it_is_put(name in any::<String>()) {
        let inside = comment(&name);
        prop_assert!(inside.is_ascii() && !inside.contains(['/', '\\', '?', '"', '\n', '\r', '\0']));
        prop_assert!(!inside.contains("dynid_") && !inside.contains("DYNID_"));
        let literal = string(&name);
        let text = &literal[1..literal.len() - 1];
        prop_assert!(text.bytes().all(|b| b == b'\\' || b == b' ' || b.is_ascii_alphanumeric()));
        let mut bytes = Vec::new();
        let mut rest = text.as_bytes();
        while let [first, tail @ ..] = rest {
            if *first == b'\\' {
                let octal = std::str::from_utf8(&tail[..3]).unwrap();
                bytes.push(u8::from_str_radix(octal, 8).unwrap());
                rest = &tail[3..];
            } else {
                bytes.push(*first);
                rest = tail;
            }
        }
        prop_assert_eq!(bytes, name.as_bytes());
    }

    #[test]
    fn any_text_gives_a_prefix(text in any::<String>()) {
        let prefix = prefix_of(&text);
        prop_assert!(check_prefix(&prefix).is_ok(), "{:?}", prefix);
    }
}

#[test]
fn prefixes_are_c_names() {
    for good in ["a", "arm", "Arm_2", "x9"] {
        assert!(check_prefix(good).is_ok());
        assert_eq!(prefix_of(good), good);
    }
    for bad in [
        "",
        "9",
        "_a",
        "a-b",
        "a b",
        "ä",
        "dynid",
        "Dynid",
        "a;",
        &"a".repeat(41),
    ] {
        let words = check_prefix(bad).unwrap_err().to_string();
        assert!(
            words.contains("cannot begin the names of a C header"),
            "{words}"
        );
    }
    for (text, prefix) in [
        ("my-robot.v2", "my_robot_v2"),
        ("6axis", "model_6axis"),
        ("", "model"),
        ("dynid", "model_dynid"),
        ("__x__", "x"),
    ] {
        assert_eq!(prefix_of(text), prefix);
    }
}

#[test]
fn the_prefix_takes_the_place_of_its_stand_in_once() {
    let text = "dynid_estimate(DYNID_STEP, dynid_x)";
    for prefix in ["arm", "my_dynid_arm", "DYNID_x"] {
        let upper = prefix.to_ascii_uppercase();
        let expected = format!("{prefix}_estimate({upper}_STEP, {prefix}_x)");
        assert_eq!(with_prefix(text, prefix), expected);
    }
}
