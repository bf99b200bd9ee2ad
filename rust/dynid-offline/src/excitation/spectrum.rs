//! Eigenvalues of a Gram matrix, and what the criteria make of them.

use faer::{MatRef, Side};

use super::tridiagonal::Tridiagonal;
use crate::error::OfflineError;

/// A block's smallest eigenvalue counts at least this part of its largest: conditions stay below 1e8 and finite.
const FLOOR: f64 = 1e-16;
/// The condition of what has a direction that is not seen: `1 / sqrt(FLOOR)`.
const WORST: f64 = 1e8;

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
    if values[0] <= 0.0 {
        // Nothing of the block is seen, and a step shows none of it in first order either.
        return Ok((WORST, Vec::new()));
    }
    let (first, last) = (floored(values[0], values[0]), floored(values[1], values[0]));
    let condition = (first / last).sqrt().min(WORST);
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
    let eigen = MatRef::from_row_major_slice(gram, width, width)
        .self_adjoint_eigen(Side::Lower)
        .map_err(|_| OfflineError::NonFinite { what: "motion" })?;
    let (values, vectors) = (eigen.S().column_vector(), eigen.U());
    let largest = values[width - 1];
    let (mut total, mut slopes) = (0.0, Vec::with_capacity(width));
    for k in (0..width).rev() {
        let value = floored(values[k], largest);
        let (part, slope) = match what {
            Sum::LogVolume => (-value.ln(), -1.0 / value),
            Sum::TotalVariance => (value.recip(), -value.powi(-2)),
        };
        total += part;
        slopes.push((slope, (0..width).map(|i| vectors[(i, k)]).collect()));
    }
    Ok((total, slopes))
}
