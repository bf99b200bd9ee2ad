//! The Python face: arrays in, arrays out, errors mapped. No formula lives here.

mod adapt;
mod arrays;
mod base;
mod c_header;
mod effects;
mod em;
mod errors;
mod excitation;
mod friction_search;
mod habits;
mod likeliest;
mod lists;
mod mixture;
mod model;
mod observer;
mod offline;
mod physical;
mod rbf;
mod residual;
mod robot;
mod run;
mod samples;
mod signals;
mod small;
mod watch;

use pyo3::prelude::*;

/// Compiled part of `dynid_rs`.
#[pymodule]
fn _core(m: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = m.py();
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add("UrdfError", py.get_type::<errors::UrdfError>())?;
    m.add("MdhError", py.get_type::<errors::MdhError>())?;
    m.add("FormatError", py.get_type::<errors::FormatError>())?;
    m.add(
        "LINK_PARAMETER_NAMES",
        dynid_core::link_params::NAMES.to_vec(),
    )?;
    m.add(
        "FRICTION_NAMES",
        dynid_core::effects::FRICTION_NAMES.to_vec(),
    )?;
    m.add_class::<robot::PyRobotModel>()?;
    m.add_class::<base::PyBaseParameters>()?;
    m.add_class::<effects::PyEffect>()?;
    m.add_class::<mixture::PyGaussianMixtureRegression>()?;
    m.add_class::<rbf::PyNormalisedRbf>()?;
    m.add_class::<model::PyTorqueModel>()?;
    m.add_class::<excitation::PyExcitation>()?;
    m.add_function(wrap_pyfunction!(excitation::inverse_dynamics_gradient, m)?)?;
    m.add_function(wrap_pyfunction!(excitation::places, m)?)?;
    m.add_function(wrap_pyfunction!(excitation::places_gradient, m)?)?;
    m.add_class::<friction_search::PyFrictionSearch>()?;
    // What `__reduce__` names: other processes build copies with them. Set, not added: they are nobody else's.
    m.setattr("_robot_of", wrap_pyfunction!(robot::_robot_of, m)?)?;
    m.setattr("_model_of", wrap_pyfunction!(model::_model_of, m)?)?;
    m.setattr("_effect_of", wrap_pyfunction!(effects::_effect_of, m)?)?;
    m.setattr("_base_of", wrap_pyfunction!(base::_base_of, m)?)?;
    m.add_class::<physical::PyPhysicalSet>()?;
    m.add_function(wrap_pyfunction!(effects::friction_basis, m)?)?;
    m.add_function(wrap_pyfunction!(effects::effect_catalogue, m)?)?;
    m.add_function(wrap_pyfunction!(effects::effect_columns, m)?)?;
    m.add_function(wrap_pyfunction!(effects::effect_torque, m)?)?;
    m.add_function(wrap_pyfunction!(effects::motor_torque, m)?)?;
    m.add_function(wrap_pyfunction!(signals::residual_inputs, m)?)?;
    m.add_function(wrap_pyfunction!(signals::named_signals, m)?)?;
    m.add_function(wrap_pyfunction!(signals::align_link_side, m)?)?;
    m.add_function(wrap_pyfunction!(signals::true_motion, m)?)?;
    m.add_function(wrap_pyfunction!(offline::observe, m)?)?;
    m.add_function(wrap_pyfunction!(observer::observe_momentum, m)?)?;
    m.add_function(wrap_pyfunction!(observer::read_contact, m)?)?;
    m.add_function(wrap_pyfunction!(watch::watch_run, m)?)?;
    m.add_function(wrap_pyfunction!(watch::read_watch, m)?)?;
    m.add_function(wrap_pyfunction!(adapt::adapt_run, m)?)?;
    m.add_function(wrap_pyfunction!(adapt::with_adapted, m)?)?;
    m.add_function(wrap_pyfunction!(offline::fold, m)?)?;
    m.add_function(wrap_pyfunction!(offline::weighted_fit, m)?)?;
    m.add_function(wrap_pyfunction!(offline::processor_path, m)?)?;
    m.add_function(wrap_pyfunction!(offline::sign_slopes, m)?)?;
    m.add_function(wrap_pyfunction!(offline::low_pass, m)?)?;
    m.add_function(wrap_pyfunction!(offline::extent, m)?)?;
    m.add_function(wrap_pyfunction!(offline::slope, m)?)?;
    m.add_function(wrap_pyfunction!(offline::triangular_factor, m)?)?;
    m.add_function(wrap_pyfunction!(offline::merge_factors, m)?)?;
    m.add_function(wrap_pyfunction!(physical::pseudo_inertia, m)?)?;
    m.add_function(wrap_pyfunction!(physical::phi_from_pseudo_inertia, m)?)?;
    m.add_function(wrap_pyfunction!(physical::mjcf_with_physical, m)?)?;
    m.add_function(wrap_pyfunction!(physical::urdf_with_physical, m)?)?;
    m.add_function(wrap_pyfunction!(c_header::c_header, m)?)?;
    m.add_function(wrap_pyfunction!(c_header::c_prefix, m)?)?;
    m.add_function(wrap_pyfunction!(em::fit_mixture, m)?)?;
    m.add_function(wrap_pyfunction!(likeliest::likeliest, m)?)?;
    Ok(())
}
