//! The search for friction's shape in Python: many shapes in, what each leaves of the torque out.

use std::sync::Mutex;

use dynid_core::effects::N_FRICTION;
use dynid_offline::friction_search::Scratch;
use dynid_offline::{FrictionSearch, SearchRun};
use numpy::PyArray1;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::effects::check_shape;
use crate::lists::{optional, List};
use crate::offline::{sampling, FilterParts};
use crate::{arrays, errors};

/// Speeds (n_samples,), filter, kept samples, their mirrored ones or `None`.
type RunParts<'py> = (
    Bound<'py, PyAny>,
    FilterParts<'py>,
    List<usize>,
    Option<List<usize>>,
);

/// Residual power of one joint's torque as a function of friction's shape, links taken out.
#[pyclass(name = "FrictionSearch", module = "dynid_rs._core", frozen)]
pub struct PyFrictionSearch(Mutex<(FrictionSearch, Scratch)>);

#[pymethods]
impl PyFrictionSearch {
    #[new]
    #[pyo3(signature = (runs, links, tau, *, weak, n_orders=3, fixed=None))]
    fn new(
        py: Python<'_>,
        runs: List<RunParts<'_>>,
        links: &Bound<'_, PyAny>,
        tau: &Bound<'_, PyAny>,
        weak: f64,
        n_orders: usize,
        fixed: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let fixed = match fixed {
            None => Vec::new(),
            Some(rows) => arrays::matrix(&rows, "fixed rows", N_FRICTION)?
                .as_slice()?
                .as_chunks::<N_FRICTION>()
                .0
                .to_vec(),
        };
        let runs = runs
            .0
            .into_iter()
            .map(|(speeds, filter, kept, mirrored)| {
                let sampling = sampling(filter, kept.0)?;
                Ok(SearchRun {
                    speeds: arrays::vector(&speeds, "speeds", None)?
                        .as_slice()?
                        .to_vec(),
                    filter: sampling.filter,
                    kept: sampling.kept,
                    mirrored: optional(mirrored),
                })
            })
            .collect::<PyResult<Vec<_>>>()?;
        let tau = arrays::vector(tau, "tau", None)?.as_slice()?.to_vec();
        let links = arrays::matrix(
            links,
            "links",
            // What is no matrix has another shape than (n, 1).
            links
                .getattr("shape")
                .and_then(|shape| shape.get_item(1)?.extract())
                .unwrap_or(1),
        )?;
        let links = links.as_slice()?;
        let search = py
            .detach(|| FrictionSearch::new(runs, links, tau, weak, n_orders, fixed))
            .map_err(errors::offline)?;
        Ok(Self(Mutex::new((search, Scratch::default()))))
    }

    /// Sum of squares that is left at each shape, (n_shapes,). Shapes of one threshold are best given in a row.
    #[pyo3(signature = (velocity_threshold, transition_width, *, all_links=false))]
    fn power<'py>(
        &self,
        py: Python<'py>,
        velocity_threshold: &Bound<'py, PyAny>,
        transition_width: &Bound<'py, PyAny>,
        all_links: bool,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let thresholds = arrays::vector(velocity_threshold, "velocity_threshold", None)?;
        let thresholds = thresholds.as_slice()?;
        let widths = arrays::vector(transition_width, "transition_width", Some(thresholds.len()))?;
        let widths = widths.as_slice()?;
        for (threshold, width) in thresholds.iter().zip(widths) {
            check_shape(*threshold, *width)?;
        }
        let powers = py.detach(|| {
            let mut inner = self.0.lock().map_err(|_| broken())?;
            let (search, scratch) = &mut *inner;
            Ok::<_, PyErr>(
                thresholds
                    .iter()
                    .zip(widths)
                    .map(|(threshold, width)| search.power(*threshold, *width, all_links, scratch))
                    .collect::<Vec<_>>(),
            )
        })?;
        Ok(PyArray1::from_vec(py, powers))
    }
}

fn broken() -> PyErr {
    PyRuntimeError::new_err("an earlier call failed in the middle")
}
