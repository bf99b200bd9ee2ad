//! Criteria of exciting motions and the derivatives that their search needs.

use dynid_offline::points::{point_gradient, point_places, LinkPoint};
use dynid_offline::{adjoint, Criterion, Excitation};
use nalgebra::Vector3;
use numpy::{PyArray1, PyArray2, PyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::lists::List;
use crate::robot::PyRobotModel;
use crate::{arrays, errors};

/// Gradient with respect to q, dq and ddq.
type Gradient<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
);

fn criterion(name: &str, weights: Option<[f64; 3]>) -> PyResult<Criterion> {
    match (name, weights) {
        ("block", Some(w)) if w.iter().all(|w| *w >= 0.0 && w.is_finite()) => {
            Ok(Criterion::Block(w))
        }
        ("block", _) => Err(errors::value(
            "criterion \"block\" needs three weights that are finite and not negative",
        )),
        ("condition", _) => Ok(Criterion::Condition),
        ("D", _) => Ok(Criterion::D),
        ("A", _) => Ok(Criterion::A),
        _ => Err(errors::value(format!(
            "criterion {name:?} is not known; choose block, condition, D or A"
        ))),
    }
}

/// How well a motion excites a robot (Eqs. 13, 14), with the exact gradient.
#[pyclass(name = "Excitation", module = "dynid_rs._core", frozen)]
pub struct PyExcitation {
    inner: Excitation,
    n_joints: usize,
    n_base: usize,
}

#[pymethods]
impl PyExcitation {
    #[new]
    #[pyo3(signature = (robot, pivots, *, whitening=None, random_state=0, rtol=1e-9))]
    fn new(
        py: Python<'_>,
        robot: &PyRobotModel,
        pivots: List<usize>,
        whitening: Option<&Bound<'_, PyAny>>,
        random_state: u64,
        rtol: f64,
    ) -> PyResult<Self> {
        let n_joints = robot.0.n_joints();
        let whitening = whitening
            .map(|matrix| arrays::matrix(matrix, "whitening", n_joints))
            .transpose()?;
        let whitening = whitening.as_ref().map(|m| m.as_slice()).transpose()?;
        let inner = py
            .detach(|| Excitation::new(&robot.0, &pivots, whitening, random_state, rtol))
            .map_err(errors::offline)?;
        Ok(Self {
            inner,
            n_joints,
            n_base: pivots.len(),
        })
    }

    /// Structural ranks of the whole and of the blocks.
    #[getter]
    fn ranks(&self) -> (usize, usize, usize, usize) {
        self.inner.ranks().into()
    }

    fn blocks<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
    ) -> PyResult<Gradient<'py>> {
        let motion = arrays::samples([("q", q), ("dq", dq), ("ddq", ddq)], self.n_joints)?;
        let [q, dq, ddq] = &motion;
        let motion = [q.as_slice()?, dq.as_slice()?, ddq.as_slice()?];
        let [a, b, g] = py
            .detach(|| self.inner.blocks(motion))
            .map_err(errors::offline)?;
        let matrix = |rows| arrays::to_matrix(py, rows, self.n_base);
        Ok((matrix(a)?, matrix(b)?, matrix(g)?))
    }

    fn conditions<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let motion = arrays::samples([("q", q), ("dq", dq), ("ddq", ddq)], self.n_joints)?;
        let [q, dq, ddq] = &motion;
        let motion = [q.as_slice()?, dq.as_slice()?, ddq.as_slice()?];
        let conditions = py
            .detach(|| self.inner.conditions(motion))
            .map_err(errors::offline)?;
        Ok(PyArray1::from_slice(py, &conditions))
    }

    #[pyo3(signature = (q, dq, ddq, *, criterion, weights=None))]
    fn value<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
        criterion: &str,
        weights: Option<[f64; 3]>,
    ) -> PyResult<f64> {
        let criterion = self::criterion(criterion, weights)?;
        let motion = arrays::samples([("q", q), ("dq", dq), ("ddq", ddq)], self.n_joints)?;
        let [q, dq, ddq] = &motion;
        let motion = [q.as_slice()?, dq.as_slice()?, ddq.as_slice()?];
        py.detach(|| self.inner.evaluate(criterion, motion, None))
            .map_err(errors::offline)
    }

    #[pyo3(signature = (q, dq, ddq, *, criterion, weights=None))]
    fn value_and_gradient<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
        criterion: &str,
        weights: Option<[f64; 3]>,
    ) -> PyResult<(f64, Gradient<'py>)> {
        let criterion = self::criterion(criterion, weights)?;
        let motion = arrays::samples([("q", q), ("dq", dq), ("ddq", ddq)], self.n_joints)?;
        let [q, dq, ddq] = &motion;
        let motion = [q.as_slice()?, dq.as_slice()?, ddq.as_slice()?];
        let mut out = zeros(q.len());
        let [out_q, out_dq, out_ddq] = &mut out;
        let gradient = [&mut out_q[..], &mut out_dq[..], &mut out_ddq[..]];
        let value = py
            .detach(|| self.inner.evaluate(criterion, motion, Some(gradient)))
            .map_err(errors::offline)?;
        Ok((value, matrices(py, out, self.n_joints)?))
    }
}

/// Gradient of `sum(direction * inverse_dynamics(q, dq, ddq, phi))` with respect to q, dq, ddq.
#[pyfunction]
#[pyo3(signature = (robot, q, dq, ddq, direction, phi=None))]
pub fn inverse_dynamics_gradient<'py>(
    py: Python<'py>,
    robot: &PyRobotModel,
    q: &Bound<'py, PyAny>,
    dq: &Bound<'py, PyAny>,
    ddq: &Bound<'py, PyAny>,
    direction: &Bound<'py, PyAny>,
    phi: Option<&Bound<'py, PyAny>>,
) -> PyResult<Gradient<'py>> {
    let n = robot.0.n_joints();
    let signals = [("q", q), ("dq", dq), ("ddq", ddq), ("direction", direction)];
    let signals = arrays::samples(signals, n)?;
    let [q, dq, ddq, direction] = &signals;
    let phi = match phi {
        Some(phi) => arrays::vector(phi, "phi", Some(10 * n))?
            .as_slice()?
            .to_vec(),
        None => robot.0.phi(),
    };
    let motion = [q.as_slice()?, dq.as_slice()?, ddq.as_slice()?];
    let direction = direction.as_slice()?;
    let mut out = zeros(q.len());
    let [out_q, out_dq, out_ddq] = &mut out;
    let gradient = [&mut out_q[..], &mut out_dq[..], &mut out_ddq[..]];
    py.detach(|| adjoint::inverse_dynamics_gradient(&robot.0, motion, &phi, direction, gradient))
        .map_err(errors::offline)?;
    matrices(py, out, n)
}

/// Places of points that are fixed to links, in the base frame: (n_samples, n_points, 3).
#[pyfunction(name = "point_places")]
pub fn places<'py>(
    py: Python<'py>,
    robot: &PyRobotModel,
    q: &Bound<'py, PyAny>,
    links: List<usize>,
    places: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let n = robot.0.n_joints();
    let points = link_points(&links, places)?;
    let q = arrays::matrix(q, "q", n)?;
    let (n_samples, q) = (q.shape()[0], q.as_slice()?);
    let mut out = vec![0.0; n_samples * points.len() * 3];
    py.detach(|| point_places(&robot.0, &points, q, &mut out))
        .map_err(errors::offline)?;
    arrays::to_cube(py, out, [n_samples, points.len(), 3])
}

/// Gradient of `sum(weights * point_places(robot, q, links, places))` with respect to q.
#[pyfunction(name = "point_gradient")]
pub fn places_gradient<'py>(
    py: Python<'py>,
    robot: &PyRobotModel,
    q: &Bound<'py, PyAny>,
    links: List<usize>,
    places: &Bound<'py, PyAny>,
    weights: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let n = robot.0.n_joints();
    let points = link_points(&links, places)?;
    let q = arrays::matrix(q, "q", n)?;
    let weights = weights.call_method1("reshape", (q.shape()[0], 3 * points.len()))?;
    let weights = arrays::matrix(&weights, "weights", 3 * points.len())?;
    let (q, weights) = (q.as_slice()?, weights.as_slice()?);
    let mut out = vec![0.0; q.len()];
    py.detach(|| point_gradient(&robot.0, &points, q, weights, &mut out))
        .map_err(errors::offline)?;
    arrays::to_matrix(py, out, n)
}

fn link_points(links: &[usize], places: &Bound<'_, PyAny>) -> PyResult<Vec<LinkPoint>> {
    let places = arrays::matrix(places, "places", 3)?;
    if places.shape()[0] != links.len() {
        return Err(errors::value(format!(
            "places has {} rows, expected {}, one per link index",
            places.shape()[0],
            links.len()
        )));
    }
    let point = |(&link, place)| LinkPoint {
        link,
        place: Vector3::from_column_slice(place),
    };
    let rows = places.as_slice()?.chunks_exact(3);
    Ok(links.iter().zip(rows).map(point).collect())
}

fn zeros(length: usize) -> [Vec<f64>; 3] {
    std::array::from_fn(|_| vec![0.0; length])
}

fn matrices(py: Python<'_>, values: [Vec<f64>; 3], n: usize) -> PyResult<Gradient<'_>> {
    let [a, b, c] = values;
    let matrix = |values| arrays::to_matrix(py, values, n);
    Ok((matrix(a)?, matrix(b)?, matrix(c)?))
}
