//! `NormalisedRbf` in Python.

use dynid_core::{CoreError, NormalisedRbf};
use numpy::{PyArray1, PyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::{arrays, errors};

/// Normalised radial basis functions (Eqs. 27-29).
#[pyclass(
    name = "NormalisedRbf",
    module = "dynid_rs._core",
    frozen,
    from_py_object
)]
#[derive(Clone)]
pub struct PyNormalisedRbf(pub NormalisedRbf);

type Rebuild<'py> = (
    Bound<'py, PyAny>,
    (
        Bound<'py, PyArray2<f64>>,
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray1<f64>>,
    ),
);
/// A method of the core that writes one number per centre.
type WriteRow = fn(&NormalisedRbf, &[f64], &mut [f64]) -> Result<(), CoreError>;
type Prediction<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

#[pymethods]
impl PyNormalisedRbf {
    #[new]
    fn new(
        centers: &Bound<'_, PyAny>,
        precision: &Bound<'_, PyAny>,
        weights: &Bound<'_, PyAny>,
        variances: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let vector = |value, name, length| -> PyResult<Vec<f64>> {
            Ok(arrays::vector(value, name, length)?.as_slice()?.to_vec())
        };
        let precision = vector(precision, "precision", None)?;
        let weights = vector(weights, "weights", None)?;
        let variances = vector(variances, "variances", Some(weights.len()))?;
        let centers = arrays::matrix(centers, "centers", precision.len())?;
        NormalisedRbf::new(centers.as_slice()?.to_vec(), precision, weights, variances)
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

    /// psi at `u` (n_samples, n_inputs): (n_samples, n_centers).
    fn basis<'py>(
        &self,
        py: Python<'py>,
        u: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, u, NormalisedRbf::basis_into)
    }

    /// psi over its sum at `u` (n_samples, n_inputs): (n_samples, n_centers).
    fn shares<'py>(
        &self,
        py: Python<'py>,
        u: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, u, NormalisedRbf::shares_into)
    }

    /// These four are all there is, so copies and other processes are built from them.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Rebuild<'py>> {
        let parts = (
            self.centers(py)?,
            self.precision(py),
            self.weights(py),
            self.variances(py),
        );
        Ok((py.get_type::<Self>().into_any(), parts))
    }

    #[getter]
    fn n_components(&self) -> usize {
        self.0.weights().len()
    }

    #[getter]
    fn centers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        arrays::to_matrix(py, self.0.centers().to_vec(), self.0.n_inputs())
    }

    #[getter]
    fn precision<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.precision())
    }

    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.weights())
    }

    #[getter]
    fn variances<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.variances())
    }
}

impl PyNormalisedRbf {
    /// One row of `n_centers` numbers per sample.
    fn rows<'py>(
        &self,
        py: Python<'py>,
        u: &Bound<'py, PyAny>,
        write: WriteRow,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (d, n) = (self.0.n_inputs(), self.0.weights().len());
        let u = arrays::matrix(u, "u", d)?;
        let mut rows = vec![0.0; u.shape()[0] * n];
        let mut pairs = u.as_slice()?.chunks_exact(d).zip(rows.chunks_exact_mut(n));
        py.detach(|| pairs.try_for_each(|(u, row)| write(&self.0, u, row)))
            .map_err(errors::core)?;
        arrays::to_matrix(py, rows, n)
    }
}
