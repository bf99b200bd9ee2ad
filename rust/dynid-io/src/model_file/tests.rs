use dynid_core::model::TorqueModelParts;
use dynid_core::{
    Domain, Effect, EffectTerm, EncoderError, GaussianMixtureRegression, Joint, JointKind,
    JointLimits, NormalisedRbf, PhysicalSet, Residual, ResidualInputs, RobotModel, Signal,
};
use nalgebra::{Matrix3, Rotation3, Vector3};
use proptest::prelude::*;

use super::*;

fn joint(name: &str, kind: JointKind) -> Joint {
    Joint {
        name: name.into(),
        link: format!("{name}_link"),
        kind,
        rotation: Rotation3::from_euler_angles(0.1, 0.2, 0.3).into_inner(),
        translation: Vector3::new(0.1, -0.2, 1.0 / 3.0),
        axis: Vector3::new(0.6, 0.0, 0.8),
        limits: JointLimits {
            effort: 100.0,
            ..JointLimits::default()
        },
        rotor_inertia: 0.25,
        gear_ratio: Some(101.0),
        phi: [1.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9],
    }
}

fn model() -> TorqueModel {
    model_in("N*m")
}

fn model_in(torque_unit: &str) -> TorqueModel {
    let joints = vec![
        joint("a", JointKind::Revolute),
        joint("b", JointKind::Prismatic),
    ];
    let robot = RobotModel::new("arm".into(), joints, Vector3::new(0.0, 0.0, -9.81)).unwrap();
    let friction = Effect::friction(&[0.0, 0.05], &[0.01, 0.02]).unwrap();
    let covariance = (Matrix3::identity() * 0.5).as_slice().to_vec();
    let mixture =
        GaussianMixtureRegression::new(2, vec![1.0], vec![0.1, 0.2, 0.3], covariance).unwrap();
    TorqueModel::new(TorqueModelParts {
        robot,
        phi: (0..20).map(|k| f64::from(k) / 7.0).collect(),
        torque_scale: vec![1.0, 0.8],
        effects: vec![
            EffectTerm::new(Effect::rotor_inertia(), vec![0.1, 0.2], 2).unwrap(),
            EffectTerm::new(Effect::torque_offset(), vec![-0.1, 0.2], 2).unwrap(),
            EffectTerm::new(friction, (0..16).map(f64::from).collect(), 2).unwrap(),
        ],
        residual: Some(
            Residual::new(ResidualInputs::Deflection, vec![Some(mixture.into()), None]).unwrap(),
        ),
        encoder_delay: vec![0.003, 0.0],
        noise_std: vec![0.5, 0.6],
        domain: Domain {
            q: vec![[-1.0, 1.0]; 2],
            dq: vec![2.0; 2],
            ddq: vec![3.0; 2],
        },
        torque_unit: torque_unit.into(),
        step: None,
    })
    .unwrap()
}

fn message(bytes: &[u8]) -> String {
    parse(bytes, "model.json").unwrap_err().to_string()
}

#[test]
fn a_model_takes_the_place_of_an_older_one_whole() {
    let folder = tempfile::tempdir().unwrap();
    let (path, other) = (folder.path().join("model.json"), folder.path().join("old"));
    save(&model(), &path).unwrap();
    // Who has the old file open, or by another name, keeps it: a controller never reads half of a model.
    fs::hard_link(&path, &other).unwrap();
    let newer = model_in("A");
    save(&newer, &path).unwrap();
    assert_eq!(load(&path).unwrap(), newer);
    assert_eq!(load(&other).unwrap(), model());
}

#[cfg(unix)]
#[test]
fn a_link_is_neither_followed_nor_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let (path, link) = (folder.path().join("precious"), folder.path().join("link"));
    fs::write(&path, "not yours").unwrap();
    std::os::unix::fs::symlink(&path, &link).unwrap();
    let error = save(&model(), &link).unwrap_err().to_string();
    assert!(
        error.contains("link: this is a symbolic link to "),
        "{error}"
    );
    assert_eq!(fs::read(&path).unwrap(), b"not yours");
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
}

#[test]
fn a_place_that_is_not_there_is_named_as_it_was_given() {
    let folder = tempfile::tempdir().unwrap();
    let none = folder.path().join("none");
    let said = save(&model(), &none.join("x.json"))
        .unwrap_err()
        .to_string();
    let wanted = format!(
        "the folder {} does not exist; create it first",
        none.display()
    );
    assert!(said.ends_with(&wanted), "{said}");
    fs::write(&none, "a file").unwrap();
    let said = save(&model(), &none.join("x.json"))
        .unwrap_err()
        .to_string();
    assert!(!said.contains(".dynid-"), "{said}");
}

#[test]
fn a_word_of_a_megabyte_is_quoted_short() {
    let long = "9".repeat(1_000_000);
    let text = to_text(&model()).unwrap();
    for (old, new) in [
        ("\"version\": 1", format!("\"version\": \"{long}\"")),
        (
            "\"version\": 1",
            format!("\"version\": \", expected {long}\""),
        ),
        (
            "\"format\": \"dynid-model\"",
            format!("\"format\": [\"{long}\"]"),
        ),
        (
            "\"format\": \"dynid-model\"",
            format!("\"format\": \"{long}\""),
        ),
    ] {
        assert!(text.contains(old));
        let said = message(text.replacen(old, &new, 1).as_bytes());
        assert!(said.contains("expected"), "{said}");
        assert!(said.chars().count() < 250, "{}", said.len());
    }
    // With the right checksum: a part that is not what it should be.
    let named = text.replacen("\"torque_offset\"", &format!("\"{long}\""), 1);
    let said = message(resign(&named).as_bytes());
    assert!(!said.contains("checksum"), "{said}");
    assert!(said.chars().count() < 500, "{}", said.len());
}

#[test]
fn a_model_survives_the_file_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.json");
    save(&model(), &path).unwrap();
    assert_eq!(load(&path).unwrap(), model());
    assert_eq!(
        fs::read_dir(folder.path()).unwrap().count(),
        1,
        "no temporary file stays"
    );
}

fn physical() -> PhysicalSet {
    let body = [2.0, 0.3, -0.1, 0.2, 0.4, 0.02, 0.5, -0.03, 0.01, 0.6];
    PhysicalSet {
        phi: [body, body].concat(),
        rotor_inertia: vec![0.0, 0.3],
        damping: vec![1.0, 2.0],
        friction: vec![0.5, 0.0],
        drive_gain: vec![1.0, 1.0 / 3.0],
    }
}

#[test]
fn a_physical_set_survives_the_file_and_is_absent_without_one() {
    let with = model().with_physical(physical()).unwrap();
    let text = to_text(&with).unwrap();
    assert_eq!(
        parse(text.as_bytes(), "x").unwrap().physical(),
        Some(&physical())
    );
    assert!(!to_text(&model()).unwrap().contains("physical"));
}

#[test]
fn a_set_that_no_body_has_is_refused() {
    type Spoil = fn(&mut PhysicalSet);
    let spoiled: [(&str, Spoil); 6] = [
        ("phi", |set| set.phi[4] = -0.4),
        ("phi", |set| set.phi.truncate(19)),
        ("rotor_inertia", |set| set.rotor_inertia[1] = -1e-9),
        ("friction", |set| set.friction[0] = -0.5),
        ("drive_gain", |set| set.drive_gain[0] = 0.0),
        ("NaN", |set| set.damping[0] = f64::NAN),
    ];
    for (what, spoil) in spoiled {
        let mut set = physical();
        spoil(&mut set);
        let error = model().with_physical(set).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    }
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let text = to_text(&model()).unwrap();
    for end in 0..text.len() {
        assert!(
            parse(&text.as_bytes()[..end], "model.json").is_err(),
            "cut at {end}"
        );
    }
    assert!(message(&text.as_bytes()[..text.len() / 2]).contains("ends too early"));
}

#[test]
fn every_single_byte_counts() {
    let text = to_text(&model()).unwrap();
    for at in 0..text.len() {
        for other in [b'0', b'7', b' ', b'"', b'x', 0xff] {
            let mut bytes = text.clone().into_bytes();
            if bytes[at] != other {
                bytes[at] = other;
                assert!(
                    parse(&bytes, "model.json").is_err(),
                    "byte {at} changed to {other}"
                );
            }
        }
    }
}

#[test]
fn other_files_are_told_apart() {
    assert!(message(b"{}").contains("not a torque model"));
    let mend = "give the model.json that `dynid identify` wrote";
    assert!(message(b"\xff\xfe").contains(&format!("not a text file; {mend}")));
    let unnumbered = message(b"{\"format\": \"dynid-model\"}");
    assert!(
        unnumbered
            .contains("no usable version (expected \"version\": 1 to 6); give the model.json as"),
        "{unnumbered}"
    );
    assert!(message(b"{\"format\": \"dynid-model\", \"version\": 99}").contains("newer"));
    assert!(message(b"{\"format\": \"dynid-model\", \"version\": 1}").contains("checksum"));
    assert!(message("[".repeat(1_000_000).as_bytes()).contains("not a readable model"));
    assert!(message(b"<robot name=\"arm\"/>").contains("no JSON object; give the model.json"));
    assert!(matches!(
        load(Path::new("/nowhere/model.json")),
        Err(ModelFileError::Io { .. })
    ));
}

/// The text with the checksum that belongs to it.
fn resign(text: &str) -> String {
    let start = text.find(CHECKSUM_PREFIX).unwrap();
    let stated = &text[start..start + CHECKSUM_PREFIX.len() + N_DIGITS];
    let blank = format!("{CHECKSUM_PREFIX}{}", "0".repeat(N_DIGITS));
    let blanked = text.replacen(stated, &blank, 1);
    let sum = format!("{CHECKSUM_PREFIX}{}", digest(&blanked));
    blanked.replacen(&blank, &sum, 1)
}

/// A file that was edited by someone who also knows how to write the checksum still has to make sense.
#[test]
fn a_resigned_file_is_checked_for_sense() {
    let text = to_text(&model()).unwrap();
    assert!(parse(resign(&text).as_bytes(), "model.json").is_ok());
    for (old, new) in [
        (
            "\"torque_unit\": \"N*m\",",
            "\"torque_unit\": \"N*m\", \"more\": 1,",
        ),
        ("\"kind\": \"revolute\"", "\"kind\": \"screw\""),
        ("\"rotor_inertia\": 0.25", "\"rotor_inertia\": 1e999"),
        ("\"noise_std\": [", "\"noise_std\": [ 1.0, "),
        ("\"transition_width\": [", "\"transition_width\": [ 0.0,"),
        ("\"deflection\"", "\"measured_torque\""),
        (
            "\"kind\": \"torque_offset\"",
            "\"kind\": \"torque_offsets\"",
        ),
        (
            "\"kind\": \"torque_offset\",",
            "\"kind\": \"torque_offset\", \"kind\": \"torque_offset\",",
        ),
        (
            "\"kind\": \"torque_offset\",",
            "\"kind\": \"torque_offset\", \"width\": [1.0, 1.0],",
        ),
        ("\"transition_width\"", "\"velocity_threshold\""),
        ("\"transition_width\"", "\"transition_widths\""),
        ("\"noise_std\": [", "\"step\": 0.0, \"noise_std\": ["),
    ] {
        assert!(text.contains(old), "{old}");
        assert!(
            parse(resign(&text.replacen(old, new, 1)).as_bytes(), "model.json").is_err(),
            "{new}"
        );
    }
}

proptest! {
    #[test]
    fn numbers_survive_to_the_last_bit(bits in proptest::collection::vec(any::<u64>(), 20)) {
        let phi: Vec<f64> = bits.iter().map(|b| f64::from_bits(*b)).map(|x| if x.abs() <= 1e9 { x } else { 0.5 }).collect();
        let base = model();
        let changed = TorqueModel::new(TorqueModelParts {
            robot: base.robot().clone(),
            phi,
            torque_scale: vec![1.0; 2],
            effects: base.effects().to_vec(),
            residual: None,
            encoder_delay: base.encoder_delay().to_vec(),
            noise_std: base.noise_std().to_vec(),
            domain: base.domain().clone(),
            torque_unit: "A".into(),
            step: None,
        }).unwrap();
        let text = to_text(&changed).unwrap();
        prop_assert_eq!(parse(text.as_bytes(), "x").unwrap(), changed);
    }
}

/// Version 1 as it was written before models had a step and effects a catalogue.
#[test]
fn an_old_file_is_read_and_written_as_it_was() {
    let old = include_str!("old_model.json");
    assert!(!old.contains("\"step\""));
    let model = parse(old.as_bytes(), "old_model.json").unwrap();
    assert_eq!(model.step(), None);
    assert_eq!(to_text(&model).unwrap(), old);
}

#[test]
fn every_kind_of_the_catalogue_survives_the_file() {
    let base = model();
    let value = |name: &str| match name {
        "partner" => [1.0, -1.0],
        "side" => [1.0, -1.0],
        "a" => [1.0, 0.5],
        "gas_length" => [0.9, -0.1],
        _ => [0.1, 0.3],
    };
    let term = |entry: &'static dynid_core::effects::Entry| {
        let shape: Vec<_> = entry
            .shape
            .iter()
            .map(|parameter| (parameter.name, value(parameter.name)))
            .collect();
        let effect = Effect::new(entry.kind, &shape).unwrap();
        let coefficients = vec![0.5; 2 * effect.n_columns()];
        EffectTerm::new(effect, coefficients, 2).unwrap()
    };
    let all = TorqueModel::new(TorqueModelParts {
        robot: base.robot().clone(),
        phi: base.phi().to_vec(),
        torque_scale: vec![1.0; 2],
        effects: dynid_core::effects::CATALOGUE.iter().map(term).collect(),
        residual: None,
        encoder_delay: vec![0.0; 2],
        noise_std: vec![0.0; 2],
        domain: base.domain().clone(),
        torque_unit: "N*m".into(),
        step: Some(1.0 / 3.0),
    })
    .unwrap();
    let text = to_text(&all).unwrap();
    assert_eq!(parse(text.as_bytes(), "x").unwrap(), all);
}

fn model_that_saturates() -> TorqueModel {
    let saturation = Effect::new("torque_saturation", &[] as &[(&str, &[f64])]).unwrap();
    model_with(EffectTerm::new(saturation, vec![1e-4, 0.0], 2).unwrap())
}

fn model_with(term: EffectTerm) -> TorqueModel {
    let base = model();
    let mut effects = base.effects().to_vec();
    effects.push(term);
    TorqueModel::new(TorqueModelParts {
        robot: base.robot().clone(),
        phi: base.phi().to_vec(),
        torque_scale: base.torque_scale().to_vec(),
        effects,
        residual: None,
        encoder_delay: vec![0.0; 2],
        noise_std: vec![0.0; 2],
        domain: base.domain().clone(),
        torque_unit: "N*m".into(),
        step: None,
    })
    .unwrap()
}

/// Whose sign turns round like a tanh says so by saying nothing: files of before are read as they were meant.
#[test]
fn a_sharpness_is_in_files_of_version_6_and_a_tanh_in_any() {
    let model = |sharpness: f64| {
        let shape = [
            ("transition_width", [0.01, 0.02]),
            ("sharpness", [sharpness; 2]),
        ];
        let effect = Effect::new("load_dependent_friction", &shape).unwrap();
        model_with(EffectTerm::new(effect, vec![0.1; 4], 2).unwrap())
    };
    let (tanh, sharp) = (model(0.0), model(1.5));
    let version = |text: &str| {
        text.lines()
            .find(|line| line.contains("version"))
            .map(str::to_owned)
    };
    let (of_tanh, of_sharp) = (to_text(&tanh).unwrap(), to_text(&sharp).unwrap());
    assert!(
        version(&of_tanh) == version(&to_text(&model_in("N*m")).unwrap())
            && !of_tanh.contains("sharpness")
    );
    assert!(of_sharp.contains("\"version\": 6,") && of_sharp.contains("sharpness"));
    for (text, written) in [(&of_tanh, &tanh), (&of_sharp, &sharp)] {
        assert_eq!(parse(text.as_bytes(), "x").unwrap(), *written);
    }
    let old = resign(&of_sharp.replace("\"version\": 6,", "\"version\": 5,"));
    assert_eq!(
        message(old.as_bytes()),
        "model.json: a file of version 5 has no sharpness in load_dependent_friction; save the model again"
    );
}

/// It was a function of the rigid body's torque in files of version 1 and 2: their numbers mean nothing here.
#[test]
fn a_saturation_of_an_older_file_is_refused_in_a_sentence() {
    let text = to_text(&model_that_saturates()).unwrap();
    assert!(text.contains("\"version\": 3,"));
    assert_eq!(parse(text.as_bytes(), "x").unwrap(), model_that_saturates());
    for version in [1, 2] {
        let old = resign(&text.replace("\"version\": 3,", &format!("\"version\": {version},")));
        assert_eq!(
            message(old.as_bytes()),
            format!(
                "model.json: torque_saturation in a file of version {version} follows the rigid body's torque alone, and here \
                 it follows the motor's whole torque; fit the model to its runs again"
            )
        );
    }
}

/// The other choices: bumps beside a mixture, on the load-free deflection, which needs the compliance.
fn model_with_rbf() -> TorqueModel {
    let old = model();
    let Some(residual) = old.residual() else {
        unreachable!("the model has one")
    };
    let rbf = NormalisedRbf::new(
        vec![0.1, 0.2, -0.3, 1e-300],
        vec![1e6, 0.1],
        vec![1.0 / 3.0, -2.0],
        vec![0.0, 0.7],
    )
    .unwrap();
    let joints = vec![residual.joints()[0].clone(), Some(rbf.into())];
    TorqueModel::new(TorqueModelParts {
        robot: old.robot().clone(),
        phi: old.phi().to_vec(),
        torque_scale: old.torque_scale().to_vec(),
        effects: old.effects().to_vec(),
        residual: Residual::new(ResidualInputs::LoadFreeDeflection, joints)
            .and_then(|residual| residual.with_compliance(vec![1e-6, 0.0]))
            .ok(),
        encoder_delay: old.encoder_delay().to_vec(),
        noise_std: old.noise_std().to_vec(),
        domain: old.domain().clone(),
        torque_unit: old.torque_unit().to_owned(),
        step: old.step(),
    })
    .unwrap()
}

#[test]
fn both_regressions_and_the_compliance_come_back() {
    let model = model_with_rbf();
    let text = to_text(&model).unwrap();
    assert_eq!(parse(text.as_bytes(), "m").unwrap(), model);
}

#[test]
fn a_load_free_deflection_without_compliance_is_refused() {
    let text = to_text(&model_with_rbf()).unwrap();
    let mut file: serde_json::Value = serde_json::from_str(&text).unwrap();
    file["residual"]
        .as_object_mut()
        .unwrap()
        .remove("compliance");
    let file: schema::ModelFile = serde_json::from_value(file).unwrap();
    assert_eq!(
        file.into_model().unwrap_err(),
        "residual: compliance is missing, which load_free_deflection needs"
    );
}

#[test]
fn a_regression_of_neither_kind_is_named() {
    let text = to_text(&model_with_rbf()).unwrap();
    let mut file: serde_json::Value = serde_json::from_str(&text).unwrap();
    file["residual"]["joints"][1]["sigma"] = 1.0.into();
    let error = serde_json::from_value::<schema::ModelFile>(file)
        .err()
        .unwrap();
    assert!(error
        .to_string()
        .contains("centers, precision, weights, variances (rbf)"));
}

/// A regression on three signals of either joint, and none.
fn model_on_signals() -> TorqueModel {
    let old = model();
    let covariance: Vec<f64> = (0..16)
        .map(|at| if at % 5 == 0 { 1.0 / 3.0 } else { 1e-3 })
        .collect();
    let means = vec![0.1, 0.2, 0.3, 0.4, -0.1, -0.2, -0.3, -0.4];
    let covariances = [covariance.clone(), covariance].concat();
    let mixture = GaussianMixtureRegression::new(3, vec![0.3, 0.7], means, covariances).unwrap();
    let signal = |name, joint| Signal::named(name, joint).unwrap();
    let named = vec![
        signal("q", 1),
        signal("tau_link", 0),
        signal("ddq_motor", 0),
    ];
    let inputs = ResidualInputs::Signals(vec![named, vec![]]);
    TorqueModel::new(TorqueModelParts {
        robot: old.robot().clone(),
        phi: old.phi().to_vec(),
        torque_scale: old.torque_scale().to_vec(),
        effects: old.effects().to_vec(),
        residual: Residual::new(inputs, vec![Some(mixture.into()), None]).ok(),
        encoder_delay: old.encoder_delay().to_vec(),
        noise_std: old.noise_std().to_vec(),
        domain: old.domain().clone(),
        torque_unit: old.torque_unit().to_owned(),
        step: old.step(),
    })
    .unwrap()
}

#[test]
fn signals_come_back_by_name() {
    let model = model_on_signals();
    let text = to_text(&model).unwrap();
    assert_eq!(parse(text.as_bytes(), "m").unwrap(), model);
    let file: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(file["residual"]["inputs"], "signals");
    let expected = serde_json::json!([[["q", 1], ["tau_link", 0], ["ddq_motor", 0]], []]);
    assert_eq!(file["residual"]["signals"], expected);
}

#[test]
fn signals_that_make_no_sense_are_refused() {
    use serde_json::json;
    type Spoil = fn(&mut serde_json::Value);
    let spoiled: [(&str, Spoil); 10] = [
        ("there is no signal \"tau\", expected one of q,", |r| {
            r["signals"][0][1] = json!(["tau", 0]);
        }),
        ("names a signal of joint 2, which", |r| {
            r["signals"][0][1] = json!(["q", 2]);
        }),
        ("has 3 inputs, expected 2", |r| {
            r["signals"][0] = json!([["q", 0], ["q", 1]]);
        }),
        ("residual signals has 1 values, expected 2", |r| {
            r["signals"] = json!([[["q", 0]]]);
        }),
        ("number of signals of a joint's residual", |r| {
            r["signals"][1] = vec![json!(["q", 0]); 7].into();
        }),
        ("signals are missing", |r| {
            r.as_object_mut().unwrap().remove("signals");
        }),
        ("there are signals, but its inputs are others", |r| {
            r["inputs"] = "deflection".into();
        }),
        ("means has a row of 3 values, expected 4", |r| {
            r["joints"][0]["means"][1] = json!([0.0, 0.0, 0.0]);
        }),
        ("covariances has a matrix of 3 rows, expected 4", |r| {
            r["joints"][0]["covariances"][1]
                .as_array_mut()
                .unwrap()
                .pop();
        }),
        ("means has rows for 99999 inputs, expected 1 to 6", |r| {
            r["joints"][0]["means"][0] = vec![0.5; 100_000].into();
        }),
    ];
    let text = to_text(&model_on_signals()).unwrap();
    for (words, spoil) in spoiled {
        let mut file: serde_json::Value = serde_json::from_str(&text).unwrap();
        spoil(&mut file["residual"]);
        let file: schema::ModelFile = serde_json::from_value(file).unwrap();
        let error = file.into_model().unwrap_err();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn an_encoder_error_survives_the_file_and_is_absent_without_one() {
    let mut joints = model().robot().joints().to_vec();
    joints[1].kind = JointKind::Revolute;
    let old = model();
    let parts = TorqueModelParts {
        robot: RobotModel::new("arm".into(), joints, *old.robot().gravity()).unwrap(),
        phi: old.phi().to_vec(),
        torque_scale: old.torque_scale().to_vec(),
        effects: old.effects().to_vec(),
        residual: old.residual().cloned(),
        encoder_delay: old.encoder_delay().to_vec(),
        noise_std: old.noise_std().to_vec(),
        domain: old.domain().clone(),
        torque_unit: old.torque_unit().to_owned(),
        step: old.step(),
    };
    let plain = TorqueModel::new(parts).unwrap();
    for both_sides in [false, true] {
        let cos_sin = vec![[1e-3, -1e-3 / 3.0], [0.0, 2e-3]];
        let error = EncoderError {
            cos_sin,
            both_sides,
        };
        let with = plain.clone().with_encoder_error(error).unwrap();
        let text = to_text(&with).unwrap();
        assert_eq!(parse(text.as_bytes(), "x").unwrap(), with);
        let sides = if both_sides { "both" } else { "link" };
        assert!(text.contains(&format!("\"sides\": \"{sides}\"")));
    }
    assert!(!to_text(&plain).unwrap().contains("encoder_error"));
}
