//! The arms that inputs are tried on.

use dynid_core::effects::CATALOGUE;
use dynid_core::model::TorqueModelParts;
use dynid_core::{
    Domain, Effect, EffectTerm, GaussianMixtureRegression, Joint, JointKind, JointLimits,
    NormalisedRbf, Residual, ResidualInputs, RobotModel, Signal, TorqueModel,
};
use nalgebra::{Matrix3, Rotation3, Vector3};

/// An arm of two joints with a few effects and a mixture on the deflection.
///
/// # Panics
/// Never.
pub fn arm() -> TorqueModel {
    model(
        &["rotor_inertia", "friction", "gear_hysteresis"],
        Third::Mixture,
    )
}

/// Models to begin with: together they have an effect of every kind, and every kind of residual.
///
/// # Panics
/// Never.
pub fn models() -> Vec<TorqueModel> {
    let kinds: Vec<&str> = CATALOGUE.iter().map(|entry| entry.kind).collect();
    let thirds = [Third::None, Third::Rbf, Third::Mixture]
        .into_iter()
        .cycle();
    kinds
        .chunks(4)
        .zip(thirds)
        .map(|(kinds, third)| model(kinds, third))
        .chain([arm()])
        .collect()
}

#[derive(Clone, Copy)]
enum Third {
    None,
    Mixture,
    Rbf,
}

fn model(kinds: &[&str], third: Third) -> TorqueModel {
    let joint = |name: &str, kind| Joint {
        name: name.to_owned(),
        link: format!("{name}_link"),
        kind,
        rotation: Rotation3::from_euler_angles(0.1, 0.2, 0.3).into_inner(),
        translation: Vector3::new(0.1, -0.2, 0.5),
        axis: Vector3::new(0.6, 0.0, 0.8),
        limits: JointLimits::default(),
        rotor_inertia: 0.25,
        gear_ratio: None,
        phi: [0.0; 10],
    };
    let joints = vec![
        joint("a", JointKind::Revolute),
        joint("b", JointKind::Prismatic),
    ];
    let robot = RobotModel::new("arm".to_owned(), joints, Vector3::new(0.0, 0.0, -9.81));
    let effects = kinds.iter().map(|kind| term(kind)).collect();
    let residual = match third {
        Third::None => None,
        Third::Mixture => {
            let covariance = (Matrix3::identity() * 0.5).as_slice().to_vec();
            let mixture =
                GaussianMixtureRegression::new(2, vec![1.0], vec![0.1, 0.2, 0.3], covariance);
            let joints = vec![Some(mixture.expect("a mixture").into()), None];
            Some(Residual::new(ResidualInputs::Deflection, joints).expect("a residual"))
        }
        Third::Rbf => {
            let rbf =
                NormalisedRbf::new(vec![0.0, 0.5], vec![4.0], vec![0.1, -0.1], vec![0.01, 0.01]);
            let signal = Signal::named("q", 0).expect("a signal");
            let inputs = ResidualInputs::Signals(vec![vec![], vec![signal]]);
            let joints = vec![None, Some(rbf.expect("basis functions").into())];
            Some(Residual::new(inputs, joints).expect("a residual"))
        }
    };
    TorqueModel::new(TorqueModelParts {
        robot: robot.expect("a robot"),
        phi: (0..20).map(|k| f64::from(k) / 8.0).collect(),
        torque_scale: vec![1.0, 0.8],
        effects,
        residual,
        encoder_delay: vec![0.003, 0.0],
        noise_std: vec![0.5, 0.6],
        domain: Domain {
            q: vec![[-1.0, 1.0]; 2],
            dq: vec![2.0; 2],
            ddq: vec![3.0; 2],
        },
        torque_unit: "N*m".to_owned(),
        step: Some(0.001),
    })
    .expect("a model")
}

fn term(kind: &str) -> EffectTerm {
    let entry = CATALOGUE
        .iter()
        .find(|entry| entry.kind == kind)
        .expect("a kind");
    let value = |parameter: &str, joint: f64| match parameter {
        "a" => 0.8 + 0.1 * joint,
        "b" => 0.2 + 0.05 * joint,
        "phase" | "sharpness" => 1.0 + joint,
        "gas_length" => 2.0 - 0.1 * joint,
        "partner" => joint - 1.0,
        "cycles" => 2.0 + joint,
        _ => 0.02 + 0.01 * joint,
    };
    let shape = |name: &'static str| (name, vec![value(name, 0.0), value(name, 1.0)]);
    let mut shape: Vec<_> = entry
        .shape
        .iter()
        .map(|parameter| shape(parameter.name))
        .collect();
    if kind == "joint_spring" {
        shape.extend([("held_from", vec![-0.7, 0.0]), ("held_to", vec![0.6, 0.0])]);
    }
    let effect = Effect::new(kind, &shape).expect("a valid shape");
    let coefficients = (0..2 * effect.n_columns())
        .map(|k| 0.5 + k as f64)
        .collect();
    EffectTerm::new(effect, coefficients, 2).expect("a term")
}
