//! Encoders that are not centred: their error goes before anything else, on one side of the gear or on both.

use std::sync::Arc;

use dynid_core::model::TorqueModelParts;
use dynid_core::state::true_motion;
use dynid_core::{
    CoreError, Domain, Effect, EffectTerm, EncoderError, Joint, JointKind, JointLimits, RobotModel,
    State, TorqueEstimator, TorqueModel,
};
use nalgebra::{Matrix3, Vector3};

fn joint(kind: JointKind) -> Joint {
    Joint {
        name: "joint".to_owned(),
        link: "link".to_owned(),
        kind,
        rotation: Matrix3::identity(),
        translation: Vector3::new(0.3, -0.1, 0.2),
        axis: Vector3::new(0.0, 0.6, 0.8),
        limits: JointLimits::default(),
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi: [2.0, 0.3, -0.1, 0.5, 0.7, 0.02, 0.9, -0.05, 0.04, 1.1],
    }
}

/// A model of two joints with rotors, the second one as given.
fn model(second: JointKind, delay: f64) -> TorqueModel {
    let joints = vec![joint(JointKind::Revolute), joint(second)];
    let robot =
        RobotModel::new("arm".into(), joints, Vector3::new(0.0, 0.0, -9.81)).expect("a chain");
    let rotor = EffectTerm::new(Effect::rotor_inertia(), vec![0.5; 2], 2).expect("a term");
    TorqueModel::new(TorqueModelParts {
        phi: robot.phi(),
        robot,
        torque_scale: vec![1.0; 2],
        effects: vec![rotor],
        residual: None,
        encoder_delay: vec![delay; 2],
        noise_std: vec![0.1; 2],
        domain: Domain {
            q: vec![[-9.0, 9.0]; 2],
            dq: vec![9.0; 2],
            ddq: vec![9.0; 2],
        },
        torque_unit: "N*m".to_owned(),
        step: None,
    })
    .expect("a model")
}

/// Bits of the torque at one state.
fn torque(model: TorqueModel, state: &State<'_>) -> [u64; 2] {
    let mut tau = [0.0; 2];
    let mut estimator = TorqueEstimator::new(Arc::new(model));
    estimator
        .estimate_into(state, &mut tau)
        .expect("right lengths");
    tau.map(f64::to_bits)
}

/// Shown motion with an error gives the torque that true motion gives without.
#[test]
fn it_goes_before_anything_else() {
    let cos_sin = [[3e-3, -4e-3], [0.0, 2e-3]];
    let shown = [[0.4, -0.7], [1.0, 0.3], [-2.0, 0.8]];
    let [q, dq, ddq] = &shown;
    let of = |j: usize| true_motion(q[j], dq[j], ddq[j], cos_sin[j]);
    let motion = [of(0), of(1)];
    let [q_true, dq_true, ddq_true] = [0, 1, 2].map(|k| motion.map(|x| x[k]));
    let link = State::single(&q_true, &dq_true, &ddq_true);
    for both_sides in [false, true] {
        for delay in [0.0, 0.002] {
            let plain = model(JointKind::Revolute, delay);
            let error = EncoderError {
                cos_sin: cos_sin.to_vec(),
                both_sides,
            };
            let with = plain
                .clone()
                .with_encoder_error(error)
                .expect("joints that turn");
            let expected = if both_sides {
                link
            } else {
                State {
                    q_motor: q,
                    dq_motor: dq,
                    ddq_motor: ddq,
                    ..link
                }
            };
            let shown = State::single(q, dq, ddq);
            assert_eq!(torque(with, &shown), torque(plain.clone(), &expected));
            assert_ne!(torque(plain.clone(), &shown), torque(plain, &expected));
        }
    }
}

#[test]
fn what_makes_no_sense_is_refused() {
    let model = model(JointKind::Prismatic, 0.0);
    let with = |cos_sin: Vec<[f64; 2]>| {
        let error = EncoderError {
            cos_sin,
            both_sides: false,
        };
        model.clone().with_encoder_error(error)
    };
    let what = "encoder_error";
    assert!(with(vec![[1e-3, 0.0], [0.0; 2]])
        .expect("good")
        .encoder_error()
        .is_some());
    assert_eq!(with(vec![[0.0; 2]; 2]).expect("none"), model);
    assert_eq!(
        with(vec![[0.0; 2], [1e-3, 0.0]]),
        Err(CoreError::Range { what })
    );
    assert_eq!(
        with(vec![[f64::NAN, 0.0], [0.0; 2]]),
        Err(CoreError::NonFiniteParameter)
    );
    let (expected, actual) = (2, 1);
    assert_eq!(
        with(vec![[0.0; 2]]),
        Err(CoreError::Length {
            what,
            expected,
            actual
        })
    );
}
