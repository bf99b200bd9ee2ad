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
use numpy::{PyArray, PyArray2, PyArrayMethods, PyReadwriteArray, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

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
    let array = value.cast_exact::<PyArray2<f64>>().ok()?;
    if array.shape() != [1, n] || n > MOST_JOINTS || !array.is_c_contiguous() {
        return None;
    }
    let mut numbers = [0.0_f64; MOST_JOINTS];
    // SAFETY: the array is of n float64 in a row, and whoever may write to it needs Python's lock, which is held here. Read
    // without a slice, byte by byte if it has to be: an array need not be aligned.
    unsafe {
        let from = array.data().cast::<u8>();
        core::ptr::copy_nonoverlapping(from, numbers.as_mut_ptr().cast::<u8>(), 8 * n);
    }
    let finite = numbers.iter().fold(true, |all, x| all & x.is_finite());
    finite.then_some(Row { numbers, n })
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
    if let Some(out) = out {
        let (array, mut room) = given(out, shape)?;
        work(room.as_slice_mut()?)?;
        return Ok(array);
    }
    let size: usize = shape.iter().product();
    if size > SMALL {
        let array = PyArray::zeros(py, shape, false);
        work(array.try_readwrite()?.as_slice_mut()?)?;
        return Ok(array);
    }
    // SAFETY: new, so nobody else has it; in C order; every place is written before a slice is made of them.
    let array = unsafe { PyArray::<f64, Dim<[usize; N]>>::new(py, shape, false) };
    let room = unsafe {
        array.data().write_bytes(0, size);
        core::slice::from_raw_parts_mut(array.data(), size)
    };
    work(room)?;
    Ok(array)
}

/// Numbers up to which a new array is made without asking the system for memory.
const SMALL: usize = 1024;

type Given<'py, D> = (Bound<'py, PyArray<f64, D>>, PyReadwriteArray<'py, f64, D>);

/// `out`, if it is what a result would be.
fn given<'py, const N: usize>(
    out: &Bound<'py, PyAny>,
    shape: [usize; N],
) -> PyResult<Given<'py, Dim<[usize; N]>>>
where
    Dim<[usize; N]>: numpy::ndarray::Dimension,
{
    let fits = out
        .cast::<PyArray<f64, Dim<[usize; N]>>>()
        .ok()
        .filter(|array| array.shape() == shape && array.is_c_contiguous());
    let wrong = |why: &str| PyValueError::new_err(format!("out must be {why}"));
    let Some(array) = fits else {
        let shape = shape.map(|n| n.to_string()).join(", ");
        return Err(wrong(&format!(
            "a float64 array in C order of shape ({shape})"
        )));
    };
    let room = array
        .try_readwrite()
        .map_err(|_| wrong("writable and none of the arguments"))?;
    Ok((array.clone(), room))
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
        let known = scratch.take().filter(|s| Arc::ptr_eq(&s.robot, robot));
        let scratch = scratch.insert(known.unwrap_or_else(|| Scratch {
            robot: Arc::clone(robot),
            workspace: Workspace::new(robot),
            phi: robot.phi(),
        }));
        work(&mut scratch.workspace, &scratch.phi)
    })
}

/// `work` with this thread's estimator of `model`, as new.
pub fn with_estimator<T>(
    model: &Arc<TorqueModel>,
    work: impl FnOnce(&mut TorqueEstimator) -> T,
) -> T {
    ESTIMATOR.with_borrow_mut(|known| {
        let known_one = known
            .take()
            .filter(|e| core::ptr::eq(e.model(), &raw const **model));
        let estimator = known.insert(match known_one {
            Some(mut estimator) => {
                estimator.reset();
                estimator
            }
            None => TorqueEstimator::new(Arc::clone(model)),
        });
        work(estimator)
    })
}
