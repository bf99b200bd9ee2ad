//! `TorqueModel` in Python: built once, saved, loaded, evaluated in batches.

use std::path::PathBuf;
use std::sync::Arc;

use dynid_core::model::TorqueModelParts;
use dynid_core::{
    Domain, EffectTerm, EncoderError, ErrorBand, Residual, Signal, State, TorqueEstimator,
    TorqueModel,
};
use dynid_io::model_file;
use dynid_offline::batch;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;

use crate::effects::PyEffect;
use crate::lists::{optional, List};
use crate::physical::PyPhysicalSet;
use crate::residual::{inputs_named, Named, PyRegression};
use crate::robot::{PyRobotModel, Rebuild};
use crate::run::{Predicted, RunArrays};
use crate::signals::{cos_sin, delays};
use crate::{arrays, errors, habits, small};

/// A torque model: rigid body, effects, residual. Owned by Rust, immutable.
#[pyclass(name = "TorqueModel", module = "dynid_rs._core", frozen)]
pub struct PyTorqueModel(pub Arc<TorqueModel>);

type Made<'py> = PyResult<Bound<'py, PyAny>>;

type Evaluation<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray1<u32>>,
);

impl PyTorqueModel {
    fn needs_no_temperature(&self) -> PyResult<()> {
        if self.0.wants_temperature().contains(&true) {
            return Err(errors::value(
                "the model's friction follows a measured temperature, which was not given",
            ));
        }
        Ok(())
    }
}

#[pymethods]
impl PyTorqueModel {
    #[new]
    #[pyo3(signature = (robot, phi, effects, *, residual=None, residual_signals=None, compliance=None, torque_scale=None, encoder_delay, encoder_error=None, encoder_error_sides="link", torque_delay=None, noise_std, domain, torque_unit="N*m", step=None, band=None))]
    #[expect(
        clippy::too_many_arguments,
        reason = "a keyword constructor; the parts are the model"
    )]
    fn new(
        robot: &PyRobotModel,
        phi: &Bound<'_, PyAny>,
        effects: List<(PyEffect, Bound<'_, PyAny>)>,
        residual: Option<(String, List<Option<PyRegression>>)>,
        residual_signals: Option<List<Named>>,
        compliance: Option<List<f64>>,
        torque_scale: Option<List<f64>>,
        encoder_delay: List<f64>,
        encoder_error: Option<Bound<'_, PyAny>>,
        encoder_error_sides: &str,
        torque_delay: Option<Bound<'_, PyAny>>,
        noise_std: List<f64>,
        domain: (List<[f64; 2]>, List<f64>, List<f64>),
        torque_unit: &str,
        step: Option<f64>,
        band: Option<(f64, f64, bool)>,
    ) -> PyResult<Self> {
        let n = robot.0.n_joints();
        let torque_delay =
            torque_delay.map_or_else(|| Ok(vec![0.0; n]), |given| delays(&given, n))?;
        let effects = effects
            .0
            .into_iter()
            .map(|(effect, coefficients)| {
                let columns = effect.0.n_columns();
                let matrix = arrays::matrix(&coefficients, "coefficients", columns)?;
                EffectTerm::new(effect.0, matrix.as_slice()?.to_vec(), n).map_err(errors::core)
            })
            .collect::<PyResult<Vec<_>>>()?;
        let residual = residual
            .map(|(inputs, joints)| {
                let joints = joints.0.into_iter().map(|joint| joint.map(Into::into));
                let residual =
                    Residual::new(inputs_named(&inputs, residual_signals)?, joints.collect());
                match compliance {
                    Some(compliance) => residual.and_then(|r| r.with_compliance(compliance.0)),
                    None => residual,
                }
                .map_err(errors::core)
            })
            .transpose()?;
        let (List(q), List(dq), List(ddq)) = domain;
        let encoder_error = EncoderError {
            cos_sin: match encoder_error {
                None => vec![[0.0; 2]; n],
                Some(error) => cos_sin(&error)?,
            },
            both_sides: match encoder_error_sides {
                "link" => false,
                "both" => true,
                other => {
                    return Err(errors::value(format!(
                        "encoder_error_sides must be \"link\" or \"both\", found {other:?}"
                    )))
                }
            },
        };
        TorqueModel::new(TorqueModelParts {
            robot: (*robot.0).clone(),
            phi: arrays::vector(phi, "phi", Some(10 * n))?
                .as_slice()?
                .to_vec(),
            torque_scale: optional(torque_scale).unwrap_or_else(|| vec![1.0; n]),
            effects,
            residual,
            encoder_delay: encoder_delay.0,
            noise_std: noise_std.0,
            domain: Domain { q, dq, ddq },
            torque_unit: torque_unit.to_owned(),
            step,
        })
        .and_then(|model| model.with_encoder_error(encoder_error))
        .and_then(|model| model.with_torque_delay(&torque_delay))
        .and_then(|model| match band {
            None => Ok(model),
            Some((cutoff, rate, standstill)) => model.with_band(ErrorBand {
                cutoff,
                rate,
                standstill,
            }),
        })
        .map(|model| Self(Arc::new(model)))
        .map_err(errors::core)
    }

    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let model = py
            .detach(|| dynid_io::load(&path))
            .map_err(errors::model_file)?;
        Ok(Self(Arc::new(model)))
    }

    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| dynid_io::save(&self.0, &path))
            .map_err(errors::model_file)
    }

    /// Total (n_samples, n), terms (n_samples, n_terms, n) and status bits (n_samples,) by the estimator that runs online.
    #[pyo3(signature = (q, dq, ddq, q_motor=None, dq_motor=None, ddq_motor=None, *, step=None, temperature=None))]
    #[expect(clippy::too_many_arguments, reason = "the signals of a state")]
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
        q_motor: Option<&Bound<'py, PyAny>>,
        dq_motor: Option<&Bound<'py, PyAny>>,
        ddq_motor: Option<&Bound<'py, PyAny>>,
        step: Option<f64>,
        temperature: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Evaluation<'py>> {
        let n = self.0.robot().n_joints();
        let motor = [q_motor, dq_motor, ddq_motor];
        let arrays = RunArrays::new(
            [q, dq, ddq],
            motor,
            Predicted::default(),
            temperature,
            step,
            n,
        )?;
        if temperature.is_none() {
            self.needs_no_temperature()?;
        }
        let (states, n_samples) = (arrays.state()?, arrays.n_samples());
        let mut estimator = TorqueEstimator::new(Arc::clone(&self.0));
        if let Some(step) = step {
            estimator = estimator.with_step(step).map_err(errors::core)?;
        }
        let n_terms = estimator.terms().len() / n;
        let mut terms = vec![0.0; n_samples * n_terms * n];
        let mut total = vec![0.0; n_samples * n];
        let mut status = vec![0; n_samples];
        py.detach(|| batch::estimate(&mut estimator, &states, &mut terms, &mut total, &mut status))
            .map_err(errors::core)?;
        Ok((
            arrays::to_matrix(py, total, n)?,
            arrays::to_cube(py, terms, [n_samples, n_terms, n])?,
            PyArray1::from_vec(py, status),
        ))
    }

    /// Total alone (n_samples, n), as [`Self::evaluate`] finds it.
    #[pyo3(signature = (q, dq, ddq, q_motor=None, dq_motor=None, ddq_motor=None, *, out=None))]
    #[expect(clippy::too_many_arguments, reason = "the six signals of a state")]
    fn torque<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
        q_motor: Option<&Bound<'py, PyAny>>,
        dq_motor: Option<&Bound<'py, PyAny>>,
        ddq_motor: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let n = self.0.robot().n_joints();
        if let Some(link) = small::rows([q, dq, ddq], n) {
            let [q, dq, ddq] = &link;
            let mut motor = [*q, *dq, *ddq];
            let given = [q_motor, dq_motor, ddq_motor];
            let mut rows = motor.iter_mut().zip(given);
            let read = rows.all(|(row, given)| match given {
                None => true,
                Some(given) => small::row(given, n).map(|read| *row = read).is_some(),
            });
            if read {
                let [q, dq, ddq] = link.each_ref().map(small::Row::as_slice);
                let [q_motor, dq_motor, ddq_motor] = motor.each_ref().map(small::Row::as_slice);
                let temperature = None;
                let state = State {
                    q,
                    dq,
                    ddq,
                    q_motor,
                    dq_motor,
                    ddq_motor,
                    temperature,
                };
                return small::one_result(py, [1, n], out, |tau| {
                    small::with_estimator(&self.0, |estimator| {
                        if estimator.wants_temperature() {
                            return self.needs_no_temperature();
                        }
                        let answer = estimator.estimate_into(&state, tau);
                        answer.map(|_| ()).map_err(errors::core)
                    })
                });
            }
        }
        self.needs_no_temperature()?;
        let motor = [q_motor, dq_motor, ddq_motor];
        let arrays = RunArrays::new([q, dq, ddq], motor, Predicted::default(), None, None, n)?;
        let (states, n_samples) = (arrays.state()?, arrays.n_samples());
        let mut estimator = TorqueEstimator::new(Arc::clone(&self.0));
        small::result(py, [n_samples, n], out, |total| {
            let work = || batch::torque(&mut estimator, &states, total);
            arrays::unlocked(py, n_samples, work).map_err(errors::core)
        })
    }

    /// Standard deviation (n_samples, n) that the model expects of measured minus predicted torque.
    #[pyo3(signature = (q, dq, ddq, q_motor=None, dq_motor=None, ddq_motor=None))]
    #[expect(clippy::too_many_arguments, reason = "the six signals of a state")]
    fn predicted_std<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
        q_motor: Option<&Bound<'py, PyAny>>,
        dq_motor: Option<&Bound<'py, PyAny>>,
        ddq_motor: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let n = self.0.robot().n_joints();
        let motor = [q_motor, dq_motor, ddq_motor];
        let arrays = RunArrays::new([q, dq, ddq], motor, Predicted::default(), None, None, n)?;
        let states = arrays.state()?;
        let mut estimator = TorqueEstimator::new(Arc::clone(&self.0));
        let mut std = vec![0.0; arrays.n_samples() * n];
        py.detach(|| batch::predicted_std(&mut estimator, &states, &mut std))
            .map_err(errors::core)?;
        arrays::to_matrix(py, std, n)
    }

    #[getter]
    fn robot(&self) -> PyRobotModel {
        self.0.robot().clone().into()
    }

    #[getter]
    fn term_names(&self) -> Vec<String> {
        self.0.term_names()
    }

    #[getter]
    fn phi<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.phi())
    }

    /// Effects with their coefficients (n_joints, n_columns), in order of summation.
    #[getter]
    fn effects<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<Vec<(PyEffect, Bound<'py, PyArray2<f64>>)>> {
        self.0
            .effects()
            .iter()
            .map(|term| {
                let coefficients =
                    arrays::to_matrix(py, term.coefficients().to_vec(), term.effect().n_columns())?;
                Ok((PyEffect(term.effect().clone()), coefficients))
            })
            .collect()
    }

    /// `(inputs, regressions)`, one regression or None per joint; None without a third loop.
    #[getter]
    fn residual(&self) -> Option<(&'static str, Vec<Option<PyRegression>>)> {
        self.0.residual().map(|residual| {
            let joints = residual.joints().iter();
            let joints = joints.map(|joint| joint.as_ref().map(Into::into)).collect();
            (residual.inputs().name(), joints)
        })
    }

    /// Signals that the regressions see, one list of `(name, joint)` per joint; None where they see a pair.
    #[getter]
    fn residual_signals(&self) -> Option<Vec<Vec<(&'static str, usize)>>> {
        let joints = self.0.residual()?.inputs().signals()?.iter();
        let named = |signal: &Signal| (signal.kind.name(), signal.joint);
        Some(
            joints
                .map(|signals| signals.iter().map(named).collect())
                .collect(),
        )
    }

    /// Compliance of the gears that the third loop's inputs are freed of the load with; None without a third loop.
    #[getter]
    fn compliance<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let residual = self.0.residual()?;
        Some(PyArray1::from_slice(py, residual.compliance()))
    }

    #[getter]
    fn torque_scale<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.torque_scale())
    }

    #[getter]
    fn encoder_delay<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.encoder_delay())
    }

    /// Cosine and sine part of what the encoders show too much, (n, 2).
    #[getter]
    fn encoder_error<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let values = match self.0.encoder_error() {
            Some(error) => error.cos_sin.concat(),
            None => vec![0.0; 2 * self.0.robot().n_joints()],
        };
        arrays::to_matrix(py, values, 2)
    }

    /// `"link"`, or `"both"` where the motor side is the same signal.
    #[getter]
    fn encoder_error_sides(&self) -> &'static str {
        match self.0.encoder_error() {
            Some(error) if error.both_sides => "both",
            _ => "link",
        }
    }

    /// How late the torque channels are behind the encoders, (n,).
    #[getter]
    fn torque_delay<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.torque_delay())
    }

    /// The same model for torque channels that are late by other seconds, all by one number or each by its own.
    fn with_torque_delay(&self, delay: &Bound<'_, PyAny>) -> PyResult<Self> {
        let delays = delays(delay, self.0.robot().n_joints())?;
        let model = (*self.0).clone().with_torque_delay(&delays);
        Ok(Self(Arc::new(model.map_err(errors::core)?)))
    }

    /// `(cutoff, rate, standstill)` of the band in which its errors are told; None where it does not say.
    #[getter]
    fn band(&self) -> Option<(f64, f64, bool)> {
        let band = self.0.band()?;
        Some((band.cutoff, band.rate, band.standstill))
    }

    #[getter]
    fn noise_std<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.noise_std())
    }

    /// `(q, dq, ddq)`: least and greatest position, greatest speed and acceleration per joint.
    #[getter]
    fn domain(&self) -> (Vec<[f64; 2]>, Vec<f64>, Vec<f64>) {
        let domain = self.0.domain();
        (domain.q.clone(), domain.dq.clone(), domain.ddq.clone())
    }

    #[getter]
    fn torque_unit(&self) -> &str {
        self.0.torque_unit()
    }

    #[getter]
    fn step(&self) -> Option<f64> {
        self.0.step()
    }

    /// The text of its file: copies in other processes are built from it.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Rebuild<'py>> {
        let text =
            model_file::to_text(&self.0).map_err(|error| errors::value(error.to_string()))?;
        Ok((py.import("dynid_rs._core")?.getattr("_model_of")?, (text,)))
    }

    /// Immutable, so a copy is the model itself.
    fn __copy__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __deepcopy__<'py>(slf: PyRef<'py, Self>, _memo: &Bound<'py, PyAny>) -> PyRef<'py, Self> {
        slf
    }

    /// The same model with a physically consistent set beside it.
    fn with_physical(&self, physical: PyPhysicalSet) -> PyResult<Self> {
        let model = (*self.0).clone().with_physical(physical.0);
        Ok(Self(Arc::new(model.map_err(errors::core)?)))
    }

    #[getter]
    fn physical(&self) -> Option<PyPhysicalSet> {
        self.0.physical().cloned().map(PyPhysicalSet)
    }

    #[getter]
    fn physical_phi<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let physical = self.0.physical()?;
        Some(PyArray1::from_slice(py, &physical.phi))
    }

    /// What is in it, as a table.
    fn summary<'py>(slf: &Bound<'py, Self>) -> Made<'py> {
        habits::made(slf, "summary", "summary", vec![])
    }

    /// Torque along runs, at their own stamps.
    fn predict<'py>(slf: &Bound<'py, Self>, runs: Bound<'py, PyAny>) -> Made<'py> {
        habits::made(slf, "along", "predict", vec![("runs", Some(runs))])
    }

    /// Share of the measured torque's variance that it explains.
    #[pyo3(signature = (runs, *, per_joint=false, as_recorded=false))]
    fn score<'py>(
        slf: &Bound<'py, Self>,
        runs: Bound<'py, PyAny>,
        per_joint: bool,
        as_recorded: bool,
    ) -> Made<'py> {
        let flags = [("per_joint", per_joint), ("as_recorded", as_recorded)];
        habits::told(slf, "along", "score", vec![("runs", Some(runs))], &flags)
    }

    /// Friction over speed, drawn by matplotlib.
    #[pyo3(signature = (runs=None, *, joints=None, axes=None))]
    fn plot_friction<'py>(
        slf: &Bound<'py, Self>,
        runs: Option<Bound<'py, PyAny>>,
        joints: Option<Bound<'py, PyAny>>,
        axes: Option<Bound<'py, PyAny>>,
    ) -> Made<'py> {
        let given = vec![("runs", runs), ("joints", joints), ("axes", axes)];
        habits::made(slf, "friction_plot", "plot_friction", given)
    }

    /// Measured and predicted torque, and what is left, drawn by matplotlib.
    #[pyo3(signature = (run, *, joints=None, axes=None))]
    fn plot_residual<'py>(
        slf: &Bound<'py, Self>,
        run: Bound<'py, PyAny>,
        joints: Option<Bound<'py, PyAny>>,
        axes: Option<Bound<'py, PyAny>>,
    ) -> Made<'py> {
        let given = vec![("run", Some(run)), ("joints", joints), ("axes", axes)];
        habits::made(slf, "residual_plot", "plot_residual", given)
    }

    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> Made<'py> {
        Self::summary(slf)?.call_method0("_repr_html_")
    }

    fn __repr__(&self) -> String {
        format!(
            "TorqueModel({:?}, n_joints={}, terms={:?})",
            self.0.robot().name(),
            self.0.robot().n_joints(),
            self.0.term_names()
        )
    }
}

/// The model of a text that `TorqueModel.__reduce__` wrote.
#[pyfunction]
pub fn _model_of(text: &str) -> PyResult<PyTorqueModel> {
    let model = model_file::parse(text.as_bytes(), "<pickle>").map_err(errors::model_file)?;
    Ok(PyTorqueModel(Arc::new(model)))
}
