//! Signals of a run in Python: what regressions of the third loop see, and the encoders' channels set right.

use dynid_core::{Signal, SignalKind, State};
use dynid_offline::observation::slice_state;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arrays;
use crate::residual::{pair_named, signals_named, Named};
use crate::run::{Predicted, RunArrays};

/// What a regression of the third loop sees: (n_samples, n_joints, 2). The channels must be on one clock.
#[pyfunction]
#[pyo3(signature = (inputs, q, dq, q_motor, dq_motor, wind_up=None))]
pub fn residual_inputs<'py>(
    py: Python<'py>,
    inputs: &str,
    q: &Bound<'py, PyAny>,
    dq: &Bound<'py, PyAny>,
    q_motor: &Bound<'py, PyAny>,
    dq_motor: &Bound<'py, PyAny>,
    wind_up: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let inputs = pair_named(inputs)?;
    let n = arrays::width(&arrays::contiguous(q, "q")?, "q")?;
    let signals = arrays::samples(
        [
            ("q", q),
            ("dq", dq),
            ("q_motor", q_motor),
            ("dq_motor", dq_motor),
        ],
        n,
    )?;
    let wind_up = wind_up
        .map(|wind_up| arrays::samples([("q", q), ("wind_up", wind_up)], n))
        .transpose()?;
    let wind_up = match &wind_up {
        Some([_, wind_up]) => Some(wind_up.as_slice()?),
        None => None,
    };
    let [q, dq, q_motor, dq_motor] = &signals;
    let states = State {
        q: q.as_slice()?,
        dq: dq.as_slice()?,
        ddq: dq.as_slice()?, // accelerations are no input of either kind
        q_motor: q_motor.as_slice()?,
        dq_motor: dq_motor.as_slice()?,
        ddq_motor: dq.as_slice()?,
        temperature: None,
    };
    let n_samples = q.shape()[0];
    let mut out = Vec::with_capacity(n_samples * n * 2);
    py.detach(|| {
        for k in 0..n_samples {
            let state = slice_state(&states, k * n..(k + 1) * n);
            for j in 0..n {
                let wind_up = wind_up.map_or(0.0, |wind_up| wind_up[k * n + j]);
                out.extend_from_slice(&inputs.at(j, &state, wind_up, &[])[..2]);
            }
        }
    });
    arrays::to_cube(py, out, [n_samples, n, 2])
}

/// Signals by name along a run, (n_samples, n_signals): what a regression on them sees online, to the same bits.
#[pyfunction]
#[pyo3(signature = (signals, q, dq, ddq, q_motor=None, dq_motor=None, ddq_motor=None, tau_link=None))]
#[expect(
    clippy::too_many_arguments,
    reason = "the six signals of a state and the load"
)]
pub fn named_signals<'py>(
    py: Python<'py>,
    signals: Named,
    q: &Bound<'py, PyAny>,
    dq: &Bound<'py, PyAny>,
    ddq: &Bound<'py, PyAny>,
    q_motor: Option<&Bound<'py, PyAny>>,
    dq_motor: Option<&Bound<'py, PyAny>>,
    ddq_motor: Option<&Bound<'py, PyAny>>,
    tau_link: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let signals = signals_named(signals)?;
    let n = arrays::width(&arrays::contiguous(q, "q")?, "q")?;
    if let Some(signal) = signals.iter().find(|signal| signal.joint >= n) {
        return Err(crate::errors::value(format!(
            "there is no joint {}, the signals are those of {n} joints",
            signal.joint
        )));
    }
    let motor = [q_motor, dq_motor, ddq_motor];
    let predicted = Predicted {
        tau_link,
        tau_motor: None,
    };
    let arrays = RunArrays::new([q, dq, ddq], motor, predicted, None, None, n)?;
    let run = arrays.signals()?;
    let of_load = |signal: &Signal| signal.kind == SignalKind::TauLink;
    if run.tau_link.is_none() && signals.iter().any(of_load) {
        return Err(crate::errors::value(
            "the signals name tau_link, which was not given",
        ));
    }
    let n_samples = arrays.n_samples();
    let mut out = Vec::with_capacity(n_samples * signals.len());
    py.detach(|| {
        for k in 0..n_samples {
            let at = k * n..(k + 1) * n;
            let state = slice_state(&run.state, at.clone());
            let tau_link = run.tau_link.map_or(&[][..], |tau| &tau[at]);
            out.extend(signals.iter().map(|signal| signal.at(&state, tau_link)));
        }
    });
    PyArray1::from_vec(py, out).reshape([n_samples, signals.len()])
}

type Aligned<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// Link-side position and velocity on the motor channel's clock, each (n_samples, n_joints).
#[pyfunction]
pub fn align_link_side<'py>(
    py: Python<'py>,
    q: &Bound<'py, PyAny>,
    dq: &Bound<'py, PyAny>,
    ddq: &Bound<'py, PyAny>,
    encoder_delay: &Bound<'py, PyAny>,
) -> PyResult<Aligned<'py>> {
    let delay = arrays::vector(encoder_delay, "encoder_delay", None)?;
    let delay = delay.as_slice()?;
    let n = delay.len();
    let signals = arrays::samples([("q", q), ("dq", dq), ("ddq", ddq)], n)?;
    let [q, dq, ddq] = &signals;
    let (q, dq, ddq) = (q.as_slice()?, dq.as_slice()?, ddq.as_slice()?);
    let (mut q_aligned, mut dq_aligned) = (q.to_vec(), dq.to_vec());
    py.detach(|| {
        for k in 0..q.len() {
            [q_aligned[k], dq_aligned[k]] =
                dynid_core::state::align_link_side(q[k], dq[k], ddq[k], delay[k % n]);
        }
    });
    Ok((
        arrays::to_matrix(py, q_aligned, n)?,
        arrays::to_matrix(py, dq_aligned, n)?,
    ))
}

type Motion<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
);

/// Motion less what eccentric encoders show too much, each (n_samples, n_joints).
#[pyfunction]
pub fn true_motion<'py>(
    py: Python<'py>,
    q: &Bound<'py, PyAny>,
    dq: &Bound<'py, PyAny>,
    ddq: &Bound<'py, PyAny>,
    encoder_error: &Bound<'py, PyAny>,
) -> PyResult<Motion<'py>> {
    let error = cos_sin(encoder_error)?;
    let n = error.len();
    let signals = arrays::samples([("q", q), ("dq", dq), ("ddq", ddq)], n)?;
    let [q, dq, ddq] = &signals;
    let mut motion = [
        q.as_slice()?.to_vec(),
        dq.as_slice()?.to_vec(),
        ddq.as_slice()?.to_vec(),
    ];
    let [q, dq, ddq] = &mut motion;
    let samples = q.iter_mut().zip(dq).zip(ddq).enumerate();
    py.detach(|| {
        for (k, ((q, dq), ddq)) in samples {
            [*q, *dq, *ddq] = dynid_core::state::true_motion(*q, *dq, *ddq, error[k % n]);
        }
    });
    let [q, dq, ddq] = motion;
    Ok((
        arrays::to_matrix(py, q, n)?,
        arrays::to_matrix(py, dq, n)?,
        arrays::to_matrix(py, ddq, n)?,
    ))
}

/// One row of two numbers per joint.
pub fn cos_sin(error: &Bound<'_, PyAny>) -> PyResult<Vec<[f64; 2]>> {
    let error = arrays::matrix(error, "encoder_error", 2)?;
    Ok(error.as_slice()?.as_chunks::<2>().0.to_vec())
}

/// Delays \[s\] of `n` torque channels: one number for all, or one each.
pub fn delays(given: &Bound<'_, PyAny>, n: usize) -> PyResult<Vec<f64>> {
    if given.len().is_err() {
        return Ok(vec![given.extract()?; n]);
    }
    let each = arrays::vector(given, "torque_delay", Some(n))?;
    Ok(each.as_slice()?.to_vec())
}
