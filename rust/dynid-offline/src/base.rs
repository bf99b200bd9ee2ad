//! Base parameters by column-pivoted QR: which of the ten-per-link parameters the torque can tell apart.

use dynid_core::{joint_torque_regressor_into, RobotModel, Workspace};
use faer::linalg::solvers::{ColPivQr, SolveLstsqCore};
use faer::{Mat, MatRef};

use crate::error::OfflineError;
use crate::factor::triangular_factor;

/// `Y phi = Y[:, pivots] phi_base` with `phi_base = phi[pivots] + beta phi[dependent]`.
#[derive(Clone, Debug, PartialEq)]
pub struct BaseParameters {
    /// Indices into phi of the independent columns, ascending.
    pub pivots: Vec<usize>,
    /// Indices into phi of the other columns that move the torque, ascending.
    pub dependent: Vec<usize>,
    /// Regrouping, `pivots.len()` × `dependent.len()`, row-major.
    pub beta: Vec<f64>,
    /// `|r_kk| / |r_k+1,k+1|` across the cut: how clear the rank is. Infinite where nothing is left.
    pub gap: f64,
    /// `|r_00| / |r_kk|`: how well the weakest independent column is seen at the probing states.
    pub spread: f64,
}

/// Finds the base parameters from the regressor at probing states.
///
/// `q, dq, ddq`: row-major, `n_samples` × n, random and well spread; a column counts as dependent where its diagonal
/// entry of R falls below `rtol` times the first one (relative, so units and scale do not decide).
///
/// # Errors
/// [`OfflineError`] if lengths disagree or there are too few states.
pub fn base_parameters(
    robot: &RobotModel,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
    rtol: f64,
) -> Result<BaseParameters, OfflineError> {
    let n = robot.n_joints();
    let width = 10 * n;
    let needed = width.div_ceil(n) + 10;
    let n_samples = q.len() / n;
    if n_samples < needed {
        return Err(OfflineError::TooFewSamples {
            actual: n_samples,
            needed,
        });
    }
    if dq.len() != q.len() || ddq.len() != q.len() || q.len() % n != 0 {
        return Err(OfflineError::Shape { what: "states" });
    }
    let mut workspace = Workspace::new(robot);
    let mut rows = vec![0.0; n_samples * n * width];
    for (k, out) in rows.chunks_exact_mut(n * width).enumerate() {
        let at = k * n..(k + 1) * n;
        joint_torque_regressor_into(
            robot,
            &mut workspace,
            &q[at.clone()],
            &dq[at.clone()],
            &ddq[at],
            out,
        )?;
    }
    let r = triangular_factor(&rows, width)?;
    Ok(select_columns(&r, width, rtol))
}

fn select_columns(r: &[f64], width: usize, rtol: f64) -> BaseParameters {
    let a = Mat::from_fn(width, width, |i, j| r[i * width + j]);
    let qr = ColPivQr::new(a.as_ref());
    let diagonal: Vec<f64> = (0..width).map(|k| qr.R()[(k, k)].abs()).collect();
    let rank = diagonal
        .iter()
        .take_while(|d| **d > rtol * diagonal[0])
        .count();
    let order: Vec<usize> = qr.P().arrays().0.to_vec();
    let mut pivots = order[..rank].to_vec();
    pivots.sort_unstable();
    // Columns of zeros never move the torque; they belong to no group.
    let mut dependent: Vec<usize> = order[rank..]
        .iter()
        .copied()
        .filter(|&j| norm(&a, j) > rtol * diagonal[0])
        .collect();
    dependent.sort_unstable();
    let beta = regroup(&a, &pivots, &dependent);
    let next = diagonal.get(rank).copied().unwrap_or(0.0);
    let last = rank.checked_sub(1).map_or(0.0, |k| diagonal[k]);
    BaseParameters {
        beta,
        gap: if next > 0.0 { last / next } else { f64::INFINITY },
        spread: if last > 0.0 { diagonal[0] / last } else { f64::INFINITY },
        pivots,
        dependent,
    }
}

fn norm(a: &Mat<f64>, j: usize) -> f64 {
    (0..a.nrows()).map(|i| a[(i, j)] * a[(i, j)]).sum::<f64>().sqrt()
}

/// `beta` with `A[:, dependent] = A[:, pivots] beta`.
fn regroup(a: &Mat<f64>, pivots: &[usize], dependent: &[usize]) -> Vec<f64> {
    if pivots.is_empty() || dependent.is_empty() {
        return Vec::new();
    }
    let independent = Mat::from_fn(a.nrows(), pivots.len(), |i, j| a[(i, pivots[j])]);
    let mut solution = Mat::from_fn(a.nrows(), dependent.len(), |i, j| a[(i, dependent[j])]);
    independent
        .as_ref()
        .qr()
        .solve_lstsq_in_place_with_conj(faer::Conj::No, solution.as_mut());
    let solution: MatRef<'_, f64> = solution.as_ref();
    (0..pivots.len())
        .flat_map(|i| (0..dependent.len()).map(move |j| (i, j)))
        .map(|at| solution[at])
        .collect()
}
