//! The estimator behind a handle: one state in, one torque per joint out, nothing allocated.

use std::sync::Arc;

use dynid_core::{State, Status, TorqueEstimator};

use crate::failure::{DynidCode, Failure};
use crate::guard::guarded;
use crate::model::DynidModel;
use crate::pointer::{copy_out, exclusive, hand_out, shared, take_back, values};

/// The state held a NaN or an infinity, or the torque overflowed; the last good torque is repeated.
pub const DYNID_STATUS_NON_FINITE: u32 = 1;
/// The state is outside the box that the model was trained on.
pub const DYNID_STATUS_OUTSIDE_DOMAIN: u32 = 2;
/// The third loop was asked far from its data; its torque was faded out.
pub const DYNID_STATUS_RESIDUAL_FADED: u32 = 4;
/// An effect needs a signal that the state does not have (a temperature); its torque is zero on that joint.
pub const DYNID_STATUS_SIGNAL_MISSING: u32 = 8;
/// The torque channel is late, and states do not reach back far enough yet: the oldest one was evaluated.
pub const DYNID_STATUS_SETTLING: u32 = 512;
/// The state lies beyond the model's limits; it was evaluated at them.
pub const DYNID_STATUS_BEYOND_LIMITS: u32 = 4096;

// cbindgen reads numbers, not the core; this holds the two together.
const _: () = {
    const fn same(ours: u32, core: Status) {
        assert!(ours == core.bits());
    }
    same(DYNID_STATUS_NON_FINITE, Status::NON_FINITE);
    same(DYNID_STATUS_OUTSIDE_DOMAIN, Status::OUTSIDE_DOMAIN);
    same(DYNID_STATUS_RESIDUAL_FADED, Status::RESIDUAL_FADED);
    same(DYNID_STATUS_SIGNAL_MISSING, Status::SIGNAL_MISSING);
    same(DYNID_STATUS_SETTLING, Status::SETTLING);
    same(DYNID_STATUS_BEYOND_LIMITS, Status::BEYOND_LIMITS);
};

/// One state: each pointer leads to as many doubles as there are joints.
#[repr(C)]
pub struct DynidState {
    /// Link-side position \[rad, m\].
    pub q: *const f64,
    /// Link-side velocity \[rad/s, m/s\].
    pub dq: *const f64,
    /// Link-side acceleration \[rad/s^2, m/s^2\].
    pub ddq: *const f64,
    /// Motor position divided by the gear ratio \[rad, m\]; NULL with one encoder per joint, like the next two.
    pub q_motor: *const f64,
    /// Motor velocity divided by the gear ratio.
    pub dq_motor: *const f64,
    /// Motor acceleration divided by the gear ratio.
    pub ddq_motor: *const f64,
    /// Measured temperatures \[degC\], NaN where one is not known; NULL without.
    pub temperature: *const f64,
}

/// Evaluates a model and remembers what its effects remember. For one thread at a time.
pub struct DynidEstimator {
    estimator: TorqueEstimator,
    /// Results wait here, so that the caller's arrays may overlap.
    row: Vec<f64>,
}

impl DynidEstimator {
    fn new(estimator: TorqueEstimator) -> Self {
        let row = vec![0.0; estimator.model().robot().n_joints()];
        Self { estimator, row }
    }
}

fn check_n(what: &'static str, actual: usize, expected: usize) -> Result<(), Failure> {
    if actual == expected {
        Ok(())
    } else {
        Err(Failure::Length {
            what,
            expected,
            actual,
        })
    }
}

/// A new estimator of `model` at `*estimator`; free it with dynid_estimator_free. `step` is the time between the states
/// that will come \[s\], 0 for the model's own. This is the last allocation. Where it fails `*estimator` stays as it is.
///
/// # Safety
/// `model` is NULL or a handle; `estimator` leads to room for a pointer.
#[no_mangle]
pub unsafe extern "C" fn dynid_estimator_new(
    model: *const DynidModel,
    step: f64,
    estimator: *mut *mut DynidEstimator,
) -> DynidCode {
    guarded(|| {
        // SAFETY: the caller's word on `model` is this function's condition.
        let model = unsafe { shared("model", model) }?;
        let made = TorqueEstimator::new(Arc::clone(&model.model));
        let made = if step == 0.0 {
            made
        } else {
            made.with_step(step).map_err(Failure::Core)?
        };
        // SAFETY: the caller's word on `estimator` is this function's condition.
        unsafe { hand_out("estimator", DynidEstimator::new(made), estimator) }
    })
}

/// A second estimator at `*copy` that remembers what `estimator` does; free it with dynid_estimator_free. Allocates.
///
/// # Safety
/// `estimator` is NULL or a handle that nobody steps meanwhile; `copy` leads to room for a pointer.
#[no_mangle]
pub unsafe extern "C" fn dynid_estimator_clone(
    estimator: *const DynidEstimator,
    copy: *mut *mut DynidEstimator,
) -> DynidCode {
    guarded(|| {
        // SAFETY: the caller's word on `estimator` is this function's condition.
        let made = unsafe { shared("estimator", estimator) }?.estimator.clone();
        // SAFETY: the caller's word on `copy` is this function's condition.
        unsafe { hand_out("copy", DynidEstimator::new(made), copy) }
    })
}

/// Forgets everything, as if it were new. Allocates nothing.
///
/// # Safety
/// `estimator` is NULL or a handle that nobody else uses meanwhile.
#[no_mangle]
pub unsafe extern "C" fn dynid_estimator_reset(estimator: *mut DynidEstimator) -> DynidCode {
    guarded(|| {
        // SAFETY: the caller's word is this function's condition.
        unsafe { exclusive("estimator", estimator) }?
            .estimator
            .reset();
        Ok(())
    })
}

/// Frees an estimator; NULL is nothing to free.
///
/// # Safety
/// `estimator` is NULL or a handle that is not freed yet and not used any more.
#[no_mangle]
pub unsafe extern "C" fn dynid_estimator_free(estimator: *mut DynidEstimator) {
    // SAFETY: the caller's word is this function's condition.
    unsafe { take_back(estimator) };
}

/// One step: the torque of every joint at `state` into `tau` (n_joints doubles), what was unusual into `*status`
/// (DYNID_STATUS_ bits, 0 for a good step). Call it once per cycle, in order of time: effects remember.
///
/// `tau` is finite whatever comes in: a NaN, an infinity or an overflow repeats the last good torque (zeros before the
/// first) and says so in the status. No allocation, no lock, no system call. Where it fails nothing is written and nothing is
/// remembered. `tau` may be one of the arrays of `state`.
///
/// # Safety
/// `estimator` is NULL or a handle that nobody else uses meanwhile; `state` is NULL or leads to a state, whose arrays and
/// `tau` are NULL or have `n_joints` doubles; `status` leads to room for its type.
#[no_mangle]
pub unsafe extern "C" fn dynid_estimator_estimate(
    estimator: *mut DynidEstimator,
    state: *const DynidState,
    tau: *mut f64,
    n_joints: usize,
    status: *mut u32,
) -> DynidCode {
    guarded(|| {
        // SAFETY: the caller's word on `estimator` is this function's condition.
        let DynidEstimator { estimator, row } = unsafe { exclusive("estimator", estimator) }?;
        check_n("n_joints", n_joints, row.len())?;
        // SAFETY: the caller's word on `state` and its arrays is this function's condition.
        let state = unsafe { borrowed(shared("state", state)?, n_joints) }?;
        // Nothing is to be remembered of a step that cannot be handed out.
        for (what, missing) in [("tau", tau.is_null()), ("status", status.is_null())] {
            if missing {
                return Err(Failure::Null(what));
            }
        }
        for (what, aligned) in [("tau", tau.is_aligned()), ("status", status.is_aligned())] {
            if !aligned {
                return Err(Failure::Unaligned(what));
            }
        }
        let bits = estimator
            .estimate_into(&state, row)
            .map_err(Failure::Core)?
            .bits();
        // SAFETY: the caller's word on `tau` and `status` is this function's condition.
        unsafe {
            copy_out("tau", row, tau)?;
            copy_out("status", &[bits], status)
        }
    })
}

/// The state behind the pointers.
///
/// # Safety
/// Every pointer is NULL or leads to `n` doubles that nobody changes for `'a`.
unsafe fn borrowed<'a>(state: &DynidState, n: usize) -> Result<State<'a>, Failure> {
    // SAFETY: the caller's word is this function's condition, for each of them.
    let read = |what, pointer| unsafe { values(what, pointer, n) };
    let mut read_state = State::single(
        read("q", state.q)?,
        read("dq", state.dq)?,
        read("ddq", state.ddq)?,
    );
    let motor = [state.q_motor, state.dq_motor, state.ddq_motor];
    match motor.iter().filter(|pointer| pointer.is_null()).count() {
        3 => {}
        0 => {
            read_state.q_motor = read("q_motor", state.q_motor)?;
            read_state.dq_motor = read("dq_motor", state.dq_motor)?;
            read_state.ddq_motor = read("ddq_motor", state.ddq_motor)?;
        }
        _ => return Err(Failure::Partial),
    }
    if !state.temperature.is_null() {
        read_state.temperature = Some(read("temperature", state.temperature)?);
    }
    Ok(read_state)
}

/// Torque of every term at the last step into `terms`: n_terms rows of n_joints, `n_values` doubles in all.
///
/// # Safety
/// `estimator` is NULL or a handle that nobody steps meanwhile; `terms` is NULL or has room for `n_values` doubles.
#[no_mangle]
pub unsafe extern "C" fn dynid_estimator_terms(
    estimator: *const DynidEstimator,
    terms: *mut f64,
    n_values: usize,
) -> DynidCode {
    guarded(|| {
        // SAFETY: the caller's word on `estimator` is this function's condition.
        let estimator = &unsafe { shared("estimator", estimator) }?.estimator;
        check_n("n_values", n_values, estimator.terms().len())?;
        // SAFETY: the caller's word on `terms` is this function's condition.
        unsafe { copy_out("terms", estimator.terms(), terms) }
    })
}

/// Standard deviation that the model expects of measured minus predicted torque at the last step into `std_dev` (n_joints
/// doubles).
///
/// # Safety
/// `estimator` is NULL or a handle that nobody else uses meanwhile; `std_dev` is NULL or has room for `n_joints` doubles.
#[no_mangle]
pub unsafe extern "C" fn dynid_estimator_predicted_std(
    estimator: *mut DynidEstimator,
    std_dev: *mut f64,
    n_joints: usize,
) -> DynidCode {
    guarded(|| {
        // SAFETY: the caller's word on `estimator` is this function's condition.
        let DynidEstimator { estimator, row } = unsafe { exclusive("estimator", estimator) }?;
        check_n("n_joints", n_joints, row.len())?;
        estimator.predicted_std_into(row).map_err(Failure::Core)?;
        // SAFETY: the caller's word on `std_dev` is this function's condition.
        unsafe { copy_out("std_dev", row, std_dev) }
    })
}
