//! A run as the samples that a stream would bring.

use dynid_core::Sample;
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::{arrays, errors};

const NAMES: [&str; 6] = ["q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor"];

/// Signals of a run, checked.
pub struct Samples<'py> {
    t: PyReadonlyArray1<'py, f64>,
    motion: Vec<Option<PyReadonlyArray2<'py, f64>>>,
    temperature: Option<PyReadonlyArray2<'py, f64>>,
    tau: PyReadonlyArray2<'py, f64>,
    n: usize,
}

impl<'py> Samples<'py> {
    /// Of `n` joints.
    ///
    /// # Errors
    /// `ValueError` if there is no q, shapes differ or a number is not finite.
    pub fn of(
        n: usize,
        t: &Bound<'py, PyAny>,
        motion: &[Option<Bound<'py, PyAny>>; 6],
        tau: &Bound<'py, PyAny>,
        temperature: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Self> {
        let [Some(q), ..] = motion else {
            return Err(errors::value("motion: q is missing"));
        };
        let beside_q = |signal: &Bound<'py, PyAny>, name: &'static str| {
            arrays::samples([("q", q), (name, signal)], n).map(|[_, signal]| signal)
        };
        let signals = motion.iter().zip(NAMES);
        let signals = signals.map(|(signal, name)| {
            let signal = signal.as_ref();
            signal.map(|signal| beside_q(signal, name)).transpose()
        });
        let tau = beside_q(tau, "tau")?;
        let temperature = temperature.map(|values| beside_q(values, "temperature"));
        Ok(Self {
            motion: signals.collect::<PyResult<_>>()?,
            t: arrays::vector(t, "t", Some(tau.shape()[0]))?,
            temperature: temperature.transpose()?,
            tau,
            n,
        })
    }

    /// Samples.
    pub fn len(&self) -> usize {
        self.tau.shape()[0]
    }

    /// True if velocity and acceleration came too.
    pub fn is_direct(&self) -> bool {
        self.motion[1].is_some() && self.motion[2].is_some()
    }

    /// Slices, which need no interpreter.
    ///
    /// # Errors
    /// None that [`Self::of`] lets through.
    pub fn rows(&self) -> PyResult<Rows<'_>> {
        let mut motion = [None; 6];
        for (slice, signal) in motion.iter_mut().zip(&self.motion) {
            *slice = signal
                .as_ref()
                .map(|signal| signal.as_slice())
                .transpose()?;
        }
        let temperature = self.temperature.as_ref();
        Ok(Rows {
            t: self.t.as_slice()?,
            motion,
            temperature: temperature.map(|values| values.as_slice()).transpose()?,
            tau: self.tau.as_slice()?,
            n: self.n,
        })
    }
}

/// The same, borrowed.
pub struct Rows<'a> {
    t: &'a [f64],
    motion: [Option<&'a [f64]>; 6],
    temperature: Option<&'a [f64]>,
    tau: &'a [f64],
    n: usize,
}

impl Rows<'_> {
    /// Sample `k`.
    pub fn at(&self, k: usize) -> Sample<'_> {
        let own = k * self.n..(k + 1) * self.n;
        Sample {
            sequence: None,
            time: self.t[k],
            motion: self.motion.map(|signal| signal.map(|x| &x[own.clone()])),
            temperature: self.temperature.map(|x| &x[own.clone()]),
            tau: Some(&self.tau[own.clone()]),
        }
    }
}
