//! Gaussian mixture regression (Eqs. 31-39), in logs: one pass, no scratch, correct however far the query is.

use nalgebra::DMatrix;

use crate::error::CoreError;

/// Conditional mean and variance of one output given `d` inputs, under a mixture of `K` Gaussians of dimension `d + 1`
/// (inputs first, output last).
#[derive(Clone, Debug, PartialEq)]
pub struct GaussianMixtureRegression {
    n_inputs: usize,
    weights: Vec<f64>,
    means: Vec<f64>,
    covariances: Vec<f64>,
    components: Vec<Component>,
}

/// What evaluation needs of one component.
#[derive(Clone, Debug, PartialEq)]
struct Component {
    /// log(pi_k) - log|L_k| with Sigma_u,k = L_k L_kᵀ. The factor (2 pi)^(-d/2) is common and cancels in Eq. 37.
    log_weight: f64,
    input_mean: Vec<f64>,
    /// Rows of the inverse of L_k, d × d row-major, lower triangular.
    whitener: Vec<f64>,
    /// Sigma_fu Sigma_u^-1 L, so that Eq. 34 is output_mean + gain · (whitened input).
    gain: Vec<f64>,
    output_mean: f64,
    /// Eq. 35.
    variance: f64,
}

/// Answer to one query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Eq. 38.
    pub mean: f64,
    /// Law of total variance: `sum h (Sigma_k + m_k^2) - mean^2`. Eq. 39 as printed leaves out the spread of the means.
    pub variance: f64,
    /// Mahalanobis distance squared of the query to its nearest component.
    pub distance_squared: f64,
}

impl GaussianMixtureRegression {
    /// `weights`: K; `means`: K × (d+1), row-major; `covariances`: K × (d+1) × (d+1), row-major.
    ///
    /// # Errors
    /// [`CoreError`] if lengths disagree, a weight is not positive, a number is not finite, or a covariance is not
    /// positive definite in its inputs.
    pub fn new(
        n_inputs: usize,
        weights: Vec<f64>,
        means: Vec<f64>,
        covariances: Vec<f64>,
    ) -> Result<Self, CoreError> {
        let (d, width) = (n_inputs, n_inputs + 1);
        if d == 0 {
            return Err(CoreError::Range { what: "n_inputs" });
        }
        if weights.is_empty() {
            return Err(CoreError::Range { what: "weights" });
        }
        let k = weights.len();
        crate::dynamics::check_length("means", &means, k * width)?;
        crate::dynamics::check_length("covariances", &covariances, k * width * width)?;
        let mut components = Vec::with_capacity(k);
        for (index, ((weight, mean), covariance)) in weights
            .iter()
            .zip(means.chunks_exact(width))
            .zip(covariances.chunks_exact(width * width))
            .enumerate()
        {
            let component = Component::new(d, *weight, mean, covariance)
                .ok_or(CoreError::Mixture { component: index })?;
            components.push(component);
        }
        Ok(Self {
            n_inputs,
            weights,
            means,
            covariances,
            components,
        })
    }

    /// Inputs `d`.
    #[must_use]
    pub fn n_inputs(&self) -> usize {
        self.n_inputs
    }

    /// Weights, K values.
    #[must_use]
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Means, K × (d+1).
    #[must_use]
    pub fn means(&self) -> &[f64] {
        &self.means
    }

    /// Covariances, K × (d+1) × (d+1).
    #[must_use]
    pub fn covariances(&self) -> &[f64] {
        &self.covariances
    }

    /// Mean square of the output over the whole mixture: what is expected where nothing is known of the inputs.
    #[must_use]
    pub fn second_moment(&self) -> f64 {
        let (d, width) = (self.n_inputs, self.n_inputs + 1);
        let total: f64 = self.weights.iter().sum();
        let moments = self.means.chunks_exact(width).zip(
            self.covariances
                .chunks_exact(width * width)
                .map(|covariance| covariance[width * width - 1]),
        );
        self.weights
            .iter()
            .zip(moments)
            .map(|(weight, (mean, variance))| weight / total * (mean[d] * mean[d] + variance))
            .sum()
    }

    /// Conditional mean (Eq. 38) and variance (instead of Eq. 39) at `u` (d values; only the first d are read): the moments
    /// of the density of Eq. 36.
    ///
    /// Responsibilities h_k (Eq. 37) are ratios of `exp(log_wp_k - max)`, with the maximum kept while running over the
    /// components, so they sum to one at any distance from the data.
    #[must_use]
    pub fn predict(&self, u: &[f64]) -> Prediction {
        let mut best = f64::NEG_INFINITY;
        // Weighted Welford update: mean and spread about it, so that a large mean does not cancel a small variance.
        let (mut total, mut mean, mut spread) = (0.0, 0.0, 0.0);
        let mut nearest = f64::INFINITY;
        for component in &self.components {
            let (distance_squared, component_mean) = component.condition(u);
            nearest = nearest.min(distance_squared);
            let log_wp = component.log_weight_at(distance_squared);
            if log_wp > best {
                let shrink = (best - log_wp).exp();
                total *= shrink;
                spread *= shrink;
                best = log_wp;
            }
            let h = (log_wp - best).exp();
            total += h;
            let step = component_mean - mean;
            mean += step * (h / total);
            spread += h * (component.variance + step * (component_mean - mean));
        }
        Prediction {
            mean,
            variance: (spread / total).max(0.0),
            distance_squared: nearest,
        }
    }

    /// Responsibilities h_k at `u` (Eq. 37), written to `h` (K values).
    ///
    /// # Errors
    /// [`CoreError::Length`] if `u` or `h` has the wrong length.
    pub fn responsibilities_into(&self, u: &[f64], h: &mut [f64]) -> Result<(), CoreError> {
        crate::dynamics::check_length("u", u, self.n_inputs)?;
        crate::dynamics::check_length("h", h, self.weights.len())?;
        let mut best = f64::NEG_INFINITY;
        for (h, component) in h.iter_mut().zip(&self.components) {
            *h = component.log_weight_at(component.condition(u).0);
            best = best.max(*h);
        }
        let mut total = 0.0;
        for h in h.iter_mut() {
            *h = (*h - best).exp();
            total += *h;
        }
        h.iter_mut().for_each(|h| *h /= total);
        Ok(())
    }
}

impl Component {
    /// `None` if the weight is not positive, a number is not finite or a covariance is not positive definite.
    fn new(d: usize, weight: f64, mean: &[f64], covariance: &[f64]) -> Option<Self> {
        let finite = mean.iter().chain(covariance).all(|x| x.is_finite());
        if !(finite && weight.is_finite() && weight > 0.0) {
            return None;
        }
        let full = DMatrix::from_row_slice(d + 1, d + 1, covariance);
        let factor = full.view((0, 0), (d, d)).into_owned().cholesky()?;
        let lower = factor.l();
        let whitener = lower
            .solve_lower_triangular(&DMatrix::identity(d, d))?
            .transpose(); // column-major storage of the transpose is the row-major storage of the inverse
        let gain: Vec<f64> = (0..d)
            .map(|r| {
                (0..=r)
                    .map(|c| whitener[(c, r)] * full[(d, c)])
                    .sum::<f64>()
            })
            .collect();
        let log_det: f64 = lower.diagonal().iter().map(|x| x.ln()).sum();
        let variance = full[(d, d)] - gain.iter().map(|g| g * g).sum::<f64>();
        let whitener: Vec<f64> = whitener.iter().copied().collect();
        let numbers_good = whitener.iter().chain(&gain).all(|x| x.is_finite());
        (numbers_good && variance.is_finite()).then(|| Self {
            log_weight: weight.ln() - log_det,
            input_mean: mean[..d].to_vec(),
            whitener,
            gain,
            output_mean: mean[d],
            variance: variance.max(0.0),
        })
    }

    /// log(pi_k N(u)) up to the common factor, which Eq. 32 prints for two dimensions; finite even where the square
    /// overflows.
    fn log_weight_at(&self, distance_squared: f64) -> f64 {
        (self.log_weight - 0.5 * distance_squared).max(f64::MIN)
    }

    /// Mahalanobis distance squared of the input and the component's conditional mean: the normal density of Eq. 33 has
    /// that mean (Eq. 34) and the component's variance (Eq. 35).
    fn condition(&self, u: &[f64]) -> (f64, f64) {
        let d = self.input_mean.len();
        let (mut distance_squared, mut mean) = (0.0, self.output_mean);
        for (r, (row, gain)) in self.whitener.chunks_exact(d).zip(&self.gain).enumerate() {
            let z: f64 = row[..=r]
                .iter()
                .zip(u.iter().zip(&self.input_mean))
                .map(|(w, (u, m))| w * (u - m))
                .sum();
            distance_squared += z * z;
            mean += gain * z;
        }
        (distance_squared, mean)
    }
}
