//! An adaptation along a run, by the code that runs online, and a model with what it found.

use std::sync::Arc;

use dynid_core::adapt::{adapted_model, AdaptSettings, Adaptation, Adapted, N_PAYLOAD};
use dynid_core::{ObserverSettings, OnlineEstimator};
use dynid_io::remembered::{digits_of, identity_of, parse_remembered};
use dynid_io::Remembered;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::lists::List;
use crate::model::PyTorqueModel;
use crate::samples::Samples;
use crate::{arrays, errors};

type Rows<'py> = (
    Bound<'py, PyArray1<usize>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
);

type Run<'py> = (
    Vec<Bound<'py, PyDict>>,
    Rows<'py>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<u32>>,
    String,
);

/// What was said, each a dict; of every row the sample that ended it (n_rows,), factors that are used, their estimates and deviations
/// (n_rows, n), and (n_rows, 6): mass and first moments that are used, the mass's estimate and its deviation; then per sample the
/// torque with what was added, the model's, the measured one at the same state (n_samples, n), and status bits; and the text of
/// what is known at the end.
#[pyfunction]
#[pyo3(signature = (model, t, motion, tau, *, temperature=None, step, window=None, inflation, noise_memory, friction, payload, row, memory, factor, mass, reach, said, observe=false, remembered=None))]
#[expect(clippy::too_many_arguments, reason = "a keyword function")]
pub fn adapt_run<'py>(
    py: Python<'py>,
    model: &PyTorqueModel,
    t: &Bound<'py, PyAny>,
    motion: [Option<Bound<'py, PyAny>>; 6],
    tau: &Bound<'py, PyAny>,
    temperature: Option<&Bound<'py, PyAny>>,
    step: f64,
    window: Option<usize>,
    inflation: List<f64>,
    noise_memory: List<f64>,
    friction: bool,
    payload: bool,
    row: f64,
    memory: f64,
    factor: [f64; 2],
    mass: f64,
    reach: f64,
    said: f64,
    observe: bool,
    remembered: Option<&str>,
) -> PyResult<Run<'py>> {
    let n = model.0.robot().n_joints();
    let run = Samples::of(n, t, &motion, tau, temperature)?;
    let settings = AdaptSettings {
        friction,
        payload,
        row,
        memory,
        factor,
        mass,
        reach,
        said,
    };
    let mut online = OnlineEstimator::new(Arc::clone(&model.0), Some(step), window)
        .and_then(|online| online.adapting(settings, &inflation, &noise_memory))
        .map_err(errors::core)?;
    if observe {
        online = online
            .observing(ObserverSettings::default())
            .map_err(errors::core)?;
    }
    let identity = identity_of(&model.0, None, Some((&settings, &inflation, &noise_memory)));
    let of = digits_of(&identity.map_err(errors::model_file)?);
    if let Some(text) = remembered {
        recall(&mut online, text, &of)?;
    }
    let mut numbers = online
        .adaptation()
        .map_or(vec![], |own| vec![f64::NAN; own.n_remembered()]);
    let mut told = Vec::<(usize, Adapted)>::new();
    let mut rows = Along::default();
    let (samples, n_samples) = (run.rows()?, run.len());
    let is_held = model.0.torque_delay().iter().any(|delay| *delay < 0.0);
    let as_it_came = run.is_direct() && !is_held;
    let mut sums: [Vec<f64>; 3] = std::array::from_fn(|_| Vec::with_capacity(n_samples * n));
    let mut status = Vec::with_capacity(n_samples);
    py.detach(|| {
        let mut n_rows = 0;
        // A run in which no row is taken to its end adds nothing to what is known.
        if let Some(own) = online.adaptation() {
            own.remember(&mut numbers)?;
        }
        for k in 0..n_samples {
            let sample = samples.at(k);
            status.push(online.step(&sample)?.bits());
            told.extend(online.adapted().map(|adapted| (k, *adapted)));
            let Some(own) = online.adaptation() else {
                continue;
            };
            let [tau, of_model, measured] = &mut sums;
            tau.extend_from_slice(own.tau());
            let model = own.tau().iter().zip(own.added());
            of_model.extend(model.map(|(tau, added)| tau - added));
            let shown = sample.tau.filter(|_| as_it_came);
            measured.extend_from_slice(shown.unwrap_or(online.measured()));
            if own.n_rows() > n_rows && own.remember(&mut numbers)? {
                n_rows = own.n_rows();
                rows.note(k, own, n);
            }
        }
        Ok(())
    })
    .map_err(errors::core)?;
    let [tau, of_model, measured] = sums;
    let text = Remembered { of, numbers }.to_text();
    let told = told.iter().map(|(k, adapted)| told_of(py, *k, adapted));
    Ok((
        told.collect::<PyResult<_>>()?,
        rows.into_arrays(py, n)?,
        arrays::to_matrix(py, tau, n)?,
        arrays::to_matrix(py, of_model, n)?,
        arrays::to_matrix(py, measured, n)?,
        PyArray1::from_vec(py, status),
        text.map_err(|error| errors::value(error.to_string()))?,
    ))
}

/// What stands at the end of every row.
#[derive(Default)]
struct Along {
    ends: Vec<usize>,
    used: Vec<f64>,
    estimate: Vec<f64>,
    std: Vec<f64>,
    load: Vec<f64>,
}

impl Along {
    fn note(&mut self, k: usize, own: &Adaptation, n: usize) {
        self.ends.push(k);
        for j in 0..n {
            let (used, estimate, std) = own.factor(j);
            self.used.push(used);
            self.estimate.push(estimate);
            self.std.push(std);
        }
        let (load, estimate, std) = own.load();
        self.load.extend(load);
        self.load.extend([estimate, std]);
    }

    fn into_arrays(self, py: Python<'_>, n: usize) -> PyResult<Rows<'_>> {
        Ok((
            PyArray1::from_vec(py, self.ends),
            arrays::to_matrix(py, self.used, n)?,
            arrays::to_matrix(py, self.estimate, n)?,
            arrays::to_matrix(py, self.std, n)?,
            arrays::to_matrix(py, self.load, N_PAYLOAD + 2)?,
        ))
    }
}

/// Lets the adaptation go on with what another run's one remembered.
fn recall(online: &mut OnlineEstimator, text: &str, of: &str) -> PyResult<()> {
    const NAME: &str = "remembered";
    let said = |words: &str| errors::FormatError::new_err(format!("{NAME}: {words}; begin anew"));
    let found = parse_remembered(text.as_bytes(), NAME).map_err(errors::model_file)?;
    if found.of != of {
        return Err(said(
            "of another model, or of an adaptation with other settings",
        ));
    }
    match online
        .adaptation_mut()
        .map(|own| own.recall(&found.numbers))
    {
        Some(Err(_)) => Err(said("numbers that no adaptation remembers")),
        _ => Ok(()),
    }
}

fn told_of<'py>(py: Python<'py>, sample: usize, adapted: &Adapted) -> PyResult<Bound<'py, PyDict>> {
    let told = PyDict::new(py);
    told.set_item("sample", sample)?;
    told.set_item("part", adapted.part.word())?;
    told.set_item("joint", adapted.joint)?;
    told.set_item("from", adapted.from)?;
    told.set_item("to", adapted.to)?;
    told.set_item("estimate", adapted.estimate)?;
    told.set_item("std", adapted.std)?;
    told.set_item("moments", adapted.moments)?;
    told.set_item("reason", adapted.reason.word())?;
    Ok(told)
}

/// The model with factors (n,) on its joints' friction and a load of mass and first moments (4,) at its last link.
#[pyfunction]
pub fn with_adapted(
    model: &PyTorqueModel,
    factors: List<f64>,
    load: [f64; N_PAYLOAD],
) -> PyResult<PyTorqueModel> {
    let made = adapted_model(&model.0, &factors, &load).map_err(errors::core)?;
    Ok(PyTorqueModel(Arc::new(made)))
}
