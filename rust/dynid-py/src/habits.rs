//! What Python people expect of an object and Python says best: methods that live in `dynid_rs.model`.

use pyo3::prelude::*;
use pyo3::types::PyDict;

/// `dynid_rs.model.<module>.<function>(object, name=value, ...)`; what was not given keeps its default.
pub fn made<'py, T>(
    object: &Bound<'py, T>,
    module: &str,
    function: &str,
    given: Vec<(&str, Option<Bound<'py, PyAny>>)>,
) -> PyResult<Bound<'py, PyAny>> {
    told(object, module, function, given, &[])
}

/// The same with flags.
pub fn told<'py, T>(
    object: &Bound<'py, T>,
    module: &str,
    function: &str,
    given: Vec<(&str, Option<Bound<'py, PyAny>>)>,
    flags: &[(&str, bool)],
) -> PyResult<Bound<'py, PyAny>> {
    let py = object.py();
    let named = PyDict::new(py);
    for (name, value) in given {
        if let Some(value) = value {
            named.set_item(name, value)?;
        }
    }
    for (name, value) in flags {
        named.set_item(name, value)?;
    }
    let module = py.import(format!("dynid_rs.model.{module}"))?;
    module
        .getattr(function)?
        .call((object.as_any(),), Some(&named))
}
