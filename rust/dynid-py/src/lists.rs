//! Lists of a length that memory has room for.

use std::mem::size_of;
use std::ops::Deref;

use pyo3::conversion::FromPyObjectOwned;
use pyo3::prelude::*;

/// Most bytes of a list. More samples than that come as arrays.
const MOST_BYTES: usize = 1 << 30;

/// A sequence from Python. A `Vec` would take memory for as many values as the sequence says it has before it looks at
/// the first, and `range(10**13)`, or an array without columns, ends the process.
pub struct List<T>(pub Vec<T>);

impl<'py, T: FromPyObjectOwned<'py>> FromPyObject<'_, 'py> for List<T> {
    type Error = PyErr;

    fn extract(value: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let (length, most) = (value.len().unwrap_or(0), MOST_BYTES / size_of::<T>().max(1));
        if length > most {
            return Err(crate::errors::value(format!(
                "a list has {length} values, expected {most} at most"
            )));
        }
        value.extract().map(Self)
    }
}

impl<T> Deref for List<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.0
    }
}

impl<T> From<List<T>> for Vec<T> {
    fn from(list: List<T>) -> Self {
        list.0
    }
}

/// The vector of a list that need not be there.
pub fn optional<T>(list: Option<List<T>>) -> Option<Vec<T>> {
    list.map(Vec::from)
}
