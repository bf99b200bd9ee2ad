//! Effects in Python: their shapes; columns are evaluated in Rust.

use dynid_core::effects::entry::{Need, Reference};
use dynid_core::effects::{Effect, EffectTerm, PaperFriction, CATALOGUE, N_FRICTION};
use dynid_offline::filter::LANES;
use dynid_offline::speed_columns::speed_columns;
use dynid_offline::OfflineError;
use numpy::{PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::lists::{optional, List};
use crate::offline::{sampling, FilterParts};
use crate::run::{Predicted, RunArrays};
use crate::{arrays, errors};

/// An effect with its shape parameters, one of the terms of a torque model.
#[pyclass(name = "Effect", module = "dynid_rs._core", frozen, from_py_object)]
#[derive(Clone)]
pub struct PyEffect(pub Effect);

type Shape = Vec<(&'static str, Vec<f64>)>;
type Rebuild<'py> = (Bound<'py, PyAny>, (&'static str, Shape));

#[pymethods]
impl PyEffect {
    #[staticmethod]
    fn rotor_inertia() -> Self {
        Self(Effect::rotor_inertia())
    }

    #[staticmethod]
    fn torque_offset() -> Self {
        Self(Effect::torque_offset())
    }

    #[staticmethod]
    fn friction(velocity_threshold: List<f64>, transition_width: List<f64>) -> PyResult<Self> {
        Effect::friction(&velocity_threshold, &transition_width)
            .map(Self)
            .map_err(errors::effect)
    }

    /// The effect `kind` of the catalogue, one value per joint for each of its shape parameters.
    #[staticmethod]
    #[pyo3(signature = (kind, **shape))]
    fn of(kind: &str, shape: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut parameters = Vec::new();
        for (name, values) in shape.into_iter().flatten() {
            let name: String = name.extract()?;
            let values = arrays::vector(&values, &name, None)?.as_slice()?.to_vec();
            parameters.push((name, values));
        }
        Effect::new(kind, &parameters)
            .map(Self)
            .map_err(errors::effect)
    }

    #[getter]
    fn kind(&self) -> &'static str {
        self.0.kind()
    }

    #[getter]
    fn coefficient_names(&self) -> Vec<&'static str> {
        self.0.coefficient_names().collect()
    }

    #[getter]
    fn n_columns(&self) -> usize {
        self.0.n_columns()
    }

    #[getter]
    fn signals(&self) -> Vec<&'static str> {
        self.0.entry().signals.to_vec()
    }

    #[getter]
    fn is_declared(&self) -> bool {
        self.0.is_declared()
    }

    #[getter]
    fn has_memory(&self) -> bool {
        self.0.entry().memory > 0
    }

    /// Shape parameters by name, one value per joint.
    #[getter]
    fn shape(&self) -> Shape {
        self.0.shape()
    }

    fn reaction(&self, joint: usize) -> Option<(usize, Vec<f64>)> {
        self.0.reaction(joint)
    }

    /// Kind and shape are all there is: copies in other processes are built from them.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Rebuild<'py>> {
        let rebuild = py.import("dynid_rs._core")?.getattr("_effect_of")?;
        Ok((rebuild, (self.kind(), self.shape())))
    }

    /// Immutable, so a copy is the effect itself.
    fn __copy__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __deepcopy__<'py>(slf: PyRef<'py, Self>, _memo: &Bound<'py, PyAny>) -> PyRef<'py, Self> {
        slf
    }

    fn __repr__(&self) -> String {
        format!("Effect({:?})", self.0.kind())
    }
}

/// The effect of a kind and a shape that `Effect.__reduce__` wrote.
#[pyfunction]
pub fn _effect_of(kind: &str, shape: Vec<(String, Vec<f64>)>) -> PyResult<PyEffect> {
    Effect::new(kind, &shape)
        .map(PyEffect)
        .map_err(errors::effect)
}

/// Basis of Eqs. 9-11 at speeds `dq`, (n_samples, 8).
#[pyfunction]
pub fn friction_basis<'py>(
    py: Python<'py>,
    dq: &Bound<'py, PyAny>,
    velocity_threshold: f64,
    transition_width: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    const { assert!(N_FRICTION == LANES, "no zeros behind the columns") }
    let dq = arrays::vector(dq, "dq", None)?;
    check_shape(velocity_threshold, transition_width)?;
    let speeds = dq.as_slice()?;
    let rows = py
        .detach(|| speed_columns::<PaperFriction, _>(speeds, velocity_threshold, transition_width));
    arrays::to_matrix(py, rows.into_flattened(), N_FRICTION)
}

/// # Errors
/// `ValueError` if the threshold is negative or the width not positive.
pub fn check_shape(velocity_threshold: f64, transition_width: f64) -> PyResult<()> {
    let good = velocity_threshold >= 0.0
        && velocity_threshold.is_finite()
        && transition_width > 0.0
        && transition_width.is_finite();
    if good {
        Ok(())
    } else {
        Err(errors::value(format!(
            "velocity_threshold must be at least 0 and transition_width positive, found {velocity_threshold} and {transition_width}"
        )))
    }
}

/// Every kind of effect as a dictionary.
#[pyfunction]
pub fn effect_catalogue(py: Python<'_>) -> PyResult<Bound<'_, PyList>> {
    let list = PyList::empty(py);
    for entry in &CATALOGUE {
        let coefficients = PyList::empty(py);
        for coefficient in entry.coefficients {
            let dict = PyDict::new(py);
            let (lower, upper) = coefficient.sign.bounds();
            dict.set_item("name", coefficient.name)?;
            dict.set_item("unit", coefficient.unit)?;
            dict.set_item("lower", lower)?;
            dict.set_item("upper", upper)?;
            coefficients.append(dict)?;
        }
        let shape = PyList::empty(py);
        for parameter in entry.shape {
            let dict = PyDict::new(py);
            dict.set_item("name", parameter.name)?;
            dict.set_item("unit", parameter.unit)?;
            dict.set_item("rule", parameter.rule.words())?;
            dict.set_item("grid", parameter.grid.to_vec())?;
            dict.set_item("relative_to", parameter.relative_to.map(Reference::word))?;
            dict.set_item("lowest", parameter.range.map(|range| range.lowest))?;
            dict.set_item("highest", parameter.range.map(|range| range.highest))?;
            dict.set_item("scale", parameter.range.map(|range| range.scale.word()))?;
            dict.set_item("absent", parameter.absent)?;
            dict.set_item("not_below", parameter.not_below)?;
            shape.append(dict)?;
        }
        let dict = PyDict::new(py);
        dict.set_item("kind", entry.kind)?;
        dict.set_item("formula", entry.formula)?;
        dict.set_item("coefficients", coefficients)?;
        dict.set_item("shape", shape)?;
        dict.set_item("signals", entry.signals.to_vec())?;
        dict.set_item("memory", entry.memory > 0)?;
        dict.set_item("declared", entry.declared)?;
        let diagnosis = &entry.diagnosis;
        let requires: Vec<&str> = entry.requirements().map(Need::word).collect();
        let drawn_against = diagnosis.drawn_against.map(|(signal, unit)| [signal, unit]);
        dict.set_item("places", diagnosis.places.word())?;
        dict.set_item("sought", diagnosis.sought)?;
        dict.set_item("requires", requires)?;
        dict.set_item("drawn_against", drawn_against)?;
        dict.set_item("reaction", diagnosis.reaction.to_vec())?;
        dict.set_item("most_relative", diagnosis.most_relative)?;
        list.append(dict)?;
    }
    Ok(list)
}

/// Torque per unit coefficient along a run, (n_samples, n_joints, n_columns); in the band at the kept samples if given.
#[pyfunction]
#[pyo3(signature = (effect, q, dq, ddq, q_motor=None, dq_motor=None, ddq_motor=None, tau_link=None, *, tau_motor=None, step=None, temperature=None, joints=None, filter=None, kept=None))]
#[expect(clippy::too_many_arguments, reason = "all that an effect may see")]
pub fn effect_columns<'py>(
    py: Python<'py>,
    effect: &PyEffect,
    q: &Bound<'py, PyAny>,
    dq: &Bound<'py, PyAny>,
    ddq: &Bound<'py, PyAny>,
    q_motor: Option<&Bound<'py, PyAny>>,
    dq_motor: Option<&Bound<'py, PyAny>>,
    ddq_motor: Option<&Bound<'py, PyAny>>,
    tau_link: Option<&Bound<'py, PyAny>>,
    tau_motor: Option<&Bound<'py, PyAny>>,
    step: Option<f64>,
    temperature: Option<&Bound<'py, PyAny>>,
    joints: Option<List<usize>>,
    filter: FilterParts<'py>,
    kept: Option<List<usize>>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let n = arrays::width(&arrays::contiguous(q, "q")?, "q")?;
    let motor = [q_motor, dq_motor, ddq_motor];
    let predicted = Predicted {
        tau_link,
        tau_motor,
    };
    let arrays = RunArrays::any([q, dq, ddq], motor, predicted, temperature, step, n)?;
    let run = arrays.signals()?;
    let joints = optional(joints).unwrap_or_else(|| (0..n).collect());
    let n_columns = effect.0.n_columns();
    let n_rows = kept.as_ref().map_or(arrays.n_samples(), |kept| kept.len());
    let sampling = kept.map(|kept| sampling(filter, kept.0)).transpose()?;
    let columns = py.detach(|| {
        let columns = dynid_offline::effect_columns(&effect.0, n, &run, &joints)?;
        match sampling {
            Some(sampling) => sampling.rows_of(&columns, joints.len() * n_columns),
            None => Ok(columns),
        }
    });
    if let Err(OfflineError::NonFinite { .. }) = columns {
        // Which number it was is only looked for now.
        RunArrays::new([q, dq, ddq], motor, predicted, temperature, step, n)?;
    }
    let columns = columns.map_err(errors::offline)?;
    arrays::to_cube(py, columns, [n_rows, joints.len(), n_columns])
}

/// Torque that a model predicts at its motors along a run, (n_samples, n_joints).
#[pyfunction]
#[pyo3(signature = (terms, torque_scale, q, dq, ddq, q_motor=None, dq_motor=None, ddq_motor=None, *, tau_link, step=None, temperature=None))]
#[expect(clippy::too_many_arguments, reason = "all that an effect may see")]
pub fn motor_torque<'py>(
    py: Python<'py>,
    terms: List<(PyEffect, Bound<'py, PyAny>)>,
    torque_scale: &Bound<'py, PyAny>,
    q: &Bound<'py, PyAny>,
    dq: &Bound<'py, PyAny>,
    ddq: &Bound<'py, PyAny>,
    q_motor: Option<&Bound<'py, PyAny>>,
    dq_motor: Option<&Bound<'py, PyAny>>,
    ddq_motor: Option<&Bound<'py, PyAny>>,
    tau_link: &Bound<'py, PyAny>,
    step: Option<f64>,
    temperature: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let n = arrays::width(&arrays::contiguous(q, "q")?, "q")?;
    let motor = [q_motor, dq_motor, ddq_motor];
    let predicted = Predicted {
        tau_link: Some(tau_link),
        tau_motor: None,
    };
    let arrays = RunArrays::any([q, dq, ddq], motor, predicted, temperature, step, n)?;
    let run = arrays.signals()?;
    let torque_scale = arrays::vector(torque_scale, "torque_scale", Some(n))?;
    let torque_scale = torque_scale.as_slice()?;
    let terms = terms.0.into_iter().map(|(effect, coefficients)| {
        let width = effect.0.n_columns();
        let coefficients = arrays::matrix(&coefficients, "coefficients", width)?;
        EffectTerm::new(effect.0, coefficients.as_slice()?.to_vec(), n).map_err(errors::core)
    });
    let terms = terms.collect::<PyResult<Vec<_>>>()?;
    let mut tau = vec![0.0; arrays.n_samples() * n];
    let found = py.detach(|| dynid_offline::motor_torque(&terms, torque_scale, &run, &mut tau));
    if let Err(OfflineError::NonFinite { .. }) = found {
        // Which number it was is only looked for now.
        RunArrays::new([q, dq, ddq], motor, predicted, temperature, step, n)?;
    }
    found.map_err(errors::offline)?;
    arrays::to_matrix(py, tau, n)
}

/// Torque along a run, (n_samples, n_joints).
#[pyfunction]
#[pyo3(signature = (effect, coefficients, q, dq, ddq, q_motor=None, dq_motor=None, ddq_motor=None, tau_link=None, *, tau_motor=None, step=None, temperature=None))]
#[expect(clippy::too_many_arguments, reason = "all that an effect may see")]
pub fn effect_torque<'py>(
    py: Python<'py>,
    effect: &PyEffect,
    coefficients: &Bound<'py, PyAny>,
    q: &Bound<'py, PyAny>,
    dq: &Bound<'py, PyAny>,
    ddq: &Bound<'py, PyAny>,
    q_motor: Option<&Bound<'py, PyAny>>,
    dq_motor: Option<&Bound<'py, PyAny>>,
    ddq_motor: Option<&Bound<'py, PyAny>>,
    tau_link: Option<&Bound<'py, PyAny>>,
    tau_motor: Option<&Bound<'py, PyAny>>,
    step: Option<f64>,
    temperature: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let n = arrays::width(&arrays::contiguous(q, "q")?, "q")?;
    let motor = [q_motor, dq_motor, ddq_motor];
    let predicted = Predicted {
        tau_link,
        tau_motor,
    };
    let arrays = RunArrays::new([q, dq, ddq], motor, predicted, temperature, step, n)?;
    let run = arrays.signals()?;
    let coefficients = arrays::matrix(coefficients, "coefficients", effect.0.n_columns())?;
    let term = EffectTerm::new(effect.0.clone(), coefficients.as_slice()?.to_vec(), n)
        .map_err(errors::core)?;
    let mut tau = vec![0.0; arrays.n_samples() * n];
    py.detach(|| dynid_offline::effect_torque(&term, n, &run, &mut tau))
        .map_err(errors::offline)?;
    arrays::to_matrix(py, tau, n)
}
