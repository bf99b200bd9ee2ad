//! What effects remember: as long as nothing wrong comes in, and as if nothing had come in when it does.

mod every_effect;

#[path = "chain/mod.rs"]
mod chain;

use std::sync::Arc;

use chain::case;
use dynid_core::effects::motor_torque_into;
use dynid_core::model::TorqueModelParts;
use dynid_core::{
    CoreError, Domain, Effect, EffectInput, EffectTerm, State, Status, TorqueEstimator, TorqueModel,
};
use every_effect::every_effect;
use proptest::collection::vec;
use proptest::prelude::*;

const STEP: f64 = 0.004;

fn parts(robot: dynid_core::RobotModel, phi: Vec<f64>, step: Option<f64>) -> TorqueModelParts {
    let n = robot.n_joints();
    let term = |effect: Effect| {
        let count = n * effect.n_columns();
        EffectTerm::new(effect, vec![0.7; count], n).expect("a valid term")
    };
    TorqueModelParts {
        robot,
        phi,
        torque_scale: vec![1.0; n],
        effects: every_effect(n).into_iter().map(term).collect(),
        residual: None,
        encoder_delay: vec![0.0; n],
        noise_std: vec![0.1; n],
        domain: Domain {
            q: vec![[-9.0, 9.0]; n],
            dq: vec![9.0; n],
            ddq: vec![9.0; n],
        },
        torque_unit: "N*m".to_owned(),
        step,
    }
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|x| x.to_bits()).collect()
}

/// Bad numbers: not finite, and finite ones that overflow.
fn bad() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(f64::NEG_INFINITY),
        Just(1e308)
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn bad_samples_leave_no_trace(
        case in case(4), numbers in vec(-3.0..3.0f64, 30 * 12),
        spoiled in vec(proptest::option::weighted(0.3, (0usize..3, bad())), 30),
    ) {
        let n = case.q.len();
        let model = Arc::new(TorqueModel::new(parts(case.robot, case.phi, Some(STEP))).expect("a valid model"));
        let (mut clean, mut tried) = (TorqueEstimator::new(Arc::clone(&model)), TorqueEstimator::new(model));
        let (mut tau, mut other) = (vec![0.0; n], vec![0.0; n]);
        for (row, spoiled) in numbers.chunks_exact(12).zip(spoiled) {
            let signal = |k: usize| row[4 * k..4 * k + n].to_vec();
            if let Some((which, x)) = spoiled {
                let mut wrong = [signal(0), signal(1), signal(2)];
                wrong[which][0] = x;
                let status = tried.estimate_into(&State::single(&wrong[0], &wrong[1], &wrong[2]), &mut other);
                prop_assert_eq!(status, Ok(Status::NON_FINITE));
                prop_assert_eq!(bits(&tau), bits(&other));
            }
            let (q, dq, ddq) = (signal(0), signal(1), signal(2));
            let state = State::single(&q, &dq, &ddq);
            clean.estimate_into(&state, &mut tau).expect("right lengths");
            tried.estimate_into(&state, &mut other).expect("right lengths");
            prop_assert_eq!(bits(&tau), bits(&other));
            prop_assert_eq!(bits(clean.terms()), bits(tried.terms()));
        }
    }

    #[test]
    fn the_estimator_sums_terms_with_a_memory_of_their_own(case in case(3), numbers in vec(-3.0..3.0f64, 20 * 9)) {
        let n = case.q.len();
        let model = Arc::new(TorqueModel::new(parts(case.robot, case.phi, Some(STEP))).expect("a valid model"));
        let mut memories: Vec<Vec<f64>> =
            model.effects().iter().map(|term| vec![0.0; term.effect().memory_len(n)]).collect();
        prop_assert!(memories.iter().any(|memory| !memory.is_empty()));
        let mut estimator = TorqueEstimator::new(Arc::clone(&model));
        let (mut tau, mut alone, mut tau_motor) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        for row in numbers.chunks_exact(9) {
            let state = State::single(&row[..n], &row[3..3 + n], &row[6..6 + n]);
            estimator.estimate_into(&state, &mut tau).expect("right lengths");
            let tau_link = &estimator.terms()[..n]; // all scales are 1
            let rows = estimator.terms()[n..].chunks_exact(n);
            motor_torque_into(tau_link, model.effects().iter().zip(rows), &mut tau_motor);
            let input = EffectInput { state, tau_link, tau_motor: &tau_motor, step: STEP, sign: None };
            for (k, (term, memory)) in model.effects().iter().zip(&mut memories).enumerate() {
                term.torque_into(&input, memory, &mut alone);
                prop_assert_eq!(bits(&alone), bits(&estimator.terms()[(k + 1) * n..(k + 2) * n]));
            }
        }
    }
}

#[test]
fn a_model_that_changes_with_time_needs_a_step() {
    use proptest::strategy::ValueTree;
    let case = case(2)
        .new_tree(&mut proptest::test_runner::TestRunner::deterministic())
        .expect("a chain")
        .current();
    let new = |step| TorqueModel::new(parts(case.robot.clone(), case.phi.clone(), step));
    let kind = "thermal_friction";
    assert_eq!(new(None), Err(CoreError::NoStep { kind }));
    let range = CoreError::Range { what: "step" };
    for step in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(new(Some(step)), Err(range));
    }
    let estimator = TorqueEstimator::new(Arc::new(new(Some(STEP)).expect("a valid model")));
    assert!(estimator.clone().with_step(0.001).is_ok());
    assert_eq!(estimator.with_step(0.0).err(), Some(range));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A model whose effects stand in another order, with other sizes and other ones between them, goes on where the old one
    /// was; an effect of another shape begins anew.
    #[test]
    fn another_model_goes_on_with_what_the_same_effects_remember(
        case in case(3), numbers in vec(-3.0..3.0f64, 30 * 9), turn in 0usize..17,
    ) {
        let n = case.q.len();
        let parts = parts(case.robot, case.phi, Some(STEP));
        let mut turned = parts.clone();
        turned.effects.rotate_left(turn);
        turned.effects.retain(|term| term.effect().kind() != "torque_ripple");
        // The first that remembers gets another shape.
        let other = Effect::new("friction_hysteresis", &[("presliding_distance", vec![0.123; n])]).expect("a valid shape");
        turned.effects.insert(0, EffectTerm::new(other, vec![0.0; n], n).expect("a valid term"));
        let old = TorqueEstimator::new(Arc::new(TorqueModel::new(parts).expect("a valid model")));
        let new = Arc::new(TorqueModel::new(turned).expect("a valid model"));
        let (mut swapped, mut always) = (old, TorqueEstimator::new(Arc::clone(&new)));
        let (mut tau, mut expected) = (vec![0.0; n], vec![0.0; n]);
        for (k, row) in numbers.chunks_exact(9).enumerate() {
            let signal = |at: usize| &row[3 * at..3 * at + n];
            let state = State::single(signal(0), signal(1), signal(2));
            if k == 15 {
                let mut next = TorqueEstimator::new(Arc::clone(&new));
                next.continue_from(&swapped);
                swapped = next;
            }
            swapped.estimate_into(&state, &mut tau).expect("right lengths");
            always.estimate_into(&state, &mut expected).expect("right lengths");
            if k >= 15 {
                // All but the effect of the other shape, which has no size.
                prop_assert_eq!(bits(&tau), bits(&expected));
            }
        }
    }
}

#[test]
fn nothing_goes_over_to_another_number_of_joints() {
    let model = |n: usize| {
        let joint = dynid_core::Joint {
            name: "joint".into(),
            link: "link".into(),
            kind: dynid_core::JointKind::Revolute,
            rotation: nalgebra::Matrix3::identity(),
            translation: nalgebra::Vector3::x(),
            axis: nalgebra::Vector3::z(),
            limits: dynid_core::JointLimits::default(),
            rotor_inertia: 0.0,
            gear_ratio: None,
            phi: [1.0; 10],
        };
        let robot =
            dynid_core::RobotModel::new("arm".into(), vec![joint; n], nalgebra::Vector3::x())
                .unwrap();
        let phi = robot.phi();
        TorqueEstimator::new(Arc::new(
            TorqueModel::new(parts(robot, phi, Some(STEP))).unwrap(),
        ))
    };
    let (mut one, mut fresh) = (model(1), model(1));
    let mut two = model(2);
    let (mut tau, mut expected) = ([0.0; 2], [0.0; 1]);
    two.estimate_into(&State::single(&[0.3; 2], &[0.2; 2], &[0.1; 2]), &mut tau)
        .unwrap();
    one.continue_from(&two);
    let state = State::single(&[0.5], &[0.4], &[0.3]);
    one.estimate_into(&state, &mut tau[..1]).unwrap();
    fresh.estimate_into(&state, &mut expected).unwrap();
    assert_eq!(bits(&tau[..1]), bits(&expected));
}
