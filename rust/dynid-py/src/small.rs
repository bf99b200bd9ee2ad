//! One state from Python: read to the stack, answered while Python's lock is held. For so little work numpy's borrow records,
//! a handful of buffers and a lock that is handed back and forth would take longer than the answer.
#![expect(
    unsafe_code,
    reason = "memory of arrays without numpy's borrow records, which cost more than the answer to one state"
)]

use std::cell::RefCell;
use std::sync::Arc;

use dynid_core::{RobotModel, TorqueEstimator, TorqueModel, Workspace};
use numpy::ndarray::Dim;
use numpy::npyffi::flags::{NPY_ARRAY_ALIGNED, NPY_ARRAY_C_CONTIGUOUS, NPY_ARRAY_WRITEABLE};
use numpy::npyffi::{PyArrayObject, PyArray_CheckExact};
use numpy::{PyArray, PyArrayDescr, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

/// Most joints of a state that is read to the stack.
const MOST_JOINTS: usize = 16;

/// One number per joint.
#[derive(Clone, Copy)]
pub struct Row {
    numbers: [f64; MOST_JOINTS],
    n: usize,
}

impl Row {
    /// The numbers.
    pub fn as_slice(&self) -> &[f64] {
        &self.numbers[..self.n]
    }
}

/// The only sample of `value`; `None` if it is not a float64 array in C order of shape (1, n) with finite numbers, or
/// there are too many joints: the way of all others then finds the words.
pub fn row(value: &Bound<'_, PyAny>, n: usize) -> Option<Row> {
    if n > MOST_JOINTS {
        return None;
    }
    let from = numbers(value, [1, n], NPY_ARRAY_C_CONTIGUOUS)?;
    let mut row = [0.0_f64; MOST_JOINTS];
    // Infinity times zero is not a number, and stays so.
    let mut doubt = 0.0;
    for (k, x) in row.iter_mut().enumerate().take(n) {
        // SAFETY: the array is of n float64 in a row, and whoever may write to it needs Python's lock, which is held here.
        // An array need not be aligned.
        *x = unsafe { from.add(k).read_unaligned() };
        doubt += *x * 0.0;
    }
    (doubt == 0.0).then_some(Row { numbers: row, n })
}

/// Where the numbers of `value` stand, if it is an array of numpy's own class of float64 with this shape and all these
/// flags. Looked up by hand: numpy's crate takes and gives back two references to find the type of a number.
fn numbers<const N: usize>(
    value: &Bound<'_, PyAny>,
    shape: [usize; N],
    flags: i32,
) -> Option<*mut f64> {
    static FLOAT64: PyOnceLock<Py<PyArrayDescr>> = PyOnceLock::new();
    let py = value.py();
    let float64 = FLOAT64.get_or_init(py, || numpy::dtype::<f64>(py).unbind());
    // SAFETY: the fields are those of an array, because the object is one; they are only read, under Python's lock. An
    // array has as many lengths as dimensions.
    unsafe {
        if PyArray_CheckExact(py, value.as_ptr()) == 0 {
            return None;
        }
        let array = &(*value.as_ptr().cast::<PyArrayObject>()).fields;
        let fits = array.descr.cast() == float64.as_ptr()
            && array.nd as usize == N
            && array.flags & flags == flags
            && (0..N).all(|k| *array.dimensions.add(k) as usize == shape[k]);
        fits.then_some(array.data.cast())
    }
}

/// [`row`] of several signals.
pub fn rows<const K: usize>(values: [&Bound<'_, PyAny>; K], n: usize) -> Option<[Row; K]> {
    let mut rows = [Row {
        numbers: [0.0; MOST_JOINTS],
        n,
    }; K];
    for (row, value) in rows.iter_mut().zip(values) {
        *row = self::row(value, n)?;
    }
    Some(rows)
}

/// A result of this shape, written by `work`: `out`, or a new array.
///
/// # Errors
/// `ValueError` if `out` is no float64 array in C order of this shape that can be written to; what `work` says.
pub fn result<'py, const N: usize>(
    py: Python<'py>,
    shape: [usize; N],
    out: Option<&Bound<'py, PyAny>>,
    work: impl FnOnce(&mut [f64]) -> PyResult<()>,
) -> PyResult<Bound<'py, PyArray<f64, Dim<[usize; N]>>>>
where
    Dim<[usize; N]>: numpy::ndarray::Dimension,
    [usize; N]: numpy::ndarray::IntoDimension<Dim = Dim<[usize; N]>>,
{
    let Some(out) = out else {
        return fresh(py, shape, work);
    };
    let array = given(out, shape)?;
    let mut room = array
        .try_readwrite()
        .map_err(|_| crate::errors::value(NOT_WRITABLE))?;
    work(room.as_slice_mut()?)?;
    drop(room);
    Ok(array)
}

/// A new array that `work` fills, all of it.
fn fresh<'py, const N: usize>(
    py: Python<'py>,
    shape: [usize; N],
    work: impl FnOnce(&mut [f64]) -> PyResult<()>,
) -> PyResult<Bound<'py, PyArray<f64, Dim<[usize; N]>>>>
where
    Dim<[usize; N]>: numpy::ndarray::Dimension,
    [usize; N]: numpy::ndarray::IntoDimension<Dim = Dim<[usize; N]>>,
{
    // SAFETY: new and in C order, so that nobody else knows it; `work` writes every place and reads none, and an array that
    // it gave up on is dropped unread. Zeros first would take as long as a third of the work.
    unsafe {
        let array = PyArray::<f64, Dim<[usize; N]>>::new(py, shape, false);
        let size = shape.iter().product();
        work(core::slice::from_raw_parts_mut(array.data(), size))?;
        Ok(array)
    }
}

/// [`result`] of one state, whose signals `work` has as [`Row`]s and of whose arrays it knows nothing.
///
/// # Errors
/// As [`result`].
pub fn one_result<'py, const N: usize>(
    py: Python<'py>,
    shape: [usize; N],
    out: Option<&Bound<'py, PyAny>>,
    work: impl FnOnce(&mut [f64]) -> PyResult<()>,
) -> PyResult<Bound<'py, PyArray<f64, Dim<[usize; N]>>>>
where
    Dim<[usize; N]>: numpy::ndarray::Dimension,
    [usize; N]: numpy::ndarray::IntoDimension<Dim = Dim<[usize; N]>>,
{
    let Some(out) = out else {
        return fresh(py, shape, work);
    };
    let usual = NPY_ARRAY_C_CONTIGUOUS | NPY_ARRAY_ALIGNED | NPY_ARRAY_WRITEABLE;
    let Some(room) = numbers(out, shape, usual) else {
        return result(py, shape, Some(out), work);
    };
    // SAFETY: aligned float64 in a row that may be written. Whoever else may touch them needs Python's lock, which is held
    // until `work` is done; `work` has copies of its inputs.
    work(unsafe { core::slice::from_raw_parts_mut(room, shape.iter().product()) })?;
    // SAFETY: its class, type of numbers and number of dimensions were looked at.
    Ok(unsafe { out.clone().cast_into_unchecked() })
}

const NOT_WRITABLE: &str = "out must be writable and none of the arguments";

/// `out`, if it has the form of a result.
fn given<'py, const N: usize>(
    out: &Bound<'py, PyAny>,
    shape: [usize; N],
) -> PyResult<Bound<'py, PyArray<f64, Dim<[usize; N]>>>>
where
    Dim<[usize; N]>: numpy::ndarray::Dimension,
{
    let fits = out
        .cast::<PyArray<f64, Dim<[usize; N]>>>()
        .ok()
        .filter(|array| array.shape() == shape && array.is_c_contiguous());
    fits.cloned().ok_or_else(|| {
        let shape = shape.map(|n| n.to_string()).join(", ");
        crate::errors::value(format!(
            "out must be a float64 array in C order of shape ({shape})"
        ))
    })
}

/// What single states of one robot need again and again.
struct Scratch {
    robot: Arc<RobotModel>,
    workspace: Workspace,
    phi: Vec<f64>,
}

thread_local! {
    static SCRATCH: RefCell<Option<Scratch>> = const { RefCell::new(None) };
    static ESTIMATOR: RefCell<Option<TorqueEstimator>> = const { RefCell::new(None) };
}

/// `work` with this thread's workspace for `robot` and its declared parameters.
pub fn with_workspace<T>(
    robot: &Arc<RobotModel>,
    work: impl FnOnce(&mut Workspace, &[f64]) -> T,
) -> T {
    SCRATCH.with_borrow_mut(|scratch| {
        // In place: whoever takes it out moves it twice.
        if !scratch
            .as_ref()
            .is_some_and(|s| Arc::ptr_eq(&s.robot, robot))
        {
            *scratch = None;
        }
        let scratch = scratch.get_or_insert_with(|| Scratch {
            robot: Arc::clone(robot),
            workspace: Workspace::new(robot),
            phi: robot.phi(),
        });
        work(&mut scratch.workspace, &scratch.phi)
    })
}

/// `work` with this thread's estimator of `model`, as new.
pub fn with_estimator<T>(
    model: &Arc<TorqueModel>,
    work: impl FnOnce(&mut TorqueEstimator) -> T,
) -> T {
    ESTIMATOR.with_borrow_mut(|known| match known {
        Some(estimator) if core::ptr::eq(estimator.model(), &raw const **model) => {
            estimator.reset();
            work(estimator)
        }
        _ => work(known.insert(TorqueEstimator::new(Arc::clone(model)))),
    })
}
