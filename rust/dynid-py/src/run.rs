//! The signals of a run, as every function that evaluates along one takes them.

use dynid_core::State;
use dynid_offline::RunSignals;
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arrays;

/// q, dq, ddq, q_motor, dq_motor, ddq_motor, each (n_samples, n_joints), held while Rust reads them.
pub struct RunArrays<'py> {
    signals: [PyReadonlyArray2<'py, f64>; 6],
    tau_link: Option<PyReadonlyArray2<'py, f64>>,
    tau_motor: Option<PyReadonlyArray2<'py, f64>>,
    temperature: Option<PyReadonlyArray2<'py, f64>>,
    step: Option<f64>,
}

/// Torques (n_samples, n_joints) that a model predicts, where they are given.
#[derive(Clone, Copy, Default)]
pub struct Predicted<'a, 'py> {
    /// Of the rigid body.
    pub tau_link: Option<&'a Bound<'py, PyAny>>,
    /// At the motors.
    pub tau_motor: Option<&'a Bound<'py, PyAny>>,
}

/// Names and arrays; the link side stands in for a motor side that is not given.
fn six<'a, 'py>(
    [q, dq, ddq]: [&'a Bound<'py, PyAny>; 3],
    [q_motor, dq_motor, ddq_motor]: [Option<&'a Bound<'py, PyAny>>; 3],
) -> [(&'static str, &'a Bound<'py, PyAny>); 6] {
    [
        ("q", q),
        ("dq", dq),
        ("ddq", ddq),
        ("q_motor", q_motor.unwrap_or(q)),
        ("dq_motor", dq_motor.unwrap_or(dq)),
        ("ddq_motor", ddq_motor.unwrap_or(ddq)),
    ]
}

fn slice<'a>(tau: Option<&'a PyReadonlyArray2<'_, f64>>) -> PyResult<Option<&'a [f64]>> {
    Ok(tau.map(|tau| tau.as_slice()).transpose()?)
}

impl<'py> RunArrays<'py> {
    /// Link side, motor side (the link side where it is not given), predicted torques, measured temperature, time between
    /// samples.
    ///
    /// # Errors
    /// As [`arrays::samples`].
    pub fn new(
        link: [&Bound<'py, PyAny>; 3],
        motor: [Option<&Bound<'py, PyAny>>; 3],
        predicted: Predicted<'_, 'py>,
        temperature: Option<&Bound<'py, PyAny>>,
        step: Option<f64>,
        n_joints: usize,
    ) -> PyResult<Self> {
        let run = Self::any(link, motor, predicted, temperature, step, n_joints)?;
        arrays::samples(six(link, motor), n_joints)?;
        for (name, value) in [
            ("tau_link", predicted.tau_link),
            ("tau_motor", predicted.tau_motor),
            ("temperature", temperature),
        ] {
            if let Some(value) = value {
                arrays::samples([(name, value)], n_joints)?;
            }
        }
        Ok(run)
    }

    /// [`Self::new`] where the signals may hold any number: for what finds those that are not finite on its way.
    ///
    /// # Errors
    /// As [`arrays::any_samples`].
    pub fn any(
        link: [&Bound<'py, PyAny>; 3],
        motor: [Option<&Bound<'py, PyAny>>; 3],
        predicted: Predicted<'_, 'py>,
        temperature: Option<&Bound<'py, PyAny>>,
        step: Option<f64>,
        n_joints: usize,
    ) -> PyResult<Self> {
        let signals = arrays::any_samples(six(link, motor), n_joints)?;
        let q = link[0];
        let beside = |name, value: Option<&Bound<'py, PyAny>>| {
            value
                .map(|value| arrays::any_samples([("q", q), (name, value)], n_joints))
                .transpose()
                .map(|found| found.map(|[_, value]| value))
        };
        Ok(Self {
            signals,
            tau_link: beside("tau_link", predicted.tau_link)?,
            tau_motor: beside("tau_motor", predicted.tau_motor)?,
            temperature: beside("temperature", temperature)?,
            step,
        })
    }

    /// Number of samples.
    pub fn n_samples(&self) -> usize {
        self.signals[0].shape()[0]
    }

    /// The six signals and the temperature, row-major.
    ///
    /// # Errors
    /// Never for arrays that came through [`Self::new`].
    pub fn state(&self) -> PyResult<State<'_>> {
        let [q, dq, ddq, q_motor, dq_motor, ddq_motor] = &self.signals;
        Ok(State {
            q: q.as_slice()?,
            dq: dq.as_slice()?,
            ddq: ddq.as_slice()?,
            q_motor: q_motor.as_slice()?,
            dq_motor: dq_motor.as_slice()?,
            ddq_motor: ddq_motor.as_slice()?,
            temperature: match &self.temperature {
                Some(t) => Some(t.as_slice()?),
                None => None,
            },
        })
    }

    /// All that effects see.
    ///
    /// # Errors
    /// Never for arrays that came through [`Self::new`].
    pub fn signals(&self) -> PyResult<RunSignals<'_>> {
        Ok(RunSignals {
            state: self.state()?,
            tau_link: slice(self.tau_link.as_ref())?,
            tau_motor: slice(self.tau_motor.as_ref())?,
            step: self.step,
        })
    }
}
