//! `BaseParameters` in Python.

use dynid_core::link_params::{NAMES, N_LINK_PARAMS};
use dynid_core::RobotModel;
use dynid_offline::BaseParameters;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::arrays;

/// Which of the ten-per-link parameters the torque can tell apart, and how the others regroup into them.
#[pyclass(name = "BaseParameters", module = "dynid_rs._core", frozen)]
pub struct PyBaseParameters {
    base: BaseParameters,
    n_standard: usize,
    links: Vec<String>,
}

impl PyBaseParameters {
    pub fn new(base: BaseParameters, robot: &RobotModel) -> Self {
        Self {
            base,
            n_standard: N_LINK_PARAMS * robot.n_joints(),
            links: robot.joints().iter().map(|j| j.link.clone()).collect(),
        }
    }

    fn label(&self, parameter: usize) -> String {
        format!(
            "{}[{}]",
            NAMES[parameter % N_LINK_PARAMS],
            self.links[parameter / N_LINK_PARAMS]
        )
    }
}

type Indices = (Vec<usize>, Vec<usize>, Vec<f64>);
type Rebuild<'py> = (Bound<'py, PyAny>, (Indices, f64, f64, Vec<String>));

/// The base parameters that `BaseParameters.__reduce__` took apart.
#[pyfunction]
pub fn _base_of(
    indices: Indices,
    gap: f64,
    spread: f64,
    links: Vec<String>,
) -> PyResult<PyBaseParameters> {
    let (pivots, dependent, beta) = indices;
    let n_standard = N_LINK_PARAMS * links.len();
    let within = pivots.iter().chain(&dependent).all(|&k| k < n_standard);
    if !within || beta.len() != pivots.len() * dependent.len() {
        return Err(crate::errors::value(
            "these are no base parameters of a robot with so many links",
        ));
    }
    let base = BaseParameters {
        pivots,
        dependent,
        beta,
        gap,
        spread,
    };
    Ok(PyBaseParameters {
        base,
        n_standard,
        links,
    })
}

#[pymethods]
impl PyBaseParameters {
    #[getter]
    fn n_base(&self) -> usize {
        self.base.pivots.len()
    }

    #[getter]
    fn n_standard(&self) -> usize {
        self.n_standard
    }

    #[getter]
    fn pivots<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_iter(py, self.base.pivots.iter().map(|&k| k as i64))
    }

    #[getter]
    fn dependent<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_iter(py, self.base.dependent.iter().map(|&k| k as i64))
    }

    #[getter]
    fn beta<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let n_dependent = self.base.dependent.len();
        if n_dependent == 0 {
            return Ok(PyArray2::zeros(py, [self.base.pivots.len(), 0], false));
        }
        arrays::to_matrix(py, self.base.beta.clone(), n_dependent)
    }

    #[getter]
    fn gap(&self) -> f64 {
        self.base.gap
    }

    #[getter]
    fn spread(&self) -> f64 {
        self.base.spread
    }

    /// For display only: each base parameter as the sum of standard parameters that it stands for.
    #[getter]
    fn names(&self) -> Vec<String> {
        let n_dependent = self.base.dependent.len();
        (0..self.base.pivots.len())
            .map(|i| {
                let mut name = self.label(self.base.pivots[i]);
                for (k, &parameter) in self.base.dependent.iter().enumerate() {
                    let factor = self.base.beta[i * n_dependent + k];
                    if factor.abs() > 1e-9 {
                        let sign = if factor < 0.0 { '-' } else { '+' };
                        let size = factor.abs();
                        let times = if (size - 1.0).abs() < 1e-9 {
                            String::new()
                        } else {
                            format!("{} ", (size * 1e4).round() / 1e4)
                        };
                        name += &format!(" {sign} {times}{}", self.label(parameter));
                    }
                }
                name
            })
            .collect()
    }

    /// Columns of the base parameters: the last axis goes from 10 n_links to n_base.
    fn reduce<'py>(
        &self,
        py: Python<'py>,
        regressor: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let numpy = py.import("numpy")?;
        let regressor = numpy.call_method1("asanyarray", (regressor,))?;
        let width = regressor.getattr("shape")?.try_iter()?.last().transpose()?;
        if width.map(|width| width.extract()).transpose()? != Some(self.n_standard) {
            return Err(crate::errors::value(format!(
                "regressor has shape {}, expected {} columns at its end",
                regressor.getattr("shape")?,
                self.n_standard
            )));
        }
        numpy.call_method1("take", (regressor, self.pivots(py), -1))
    }

    /// Base parameters of a full set: `phi[pivots] + beta phi[dependent]`.
    fn project<'py>(
        &self,
        py: Python<'py>,
        phi: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let phi = arrays::vector(phi, "phi", Some(self.n_standard))?;
        let phi = phi.as_slice()?;
        let n_dependent = self.base.dependent.len();
        let project = |(i, &pivot): (usize, &usize)| {
            let row = &self.base.beta[i * n_dependent..(i + 1) * n_dependent];
            let regrouped = row
                .iter()
                .zip(&self.base.dependent)
                .map(|(beta, &k)| beta * phi[k]);
            phi[pivot] + regrouped.sum::<f64>()
        };
        Ok(PyArray1::from_iter(
            py,
            self.base.pivots.iter().enumerate().map(project),
        ))
    }

    /// Full set with the same torque: base values in the pivot places, zeros elsewhere.
    fn lift<'py>(
        &self,
        py: Python<'py>,
        phi_base: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let phi_base = arrays::vector(phi_base, "phi_base", Some(self.base.pivots.len()))?;
        let mut phi = vec![0.0; self.n_standard];
        for (&pivot, value) in self.base.pivots.iter().zip(phi_base.as_slice()?) {
            phi[pivot] = *value;
        }
        Ok(PyArray1::from_vec(py, phi))
    }

    /// Everything it holds: copies in other processes are built from it.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Rebuild<'py>> {
        let rebuild = py.import("dynid_rs._core")?.getattr("_base_of")?;
        let BaseParameters {
            pivots,
            dependent,
            beta,
            gap,
            spread,
        } = self.base.clone();
        let indices = (pivots, dependent, beta);
        Ok((rebuild, (indices, gap, spread, self.links.clone())))
    }

    fn __repr__(&self) -> String {
        format!(
            "BaseParameters(n_base={}, n_standard={}, gap={:.1e})",
            self.base.pivots.len(),
            self.n_standard,
            self.base.gap
        )
    }
}
