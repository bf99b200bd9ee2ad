//! Eigenvalues of a Gram matrix, and what the criteria make of them.

use nalgebra::{DMatrix, SymmetricEigen};

use super::tridiagonal::Tridiagonal;
use crate::error::OfflineError;

/// A block's smallest eigenvalue counts at least this part of its largest: conditions stay below 1e8 and finite.
const FLOOR: f64 = 1e-16;

/// Steps of the decomposition before it is given up; it takes some per eigenvalue.
const MOST_STEPS: usize = 10_000;

/// How a criterion moves with one eigenvalue: its derivative, and the unit eigenvector.
pub(super) type Slope = (f64, Vec<f64>);

/// `value`, not below the floor.
fn floored(value: f64, largest: f64) -> f64 {
    value.max(FLOOR * largest).max(f64::MIN_POSITIVE)
}

fn check(gram: &[f64], width: usize) -> Result<(), OfflineError> {
    if (0..width).all(|i| gram[i * width + i].is_finite()) {
        Ok(())
    } else {
        Err(OfflineError::NonFinite { what: "motion" })
    }
}

/// `s_1 / s_r` of the matrix with this Gram matrix (width × width), and its slopes where they are asked for.
pub(super) fn condition(
    gram: &[f64],
    width: usize,
    rank: usize,
    sloped: bool,
) -> Result<(f64, Vec<Slope>), OfflineError> {
    check(gram, width)?;
    let reduced = Tridiagonal::new(gram, width);
    let values = reduced.values([width - 1, width - rank]);
    let (first, last) = (floored(values[0], values[0]), floored(values[1], values[0]));
    let condition = (first / last).sqrt().min(1.0 / FLOOR.sqrt());
    let slopes = if sloped {
        vec![
            (0.5 * condition / first, reduced.vector(values[0])),
            (-0.5 * condition / last, reduced.vector(values[1])),
        ]
    } else {
        Vec::new()
    };
    Ok((condition, slopes))
}

/// What is summed over all eigenvalues.
#[derive(Clone, Copy)]
pub(super) enum Sum {
    /// `-sum of log s_m²`.
    LogVolume,
    /// `sum of 1 / s_m²`.
    TotalVariance,
}

/// A sum over the eigenvalues of a Gram matrix (width × width), and its slopes.
pub(super) fn sum(
    gram: &[f64],
    width: usize,
    what: Sum,
) -> Result<(f64, Vec<Slope>), OfflineError> {
    check(gram, width)?;
    let eigen = SymmetricEigen::try_new(
        DMatrix::from_row_slice(width, width, gram),
        f64::EPSILON,
        MOST_STEPS,
    )
    .ok_or(OfflineError::NonFinite { what: "motion" })?;
    let mut order: Vec<usize> = (0..width).collect();
    order.sort_by(|&i, &k| eigen.eigenvalues[k].total_cmp(&eigen.eigenvalues[i]));
    let largest = order.first().map_or(0.0, |&k| eigen.eigenvalues[k]);
    let (mut total, mut slopes) = (0.0, Vec::with_capacity(width));
    for k in order {
        let value = floored(eigen.eigenvalues[k], largest);
        let (part, slope) = match what {
            Sum::LogVolume => (-value.ln(), -1.0 / value),
            Sum::TotalVariance => (value.recip(), -value.powi(-2)),
        };
        total += part;
        slopes.push((
            slope,
            eigen.eigenvectors.column(k).iter().copied().collect(),
        ));
    }
    Ok((total, slopes))
}
