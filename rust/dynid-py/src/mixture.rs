//! `GaussianMixtureRegression` in Python.

use dynid_core::GaussianMixtureRegression;
use numpy::{PyArray1, PyArray2, PyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::{arrays, errors};

/// Conditional mean and variance of the last dimension of a Gaussian mixture given the others (Eqs. 31-39).
#[pyclass(
    name = "GaussianMixtureRegression",
    module = "dynid_rs._core",
    frozen,
    from_py_object
)]
#[derive(Clone)]
pub struct PyGaussianMixtureRegression(pub GaussianMixtureRegression);

type Rebuild<'py> = (
    Bound<'py, PyAny>,
    (
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray2<f64>>,
        Bound<'py, PyArray3<f64>>,
    ),
);
type Prediction<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

#[pymethods]
impl PyGaussianMixtureRegression {
    #[new]
    fn new(
        weights: &Bound<'_, PyAny>,
        means: &Bound<'_, PyAny>,
        covariances: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let weights = arrays::vector(weights, "weights", None)?
            .as_slice()?
            .to_vec();
        let means = arrays::contiguous(means, "means")?;
        let width = arrays::width(&means, "means")?;
        let means = arrays::matrix(&means, "means", width)?.as_slice()?.to_vec();
        let covariances = arrays::contiguous(covariances, "covariances")?;
        let shape = covariances.getattr("shape")?;
        if shape.extract::<(usize, usize, usize)>().ok() != Some((weights.len(), width, width)) {
            let k = weights.len();
            return Err(errors::value(format!(
                "covariances has shape {shape}, expected ({k}, {width}, {width})"
            )));
        }
        let flat = covariances.call_method1("reshape", (-1, width * width))?;
        let covariances = arrays::matrix(&flat, "covariances", width * width)?
            .as_slice()?
            .to_vec();
        GaussianMixtureRegression::new(width.saturating_sub(1), weights, means, covariances)
            .map(Self)
            .map_err(errors::core)
    }

    /// Mean and variance at `u` (n_samples, n_inputs); each (n_samples,).
    fn predict<'py>(&self, py: Python<'py>, u: &Bound<'py, PyAny>) -> PyResult<Prediction<'py>> {
        let d = self.0.n_inputs();
        let u = arrays::matrix(u, "u", d)?;
        let rows = u.as_slice()?;
        let n = rows.len() / d;
        if n == 1 {
            let answer = self.0.predict(rows);
            return Ok((
                PyArray1::from_slice(py, &[answer.mean]),
                PyArray1::from_slice(py, &[answer.variance]),
            ));
        }
        let (mut mean, mut variance, mut distance) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        arrays::unlocked(py, n, || {
            self.0
                .predict_into(rows, &mut mean, &mut variance, &mut distance)
        })
        .map_err(errors::core)?;
        Ok((
            PyArray1::from_vec(py, mean),
            PyArray1::from_vec(py, variance),
        ))
    }

    /// Responsibilities at `u` (n_samples, n_inputs): (n_samples, n_components).
    fn responsibilities<'py>(
        &self,
        py: Python<'py>,
        u: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (d, k) = (self.0.n_inputs(), self.0.weights().len());
        let u = arrays::matrix(u, "u", d)?;
        let mut h = vec![0.0; u.shape()[0] * k];
        let mut rows = u.as_slice()?.chunks_exact(d).zip(h.chunks_exact_mut(k));
        py.detach(|| rows.try_for_each(|(u, h)| self.0.responsibilities_into(u, h)))
            .map_err(errors::core)?;
        arrays::to_matrix(py, h, k)
    }

    #[getter]
    fn covariances<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let width = self.0.n_inputs() + 1;
        let shape = [self.0.weights().len(), width, width];
        arrays::to_cube(py, self.0.covariances().to_vec(), shape)
    }

    /// Weights, means and covariances are all there is, so copies and other processes are built from them.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Rebuild<'py>> {
        let parts = (self.weights(py), self.means(py)?, self.covariances(py)?);
        Ok((py.get_type::<Self>().into_any(), parts))
    }

    #[getter]
    fn n_components(&self) -> usize {
        self.0.weights().len()
    }

    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.weights())
    }

    #[getter]
    fn means<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        arrays::to_matrix(py, self.0.means().to_vec(), self.0.n_inputs() + 1)
    }
}
