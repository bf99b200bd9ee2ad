//! The model behind a handle: loading it, and the facts that a controller asks for.

use core::ffi::{c_char, CStr};
use std::ffi::CString;
use std::path::Path;
use std::sync::Arc;

use dynid_core::{JointKind, TorqueModel};

use crate::failure::{remember, DynidCode, Failure};
use crate::guard::guarded;
use crate::pointer::{hand_out, shared, take_back, values};

/// An identified model. Immutable: any number of threads may use it, and estimators outlive it.
pub struct DynidModel {
    pub(crate) model: Arc<TorqueModel>,
    robot_name: CString,
    joint_names: Vec<CString>,
    term_names: Vec<CString>,
    torque_unit: CString,
    wants_temperature: Vec<bool>,
    wants_motor_side: bool,
}

impl DynidModel {
    fn new(model: TorqueModel) -> Self {
        let robot = model.robot();
        let joints = robot.joints().iter();
        let residual = model.residual();
        let delayed = model.encoder_delay().iter().any(|delay| *delay != 0.0);
        Self {
            robot_name: c_string(robot.name()),
            joint_names: joints.map(|joint| c_string(&joint.name)).collect(),
            term_names: model.term_names().iter().map(|n| c_string(n)).collect(),
            torque_unit: c_string(model.torque_unit()),
            wants_temperature: model.wants_temperature(),
            wants_motor_side: delayed || residual.is_some_and(|r| r.inputs().two_encoders()),
            model: Arc::new(model),
        }
    }
}

/// A name as C reads it. A zero would end it early, so it becomes a replacement character.
fn c_string(text: &str) -> CString {
    CString::new(text.replace('\0', "\u{fffd}")).unwrap_or_default()
}

/// Loads the model.json at `path`, a zero-terminated path (UTF-8 on Windows), into a new handle at `*model`; free it with
/// dynid_model_free. Where it fails `*model` stays as it is. Allocates and reads a file: not for the control loop.
///
/// # Safety
/// `path` is a zero-terminated string; `model` leads to room for a pointer.
#[no_mangle]
pub unsafe extern "C" fn dynid_model_load(
    path: *const c_char,
    model: *mut *mut DynidModel,
) -> DynidCode {
    guarded(|| {
        if path.is_null() {
            return Err(Failure::Null("path"));
        }
        // SAFETY: not null, and by the caller's word zero-terminated.
        let path = path_of(unsafe { CStr::from_ptr(path) })?;
        let loaded = dynid_io::load(path).map_err(Failure::File)?;
        // SAFETY: the caller's word on `model` is this function's condition.
        unsafe { hand_out("model", DynidModel::new(loaded), model) }
    })
}

#[cfg(unix)]
fn path_of(path: &CStr) -> Result<&Path, Failure> {
    use std::os::unix::ffi::OsStrExt;
    Ok(Path::new(std::ffi::OsStr::from_bytes(path.to_bytes())))
}

#[cfg(not(unix))]
fn path_of(path: &CStr) -> Result<&Path, Failure> {
    path.to_str().map(Path::new).map_err(|_| Failure::Path)
}

/// The same from the `n_bytes` bytes of a model.json in memory.
///
/// # Safety
/// `bytes` leads to `n_bytes` bytes; `model` leads to room for a pointer.
#[no_mangle]
pub unsafe extern "C" fn dynid_model_parse(
    bytes: *const u8,
    n_bytes: usize,
    model: *mut *mut DynidModel,
) -> DynidCode {
    guarded(|| {
        // SAFETY: the caller's word on `bytes` is this function's condition.
        let bytes = unsafe { values("bytes", bytes, n_bytes) }?;
        let parsed = dynid_io::parse(bytes, "model").map_err(Failure::File)?;
        // SAFETY: the caller's word on `model` is this function's condition.
        unsafe { hand_out("model", DynidModel::new(parsed), model) }
    })
}

/// Frees a model; NULL is nothing to free. Estimators made of it stay usable.
///
/// # Safety
/// `model` is NULL or a handle that is not freed yet and not used any more.
#[no_mangle]
pub unsafe extern "C" fn dynid_model_free(model: *mut DynidModel) {
    // SAFETY: the caller's word is this function's condition.
    unsafe { take_back(model) };
}

/// What `read` finds in the model, or `none` with a sentence where there is no such thing.
///
/// # Safety
/// As [`shared`].
unsafe fn fact<T>(
    model: *const DynidModel,
    none: T,
    read: impl FnOnce(&DynidModel) -> Result<T, Failure>,
) -> T {
    // SAFETY: the caller's word is this function's condition.
    let found = unsafe { shared("model", model) }.and_then(read);
    found.unwrap_or_else(|failure| {
        remember(&failure);
        none
    })
}

/// Entry `index` of a list, or a sentence.
fn entry<'a, T>(what: &'static str, list: &'a [T], index: usize) -> Result<&'a T, Failure> {
    let count = list.len();
    let none = Failure::Index { what, index, count };
    list.get(index).ok_or(none)
}

/// Number of joints; 0 if `model` is NULL.
///
/// # Safety
/// `model` is NULL or a handle.
#[no_mangle]
pub unsafe extern "C" fn dynid_model_n_joints(model: *const DynidModel) -> usize {
    // SAFETY: the caller's word is this function's condition.
    unsafe { fact(model, 0, |m| Ok(m.joint_names.len())) }
}

/// Number of terms whose sum is the torque; 0 if `model` is NULL.
///
/// # Safety
/// `model` is NULL or a handle.
#[no_mangle]
pub unsafe extern "C" fn dynid_model_n_terms(model: *const DynidModel) -> usize {
    // SAFETY: the caller's word is this function's condition.
    unsafe { fact(model, 0, |m| Ok(m.term_names.len())) }
}

/// Name of the robot. Like every text of a model: zero-terminated UTF-8, the model's own, gone when it is freed; NULL
/// with a sentence in dynid_last_error() where there is none.
///
/// # Safety
/// `model` is NULL or a handle.
#[no_mangle]
pub unsafe extern "C" fn dynid_model_robot_name(model: *const DynidModel) -> *const c_char {
    // SAFETY: the caller's word is this function's condition.
    unsafe { fact(model, core::ptr::null(), |m| Ok(m.robot_name.as_ptr())) }
}

/// Name of joint `joint`, counted from 0.
///
/// # Safety
/// `model` is NULL or a handle.
#[no_mangle]
pub unsafe extern "C" fn dynid_model_joint_name(
    model: *const DynidModel,
    joint: usize,
) -> *const c_char {
    // SAFETY: the caller's word is this function's condition.
    unsafe {
        fact(model, core::ptr::null(), |m| {
            entry("joint", &m.joint_names, joint).map(|name| name.as_ptr())
        })
    }
}

/// Unit of the position of joint `joint`: "rad", or "m" where it slides.
///
/// # Safety
/// `model` is NULL or a handle.
#[no_mangle]
pub unsafe extern "C" fn dynid_model_joint_unit(
    model: *const DynidModel,
    joint: usize,
) -> *const c_char {
    // SAFETY: the caller's word is this function's condition.
    unsafe {
        fact(model, core::ptr::null(), |m| {
            let joint = entry("joint", m.model.robot().joints(), joint)?;
            Ok(match joint.kind {
                JointKind::Revolute => c"rad".as_ptr(),
                JointKind::Prismatic => c"m".as_ptr(),
            })
        })
    }
}

/// Name of term `term`, counted from 0: "rigid_body", the effects, "residual".
///
/// # Safety
/// `model` is NULL or a handle.
#[no_mangle]
pub unsafe extern "C" fn dynid_model_term_name(
    model: *const DynidModel,
    term: usize,
) -> *const c_char {
    // SAFETY: the caller's word is this function's condition.
    unsafe {
        fact(model, core::ptr::null(), |m| {
            entry("term", &m.term_names, term).map(|name| name.as_ptr())
        })
    }
}

/// Unit of every torque: "N*m", or "A" where currents were identified.
///
/// # Safety
/// `model` is NULL or a handle.
#[no_mangle]
pub unsafe extern "C" fn dynid_model_torque_unit(model: *const DynidModel) -> *const c_char {
    // SAFETY: the caller's word is this function's condition.
    unsafe { fact(model, core::ptr::null(), |m| Ok(m.torque_unit.as_ptr())) }
}

/// Time between the states that the model was made for \[s\]; 0 where nothing in it depends on that.
///
/// # Safety
/// `model` is NULL or a handle.
#[no_mangle]
pub unsafe extern "C" fn dynid_model_step(model: *const DynidModel) -> f64 {
    // SAFETY: the caller's word is this function's condition.
    unsafe { fact(model, 0.0, |m| Ok(m.model.step().unwrap_or(0.0))) }
}

/// How late the torque channel of joint `joint` is behind the encoders \[s\]: an estimator gives the torque of the state of
/// that long ago, which is what the channel shows. Negative where the channel is early; an estimator then gives the torque
/// of the state, which the channel has shown before. 0 if `model` is NULL or has no such joint.
///
/// # Safety
/// `model` is NULL or a handle.
#[no_mangle]
pub unsafe extern "C" fn dynid_model_torque_delay(model: *const DynidModel, joint: usize) -> f64 {
    // SAFETY: the caller's word is this function's condition.
    unsafe {
        fact(model, 0.0, |m| {
            entry("joint", m.model.torque_delay(), joint).copied()
        })
    }
}

/// True if friction of joint `joint` follows a measured temperature.
///
/// # Safety
/// `model` is NULL or a handle.
#[no_mangle]
pub unsafe extern "C" fn dynid_model_wants_temperature(
    model: *const DynidModel,
    joint: usize,
) -> bool {
    // SAFETY: the caller's word is this function's condition.
    unsafe {
        fact(model, false, |m| {
            entry("joint", &m.wants_temperature, joint).copied()
        })
    }
}

/// True if the model was identified with an encoder on either side of the gears, so that the motor side should be given.
///
/// # Safety
/// `model` is NULL or a handle.
#[no_mangle]
pub unsafe extern "C" fn dynid_model_wants_motor_side(model: *const DynidModel) -> bool {
    // SAFETY: the caller's word is this function's condition.
    unsafe { fact(model, false, |m| Ok(m.wants_motor_side)) }
}
