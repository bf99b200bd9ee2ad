//! Eigenvalues of a Gram matrix, and what the criteria make of them.

use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, Mat, MatRef, Par, Side};

use crate::error::OfflineError;

/// A block's smallest eigenvalue counts at least this part of its largest: conditions stay below 1e8 and finite.
const FLOOR: f64 = 1e-16;

/// Eigenvalues of a Gram matrix, falling, and its eigenvectors as columns in that order.
pub(super) struct Spectrum {
    pub(super) values: Vec<f64>,
    pub(super) vectors: Mat<f64>,
}

/// A value, and its slope in each eigenvalue that it depends on.
pub(super) type Slopes = (f64, Vec<(usize, f64)>);

impl Spectrum {
    pub(super) fn new(rows: &[f64], width: usize) -> Result<Self, OfflineError> {
        let w = MatRef::from_row_major_slice(rows, rows.len() / width, width);
        let mut gram = Mat::zeros(width, width);
        triangular::matmul(
            &mut gram,
            BlockStructure::TriangularLower,
            Accum::Replace,
            w.transpose(),
            BlockStructure::Rectangular,
            w,
            BlockStructure::Rectangular,
            1.0,
            Par::Seq,
        );
        let failed = OfflineError::NonFinite { what: "motion" };
        let finite = (0..width).all(|i| gram[(i, i)].is_finite());
        let eigen = if finite {
            gram.self_adjoint_eigen(Side::Lower)
                .map_err(|_| failed.clone())?
        } else {
            return Err(failed);
        };
        let (values, vectors) = (eigen.S().column_vector(), eigen.U());
        Ok(Self {
            values: (0..width).rev().map(|k| values[k]).collect(),
            vectors: Mat::from_fn(width, width, |i, k| vectors[(i, width - 1 - k)]),
        })
    }

    /// Eigenvalue k, not below the floor.
    fn floored(&self, k: usize) -> f64 {
        self.values[k]
            .max(FLOOR * self.values[0])
            .max(f64::MIN_POSITIVE)
    }

    /// `s_1 / s_r`.
    pub(super) fn condition(&self, rank: usize) -> Slopes {
        let (first, last) = (self.floored(0), self.floored(rank - 1));
        let condition = (first / last).sqrt().min(1.0 / FLOOR.sqrt());
        let slopes = vec![
            (0, 0.5 * condition / first),
            (rank - 1, -0.5 * condition / last),
        ];
        (condition, slopes)
    }

    /// `-sum of log s_m²`.
    pub(super) fn log_volume(&self) -> Slopes {
        let values = (0..self.values.len()).map(|k| self.floored(k));
        let slopes = values.clone().map(|value| -1.0 / value).enumerate();
        (-values.map(f64::ln).sum::<f64>(), slopes.collect())
    }

    /// `sum of 1 / s_m²`.
    pub(super) fn total_variance(&self) -> Slopes {
        let values = (0..self.values.len()).map(|k| self.floored(k));
        let slopes = values.clone().map(|value| -value.powi(-2)).enumerate();
        (values.map(f64::recip).sum(), slopes.collect())
    }
}
