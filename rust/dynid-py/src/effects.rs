//! Effects in Python: their shapes; columns are evaluated in Rust.

use dynid_core::effects::{
    friction_columns, Effect, Friction, RotorInertia, TorqueOffset, N_FRICTION,
};
use numpy::PyArray2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays;

/// An effect with its shape parameters, one of the terms of a torque model.
#[pyclass(name = "Effect", module = "dynid_rs._core", frozen, from_py_object)]
#[derive(Clone)]
pub struct PyEffect(pub Effect);

type Shape = Vec<(&'static str, Vec<f64>)>;
type Rebuild<'py> = (Bound<'py, PyAny>, (&'static str, Shape));

#[pymethods]
impl PyEffect {
    #[staticmethod]
    fn rotor_inertia() -> Self {
        Self(Effect::RotorInertia(RotorInertia))
    }

    #[staticmethod]
    fn torque_offset() -> Self {
        Self(Effect::TorqueOffset(TorqueOffset))
    }

    #[staticmethod]
    fn friction(velocity_threshold: Vec<f64>, transition_width: Vec<f64>) -> PyResult<Self> {
        let effect = Effect::Friction(Friction {
            velocity_threshold,
            transition_width,
        });
        let n_joints = match &effect {
            Effect::Friction(shape) => shape.velocity_threshold.len(),
            _ => 0,
        };
        effect.check(n_joints).map_err(crate::errors::core)?;
        Ok(Self(effect))
    }

    #[getter]
    fn kind(&self) -> &'static str {
        self.0.kind()
    }

    #[getter]
    fn coefficient_names(&self) -> Vec<&'static str> {
        self.0.coefficient_names().to_vec()
    }

    #[getter]
    fn n_columns(&self) -> usize {
        self.0.n_columns()
    }

    /// Shape parameters by name, one value per joint.
    #[getter]
    fn shape(&self) -> Shape {
        match &self.0 {
            Effect::Friction(shape) => vec![
                ("velocity_threshold", shape.velocity_threshold.clone()),
                ("transition_width", shape.transition_width.clone()),
            ],
            _ => Vec::new(),
        }
    }

    /// Kind and shape are all there is: copies in other processes are built from them.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Rebuild<'py>> {
        let rebuild = py.import("dynid_rs._core")?.getattr("_effect_of")?;
        Ok((rebuild, (self.kind(), self.shape())))
    }

    /// Immutable, so a copy is the effect itself.
    fn __copy__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __deepcopy__<'py>(slf: PyRef<'py, Self>, _memo: &Bound<'py, PyAny>) -> PyRef<'py, Self> {
        slf
    }

    fn __repr__(&self) -> String {
        format!("Effect({:?})", self.0.kind())
    }
}

/// The effect of a kind and a shape that `Effect.__reduce__` wrote.
#[pyfunction]
pub fn _effect_of(kind: &str, shape: Vec<(String, Vec<f64>)>) -> PyResult<PyEffect> {
    let mut values = shape.into_iter().map(|(_, values)| values);
    match (kind, values.next(), values.next()) {
        ("rotor_inertia", None, None) => Ok(PyEffect::rotor_inertia()),
        ("torque_offset", None, None) => Ok(PyEffect::torque_offset()),
        ("friction", Some(threshold), Some(width)) => PyEffect::friction(threshold, width),
        _ => Err(PyValueError::new_err(format!(
            "{kind:?} with this shape is no effect of this release"
        ))),
    }
}

/// Basis of Eqs. 9-11 at speeds `dq`, (n_samples, 8).
#[pyfunction]
pub fn friction_basis<'py>(
    py: Python<'py>,
    dq: &Bound<'py, PyAny>,
    velocity_threshold: f64,
    transition_width: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let dq = arrays::vector(dq, "dq", None)?;
    check_shape(velocity_threshold, transition_width)?;
    let columns = dq
        .as_slice()?
        .iter()
        .flat_map(|&dq| friction_columns(dq, velocity_threshold, transition_width))
        .collect();
    arrays::to_matrix(py, columns, N_FRICTION)
}

/// # Errors
/// `ValueError` if the threshold is negative or the width not positive.
pub fn check_shape(velocity_threshold: f64, transition_width: f64) -> PyResult<()> {
    let good = velocity_threshold >= 0.0
        && velocity_threshold.is_finite()
        && transition_width > 0.0
        && transition_width.is_finite();
    if good {
        Ok(())
    } else {
        Err(PyValueError::new_err(format!(
            "velocity_threshold must be at least 0 and transition_width positive, found {velocity_threshold} and {transition_width}"
        )))
    }
}
