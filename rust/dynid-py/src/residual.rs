//! The third loop's residual from Python: either regression, and the signals that it sees by their names.

use dynid_core::{Regression, ResidualInputs, Signal};
use pyo3::prelude::*;

use crate::errors;
use crate::lists::List;
use crate::mixture::PyGaussianMixtureRegression;
use crate::rbf::PyNormalisedRbf;

/// Either regression of the third loop.
#[derive(FromPyObject, IntoPyObject)]
pub enum PyRegression {
    Mixture(PyGaussianMixtureRegression),
    Rbf(PyNormalisedRbf),
}

impl From<PyRegression> for Regression {
    fn from(regression: PyRegression) -> Self {
        match regression {
            PyRegression::Mixture(mixture) => Self::Mixture(mixture.0),
            PyRegression::Rbf(rbf) => Self::Rbf(rbf.0),
        }
    }
}

impl From<&Regression> for PyRegression {
    fn from(regression: &Regression) -> Self {
        match regression {
            Regression::Mixture(mixture) => {
                Self::Mixture(PyGaussianMixtureRegression(mixture.clone()))
            }
            Regression::Rbf(rbf) => Self::Rbf(PyNormalisedRbf(rbf.clone())),
        }
    }
}

/// Name and joint of every signal that one regression sees.
pub type Named = List<(String, usize)>;

pub fn pair_named(name: &str) -> PyResult<ResidualInputs> {
    ResidualInputs::PAIRS
        .into_iter()
        .find(|inputs| inputs.name() == name)
        .ok_or_else(|| {
            errors::value(format!(
                "inputs must be \"deflection\", \"joint_state\" or \"load_free_deflection\", found {name:?}"
            ))
        })
}

pub fn signals_named(named: Named) -> PyResult<Vec<Signal>> {
    named
        .0
        .into_iter()
        .map(|(name, joint)| Signal::named(&name, joint))
        .collect::<Result<_, _>>()
        .map_err(|error| errors::value(error.to_string()))
}

/// What the regressions see: a pair by its name, or `"signals"` with the signals of every joint.
pub fn inputs_named(name: &str, signals: Option<List<Named>>) -> PyResult<ResidualInputs> {
    match (name, signals) {
        ("signals", Some(joints)) => {
            let joints = joints.0.into_iter().map(signals_named);
            Ok(ResidualInputs::Signals(joints.collect::<PyResult<_>>()?))
        }
        ("signals", None) => Err(errors::value(
            "residual_signals is missing, one list of (name, joint) per joint",
        )),
        (name, Some(_)) => Err(errors::value(format!(
            "residual_signals is for a residual of \"signals\", found {name:?}"
        ))),
        (name, None) => pair_named(name),
    }
}
