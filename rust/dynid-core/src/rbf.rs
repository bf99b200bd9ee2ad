//! Normalised radial basis functions (Eqs. 27-29), in logs: one pass, no scratch, correct however far the query is.

use crate::error::CoreError;
use crate::mixture::Prediction;

/// One output as the weighted mean of Gaussian bumps over `d` inputs (Eq. 29):
/// `f(u) = sum w_j psi_j(u) / sum psi_j(u)`, `psi_j(u) = exp(-1/2 sum_i h_i (u_i - c_ji)^2)`.
///
/// Eq. 27 has one input and a width; here h is the precision, as Eq. 28's inverse square is meant, and with several
/// inputs the bumps are products. Where the centres stand (a grid, Eq. 28) is the caller's.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalisedRbf {
    centers: Vec<f64>,
    precision: Vec<f64>,
    weights: Vec<f64>,
    variances: Vec<f64>,
    second_moment: f64,
}

impl NormalisedRbf {
    /// `centers`: N × d, row-major; `precision`: d values, h \[1/unit²\], positive; `weights`: N; `variances`: N, what is
    /// left about f near each centre.
    ///
    /// # Errors
    /// [`CoreError`] if lengths disagree, a number is not finite, a precision is not positive or a variance negative.
    pub fn new(
        centers: Vec<f64>,
        precision: Vec<f64>,
        weights: Vec<f64>,
        variances: Vec<f64>,
    ) -> Result<Self, CoreError> {
        if precision.is_empty() {
            return Err(CoreError::Range { what: "n_inputs" });
        }
        if weights.is_empty() {
            return Err(CoreError::Range { what: "weights" });
        }
        let n = weights.len();
        crate::dynamics::check_length("centers", &centers, n * precision.len())?;
        crate::dynamics::check_length("variances", &variances, n)?;
        let numbers = [&centers, &precision, &weights, &variances];
        if !numbers.into_iter().flatten().all(|x| x.is_finite()) {
            return Err(CoreError::NonFiniteParameter);
        }
        if precision.iter().any(|h| *h <= 0.0) {
            return Err(CoreError::Range { what: "precision" });
        }
        if variances.iter().any(|v| *v < 0.0) {
            return Err(CoreError::Range { what: "variances" });
        }
        let total: f64 = weights.iter().zip(&variances).map(|(w, v)| w * w + v).sum();
        Ok(Self {
            second_moment: total / n as f64,
            centers,
            precision,
            weights,
            variances,
        })
    }

    /// Inputs `d`.
    #[must_use]
    pub fn n_inputs(&self) -> usize {
        self.precision.len()
    }

    /// Centres c, N × d.
    #[must_use]
    pub fn centers(&self) -> &[f64] {
        &self.centers
    }

    /// Precision h of every input, d values.
    #[must_use]
    pub fn precision(&self) -> &[f64] {
        &self.precision
    }

    /// Weights w, N values.
    #[must_use]
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Variance about f near every centre, N values.
    #[must_use]
    pub fn variances(&self) -> &[f64] {
        &self.variances
    }

    /// Mean square of the output over the centres: what is expected where nothing is known.
    #[must_use]
    pub fn second_moment(&self) -> f64 {
        self.second_moment
    }

    /// f and its variance at `u` (d values; only the first d are read).
    ///
    /// Sums run over `exp(log psi_j - max)`, with the maximum kept on the way, so that they never vanish. The variance
    /// is the same weighted mean of the centres' own; the distance is to the nearest centre in widths `1/sqrt(h)`.
    #[must_use]
    pub fn predict(&self, u: &[f64]) -> Prediction {
        let mut best = f64::NEG_INFINITY;
        let (mut total, mut mean, mut variance) = (0.0, 0.0, 0.0);
        let mut nearest = f64::INFINITY;
        for (j, (weight, own)) in self.weights.iter().zip(&self.variances).enumerate() {
            let distance_squared = self.distance_squared(j, u);
            nearest = nearest.min(distance_squared);
            let log_psi = log_psi(distance_squared);
            if log_psi > best {
                let shrink = (best - log_psi).exp();
                total *= shrink;
                mean *= shrink;
                variance *= shrink;
                best = log_psi;
            }
            let psi = (log_psi - best).exp();
            total += psi;
            mean += psi * weight;
            variance += psi * own;
        }
        Prediction {
            mean: mean / total,
            variance: variance / total,
            distance_squared: nearest,
        }
    }

    /// psi_j at `u` (Eq. 27), written to `psi` (N values).
    ///
    /// # Errors
    /// [`CoreError::Length`] if `u` or `psi` has the wrong length.
    pub fn basis_into(&self, u: &[f64], psi: &mut [f64]) -> Result<(), CoreError> {
        crate::dynamics::check_length("u", u, self.n_inputs())?;
        crate::dynamics::check_length("psi", psi, self.weights.len())?;
        for (j, psi) in psi.iter_mut().enumerate() {
            *psi = log_psi(self.distance_squared(j, u)).exp();
        }
        Ok(())
    }

    /// `psi_j / sum psi` at `u`, written to `share` (N values): what Eq. 29 multiplies the weights with. Sums to one at
    /// any distance.
    ///
    /// # Errors
    /// [`CoreError::Length`] if `u` or `share` has the wrong length.
    pub fn shares_into(&self, u: &[f64], share: &mut [f64]) -> Result<(), CoreError> {
        crate::dynamics::check_length("u", u, self.n_inputs())?;
        crate::dynamics::check_length("share", share, self.weights.len())?;
        let mut best = f64::NEG_INFINITY;
        for (j, share) in share.iter_mut().enumerate() {
            *share = log_psi(self.distance_squared(j, u));
            best = best.max(*share);
        }
        let mut total = 0.0;
        for share in share.iter_mut() {
            *share = (*share - best).exp();
            total += *share;
        }
        share.iter_mut().for_each(|share| *share /= total);
        Ok(())
    }

    /// `sum_i h_i (u_i - c_ji)^2`.
    fn distance_squared(&self, j: usize, u: &[f64]) -> f64 {
        let d = self.precision.len();
        let center = self.centers.get(j * d..(j + 1) * d);
        center
            .unwrap_or_default()
            .iter()
            .zip(u)
            .zip(&self.precision)
            .map(|((c, u), h)| h * (u - c) * (u - c))
            .sum()
    }
}

/// Exponent of Eq. 27; finite even where the square overflows.
fn log_psi(distance_squared: f64) -> f64 {
    (-0.5 * distance_squared).max(f64::MIN)
}
