//! A step through the C boundary allocates nothing, whether it works or is refused, and neither does a reset.

#![allow(unsafe_code)] // a global allocator, and calls as C makes them

#[path = "../../dynid-core/tests/every_effect/mod.rs"]
mod every_effect;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ptr::{null, null_mut};

use dynid::*;
use dynid_core::model::TorqueModelParts;
use dynid_core::{
    Domain, EffectTerm, Joint, JointKind, JointLimits, NormalisedRbf, Residual, ResidualInputs,
    RobotModel, TorqueModel,
};
use every_effect::every_effect;
use nalgebra::{Rotation3, Vector3};

/// The system's allocator, counting this thread's calls.
struct Counting;

thread_local! {
    static CALLS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call is handed to `System` as it came; counting touches a thread-local without destructor, which does
// not allocate. What is not named here goes through these two.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.with(|calls| calls.set(calls.get() + 1));
        System.alloc(layout)
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        CALLS.with(|calls| calls.set(calls.get() + 1));
        System.dealloc(pointer, layout);
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const N: usize = 6;

fn model_text() -> String {
    let joints = (0..N)
        .map(|j| Joint {
            name: format!("joint {j}"),
            link: format!("link {j}"),
            kind: JointKind::Revolute,
            rotation: Rotation3::from_euler_angles(0.3 * j as f64, -0.2, 0.5).into_inner(),
            translation: Vector3::new(0.1, -0.2, 0.3),
            axis: Vector3::z(),
            limits: JointLimits::default(),
            rotor_inertia: 0.0,
            gear_ratio: None,
            phi: [2.0, 0.3, -0.1, 0.5, 0.7, 0.02, 0.9, -0.05, 0.04, 1.1],
        })
        .collect();
    let robot = RobotModel::new("arm".to_owned(), joints, Vector3::new(0.0, 0.0, -9.81)).unwrap();
    let terms = every_effect(N).into_iter().map(|effect| {
        let coefficients = vec![0.5; N * effect.n_columns()];
        EffectTerm::new(effect, coefficients, N).unwrap()
    });
    let bumps = NormalisedRbf::new(vec![0.0; 2], vec![1.0; 2], vec![1.0], vec![0.1]).unwrap();
    let model = TorqueModel::new(TorqueModelParts {
        phi: robot.phi(),
        robot,
        torque_scale: vec![1.0; N],
        effects: terms.collect(),
        residual: Some(
            Residual::new(ResidualInputs::Deflection, vec![Some(bumps.into()); N]).unwrap(),
        ),
        encoder_delay: vec![0.002; N],
        noise_std: vec![0.1; N],
        domain: Domain {
            q: vec![[-1.0, 1.0]; N],
            dq: vec![1.0; N],
            ddq: vec![1.0; N],
        },
        torque_unit: "N*m".to_owned(),
        step: Some(0.001),
    });
    let late = model.unwrap().with_torque_delay(&[0.0123; N]).unwrap();
    dynid_io::model_file::to_text(&late).unwrap()
}

#[test]
fn ten_thousand_steps_from_c_allocate_nothing() {
    let text = model_text();
    let (mut model, mut estimator) = (null_mut(), null_mut());
    // SAFETY: pointers to live values of the right kind, or null on purpose, throughout this test.
    unsafe {
        assert_eq!(
            dynid_model_parse(text.as_ptr(), text.len(), &mut model),
            DynidCode::Ok
        );
        assert_eq!(
            dynid_estimator_new(model, 0.0, &mut estimator),
            DynidCode::Ok
        );
        let _ = dynid_last_error();
        let (mut q, mut tau, mut std_dev) = ([0.0; N], [0.0; N], [0.0; N]);
        let mut status = 0;
        let mut seen = 0;

        let before = CALLS.with(Cell::get);
        for k in 0..10_000 {
            for (j, q) in q.iter_mut().enumerate() {
                *q = 1.2 * (0.01 * f64::from(k) + j as f64).sin();
            }
            if k % 100 == 50 {
                q[3] = f64::NAN;
            }
            let q = q.as_ptr();
            let mut state = DynidState {
                q,
                dq: q,
                ddq: q,
                q_motor: null(),
                dq_motor: null(),
                ddq_motor: null(),
                temperature: if k % 3 == 0 { null() } else { q },
            };
            let good =
                dynid_estimator_estimate(estimator, &state, tau.as_mut_ptr(), N, &mut status);
            assert!(good == DynidCode::Ok && tau.iter().all(|tau| tau.is_finite()));
            seen |= status;
            assert_eq!(
                dynid_estimator_predicted_std(estimator, std_dev.as_mut_ptr(), N),
                DynidCode::Ok
            );
            // Refusals make a sentence, and that allocates nothing either.
            state.dq = null();
            let tau = tau.as_mut_ptr();
            let refused = dynid_estimator_estimate(estimator, &state, tau, N, &mut status);
            assert_eq!(refused, DynidCode::Pointer);
            let short = dynid_estimator_estimate(estimator, &state, tau, N - 1, &mut status);
            assert_eq!(short, DynidCode::Length);
            if k % 1000 == 999 {
                assert_eq!(dynid_estimator_reset(estimator), DynidCode::Ok);
            }
        }
        let after = CALLS.with(Cell::get);
        assert_eq!(after - before, 0);
        assert_eq!(
            seen,
            DYNID_STATUS_NON_FINITE
                | DYNID_STATUS_OUTSIDE_DOMAIN
                | DYNID_STATUS_SIGNAL_MISSING
                | DYNID_STATUS_SETTLING
        );

        dynid_estimator_free(estimator);
        dynid_model_free(model);
        assert!(
            CALLS.with(Cell::get) > after,
            "the counter should see the frees"
        );
    }
}
