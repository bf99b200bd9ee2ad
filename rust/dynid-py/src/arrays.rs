//! Arrays are checked once, at this edge: float64, C order, the right shape, finite.

use dynid_core::all_finite;
use numpy::ndarray::{Array2, Array3};
use numpy::{
    PyArray1, PyArray2, PyArray3, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::IntoPyDict;

/// `numpy.asarray(value, dtype=float, order="C")`; anything that is no array of numbers is a `TypeError` naming it. What
/// numpy's masked arrays hide is NaN.
pub fn contiguous<'py>(value: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    // What is as it should be is not handed around.
    let as_it_is = value.cast_exact::<PyArrayDyn<f64>>();
    if as_it_is.is_ok_and(PyUntypedArrayMethods::is_c_contiguous) {
        return Ok(value.clone());
    }
    let py = value.py();
    let options = [("dtype", "float64"), ("order", "C")].into_py_dict(py)?;
    let numpy = py.import("numpy")?;
    // A subclass of numpy's array, whose asarray hands out what stands behind the mask.
    let numbers = if matches!(value.hasattr("filled"), Ok(true)) {
        value
            .call_method1("astype", ("float64",))
            .and_then(|floats| floats.call_method1("filled", (f64::NAN,)))
    } else {
        Ok(value.clone())
    };
    numbers
        .and_then(|numbers| numpy.call_method("asarray", (numbers,), Some(&options)))
        .map_err(|_| PyTypeError::new_err(format!("{name} is not an array of numbers")))
}

fn shape_of(value: &Bound<'_, PyAny>) -> String {
    value
        .getattr("shape")
        .map_or_else(|_| "?".to_owned(), |shape| shape.to_string())
}

/// `(n_samples, n_columns)` array named `name`.
///
/// # Errors
/// `ValueError` with the shape that came and the one that was expected, or the place of a NaN.
pub fn matrix<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
    n_columns: usize,
) -> PyResult<PyReadonlyArray2<'py, f64>> {
    let matrix = any_matrix(value, name, n_columns)?;
    finite(matrix.as_slice()?, name, n_columns)?;
    Ok(matrix)
}

/// [`matrix`] whose numbers may be any: for what finds those that are not finite on its way through them.
///
/// # Errors
/// `ValueError` with the shape that came and the one that was expected.
pub fn any_matrix<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
    n_columns: usize,
) -> PyResult<PyReadonlyArray2<'py, f64>> {
    let array = contiguous(value, name)?;
    array
        .cast::<PyArray2<f64>>()
        .ok()
        .filter(|matrix| matrix.shape()[1] == n_columns)
        .map(|matrix| matrix.readonly())
        .ok_or_else(|| {
            let actual = shape_of(&array);
            crate::errors::value(format!(
                "{name} has shape {actual}, expected (n_samples, {n_columns})"
            ))
        })
}

/// Number of columns of a matrix named `name`.
///
/// # Errors
/// `ValueError` if it is not two-dimensional or has no column, `TypeError` if it is no array of numbers.
pub fn width(value: &Bound<'_, PyAny>, name: &str) -> PyResult<usize> {
    match contiguous(value, name)?
        .getattr("shape")
        .and_then(|shape| shape.extract::<(usize, usize)>())
    {
        Ok((_, width)) if width > 0 => Ok(width),
        _ => Err(crate::errors::value(format!(
            "{name} must be a matrix with at least one column"
        ))),
    }
}

/// Several matrices with the same number of rows.
///
/// # Errors
/// As [`matrix`]; `ValueError` if the numbers of rows differ.
pub fn samples<'py, const K: usize>(
    signals: [(&str, &Bound<'py, PyAny>); K],
    n_columns: usize,
) -> PyResult<[PyReadonlyArray2<'py, f64>; K]> {
    let arrays = any_samples(signals, n_columns)?;
    for (k, ((name, value), array)) in signals.iter().zip(&arrays).enumerate() {
        // The same array under two names is looked at once.
        if !signals[..k].iter().any(|(_, seen)| seen.is(value)) {
            finite(array.as_slice()?, name, n_columns)?;
        }
    }
    Ok(arrays)
}

/// [`samples`] whose numbers may be any, as [`any_matrix`].
///
/// # Errors
/// As [`any_matrix`]; `ValueError` if the numbers of rows differ.
pub fn any_samples<'py, const K: usize>(
    signals: [(&str, &Bound<'py, PyAny>); K],
    n_columns: usize,
) -> PyResult<[PyReadonlyArray2<'py, f64>; K]> {
    let mut arrays = Vec::with_capacity(K);
    for (name, value) in signals {
        let array = any_matrix(value, name, n_columns)?;
        if let Some(first) = arrays
            .first()
            .map(|a: &PyReadonlyArray2<'py, f64>| a.shape()[0])
        {
            if array.shape()[0] != first {
                let (other, n) = (signals[0].0, array.shape()[0]);
                return Err(crate::errors::value(format!(
                    "{name} has {n} samples, but {other} has {first}"
                )));
            }
        }
        arrays.push(array);
    }
    arrays
        .try_into()
        .map_err(|_| crate::errors::value("signals do not match"))
}

/// Vector of `n` numbers named `name`; any length if `n` is `None`.
///
/// # Errors
/// `ValueError` naming what is wrong.
pub fn vector<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
    n: Option<usize>,
) -> PyResult<PyReadonlyArray1<'py, f64>> {
    let array = contiguous(value, name)?;
    let vector = array
        .cast::<PyArray1<f64>>()
        .ok()
        .filter(|vector| n.is_none_or(|n| vector.len() == n))
        .ok_or_else(|| {
            let actual = shape_of(&array);
            let expected = n.map_or_else(|| "n".to_owned(), |n| n.to_string());
            crate::errors::value(format!("{name} has shape {actual}, expected ({expected},)"))
        })?
        .readonly();
    finite(vector.as_slice()?, name, 1)?;
    Ok(vector)
}

fn finite(values: &[f64], name: &str, n_columns: usize) -> PyResult<()> {
    if all_finite(values) {
        return Ok(());
    }
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(at) => Err(crate::errors::value(format!(
            "{name} holds {} at row {}, column {}; every value must be finite",
            values[at],
            at / n_columns,
            at % n_columns
        ))),
    }
}

/// `work` with Python's lock released, unless the samples are so few that handing it back takes longer.
pub fn unlocked<T: Send>(py: Python<'_>, n_samples: usize, work: impl FnOnce() -> T + Send) -> T {
    if n_samples < 64 {
        work()
    } else {
        py.detach(work)
    }
}

/// Hands a row-major buffer to numpy as a 2-D array, without a copy.
pub fn to_matrix(
    py: Python<'_>,
    values: Vec<f64>,
    n_columns: usize,
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let rows = values.len().checked_div(n_columns).unwrap_or(0);
    Array2::from_shape_vec([rows, n_columns], values)
        .map(|array| PyArray2::from_owned_array(py, array))
        .map_err(|error| crate::errors::value(error.to_string()))
}

/// Hands a row-major buffer to numpy as a 3-D array, without a copy.
pub fn to_cube(
    py: Python<'_>,
    values: Vec<f64>,
    shape: [usize; 3],
) -> PyResult<Bound<'_, PyArray3<f64>>> {
    Array3::from_shape_vec(shape, values)
        .map(|array| PyArray3::from_owned_array(py, array))
        .map_err(|error| crate::errors::value(error.to_string()))
}
