//! Gaussian mixture regression (Eqs. 31-39), in logs: no scratch, correct however far the query is.

use nalgebra::DMatrix;

use crate::error::CoreError;
use crate::lanes::{self, Kernel, Lanes, MOST_LANES};
use crate::mixture_rows::{root_unit, MixtureRows, Shared, MOST_INPUTS};
use crate::powers::power_falling;

/// Conditional mean and variance of one output given `d` inputs, under a mixture of `K` Gaussians of dimension `d + 1`
/// (inputs first, output last).
#[derive(Clone, Debug, PartialEq)]
pub struct GaussianMixtureRegression {
    n_inputs: usize,
    weights: Vec<f64>,
    means: Vec<f64>,
    covariances: Vec<f64>,
    components: Vec<Component>,
    rows: MixtureRows,
}

/// What evaluation needs of one component.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Component {
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
    /// [`CoreError`] if there is no input or more than 32, lengths disagree, a weight is not positive, a number is not finite, or a covariance is not
    /// positive definite in its inputs.
    pub fn new(
        n_inputs: usize,
        weights: Vec<f64>,
        means: Vec<f64>,
        covariances: Vec<f64>,
    ) -> Result<Self, CoreError> {
        let (d, width) = (n_inputs, n_inputs + 1);
        if d == 0 || d > MOST_INPUTS {
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
            rows: MixtureRows::new(d, &components),
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

    /// Its components, for rows of several joints.
    pub(crate) fn components(&self) -> &[Component] {
        &self.components
    }

    /// Conditional mean (Eq. 38) and variance (instead of Eq. 39) at `u` (d values; only the first d are read): the moments
    /// of the density of Eq. 36.
    #[must_use]
    pub fn predict(&self, u: &[f64]) -> Prediction {
        let mut answer = [0.0; 3];
        let [mean, variance, distance_squared] = &mut answer;
        lanes::run(Queries {
            rows: &self.rows,
            u: &u[..self.n_inputs],
            out: [mean, variance, distance_squared].map(core::slice::from_mut),
        });
        let [mean, variance, distance_squared] = answer;
        Prediction {
            mean,
            variance,
            distance_squared,
        }
    }

    /// [`Self::predict`] at many points: `u` holds n × d values, row-major; means, variances and squared distances go to
    /// `mean`, `variance` and `distance_squared` (n each). To the same bits.
    ///
    /// # Errors
    /// [`CoreError::Length`] if lengths disagree.
    pub fn predict_into(
        &self,
        u: &[f64],
        mean: &mut [f64],
        variance: &mut [f64],
        distance_squared: &mut [f64],
    ) -> Result<(), CoreError> {
        let n = mean.len();
        crate::dynamics::check_length("u", u, n * self.n_inputs)?;
        crate::dynamics::check_length("variance", variance, n)?;
        crate::dynamics::check_length("distance_squared", distance_squared, n)?;
        lanes::run(Queries {
            rows: &self.rows,
            u,
            out: [mean, variance, distance_squared],
        });
        Ok(())
    }

    /// Responsibilities h_k at `u` (Eq. 37), written to `h` (K values).
    ///
    /// # Errors
    /// [`CoreError::Length`] if `u` or `h` has the wrong length.
    pub fn responsibilities_into(&self, u: &[f64], h: &mut [f64]) -> Result<(), CoreError> {
        crate::dynamics::check_length("u", u, self.n_inputs)?;
        crate::dynamics::check_length("h", h, self.weights.len())?;
        lanes::run_narrow(Responsibilities {
            rows: &self.rows,
            u,
            h,
        });
        let total: f64 = h.iter().sum();
        h.iter_mut().for_each(|h| *h /= total);
        Ok(())
    }
}

/// Queries of one mixture, in lanes: mean, variance and squared distance.
struct Queries<'a> {
    rows: &'a MixtureRows,
    u: &'a [f64],
    out: [&'a mut [f64]; 3],
}

impl Kernel for Queries<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
        if self.out[0].len() == 1 {
            answer::<S>(self);
        } else {
            answer::<L>(self);
        }
    }
}

/// Rows of `L` queries; where they end before a row does, the last one fills up.
#[inline(always)]
fn answer<L: Lanes>(queries: Queries<'_>) {
    let (d, [mean, variance, distance_squared]) = (queries.rows.n_inputs(), queries.out);
    let n = mean.len();
    let mut start = 0;
    while start < n {
        let row = if d <= L::LEN {
            let mut u = [L::splat(0.0); MOST_LANES];
            for (lane, row) in u[..L::LEN].iter_mut().enumerate() {
                let at = (start + lane).min(n - 1) * d;
                *row = L::load_some(&queries.u[at..at + d]);
            }
            queries.rows.predict(&L::transpose(u)[..d], Shared)
        } else {
            let mut u = [L::splat(0.0); MOST_INPUTS];
            for (i, row) in u[..d].iter_mut().enumerate() {
                let mut numbers = [0.0; MOST_LANES];
                for (lane, x) in numbers[..L::LEN].iter_mut().enumerate() {
                    *x = queries.u[(start + lane).min(n - 1) * d + i];
                }
                *row = L::load(&numbers);
            }
            queries.rows.predict(&u[..d], Shared)
        };
        for (row, out) in [
            (row.mean, &mut mean[start..]),
            (row.variance, &mut variance[start..]),
            (row.distance_squared, &mut distance_squared[start..]),
        ] {
            // Whole where there is room: parts of a row take some processors far longer.
            if out.len() >= L::LEN {
                row.store(out);
            } else {
                row.store_some(out);
            }
        }
        start += L::LEN;
    }
}

/// Density over the greatest one, of every component.
struct Responsibilities<'a> {
    rows: &'a MixtureRows,
    u: &'a [f64],
    h: &'a mut [f64],
}

impl Kernel for Responsibilities<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
        let mut u = [S::splat(0.0); MOST_INPUTS];
        for (to, u) in u.iter_mut().zip(self.u) {
            *to = S::splat(*u);
        }
        let mut best = S::splat(f64::NEG_INFINITY);
        for (c, h) in self.h.iter_mut().enumerate() {
            let [log_density, _, _] = self.rows.condition(c, &u[..self.u.len()], Shared);
            best = best.at_least(log_density);
            [*h] = log_density.raw();
        }
        for h in self.h {
            [*h] = power_falling(S::splat(*h) - best).raw();
        }
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

    /// As a row of numbers with room for `width` inputs, at least `d`; see [`MixtureRows`].
    pub(crate) fn numbers(&self, d: usize, width: usize) -> Vec<f64> {
        let root = root_unit();
        let log_weight = self.log_weight * core::f64::consts::LOG2_E;
        let mut numbers = vec![log_weight, self.output_mean, self.variance];
        numbers.extend((0..width).map(|i| self.input_mean.get(i).copied().unwrap_or(0.0)));
        for r in 0..width {
            for i in 0..=r {
                numbers.push(if r < d {
                    self.whitener[r * d + i] / root
                } else {
                    0.0
                });
            }
            numbers.push(self.gain.get(r).map_or(0.0, |gain| gain * root));
        }
        numbers
    }
}
