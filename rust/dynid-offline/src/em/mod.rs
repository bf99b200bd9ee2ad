//! A Gaussian mixture by expectation and maximisation, each iteration one pass over the data.
//!
//! The steps are scikit-learn's `GaussianMixture` with full covariances, from the same start with the same rule to stop, so
//! that the two agree to rounding; scikit-learn is the reference and makes the start. What differs is that
//! responsibilities never leave the cache: a block of samples is weighed and summed up before the next one is read.
//! Sums are merged in a fixed order, so that the result is the same to the last bit for any number of threads.

mod pass;

use dynid_core::CoreError;
use nalgebra::{DMatrix, SMatrix};

use crate::error::OfflineError;
use pass::{Density, Moments};

/// Most dimensions of a mixture: inputs and output of a residual.
pub const MOST_DIMENSIONS: usize = 8;

/// scikit-learn adds this to the samples of every component, so that an empty one divides by something.
const ALMOST_NOTHING: f64 = 10.0 * f64::EPSILON;

/// Weights, means and covariances.
#[derive(Clone, Debug, PartialEq)]
pub struct Mixture {
    /// K values, summing to one.
    pub weights: Vec<f64>,
    /// K × D, row-major.
    pub means: Vec<f64>,
    /// K × D × D, row-major.
    pub covariances: Vec<f64>,
}

/// When to stop, and what keeps covariances from vanishing.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Added to the diagonal of every covariance.
    pub reg_covar: f64,
    /// Change of the mean log-likelihood below which it has converged.
    pub tol: f64,
    /// Most iterations.
    pub max_iter: usize,
}

/// What came out.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The mixture after the last maximisation.
    pub mixture: Mixture,
    /// Mean log-likelihood per sample before the maximisation of each iteration.
    pub lower_bounds: Vec<f64>,
    /// True if the last change was below the tolerance.
    pub converged: bool,
    /// Mean log-likelihood per sample of [`Self::mixture`].
    pub log_likelihood: f64,
}

/// Fits a mixture to `x` (n × D, row-major, finite), from `start` on.
///
/// # Errors
/// [`OfflineError`] if lengths disagree, there are more than [`MOST_DIMENSIONS`] dimensions, a covariance is not positive
/// definite (a component has collapsed), or samples are so far away that their log-likelihood is not finite.
pub fn fit_mixture(
    x: &[f64],
    n_dimensions: usize,
    start: &Mixture,
    settings: Settings,
) -> Result<Fitted, OfflineError> {
    match n_dimensions {
        1 => fit::<1>(x, start, settings),
        2 => fit::<2>(x, start, settings),
        3 => fit::<3>(x, start, settings),
        4 => fit::<4>(x, start, settings),
        5 => fit::<5>(x, start, settings),
        6 => fit::<6>(x, start, settings),
        7 => fit::<7>(x, start, settings),
        8 => fit::<8>(x, start, settings),
        _ => Err(CoreError::Range {
            what: "number of dimensions of the mixture",
        }
        .into()),
    }
}

fn fit<const D: usize>(
    x: &[f64],
    start: &Mixture,
    settings: Settings,
) -> Result<Fitted, OfflineError> {
    let k = start.weights.len();
    let n = x.len() / D;
    for (what, actual, expected) in [
        ("x", x.len(), n.max(1) * D),
        ("means", start.means.len(), k.max(1) * D),
        ("covariances", start.covariances.len(), k * D * D),
    ] {
        if actual != expected {
            return Err(CoreError::Length {
                what,
                expected,
                actual,
            }
            .into());
        }
    }
    let mut mixture = start.clone();
    let mut lower_bounds = Vec::<f64>::new();
    let mut converged = false;
    while lower_bounds.len() < settings.max_iter && !converged {
        let densities = densities::<D>(&mixture)?;
        let (log_likelihood, moments) = pass::over(x, &densities);
        check_finite(log_likelihood)?;
        mixture = maximise(&densities, &moments, settings.reg_covar);
        let lower_bound = log_likelihood / n as f64;
        let before = lower_bounds.last().copied();
        let before = before.unwrap_or(f64::NEG_INFINITY);
        converged = (lower_bound - before).abs() < settings.tol;
        lower_bounds.push(lower_bound);
    }
    let log_likelihood = pass::log_likelihood(x, &densities::<D>(&mixture)?);
    check_finite(log_likelihood)?;
    Ok(Fitted {
        mixture,
        lower_bounds,
        converged,
        log_likelihood: log_likelihood / n as f64,
    })
}

/// Samples so far away that no component is left of them, or a start that is no mixture.
fn check_finite(log_likelihood: f64) -> Result<(), OfflineError> {
    let what = "the log-likelihood of the mixture";
    let finite = log_likelihood.is_finite();
    finite.then_some(()).ok_or(OfflineError::NonFinite { what })
}

/// What the expectation needs of every component.
fn densities<const D: usize>(mixture: &Mixture) -> Result<Vec<Density<D>>, OfflineError> {
    let constant = -0.5 * D as f64 * (2.0 * std::f64::consts::PI).ln();
    let root = (2.0 * std::f64::consts::LN_2).sqrt();
    let identity = SMatrix::<f64, D, D>::identity();
    let density = |component: usize| {
        let collapsed = CoreError::Mixture { component };
        let mean = &mixture.means[component * D..][..D];
        let covariance = &mixture.covariances[component * D * D..][..D * D];
        let covariance = DMatrix::from_row_slice(D, D, covariance);
        let lower = covariance.cholesky().ok_or(collapsed)?.l();
        let inverse = lower.solve_lower_triangular(&identity).ok_or(collapsed)?;
        let log_det: f64 = lower.diagonal().iter().map(|x| x.ln()).sum();
        Ok(Density {
            log_weight: (mixture.weights[component].ln() - log_det + constant)
                * std::f64::consts::LOG2_E,
            mean: std::array::from_fn(|d| mean[d]),
            whitener: std::array::from_fn(|r| std::array::from_fn(|c| inverse[(r, c)] / root)),
        })
    };
    (0..mixture.weights.len()).map(density).collect()
}

/// Weights, means and covariances of the responsibilities' moments, which are about the means of before.
fn maximise<const D: usize>(
    densities: &[Density<D>],
    moments: &[Moments<D>],
    reg_covar: f64,
) -> Mixture {
    let total: f64 = moments.iter().map(|m| m.count + ALMOST_NOTHING).sum();
    let mut mixture = Mixture {
        weights: Vec::with_capacity(moments.len()),
        means: Vec::with_capacity(D * moments.len()),
        covariances: Vec::with_capacity(D * D * moments.len()),
    };
    for (density, m) in densities.iter().zip(moments) {
        let count = m.count + ALMOST_NOTHING;
        mixture.weights.push(count / total);
        let shift: [f64; D] =
            std::array::from_fn(|d| (m.first[d] - ALMOST_NOTHING * density.mean[d]) / count);
        mixture
            .means
            .extend((0..D).map(|d| density.mean[d] + shift[d]));
        for r in 0..D {
            for c in 0..D {
                let (r, c) = (r.max(c), r.min(c));
                let about_the_new = m.second[r][c] - shift[r] * m.first[c] - shift[c] * m.first[r]
                    + m.count * shift[r] * shift[c];
                let ridge = if r == c { reg_covar } else { 0.0 };
                mixture.covariances.push(about_the_new / count + ridge);
            }
        }
    }
    mixture
}
