//! Rows and factors in Python.

use dynid_core::effects::{SignSlopes, N_SLOPES};
use dynid_core::lanes::{use_path, Path};
use dynid_offline::speed_columns::speed_columns;
use dynid_offline::{OfflineError, RunStates, Sampling, ZeroPhase};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::effects::PyEffect;
use crate::lists::{optional, List};
use crate::robot::PyRobotModel;
use crate::run::{Predicted, RunArrays};
use crate::{arrays, errors};

/// `(sections, steady state, padding)` as `scipy.signal.butter` and `sosfilt_zi` give them; `None` filters nothing.
pub type FilterParts<'py> = Option<(Bound<'py, PyAny>, Bound<'py, PyAny>, usize)>;

/// # Errors
/// `ValueError` if the filter's parts do not fit each other.
pub fn sampling(filter: FilterParts<'_>, kept: Vec<usize>) -> PyResult<Sampling> {
    let filter = zero_phase(filter)?;
    Ok(Sampling { filter, kept })
}

fn zero_phase(filter: FilterParts<'_>) -> PyResult<ZeroPhase> {
    let Some((sections, steady, pad)) = filter else {
        return Ok(ZeroPhase::default());
    };
    let sections = arrays::matrix(&sections, "filter sections", 6)?;
    let steady = arrays::matrix(&steady, "steady state of the filter", 2)?;
    ZeroPhase::new(
        sections.as_slice()?.as_chunks::<6>().0,
        steady.as_slice()?.as_chunks::<2>().0,
        pad,
    )
    .map_err(errors::offline)
}

/// Every column of `x` (n, k) forwards and backwards through a low-pass.
#[pyfunction]
pub fn low_pass<'py>(
    py: Python<'py>,
    x: &Bound<'py, PyAny>,
    filter: FilterParts<'py>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let width = arrays::width(x, "x")?;
    // What is not finite comes out as such, as it does from scipy's.
    let mut filtered = arrays::any_matrix(x, "x", width)?.as_slice()?.to_vec();
    let filter = zero_phase(filter)?;
    py.detach(|| filter.low_pass(&mut filtered, width))
        .map_err(errors::offline)?;
    arrays::to_matrix(py, filtered, width)
}

/// Slope of every column of `x` (n, k), sampled at `rate` [1/s].
#[pyfunction]
pub fn slope<'py>(
    py: Python<'py>,
    x: &Bound<'py, PyAny>,
    rate: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let width = arrays::width(x, "x")?;
    let x = arrays::any_matrix(x, "x", width)?;
    let x = x.as_slice()?;
    let slopes = py.detach(|| dynid_offline::slope(x, width, rate));
    arrays::to_matrix(py, slopes, width)
}

/// Lowest and highest number, largest step and longest stretch of equal neighbours of every column of `x` (n, k): (4, k).
#[pyfunction]
pub fn extent<'py>(py: Python<'py>, x: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let width = arrays::width(x, "x")?;
    let x = arrays::matrix(x, "x", width)?;
    let x = x.as_slice()?;
    if x.is_empty() {
        return Err(errors::value("x must have at least one row"));
    }
    let found = py.detach(|| dynid_offline::extent(x, width));
    let rows = [
        found.lowest,
        found.highest,
        found.largest_step,
        found.longest_equal,
    ];
    arrays::to_matrix(py, rows.concat(), width)
}

/// Filtered, decimated rows of every joint: a list of (n_rows, n_columns) arrays.
#[pyfunction]
#[pyo3(signature = (robot, effects, pivots, q, dq, ddq, q_motor, dq_motor, ddq_motor, tau, *, filter=None, kept, tau_link=None, tau_motor=None, step=None, temperature=None))]
#[expect(
    clippy::too_many_arguments,
    reason = "a run's seven signals and the plan"
)]
pub fn observe<'py>(
    py: Python<'py>,
    robot: &PyRobotModel,
    effects: List<PyEffect>,
    pivots: List<usize>,
    q: &Bound<'py, PyAny>,
    dq: &Bound<'py, PyAny>,
    ddq: &Bound<'py, PyAny>,
    q_motor: &Bound<'py, PyAny>,
    dq_motor: &Bound<'py, PyAny>,
    ddq_motor: &Bound<'py, PyAny>,
    tau: &Bound<'py, PyAny>,
    filter: FilterParts<'py>,
    kept: List<usize>,
    tau_link: Option<&Bound<'py, PyAny>>,
    tau_motor: Option<&Bound<'py, PyAny>>,
    step: Option<f64>,
    temperature: Option<&Bound<'py, PyAny>>,
) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
    let n = robot.0.n_joints();
    let motor = [Some(q_motor), Some(dq_motor), Some(ddq_motor)];
    let predicted = Predicted {
        tau_link,
        tau_motor,
    };
    let link = [q, dq, ddq];
    let arrays = RunArrays::any(link, motor, predicted, temperature, step, n)?;
    let [_, torque] = arrays::any_samples([("q", q), ("tau", tau)], n)?;
    let run = RunStates {
        signals: arrays.signals()?,
        tau: torque.as_slice()?,
    };
    let effects: Vec<_> = effects.0.into_iter().map(|effect| effect.0).collect();
    let sampling = sampling(filter, kept.0)?;
    let observed =
        py.detach(|| dynid_offline::observe(&robot.0, &effects, &pivots, &run, &sampling));
    if let Err(OfflineError::NonFinite { .. }) = observed {
        // Which number it was is only looked for now.
        RunArrays::new(link, motor, predicted, temperature, step, n)?;
        arrays::samples([("q", q), ("tau", tau)], n)?;
    }
    observed
        .map_err(errors::offline)?
        .joints
        .into_iter()
        .map(|joint| arrays::to_matrix(py, joint.rows, joint.width))
        .collect()
}

/// Triangular factor of every joint's rows, folded while they are built: a list of (n_columns, n_columns) arrays.
#[pyfunction]
#[pyo3(signature = (robot, effects, pivots, q, dq, ddq, q_motor, dq_motor, ddq_motor, tau, *, filter=None, kept=None, tau_link=None, tau_motor=None, step=None, temperature=None))]
#[expect(
    clippy::too_many_arguments,
    reason = "a run's seven signals and the plan"
)]
pub fn fold<'py>(
    py: Python<'py>,
    robot: &PyRobotModel,
    effects: List<PyEffect>,
    pivots: List<usize>,
    q: &Bound<'py, PyAny>,
    dq: &Bound<'py, PyAny>,
    ddq: &Bound<'py, PyAny>,
    q_motor: &Bound<'py, PyAny>,
    dq_motor: &Bound<'py, PyAny>,
    ddq_motor: &Bound<'py, PyAny>,
    tau: &Bound<'py, PyAny>,
    filter: FilterParts<'py>,
    kept: Option<List<usize>>,
    tau_link: Option<&Bound<'py, PyAny>>,
    tau_motor: Option<&Bound<'py, PyAny>>,
    step: Option<f64>,
    temperature: Option<&Bound<'py, PyAny>>,
) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
    let n = robot.0.n_joints();
    let motor = [Some(q_motor), Some(dq_motor), Some(ddq_motor)];
    let link = [q, dq, ddq];
    let predicted = Predicted {
        tau_link,
        tau_motor,
    };
    let arrays = RunArrays::any(link, motor, predicted, temperature, step, n)?;
    let [_, torque] = arrays::any_samples([("q", q), ("tau", tau)], n)?;
    let run = RunStates {
        signals: arrays.signals()?,
        tau: torque.as_slice()?,
    };
    let effects: Vec<_> = effects.0.into_iter().map(|effect| effect.0).collect();
    let sampling = match (filter, kept) {
        (None, None) => None,
        (filter, kept) => {
            let every = || (0..run.tau.len() / n).collect();
            Some(sampling(filter, optional(kept).unwrap_or_else(every))?)
        }
    };
    let folded =
        py.detach(|| dynid_offline::fold(&robot.0, &effects, &pivots, &run, sampling.as_ref()));
    if let Err(OfflineError::NonFinite { .. }) = folded {
        // Which number it was is only looked for now.
        RunArrays::new(link, motor, predicted, temperature, step, n)?;
        arrays::matrix(tau, "tau", n)?;
    }
    let factors = folded.map_err(errors::offline)?;
    factors
        .into_iter()
        .map(|factor| {
            let width = factor.len().isqrt();
            arrays::to_matrix(py, factor, width)
        })
        .collect()
}

/// Base parameters, effects, noise and standard deviations from the joints' factors.
#[pyfunction]
#[pyo3(signature = (factors, pivots, n_rows, *, n_reweightings=2))]
pub fn weighted_fit<'py>(
    py: Python<'py>,
    factors: List<Bound<'py, PyAny>>,
    pivots: List<usize>,
    n_rows: usize,
    n_reweightings: usize,
) -> PyResult<[Bound<'py, PyArray1<f64>>; 5]> {
    let parts = factors
        .iter()
        .map(|factor| arrays::matrix(factor, "factor", arrays::width(factor, "factor")?))
        .collect::<PyResult<Vec<_>>>()?;
    let slices = parts
        .iter()
        .map(|part| part.as_slice())
        .collect::<Result<Vec<_>, _>>()?;
    let fit = py
        .detach(|| dynid_offline::weighted_fit(&slices, &pivots, n_rows, n_reweightings))
        .map_err(errors::offline)?;
    let parts = [
        fit.base,
        fit.base_std,
        fit.effects,
        fit.effects_std,
        fit.noise_std,
    ];
    Ok(parts.map(|part| PyArray1::from_vec(py, part)))
}

/// Name of the instructions that the kernels run on; with `path`, those of that name from now on.
#[pyfunction]
#[pyo3(signature = (path=None))]
pub fn processor_path(path: Option<&str>) -> PyResult<&'static str> {
    if let Some(name) = path {
        let wanted = Path::ALL.into_iter().find(|path| path.name() == name);
        if !wanted.is_some_and(use_path) {
            let there = Path::ALL.into_iter().filter(|path| path.is_available());
            let there: Vec<_> = there.map(Path::name).collect();
            return Err(errors::value(format!(
                "this processor has no path {name:?}, expected one of {}",
                there.join(", ")
            )));
        }
    }
    Ok(dynid_core::lanes::path().name())
}

/// What a smooth law's sign changes by with its shape at speeds `dq` of one joint, filtered and decimated: (n_kept, 4).
#[pyfunction]
#[pyo3(signature = (dq, transition_width, sharpness, *, filter=None, kept))]
pub fn sign_slopes<'py>(
    py: Python<'py>,
    dq: &Bound<'py, PyAny>,
    transition_width: f64,
    sharpness: f64,
    filter: FilterParts<'py>,
    kept: List<usize>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let dq = arrays::vector(dq, "dq", None)?;
    if !(transition_width > 0.0
        && transition_width.is_finite()
        && sharpness > 0.0
        && sharpness.is_finite())
    {
        return Err(errors::value(format!(
            "transition_width and sharpness must be positive, found {transition_width} and {sharpness}"
        )));
    }
    let dq = dq.as_slice()?;
    let sampling = sampling(filter, kept.0)?;
    if dq.len() < sampling.filter.min_samples() || sampling.kept.iter().any(|&k| k >= dq.len()) {
        return Err(errors::value(
            "dq is too short for the filter or for the kept samples",
        ));
    }
    let rows = py.detach(|| {
        let mut columns = speed_columns::<SignSlopes, _>(dq, transition_width, sharpness);
        sampling.filter.apply(&mut columns, &mut Vec::new());
        let kept = sampling.kept.iter().flat_map(|&k| &columns[k][..N_SLOPES]);
        kept.copied().collect()
    });
    arrays::to_matrix(py, rows, N_SLOPES)
}

/// R with `R.T @ R == A.T @ A`, (width, width), upper triangular, non-negative diagonal.
#[pyfunction]
pub fn triangular_factor<'py>(
    py: Python<'py>,
    rows: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let width = arrays::width(rows, "rows")?;
    let rows = arrays::matrix(rows, "rows", width)?;
    let rows = rows.as_slice()?;
    let factor = py
        .detach(|| dynid_offline::triangular_factor(rows, width))
        .map_err(errors::offline)?;
    arrays::to_matrix(py, factor, width)
}

/// R of several factors stacked, merged in a fixed tree.
#[pyfunction]
pub fn merge_factors<'py>(
    py: Python<'py>,
    factors: List<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let first = factors
        .first()
        .ok_or_else(|| errors::value("no factor to merge"))?;
    let width = arrays::width(first, "factor")?;
    let parts = factors
        .iter()
        .map(|factor| arrays::matrix(factor, "factor", width))
        .collect::<PyResult<Vec<_>>>()?;
    let slices = parts
        .iter()
        .map(|part| part.as_slice())
        .collect::<Result<Vec<_>, _>>()?;
    let factor = py
        .detach(|| dynid_offline::merge(&slices, width))
        .map_err(errors::offline)?;
    arrays::to_matrix(py, factor, width)
}
