//! The observer along a run, by the code that runs online.

use std::sync::Arc;

use dynid_core::{ObserverSettings, OnlineEstimator, Sample};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::model::PyTorqueModel;
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
    let q = motion[0]
        .as_ref()
        .ok_or_else(|| errors::value("motion: q is missing"))?;
    let beside_q = |signal: &Bound<'py, PyAny>, name: &'static str| {
        arrays::samples([("q", q), (name, signal)], n).map(|[_, signal]| signal)
    };
    let names = ["q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor"];
    let mut signals = Vec::new();
    for (signal, name) in motion.iter().zip(names) {
        signals.push(
            signal
                .as_ref()
                .map(|signal| beside_q(signal, name))
                .transpose()?,
        );
    }
    let tau = beside_q(tau, "tau")?;
    let temperature = temperature
        .map(|temperature| beside_q(temperature, "temperature"))
        .transpose()?;
    let tau = tau.as_slice()?;
    let n_samples = tau.len() / n;
    let t = arrays::vector(t, "t", Some(n_samples))?;
    let t = t.as_slice()?;
    let rows = signals
        .iter()
        .map(|signal| signal.as_ref().map(|signal| signal.as_slice()).transpose())
        .collect::<Result<Vec<_>, _>>()?;
    let temperature = temperature.as_ref().map(|t| t.as_slice()).transpose()?;
    let settings = ObserverSettings {
        time_constant,
        correlation_time,
        false_per_hour,
    };
    let online = OnlineEstimator::new(Arc::clone(&model.0), Some(step), window);
    let mut online = online
        .and_then(|online| online.observing(settings))
        .map_err(errors::core)?;
    let direct = rows[1].is_some() && rows[2].is_some();
    let delay = if direct { 0.0 } else { online.delay() };
    let mut external = vec![0.0; n_samples * n];
    let mut threshold = vec![f64::INFINITY; n_samples * n];
    let mut rest = vec![0.0; n_samples * n];
    let mut std = vec![0.0; n_samples * n];
    let mut status = vec![0; n_samples];
    py.detach(|| {
        for (k, t) in t.iter().enumerate() {
            let at = k * n..(k + 1) * n;
            let sample = Sample {
                sequence: None,
                time: *t,
                motion: std::array::from_fn(|signal| rows[signal].map(|x| &x[at.clone()])),
                temperature: temperature.map(|x| &x[at.clone()]),
                tau: Some(&tau[at.clone()]),
            };
            status[k] = online.step(&sample)?.bits();
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
