//! The observer along a run, by the code that runs online.

use std::path::PathBuf;
use std::sync::Arc;

use dynid_core::uncertainty::Doing;
use dynid_core::{MomentumObserver, ObserverSettings, OnlineEstimator};
use dynid_io::contact_file::parse_contact;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::model::PyTorqueModel;
use crate::samples::Samples;
use crate::{arrays, errors};

type Observation<'py> = (
    [Bound<'py, PyArray2<f64>>; 5],
    [Bound<'py, PyArray2<f64>>; 3],
    Bound<'py, PyArray1<u32>>,
    f64,
);

/// External torque, threshold, what of it is friction at rest, expected deviation, and what a hand may guide the arm by (n_samples, n);
/// with `uncertainty`, the text of a `contact.json`, what every joint does (0 moves, 1 stands, 2 has just begun, stopped or turned),
/// predicted torque, and variance by the parameters, else zeros; status bits (n_samples,) and the delay of all of them \[s\], which is
/// zero where dq and ddq are given.
#[pyfunction]
#[pyo3(signature = (model, t, motion, tau, *, temperature=None, step, window=None, time_constant, correlation_time=None, false_per_hour, uncertainty=None))]
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
    uncertainty: Option<&str>,
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
    if let Some(text) = uncertainty {
        let file = parse_contact(text.as_bytes(), "uncertainty").map_err(errors::model_file)?;
        let known = online.knowing(Arc::new(file.uncertainty));
        online = known.map_err(errors::core)?;
    }
    let delay = if run.is_direct() { 0.0 } else { online.delay() };
    let zeros = || vec![0.0; n_samples * n];
    let [mut external, mut rest, mut std, mut guide] = std::array::from_fn(|_| zeros());
    let [mut doing, mut torque, mut of_parameters] = std::array::from_fn(|_| zeros());
    let mut threshold = vec![f64::INFINITY; n_samples * n];
    let mut status = vec![0; n_samples];
    let rows = run.rows()?;
    py.detach(|| {
        for (k, status) in status.iter_mut().enumerate() {
            let at = k * n..(k + 1) * n;
            *status = online.step(&rows.at(k))?.bits();
            let estimator = online.estimator();
            estimator.predicted_std_into(&mut std[at.clone()])?;
            let Some(observer) = online.observer() else {
                continue;
            };
            external[at.clone()].copy_from_slice(observer.external());
            threshold[at.clone()].copy_from_slice(observer.threshold());
            rest[at.clone()].copy_from_slice(observer.rest());
            guide[at.clone()].copy_from_slice(observer.guide());
            if let Some((does, variance)) = observer.sources() {
                let numbers = does.iter().map(|does| number(*does));
                for (place, number) in doing[at.clone()].iter_mut().zip(numbers) {
                    *place = number;
                }
                torque[at.clone()].copy_from_slice(online.tau());
                of_parameters[at].copy_from_slice(variance);
            }
        }
        Ok(())
    })
    .map_err(errors::core)?;
    let matrix = |values| arrays::to_matrix(py, values, n);
    let said = [
        matrix(external)?,
        matrix(threshold)?,
        matrix(rest)?,
        matrix(std)?,
        matrix(guide)?,
    ];
    let sources = [matrix(doing)?, matrix(torque)?, matrix(of_parameters)?];
    Ok((said, sources, PyArray1::from_vec(py, status), delay))
}

fn number(does: Doing) -> f64 {
    match does {
        Doing::Moving => 0.0,
        Doing::Standing => 1.0,
        Doing::Turning => 2.0,
    }
}

type OfFile = (Vec<String>, String, f64, Option<usize>, f64, f64);

/// Joints, unit of torque, time between samples \[s\], window, time constant \[s\] and false contacts per hour of a `contact.json`, which is of `model`.
#[pyfunction]
pub fn read_contact(path: PathBuf, model: &PyTorqueModel) -> PyResult<OfFile> {
    let file = dynid_io::load_contact(&path).map_err(errors::model_file)?;
    MomentumObserver::new(Arc::clone(&model.0), file.settings)
        .and_then(|observer| observer.with_uncertainty(Arc::new(file.uncertainty)))
        .map_err(errors::core)?;
    let (time, per_hour) = (file.settings.time_constant, file.settings.false_per_hour);
    Ok((
        file.joints,
        file.torque_unit,
        file.step,
        file.window,
        time,
        per_hour,
    ))
}
