//! A whole estimate on every path of this processor, and joints in lanes against joints one by one.
//!
//! The path is the whole process's, so there is one test.

use std::sync::Arc;

use dynid_core::lanes::{use_path, Path};
use dynid_core::model::TorqueModelParts;
use dynid_core::{
    Domain, Effect, EffectInput, EffectTerm, GaussianMixtureRegression, Joint, JointKind,
    JointLimits, NormalisedRbf, Regression, Residual, ResidualInputs, RobotModel, State, Status,
    TorqueEstimator, TorqueModel,
};
use nalgebra::{Rotation3, Vector3};

/// More than a row of eight, and not a multiple of anything.
const N: usize = 11;

/// SplitMix64 on [-1, 1].
struct Uniform(u64);

impl Uniform {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

fn mixture(k: usize, random: &mut Uniform) -> GaussianMixtureRegression {
    let weights = (0..k).map(|_| 1.5 + random.next()).collect();
    let means = (0..3 * k).map(|_| 2.0 * random.next()).collect();
    let covariances = (0..k).flat_map(|_| {
        let [a, b, c] = [0, 1, 2].map(|_| 0.1 * random.next());
        [0.3, a, b, a, 0.4, c, b, c, 0.5]
    });
    GaussianMixtureRegression::new(2, weights, means, covariances.collect()).unwrap()
}

fn model(random: &mut Uniform) -> TorqueModel {
    let joints = (0..N).map(|j| Joint {
        name: format!("joint {j}"),
        link: format!("link {j}"),
        kind: if j % 4 == 2 {
            JointKind::Prismatic
        } else {
            JointKind::Revolute
        },
        rotation: Rotation3::from_euler_angles(random.next(), random.next(), 0.3).into_inner(),
        translation: Vector3::new(0.1, random.next(), 0.3),
        axis: if j % 3 == 0 {
            Vector3::z()
        } else {
            Vector3::new(0.6, 0.0, -0.8)
        },
        limits: JointLimits::default(),
        rotor_inertia: 0.0,
        gear_ratio: None,
        phi: [2.0, 0.3, -0.1, 0.5, 0.7, 0.02, 0.9, -0.05, 0.04, 1.1],
    });
    let joints: Vec<Joint> = joints.collect();
    let robot = RobotModel::new("arm".to_owned(), joints, Vector3::new(0.0, 1.0, -9.81)).unwrap();
    let friction = Effect::friction(&[0.3; N], &[0.2; N]).unwrap();
    let coefficients = (0..8 * N).map(|_| random.next()).collect();
    let joints = (0..N).map(|j| match j {
        3 | 10 => None,
        5 => Some(
            NormalisedRbf::new(
                vec![0.0, 0.5, 1.0, -0.5],
                vec![1.0, 2.0],
                vec![2.0, 1.0],
                vec![0.1; 2],
            )
            .unwrap()
            .into(),
        ),
        // Up to more components than one block has.
        _ => Some(mixture(1 + 4 * j, random).into()),
    });
    let joints = joints.collect();
    TorqueModel::new(TorqueModelParts {
        phi: robot.phi(),
        torque_scale: vec![1.0; N],
        effects: vec![EffectTerm::new(friction, coefficients, N).unwrap()],
        residual: Some(Residual::new(ResidualInputs::JointState, joints).unwrap()),
        encoder_delay: vec![0.002; N],
        noise_std: vec![0.1; N],
        domain: Domain {
            q: vec![[-3.0, 3.0]; N],
            dq: vec![3.0; N],
            ddq: vec![9.0; N],
        },
        torque_unit: "N*m".to_owned(),
        step: None,
        robot,
    })
    .unwrap()
}

/// Terms, sum, standard deviation and status of some states, two of which are spoiled.
fn estimates(model: &Arc<TorqueModel>, states: &[[f64; 3 * N]]) -> Vec<f64> {
    let mut estimator = TorqueEstimator::new(Arc::clone(model));
    let (mut tau, mut std) = ([0.0; N], [0.0; N]);
    let mut all = Vec::new();
    for (k, state) in states.iter().enumerate() {
        let [q, dq, ddq] = [0, 1, 2].map(|i| &state[i * N..(i + 1) * N]);
        let status = estimator
            .estimate_into(&State::single(q, dq, ddq), &mut tau)
            .unwrap();
        estimator.predicted_std_into(&mut std).unwrap();
        assert_eq!(
            status.contains(Status::NON_FINITE),
            k == 7 || k == 20,
            "{k}"
        );
        assert_eq!(status.contains(Status::OUTSIDE_DOMAIN), k == 11, "{k}");
        all.extend_from_slice(estimator.terms());
        all.extend_from_slice(&tau);
        all.extend_from_slice(&std);
        all.push(f64::from(status.bits()));
    }
    all
}

/// Friction by its columns and the mixtures one by one give the bits that the estimator summed.
fn check_terms(model: &Arc<TorqueModel>, state: &[f64; 3 * N]) {
    let [q, dq, ddq] = [0, 1, 2].map(|i| &state[i * N..(i + 1) * N]);
    let state = State::single(q, dq, ddq);
    let mut estimator = TorqueEstimator::new(Arc::clone(model));
    estimator.estimate_into(&state, &mut [0.0; N]).unwrap();
    let (friction, residual) = (&model.effects()[0], model.residual().unwrap());
    let input = EffectInput {
        state,
        tau_link: &[0.0; N],
        tau_motor: &[0.0; N],
        step: 0.0,
        sign: None,
    };
    for j in 0..N {
        let mut columns = [0.0; 8];
        friction
            .effect()
            .columns_into(j, &input, &mut [], &mut columns);
        let coefficients = &friction.coefficients()[8 * j..8 * (j + 1)];
        let torque: f64 = columns.iter().zip(coefficients).map(|(a, b)| a * b).sum();
        assert_eq!(torque, estimator.terms()[N + j], "friction of joint {j}");
        if let Some(Regression::Mixture(mixture)) = &residual.joints()[j] {
            let alone = mixture.predict(&[q[j], dq[j]]);
            let term = estimator.terms()[2 * N + j];
            // Far from the data the torque fades.
            assert!(
                alone.distance_squared > 16.0 || alone.mean == term,
                "joint {j}"
            );
            let many: Vec<f64> = (0..13).flat_map(|_| [q[j], dq[j]]).collect();
            let mut answers = [[0.0; 13]; 3];
            let [mean, variance, distance] = &mut answers;
            mixture
                .predict_into(&many, mean, variance, distance)
                .unwrap();
            for k in 0..13 {
                assert_eq!(
                    answers.map(|row| row[k]),
                    [alone.mean, alone.variance, alone.distance_squared]
                );
            }
            let mut h = vec![0.0; mixture.weights().len()];
            mixture
                .responsibilities_into(&[q[j], dq[j]], &mut h)
                .unwrap();
            assert!((h.iter().sum::<f64>() - 1.0).abs() < 1e-14);
        }
    }
}

#[test]
fn estimates_are_the_same_on_every_path() {
    let mut random = Uniform(3);
    let model = Arc::new(model(&mut random));
    let mut states = vec![[0.0; 3 * N]; 60];
    for x in states.iter_mut().flatten() {
        *x = 2.5 * random.next();
    }
    states[7][4] = f64::NAN;
    states[20][3 * N - 1] = f64::INFINITY;
    states[11][N - 1] = 40_000.0; // beyond what the sines reduce by themselves
    let mut answers = Vec::new();
    for path in Path::ALL.into_iter().filter(|path| path.is_available()) {
        assert!(use_path(path));
        answers.push(estimates(&model, &states));
        check_terms(&model, &states[2]);
    }
    let bits = |x: &[f64]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    for pair in answers.windows(2).skip(1) {
        assert!(bits(&pair[0]) == bits(&pair[1]));
    }
    for (a, b) in answers[0].iter().zip(&answers[answers.len() - 1]) {
        assert!((a - b).abs() <= 1e-10 * (1.0 + a.abs()), "{a:e} {b:e}");
    }
}
