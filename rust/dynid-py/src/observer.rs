//! The observer along a run, by the code that runs online.

use std::sync::Arc;

use dynid_core::{ObserverSettings, OnlineEstimator};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::model::PyTorqueModel;
use crate::samples::Samples;
use crate::{arrays, errors};

type Observation<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<u32>>,
    f64,
);

/// External torque, threshold, what of it is friction at rest, and expected deviation (n_samples, n), status bits (n_samples,) and the delay of all of them
/// \[s\], which is zero where dq and ddq are given.
#[pyfunction]
#[pyo3(signature = (model, t, motion, tau, *, temperature=None, step, window=None, time_constant, correlation_time=None, false_per_hour))]
#[expect(clippy::too_many_arguments, reason = "a keyword function")]
pub fn observe_momentum<'py>(
    py: Python<'py>,
    model: &PyTorqueModel,
    t: &Bound<'py, PyAny>,
    motion: [Option<Bound<'py, PyAny>>; 6],
    tau: &Bound<'py, PyAny>,
    temperature: Option<&Bound<'py, PyAny>>,
    step: f64,
    window: Option<usize>,
    time_constant: f64,
    correlation_time: Option<f64>,
    false_per_hour: f64,
) -> PyResult<Observation<'py>> {
    let n = model.0.robot().n_joints();
    let run = Samples::of(n, t, &motion, tau, temperature)?;
    let n_samples = run.len();
    let settings = ObserverSettings {
        time_constant,
        correlation_time,
        false_per_hour,
    };
    let online = OnlineEstimator::new(Arc::clone(&model.0), Some(step), window);
    let mut online = online
        .and_then(|online| online.observing(settings))
        .map_err(errors::core)?;
    let delay = if run.is_direct() { 0.0 } else { online.delay() };
    let mut external = vec![0.0; n_samples * n];
    let mut threshold = vec![f64::INFINITY; n_samples * n];
    let mut rest = vec![0.0; n_samples * n];
    let mut std = vec![0.0; n_samples * n];
    let mut status = vec![0; n_samples];
    let rows = run.rows()?;
    py.detach(|| {
        for (k, status) in status.iter_mut().enumerate() {
            let at = k * n..(k + 1) * n;
            *status = online.step(&rows.at(k))?.bits();
            online
                .estimator()
                .predicted_std_into(&mut std[at.clone()])?;
            if let Some(observer) = online.observer() {
                external[at.clone()].copy_from_slice(observer.external());
                threshold[at.clone()].copy_from_slice(observer.threshold());
                rest[at].copy_from_slice(observer.rest());
            }
        }
        Ok(())
    })
    .map_err(errors::core)?;
    Ok((
        arrays::to_matrix(py, external, n)?,
        arrays::to_matrix(py, threshold, n)?,
        arrays::to_matrix(py, rest, n)?,
        arrays::to_matrix(py, std, n)?,
        PyArray1::from_vec(py, status),
        delay,
    ))
}
