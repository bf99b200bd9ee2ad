//! A model as C, for Python.

use dynid_io::c_header as header;
use pyo3::prelude::*;

use crate::errors;
use crate::model::PyTorqueModel;

/// The C99 header of `model`, whose names begin with `prefix`.
#[pyfunction]
pub fn c_header(model: &PyTorqueModel, prefix: &str) -> PyResult<String> {
    header::c_header(&model.0, prefix).map_err(errors::c_header)
}

/// A prefix made of any text.
#[pyfunction]
pub fn c_prefix(text: &str) -> String {
    header::prefix_of(text)
}
