//! Most probable unknowns of all joints under a normal prior, and their noise at its fixed point, from Gram matrices.
//!
//! ```text
//! H = sum_j w_j^2 G_j + P     x = H^-1 (sum_j w_j^2 g_j + p)     w_j^2 = k_j / (n sigma_j^2)
//! sigma_j^2 = k_j |r_j|^2 / (n (k_j - gamma_j))     gamma_j = w_j^2 tr(H^-1 G_j)
//! ```
//!
//! `k_j` of a joint's n rows are worth an independent sample; `gamma_j` is how many unknowns they determine (MacKay 1992,
//! Neural Computation 4). Unknowns that one joint alone sees come first: their rows of the factor end where that joint
//! begins, and what is zero is not touched.

mod factor;
mod system;

use dynid_core::lanes::{self, Kernel, Lanes};

use crate::error::OfflineError;
use factor::{squared, times, Factor};
use system::System;

/// Steps of the fixed point, and its relative change at which they stop.
const MOST_STEPS: usize = 12;
const CHANGE: f64 = 1e-2;
/// At most this part of a joint's independent samples counts as used up by the unknowns.
const MOST_TAKEN: f64 = 0.9;

/// Columns and target of one joint.
#[derive(Clone, Copy, Debug)]
pub struct JointGram<'a> {
    /// `[M | y]' [M | y]`, (k + 1) × (k + 1), row-major.
    pub gram: &'a [f64],
    /// Where its k columns stand among all unknowns; each at most once.
    pub places: &'a [usize],
}

/// Most unknowns: H has half a gigabyte, and no robot so many.
const MOST_UNKNOWNS: usize = 1 << 13;

/// What is known of the first unknowns beforehand; those behind them are standard normal.
#[derive(Clone, Copy, Debug)]
pub struct NormalPrior<'a> {
    /// Precision P, square, row-major. Unknowns without any stay at zero unless the data tell them.
    pub precision: &'a [f64],
    /// `P mean`.
    pub moment: &'a [f64],
}

/// What the noise of every joint depends on; one number per joint each.
#[derive(Clone, Copy, Debug)]
pub struct Noise<'a> {
    /// Standard deviations that the search begins with, or that are known.
    pub std: &'a [f64],
    /// Independent samples that the rows are worth.
    pub n_effective: &'a [f64],
    /// No noise is smaller.
    pub least: &'a [f64],
    /// Rows of every joint.
    pub n_rows: f64,
    /// The noise is what `std` says.
    pub is_known: bool,
}

/// The solution.
#[derive(Clone, Debug, PartialEq)]
pub struct Likeliest {
    /// Unknowns.
    pub x: Vec<f64>,
    /// Standard deviation of every joint's noise.
    pub noise: Vec<f64>,
    /// Sum of squares that every joint's rows leave.
    pub power: Vec<f64>,
    /// `x' P x - 2 p' x`, what the prior says against them but for a constant.
    pub distance: f64,
    /// W with `W' W = H^-1`, n × n, row-major.
    pub whitener: Vec<f64>,
    /// `ln det H`
    pub log_det: f64,
}

/// Most probable of `n` unknowns.
///
/// # Errors
/// [`OfflineError`] if sizes disagree, or numbers are not finite or so far apart that H cannot be factored.
pub fn likeliest(
    joints: &[JointGram<'_>],
    n: usize,
    prior: NormalPrior<'_>,
    noise: Noise<'_>,
) -> Result<Likeliest, OfflineError> {
    check(joints, n, prior, noise)?;
    lanes::run(Search {
        system: System::new(joints, n, prior),
        noise,
    })
}

fn check(
    joints: &[JointGram<'_>],
    n: usize,
    prior: NormalPrior<'_>,
    noise: Noise<'_>,
) -> Result<(), OfflineError> {
    let fits = |joint: &JointGram<'_>| {
        joint.gram.len() == (joint.places.len() + 1).pow(2) && joint.places.iter().all(|&at| at < n)
    };
    let held = prior.moment.len();
    let what = if !joints.iter().all(fits) {
        "Gram matrix of a joint"
    } else if n > MOST_UNKNOWNS {
        "unknowns"
    } else if held > n || prior.precision.len() != held * held {
        "precision of the prior"
    } else if [noise.std, noise.n_effective, noise.least]
        .iter()
        .any(|part| part.len() != joints.len())
    {
        "noise"
    } else {
        return Ok(());
    };
    Err(OfflineError::Shape { what })
}

struct Search<'a> {
    system: System,
    noise: Noise<'a>,
}

impl Kernel for Search<'_> {
    type Output = Result<Likeliest, OfflineError>;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Self::Output {
        let Self { system, noise } = &self;
        let mut std = noise.std.to_vec();
        let share: Vec<f64> = noise.n_effective.iter().map(|k| k / noise.n_rows).collect();
        let steps = if noise.is_known { 0 } else { MOST_STEPS };
        for _ in 0..steps {
            let (weights, factor, x) = self.solved::<L>(&std, &share)?;
            let (inverse, begins) = factor.inverse::<L>(&system.first);
            let square = squared::<L>(&inverse, &begins, &system.first);
            let mut change: f64 = 0.0;
            for (j, joint) in system.joints.iter().enumerate() {
                let taken = weights[j] * joint.trace(&square, &factor.scale);
                let all = noise.n_effective[j];
                let left = (all - taken).max((1.0 - MOST_TAKEN) * all);
                let update = (share[j] * joint.power(&x) / left)
                    .sqrt()
                    .max(noise.least[j]);
                change = change.max((update / std[j] - 1.0).abs());
                std[j] = update;
            }
            if change < CHANGE {
                break;
            }
        }
        // Hypotheses are scored beside the very solution of these weights.
        let (_, factor, x) = self.solved::<L>(&std, &share)?;
        let (inverse, begins) = factor.inverse::<L>(&system.first);
        let n = x.len();
        let held = times::<L>(&system.prior, &x, &system.first);
        let against = |((x, held), p): ((&f64, &f64), &f64)| x * (held - 2.0 * p);
        let distance = x.iter().zip(&held).zip(&system.moment).map(against).sum();
        let mut whitener = vec![0.0; n * n];
        for (i, row) in whitener.chunks_exact_mut(n.max(1)).enumerate() {
            for k in begins[i]..=i {
                row[system.unknown[k]] = inverse.at(i, k) * factor.scale[k];
            }
        }
        let mut ordered = vec![0.0; n];
        for (&u, x) in system.unknown.iter().zip(&x) {
            ordered[u] = *x;
        }
        Ok(Likeliest {
            power: system.joints.iter().map(|joint| joint.power(&x)).collect(),
            x: ordered,
            distance,
            noise: std,
            whitener,
            log_det: factor.log_det,
        })
    }
}

impl Search<'_> {
    /// Squared weights, factor and unknowns, in the order of the factor.
    #[inline(always)]
    fn solved<L: Lanes>(
        &self,
        std: &[f64],
        share: &[f64],
    ) -> Result<(Vec<f64>, Factor, Vec<f64>), OfflineError> {
        let weights: Vec<f64> = share.iter().zip(std).map(|(k, s)| k / (s * s)).collect();
        let (precision, moment) = self.system.weighted(&weights);
        let first = &self.system.first;
        let factor = Factor::new::<L>(&precision, first)?;
        let mut x = factor.solve::<L>(&moment, first);
        // Once more on what is left: H has the square of the columns' condition.
        let mut left = times::<L>(&precision, &x, first);
        for (left, moment) in left.iter_mut().zip(&moment) {
            *left = moment - *left;
        }
        for (x, more) in x.iter_mut().zip(factor.solve::<L>(&left, first)) {
            *x += more;
        }
        Ok((weights, factor, x))
    }
}
