//! `GaussianMixtureRegression` in Python.

use dynid_core::GaussianMixtureRegression;
use numpy::{PyArray1, PyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::{arrays, errors};

/// Conditional mean and variance of the last dimension of a Gaussian mixture given the others (Eqs. 31-39).
#[pyclass(
    name = "GaussianMixtureRegression",
    module = "dynid_rs",
    frozen,
    from_py_object
)]
#[derive(Clone)]
pub struct PyGaussianMixtureRegression(pub GaussianMixtureRegression);

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
        let width = arrays::width(means, "means")?;
        let means = arrays::matrix(means, "means", width)?.as_slice()?.to_vec();
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
        let (mean, variance): (Vec<f64>, Vec<f64>) = py.detach(|| {
            rows.chunks_exact(d)
                .map(|u| self.0.predict(u))
                .map(|p| (p.mean, p.variance))
                .unzip()
        });
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
        for (u, h) in u.as_slice()?.chunks_exact(d).zip(h.chunks_exact_mut(k)) {
            self.0.responsibilities_into(u, h).map_err(errors::core)?;
        }
        arrays::to_matrix(py, h, k)
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
