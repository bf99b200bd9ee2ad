//! Most probable unknowns of linear models in Python.

use dynid_offline::{likeliest as solve, JointGram, Noise, NormalPrior, OfflineError};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::lists::List;
use crate::{arrays, errors};

type Answer<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    f64,
    Bound<'py, PyArray2<f64>>,
    f64,
);

/// One model: Gram matrices, places, how many unknowns, precision and moment of the prior, noise, samples that rows are
/// worth, least noise, rows, whether the noise is known.
type Problem<'py> = (
    List<PyReadonlyArray2<'py, f64>>,
    List<PyReadonlyArray1<'py, isize>>,
    usize,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    f64,
    bool,
);

/// What Rust reads of one: Gram matrices and places, how many unknowns, the prior and the noise.
type Slices<'a> = (
    Vec<(&'a [f64], &'a [isize])>,
    usize,
    NormalPrior<'a>,
    Noise<'a>,
);

/// Unknowns, noise, power, distance from the prior, whitener and `ln det H` of every model, all of them side by side.
#[pyfunction]
pub fn likeliest<'py>(py: Python<'py>, models: List<Problem<'py>>) -> PyResult<Vec<Answer<'py>>> {
    let mut problems = Vec::with_capacity(models.len());
    for (grams, places, n, precision, moment, std, n_effective, least, n_rows, is_known) in
        models.iter()
    {
        let mut joints = Vec::with_capacity(grams.len());
        for (gram, places) in grams.iter().zip(places.iter()) {
            joints.push((gram.as_slice()?, places.as_slice()?));
        }
        let prior = NormalPrior {
            precision: precision.as_slice()?,
            moment: moment.as_slice()?,
        };
        let noise = Noise {
            std: std.as_slice()?,
            n_effective: n_effective.as_slice()?,
            least: least.as_slice()?,
            n_rows: *n_rows,
            is_known: *is_known,
        };
        problems.push((joints, *n, prior, noise));
    }
    let solved = |(joints, n, prior, noise): &Slices<'_>| {
        // A negative place is beyond all unknowns, and told as such.
        let places: Vec<Vec<usize>> = joints
            .iter()
            .map(|(_, places)| places.iter().map(|at| *at as usize).collect())
            .collect();
        let joints: Vec<_> = joints
            .iter()
            .zip(&places)
            .map(|((gram, _), places)| JointGram { gram, places })
            .collect();
        solve(&joints, *n, *prior, *noise)
    };
    let solved: Result<Vec<_>, OfflineError> = py.detach(|| match problems.as_slice() {
        [one] => solved(one).map(|found| vec![found]), // to wake the pool takes longer
        many => many.par_iter().map(solved).collect(),
    });
    let answer = |found: dynid_offline::Likeliest| {
        Ok((
            PyArray1::from_vec(py, found.x.clone()),
            PyArray1::from_vec(py, found.noise),
            PyArray1::from_vec(py, found.power),
            found.distance,
            arrays::to_matrix(py, found.whitener, found.x.len())?,
            found.log_det,
        ))
    };
    solved
        .map_err(errors::offline)?
        .into_iter()
        .map(answer)
        .collect()
}
