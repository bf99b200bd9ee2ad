//! `libdynid`: [`dynid_core::TorqueEstimator`] for controllers in C and C++. `dynid.h` is made of these files.
//!
//! ```text
//! dynid_model_load -> DynidModel -> dynid_estimator_new -> DynidEstimator -> dynid_estimator_estimate, 1000 times a second
//! ```
//!
//! No formula lives here. Pointers are checked in [`pointer`], panics end in [`guard`], sentences wait in [`failure`].

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout
)]
// The C boundary: exported names, and pointers that somebody else made. The dereferences are in `pointer`.
#![allow(unsafe_code)]

mod estimator;
mod failure;
mod guard;
mod model;
mod pointer;

pub use estimator::{
    dynid_estimator_clone, dynid_estimator_estimate, dynid_estimator_free, dynid_estimator_new,
    dynid_estimator_predicted_std, dynid_estimator_reset, dynid_estimator_terms, DynidEstimator,
    DynidState, DYNID_STATUS_BEYOND_LIMITS, DYNID_STATUS_NON_FINITE, DYNID_STATUS_OUTSIDE_DOMAIN,
    DYNID_STATUS_RESIDUAL_FADED, DYNID_STATUS_SETTLING, DYNID_STATUS_SIGNAL_MISSING,
};
pub use failure::{dynid_last_error, dynid_version, DynidCode};
pub use model::{
    dynid_model_free, dynid_model_joint_name, dynid_model_joint_unit, dynid_model_load,
    dynid_model_n_joints, dynid_model_n_terms, dynid_model_parse, dynid_model_robot_name,
    dynid_model_step, dynid_model_term_name, dynid_model_torque_delay, dynid_model_torque_unit,
    dynid_model_wants_motor_side, dynid_model_wants_temperature, DynidModel,
};
