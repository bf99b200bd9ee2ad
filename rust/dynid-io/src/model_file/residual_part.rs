//! What the third loop learned, as `model.json` holds it: mixtures or radial basis functions per joint.

use dynid_core::{
    GaussianMixtureRegression, NormalisedRbf, Regression, Residual, ResidualInputs, Signal,
    MAX_INPUTS,
};
use serde::{Deserialize, Serialize};

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ResidualPart {
    inputs: InputsPart,
    /// Of every joint, by name and joint; for inputs of that name only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    signals: Option<Vec<Vec<(String, usize)>>>,
    /// Left out where the inputs do not need it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    compliance: Option<Vec<f64>>,
    joints: Vec<Option<RegressionPart>>,
}

/// Told apart by their fields: files from before there was a choice hold mixtures.
#[derive(Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "a residual's joint needs weights, means, covariances (mixture) or centers, precision, weights, variances (rbf)"
)]
enum RegressionPart {
    Mixture(MixturePart),
    Rbf(RbfPart),
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum InputsPart {
    Deflection,
    JointState,
    LoadFreeDeflection,
    Signals,
}

/// K components over d inputs and one output: `means` K × (d + 1), `covariances` K × (d + 1) × (d + 1).
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct MixturePart {
    weights: Vec<f64>,
    means: Vec<Vec<f64>>,
    covariances: Vec<Vec<Vec<f64>>>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RbfPart {
    centers: Vec<Vec<f64>>,
    precision: Vec<f64>,
    weights: Vec<f64>,
    variances: Vec<f64>,
}

impl ResidualPart {
    pub(super) fn from_residual(residual: &Residual) -> Self {
        let needed = *residual.inputs() == ResidualInputs::LoadFreeDeflection
            || residual.compliance().iter().any(|c| *c != 0.0);
        let named = |signal: &Signal| (signal.kind.name().to_owned(), signal.joint);
        Self {
            inputs: match residual.inputs() {
                ResidualInputs::Deflection => InputsPart::Deflection,
                ResidualInputs::JointState => InputsPart::JointState,
                ResidualInputs::LoadFreeDeflection => InputsPart::LoadFreeDeflection,
                ResidualInputs::Signals(_) => InputsPart::Signals,
            },
            signals: residual.inputs().signals().map(|joints| {
                let joints = joints.iter();
                joints
                    .map(|signals| signals.iter().map(named).collect())
                    .collect()
            }),
            compliance: needed.then(|| residual.compliance().to_vec()),
            joints: residual
                .joints()
                .iter()
                .map(|joint| joint.as_ref().map(RegressionPart::from_regression))
                .collect(),
        }
    }

    pub(super) fn into_residual(self) -> Result<Residual, String> {
        let joints: Vec<Option<Regression>> = self
            .joints
            .into_iter()
            .map(|joint| joint.map(RegressionPart::into_regression).transpose())
            .collect::<Result<_, _>>()?;
        let inputs = match (self.inputs, self.signals) {
            (InputsPart::Signals, Some(joints)) => {
                let signals = |named: Vec<(String, usize)>| {
                    let named = named.into_iter();
                    named.map(|(name, j)| Signal::named(&name, j)).collect()
                };
                let joints = joints.into_iter().map(signals).collect::<Result<_, _>>();
                ResidualInputs::Signals(joints.map_err(|e| format!("residual: {e}"))?)
            }
            (InputsPart::Signals, None) => {
                return Err("residual: signals are missing, which its inputs need".to_owned())
            }
            (_, Some(_)) => {
                return Err("residual: there are signals, but its inputs are others".to_owned())
            }
            (InputsPart::Deflection, None) => ResidualInputs::Deflection,
            (InputsPart::JointState, None) => ResidualInputs::JointState,
            (InputsPart::LoadFreeDeflection, None) => ResidualInputs::LoadFreeDeflection,
        };
        let compliance = match (&inputs, self.compliance) {
            (ResidualInputs::LoadFreeDeflection, None) => {
                return Err(
                    "residual: compliance is missing, which load_free_deflection needs".to_owned(),
                )
            }
            (_, compliance) => compliance.unwrap_or_else(|| vec![0.0; joints.len()]),
        };
        Residual::new(inputs, joints)
            .and_then(|residual| residual.with_compliance(compliance))
            .map_err(|e| format!("residual: {e}"))
    }
}

impl RegressionPart {
    fn from_regression(regression: &Regression) -> Self {
        match regression {
            Regression::Mixture(mixture) => Self::Mixture(MixturePart::from_mixture(mixture)),
            Regression::Rbf(rbf) => Self::Rbf(RbfPart::from_rbf(rbf)),
        }
    }

    fn into_regression(self) -> Result<Regression, String> {
        match self {
            Self::Mixture(part) => part.into_mixture().map(Regression::Mixture),
            Self::Rbf(part) => part.into_rbf().map(Regression::Rbf),
        }
    }
}

/// Rows of `width` as they stand in the file.
fn rows(values: &[f64], width: usize) -> Vec<Vec<f64>> {
    values.chunks_exact(width).map(<[f64]>::to_vec).collect()
}

/// All of `rows` in a line, each `width` long.
fn flat(what: &str, rows: Vec<Vec<f64>>, width: usize) -> Result<Vec<f64>, String> {
    match rows.iter().find(|row| row.len() != width) {
        None => Ok(rows.concat()),
        Some(row) => Err(format!(
            "residual: {what} has a row of {} values, expected {width}",
            row.len()
        )),
    }
}

/// Number of inputs, before memory is taken for their squares.
fn inputs_of(what: &str, n_inputs: usize) -> Result<usize, String> {
    if (1..=MAX_INPUTS).contains(&n_inputs) {
        Ok(n_inputs)
    } else {
        Err(format!(
            "residual: {what} has rows for {n_inputs} inputs, expected 1 to {MAX_INPUTS}"
        ))
    }
}

impl RbfPart {
    fn from_rbf(rbf: &NormalisedRbf) -> Self {
        Self {
            centers: rows(rbf.centers(), rbf.n_inputs()),
            precision: rbf.precision().to_vec(),
            weights: rbf.weights().to_vec(),
            variances: rbf.variances().to_vec(),
        }
    }

    fn into_rbf(self) -> Result<NormalisedRbf, String> {
        let d = inputs_of("precision", self.precision.len())?;
        NormalisedRbf::new(
            flat("centers", self.centers, d)?,
            self.precision,
            self.weights,
            self.variances,
        )
        .map_err(|e| format!("residual: {e}"))
    }
}

impl MixturePart {
    fn from_mixture(mixture: &GaussianMixtureRegression) -> Self {
        let width = mixture.n_inputs() + 1;
        let covariances = mixture.covariances().chunks_exact(width * width);
        Self {
            weights: mixture.weights().to_vec(),
            means: rows(mixture.means(), width),
            covariances: covariances.map(|c| rows(c, width)).collect(),
        }
    }

    fn into_mixture(self) -> Result<GaussianMixtureRegression, String> {
        let width = self.means.first().map_or(0, Vec::len);
        let d = inputs_of("means", width.saturating_sub(1))?;
        if let Some(covariance) = self.covariances.iter().find(|c| c.len() != width) {
            return Err(format!(
                "residual: covariances has a matrix of {} rows, expected {width}",
                covariance.len()
            ));
        }
        GaussianMixtureRegression::new(
            d,
            self.weights,
            flat("means", self.means, width)?,
            flat("covariances", self.covariances.concat(), width)?,
        )
        .map_err(|e| format!("residual: {e}"))
    }
}
