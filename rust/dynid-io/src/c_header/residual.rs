//! The third loop in C: a table for each joint's regression, and the call that blends it in.

use std::fmt::Write;

use dynid_core::{
    GaussianMixtureRegression, NormalisedRbf, Regression, Residual, ResidualInputs, SignalKind,
    TorqueModel,
};
use nalgebra::DMatrix;

use super::numbers::{number, table};

/// Functions and tables.
pub(super) fn parts(model: &TorqueModel) -> Vec<String> {
    let Some(residual) = model.residual() else {
        return Vec::new();
    };
    let used = |name: &str| residual.joints().iter().flatten().any(|r| r.name() == name);
    let mut parts = vec![include_str!("c/prediction.c").to_owned()];
    if used("mixture") {
        parts.push(include_str!("c/mixture.c").to_owned());
    }
    if used("rbf") {
        parts.push(include_str!("c/rbf.c").to_owned());
    }
    let mut tables = String::new();
    for (j, regression) in residual.joints().iter().enumerate() {
        match regression {
            Some(Regression::Mixture(mixture)) => {
                let components = table(&format!("mixture_{j}"), 1, &components(mixture));
                tables.push_str(&components);
            }
            Some(Regression::Rbf(rbf)) => tables.push_str(&rbf_tables(j, rbf)),
            None => {}
        }
    }
    parts.push(tables);
    parts
}

/// What evaluation needs of each component, in the order that `c/mixture.c` names.
fn components(mixture: &GaussianMixtureRegression) -> Vec<f64> {
    let (d, width) = (mixture.n_inputs(), mixture.n_inputs() + 1);
    let mut values = Vec::new();
    let parts = mixture.means().chunks_exact(width);
    let parts = parts.zip(mixture.covariances().chunks_exact(width * width));
    for (weight, (mean, covariance)) in mixture.weights().iter().zip(parts) {
        let full = DMatrix::from_row_slice(width, width, covariance);
        let factor = full.view((0, 0), (d, d)).into_owned().cholesky();
        let inverse = factor.and_then(|factor| {
            let lower = factor.l();
            let log_det: f64 = lower.diagonal().iter().map(|x| x.ln()).sum();
            let inverse = lower.solve_lower_triangular(&DMatrix::identity(d, d))?;
            Some((inverse, log_det))
        });
        // A mixture is only made of covariances that have a root; without one nothing would weigh.
        let (inverse, log_det) = inverse.unwrap_or_else(|| (DMatrix::zeros(d, d), f64::MAX));
        let gain: Vec<f64> = (0..d)
            .map(|r| (0..=r).map(|c| inverse[(r, c)] * full[(d, c)]).sum())
            .collect();
        let variance = full[(d, d)] - gain.iter().map(|g| g * g).sum::<f64>();
        values.extend([weight.ln() - log_det, mean[d], variance.max(0.0)]);
        values.extend(&mean[..d]);
        values.extend(&gain);
        values.extend(
            (0..d)
                .flat_map(|r| (0..=r).map(move |c| (r, c)))
                .map(|at| inverse[at]),
        );
    }
    values
}

fn rbf_tables(j: usize, rbf: &NormalisedRbf) -> String {
    [
        ("center", rbf.centers()),
        ("precision", rbf.precision()),
        ("weight", rbf.weights()),
        ("bump_variance", rbf.variances()),
    ]
    .map(|(name, values)| table(&format!("{name}_{j}"), 1, values))
    .concat()
}

/// Statements that fill the last row of the terms, joint by joint.
pub(super) fn calls(model: &TorqueModel) -> String {
    let Some(residual) = model.residual() else {
        return String::new();
    };
    let row = model.n_terms() - 1;
    let mut text = String::new();
    for (j, regression) in residual.joints().iter().enumerate() {
        let Some(regression) = regression else {
            let _ = writeln!(text, "    terms[{row}][{j}] = 0.0;");
            continue;
        };
        let d = regression.n_inputs();
        let (call, second_moment) = match regression {
            Regression::Mixture(mixture) => {
                let k = mixture.weights().len();
                let call = format!("dynid_mixture(dynid_mixture_{j}, {k}, {d}, u)");
                (call, mixture.second_moment())
            }
            Regression::Rbf(rbf) => {
                let k = rbf.weights().len();
                let call = format!(
                    "dynid_rbf(dynid_center_{j}, dynid_precision_{j}, dynid_weight_{j}, dynid_bump_variance_{j}, {k}, {d}, u)"
                );
                (call, rbf.second_moment())
            }
        };
        let _ = writeln!(
            text,
            "    {{\n        double u[{d}] = {{{}}};\n        dynid_prediction p = {call};\n        faded |= dynid_trust(&p, \
             {d}, {}, &terms[{row}][{j}], &variance[{j}]);\n    }}",
            inputs(residual, j).join(", "),
            number(second_moment),
        );
    }
    text
}

/// What joint `j`'s regression sees, as C expressions.
fn inputs(residual: &Residual, j: usize) -> Vec<String> {
    let deflection = format!("x->q_motor[{j}] - x->q[{j}]");
    let rate = format!("x->dq_motor[{j}] - x->dq[{j}]");
    match residual.inputs() {
        ResidualInputs::Deflection => vec![deflection, rate],
        ResidualInputs::JointState => {
            vec![format!("x->q_motor[{j}]"), format!("x->dq_motor[{j}]")]
        }
        ResidualInputs::LoadFreeDeflection => {
            // The load as the torque channel shows it is the first term.
            let compliance = number(residual.compliance()[j]);
            vec![format!("{deflection} - {compliance} * terms[0][{j}]"), rate]
        }
        ResidualInputs::Signals(joints) => joints[j]
            .iter()
            .map(|signal| {
                let name = match signal.kind {
                    SignalKind::Q => "q",
                    SignalKind::Dq => "dq",
                    SignalKind::Ddq => "ddq",
                    SignalKind::QMotor => "q_motor",
                    SignalKind::DqMotor => "dq_motor",
                    SignalKind::DdqMotor => "ddq_motor",
                    SignalKind::TauLink => "tau_link",
                };
                format!("x->{name}[{}]", signal.joint)
            })
            .collect(),
    }
}
