//! `PhysicalSet` in Python, pseudo-inertias, and the URDFs that carry such a set.

use dynid_core::link_params::{
    from_pseudo_inertia, pseudo_inertia as pseudo_inertia_of, LinkParams,
};
use dynid_core::PhysicalSet;
use dynid_io::{mjcf, urdf};
use nalgebra::Matrix4;
use numpy::{PyArray1, PyArray3, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::model::PyTorqueModel;
use crate::{arrays, errors};

/// Standard parameters that a body can have, beside a torque model. SI. Immutable.
#[pyclass(
    name = "PhysicalSet",
    module = "dynid_rs._core",
    frozen,
    from_py_object
)]
#[derive(Clone)]
pub struct PyPhysicalSet(pub PhysicalSet);

#[pymethods]
impl PyPhysicalSet {
    #[new]
    #[pyo3(signature = (phi, rotor_inertia, *, damping, friction, drive_gain))]
    fn new(
        phi: &Bound<'_, PyAny>,
        rotor_inertia: &Bound<'_, PyAny>,
        damping: &Bound<'_, PyAny>,
        friction: &Bound<'_, PyAny>,
        drive_gain: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let read = |value, name| -> PyResult<Vec<f64>> {
            Ok(arrays::vector(value, name, None)?.as_slice()?.to_vec())
        };
        let set = PhysicalSet {
            phi: read(phi, "phi")?,
            rotor_inertia: read(rotor_inertia, "rotor_inertia")?,
            damping: read(damping, "damping")?,
            friction: read(friction, "friction")?,
            drive_gain: read(drive_gain, "drive_gain")?,
        };
        set.check(set.rotor_inertia.len()).map_err(errors::core)?;
        Ok(Self(set))
    }

    #[getter]
    fn phi<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.phi)
    }

    #[getter]
    fn rotor_inertia<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.rotor_inertia)
    }

    #[getter]
    fn damping<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.damping)
    }

    #[getter]
    fn friction<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.friction)
    }

    #[getter]
    fn drive_gain<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.drive_gain)
    }

    fn __repr__(&self) -> String {
        format!("PhysicalSet(n_links={})", self.0.rotor_inertia.len())
    }
}

/// Links of a vector of ten per link.
fn links<'v>(phi: &'v PyReadonlyArray1<'_, f64>) -> PyResult<&'v [LinkParams]> {
    let (links, rest) = phi.as_slice()?.as_chunks::<10>();
    if rest.is_empty() {
        return Ok(links);
    }
    let n = 10 * links.len() + rest.len();
    Err(errors::value(format!(
        "phi has {n} values, expected ten per link"
    )))
}

/// Pseudo-inertias (n_links, 4, 4) of phi (10 n_links,).
#[pyfunction]
pub fn pseudo_inertia<'py>(
    py: Python<'py>,
    phi: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let phi = arrays::vector(phi, "phi", None)?;
    let links = links(&phi)?;
    // Symmetric, so that columns are rows.
    let values = links
        .iter()
        .flat_map(|link| pseudo_inertia_of(link).as_slice().to_vec())
        .collect();
    arrays::to_cube(py, values, [links.len(), 4, 4])
}

/// phi (10 n_links,) of pseudo-inertias (n_links, 4, 4); of each the symmetric part counts.
#[pyfunction]
pub fn phi_from_pseudo_inertia<'py>(
    py: Python<'py>,
    pseudo: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let array = arrays::contiguous(pseudo, "pseudo")?;
    let shape = array.getattr("shape")?;
    if !matches!(shape.extract::<(usize, usize, usize)>(), Ok((_, 4, 4))) {
        return Err(errors::value(format!(
            "pseudo has shape {shape}, expected (n_links, 4, 4)"
        )));
    }
    let flat = array.call_method1("reshape", (-1, 16))?;
    let matrix = arrays::matrix(&flat, "pseudo", 16)?;
    let (links, _) = matrix.as_slice()?.as_chunks::<16>();
    let phi = links
        .iter()
        .flat_map(|link| from_pseudo_inertia(&Matrix4::from_column_slice(link)))
        .collect();
    Ok(PyArray1::from_vec(py, phi))
}

/// The chain with the physical set of `model` as a MuJoCo model.
#[pyfunction]
pub fn mjcf_with_physical(model: &PyTorqueModel) -> PyResult<String> {
    let physical = model.0.physical();
    let physical = physical.ok_or_else(|| errors::value("the model has no physical set"))?;
    Ok(mjcf::minimal(model.0.robot(), physical))
}

/// A URDF with the physical set of `model`: the text of the original, edited in place, or a chain of links and joints.
#[pyfunction]
#[pyo3(signature = (model, original=None, *, source_name="<string>"))]
pub fn urdf_with_physical(
    py: Python<'_>,
    model: &PyTorqueModel,
    original: Option<&[u8]>,
    source_name: &str,
) -> PyResult<Vec<u8>> {
    let robot = model.0.robot();
    let Some(physical) = model.0.physical() else {
        return Err(errors::value("the model has no physical set"));
    };
    match original {
        None => Ok(urdf::minimal(robot, physical).into_bytes()),
        Some(text) => py
            .detach(|| urdf::with_physical(text, source_name, robot, physical))
            .map_err(errors::urdf),
    }
}
