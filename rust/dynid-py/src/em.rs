//! Expectation and maximisation in Python.

use dynid_core::CoreError;
use dynid_offline::em::{self, Mixture, Settings, MOST_DIMENSIONS};
use dynid_offline::OfflineError;
use numpy::{PyArray1, PyArray2, PyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::{arrays, errors};

type Answer<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray3<f64>>,
    Vec<f64>,
    bool,
    f64,
);

/// Weights, means, covariances, the mean log-likelihood of every iteration, whether it converged, and the last mixture's.
#[pyfunction]
#[pyo3(signature = (x, weights, means, covariances, *, reg_covar, tol, max_iter))]
#[expect(clippy::too_many_arguments, reason = "a start and its settings")]
pub fn fit_mixture<'py>(
    py: Python<'py>,
    x: &Bound<'py, PyAny>,
    weights: &Bound<'py, PyAny>,
    means: &Bound<'py, PyAny>,
    covariances: &Bound<'py, PyAny>,
    reg_covar: f64,
    tol: f64,
    max_iter: usize,
) -> PyResult<Answer<'py>> {
    let x = arrays::contiguous(x, "x")?;
    let width = arrays::width(&x, "x")?;
    if !(1..=MOST_DIMENSIONS).contains(&width) {
        return Err(errors::value(format!(
            "x has {width} columns, expected 1 to {MOST_DIMENSIONS}"
        )));
    }
    let x = arrays::matrix(&x, "x", width)?;
    if x.shape()[0] == 0 {
        return Err(errors::offline(OfflineError::TooFewSamples {
            actual: 0,
            needed: 1,
        }));
    }
    let weights = arrays::vector(weights, "weights", None)?
        .as_slice()?
        .to_vec();
    let k = weights.len();
    let means = arrays::matrix(means, "means", width)?.as_slice()?.to_vec();
    let covariances = arrays::contiguous(covariances, "covariances")?;
    let shape = covariances.getattr("shape")?;
    if means.len() != k * width
        || shape.extract::<(usize, usize, usize)>().ok() != Some((k, width, width))
    {
        return Err(errors::value(format!(
            "weights, means and covariances are not those of {k} components with {width} dimensions"
        )));
    }
    let flat = covariances.call_method1("reshape", (-1, width * width))?;
    let start = Mixture {
        weights,
        means,
        covariances: arrays::matrix(&flat, "covariances", width * width)?
            .as_slice()?
            .to_vec(),
    };
    let rows = x.as_slice()?;
    let settings = Settings {
        reg_covar,
        tol,
        max_iter,
    };
    let fitted = py
        .detach(|| em::fit_mixture(rows, width, &start, settings))
        .map_err(|error| match error {
            OfflineError::Core(CoreError::Mixture { component }) => errors::value(format!(
                "component {component} of the mixture has collapsed onto too few samples; take fewer components, or \
                 increase reg_covar"
            )),
            other => errors::offline(other),
        })?;
    let mixture = fitted.mixture;
    Ok((
        PyArray1::from_vec(py, mixture.weights),
        arrays::to_matrix(py, mixture.means, width)?,
        arrays::to_cube(py, mixture.covariances, [k, width, width])?,
        fitted.lower_bounds,
        fitted.converged,
        fitted.log_likelihood,
    ))
}
