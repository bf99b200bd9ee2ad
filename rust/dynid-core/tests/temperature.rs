//! Friction that follows a measured temperature, and a temperature that is not there.

use std::sync::Arc;

use dynid_core::effects::FRICTION_NAMES;
use dynid_core::model::TorqueModelParts;
use dynid_core::{
    CoreError, Domain, Effect, EffectTerm, Joint, JointKind, JointLimits, RobotModel, State,
    Status, TorqueEstimator, TorqueModel,
};
use nalgebra::{Matrix3, Vector3};

/// Two joints without mass; the first one's friction follows its temperature.
fn estimator() -> TorqueEstimator {
    let joint = Joint {
        name: "joint".to_owned(),
        link: "link".to_owned(),
        kind: JointKind::Revolute,
        rotation: Matrix3::identity(),
        translation: Vector3::zeros(),
        axis: Vector3::z(),
        limits: JointLimits::default(),
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi: [0.0; 10],
    };
    let robot = RobotModel::new("arm".into(), vec![joint; 2], Vector3::zeros()).expect("a chain");
    // Friction of 2 N m to the one side, of 1 N m and 0.5 N m s/rad to the other.
    let friction = [2.0, 1.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0];
    let mut shape = vec![
        ("reference_temperature", vec![20.0, 20.0]),
        ("transition_width", vec![1e-9, 1e-9]),
    ];
    shape.extend(
        FRICTION_NAMES
            .iter()
            .zip(friction)
            .map(|(name, k)| (*name, vec![k, k])),
    );
    let effect = Effect::new("temperature_friction", &shape).expect("a shape");
    let terms = [
        (effect, vec![-0.5, 0.0]),
        (Effect::torque_offset(), vec![3.0, 4.0]),
    ];
    let terms = terms.map(|(effect, sizes)| EffectTerm::new(effect, sizes, 2).expect("a term"));
    let model = TorqueModel::new(TorqueModelParts {
        phi: robot.phi(),
        robot,
        torque_scale: vec![1.0; 2],
        effects: terms.to_vec(),
        residual: None,
        encoder_delay: vec![0.0; 2],
        noise_std: vec![0.1; 2],
        domain: Domain {
            q: vec![[-9.0, 9.0]; 2],
            dq: vec![9.0; 2],
            ddq: vec![9.0; 2],
        },
        torque_unit: "N*m".to_owned(),
        step: None,
    })
    .expect("a model");
    assert_eq!(model.wants_temperature(), [true, false]);
    TorqueEstimator::new(Arc::new(model))
}

const Q: [f64; 2] = [0.5, -0.5];
const DQ: [f64; 2] = [-2.0, 2.0];

fn answer(temperature: Option<&[f64]>) -> (Status, [f64; 2]) {
    let state = State {
        temperature,
        ..State::single(&Q, &DQ, &Q)
    };
    let mut tau = [f64::NAN; 2];
    let status = estimator().estimate_into(&state, &mut tau);
    (status.expect("right lengths"), tau)
}

#[test]
fn friction_changes_with_what_the_joint_is_above_its_reference() {
    // -0.5 (30 - 20) (-1 + 0.5 * -2) = 10, beside the offsets.
    assert_eq!(answer(Some(&[30.0, 99.0])), (Status::OK, [13.0, 4.0]));
    assert_eq!(answer(Some(&[20.0, 99.0])), (Status::OK, [3.0, 4.0]));
    assert_eq!(answer(Some(&[10.0, 99.0])), (Status::OK, [-7.0, 4.0]));
}

#[test]
fn where_it_is_not_known_the_rest_goes_on_and_the_status_says_so() {
    let without = (Status::SIGNAL_MISSING, [3.0, 4.0]);
    for temperature in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(answer(Some(&[temperature, 25.0])), without);
        // Nothing follows the second joint's.
        assert_eq!(
            answer(Some(&[30.0, temperature])),
            (Status::OK, [13.0, 4.0])
        );
    }
    assert_eq!(answer(None), without);
}

#[test]
fn a_temperature_of_another_robot_is_an_error() {
    let state = State {
        temperature: Some(&[20.0]),
        ..State::single(&Q, &DQ, &Q)
    };
    let error = CoreError::Length {
        what: "temperature",
        expected: 2,
        actual: 1,
    };
    let mut tau = [0.0; 2];
    assert_eq!(estimator().estimate_into(&state, &mut tau), Err(error));
}
