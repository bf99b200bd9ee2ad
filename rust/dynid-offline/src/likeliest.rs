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

use std::ops::Range;

use dynid_core::lanes::{self, Kernel, Lanes, MOST_LANES};

use crate::error::OfflineError;
use crate::triangle::{product, subtract, Rows};

/// Steps of the fixed point, and its relative change at which they stop.
const MOST_STEPS: usize = 12;
const CHANGE: f64 = 1e-2;
/// At most this part of a joint's independent samples counts as used up by the unknowns.
const MOST_TAKEN: f64 = 0.9;
/// Relative precision that every direction has beside its own, so that rounding cannot make H indefinite.
const ROUNDING: f64 = 1e-12;

/// Columns and target of one joint.
#[derive(Clone, Copy, Debug)]
pub struct JointGram<'a> {
    /// `[M | y]' [M | y]`, (k + 1) × (k + 1), row-major.
    pub gram: &'a [f64],
    /// Where its k columns stand among all unknowns; each at most once.
    pub places: &'a [usize],
}

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

/// Rows of a symmetric or a triangular matrix left of the diagonal, zeros from there on, in whole [`Rows`].
#[derive(Clone)]
struct Lower {
    numbers: Vec<Rows>,
    diagonal: Vec<f64>,
    stride: usize,
}

impl Lower {
    fn zeros(n: usize) -> Self {
        let stride = n.div_ceil(MOST_LANES);
        Self {
            numbers: vec![[0.0; MOST_LANES]; n * stride],
            diagonal: vec![0.0; n],
            stride,
        }
    }

    /// Row i, as far as it can be other than zero.
    #[inline(always)]
    fn row(&self, i: usize, columns: Range<usize>) -> &[Rows] {
        let first = i * self.stride;
        &self.numbers[first + columns.start / MOST_LANES..first + columns.end.div_ceil(MOST_LANES)]
    }

    #[inline(always)]
    fn at(&self, i: usize, k: usize) -> f64 {
        self.numbers[i * self.stride + k / MOST_LANES][k % MOST_LANES]
    }

    #[inline(always)]
    fn at_mut(&mut self, i: usize, k: usize) -> &mut f64 {
        &mut self.numbers[i * self.stride + k / MOST_LANES][k % MOST_LANES]
    }
}

/// One joint in the order of the factor.
struct Joint {
    /// Row, column, entry of the Gram matrix left of the diagonal.
    pairs: Vec<(u32, u32, f64)>,
    /// Entries on it, in the order of `places`.
    squares: Vec<f64>,
    places: Vec<usize>,
    /// `M' y`
    moment: Vec<f64>,
    /// `y' y`
    square: f64,
}

impl Joint {
    /// `order[u]`: where unknown u stands in the factor.
    fn new(joint: &JointGram<'_>, order: &[usize]) -> Self {
        let k = joint.places.len();
        let mut columns: Vec<usize> = (0..k).collect();
        columns.sort_by_key(|&c| order[joint.places[c]]);
        let place = |c: usize| order[joint.places[c]];
        let mut pairs = Vec::with_capacity(k * k / 2);
        for (a, &row) in columns.iter().enumerate() {
            for &column in &columns[..a] {
                let entry = joint.gram[row * (k + 1) + column];
                pairs.push((place(row) as u32, place(column) as u32, entry));
            }
        }
        Self {
            pairs,
            squares: columns.iter().map(|&c| joint.gram[c * (k + 2)]).collect(),
            places: columns.iter().map(|&c| place(c)).collect(),
            moment: columns
                .iter()
                .map(|&c| joint.gram[c * (k + 1) + k])
                .collect(),
            square: joint.gram[(k + 1) * (k + 1) - 1],
        }
    }

    /// `sum over a, b of G_ab X_ab` of a symmetric X.
    #[inline(always)]
    fn along(&self, x: impl Fn(usize, usize) -> f64) -> f64 {
        let twice = |&(a, b, entry): &(u32, u32, f64)| entry * x(a as usize, b as usize);
        let once = |(&at, entry): (&usize, &f64)| entry * x(at, at);
        let own: f64 = self.places.iter().zip(&self.squares).map(once).sum();
        2.0 * self.pairs.iter().map(twice).sum::<f64>() + own
    }

    /// `|y - M x|^2`
    #[inline(always)]
    fn power(&self, x: &[f64]) -> f64 {
        let mixed: f64 = self
            .places
            .iter()
            .zip(&self.moment)
            .map(|(&at, g)| g * x[at])
            .sum();
        (self.square - 2.0 * mixed + self.along(|a, b| x[a] * x[b])).max(0.0)
    }
}

/// All joints and the prior in the order of the factor.
struct System {
    joints: Vec<Joint>,
    prior: Lower,
    moment: Vec<f64>,
    /// Where every row of H begins.
    first: Vec<usize>,
    /// Which unknown stands at each place.
    unknown: Vec<usize>,
}

impl System {
    fn new(joints: &[JointGram<'_>], n: usize, prior: NormalPrior<'_>) -> Self {
        // Unknowns of one joint alone, joint by joint, then those that several see, or none.
        let mut seen_by = vec![None; n];
        let shared = joints.len();
        for (j, joint) in joints.iter().enumerate() {
            for &at in joint.places {
                seen_by[at] = Some(if seen_by[at].is_none() { j } else { shared });
            }
        }
        let mut unknown: Vec<usize> = (0..n).collect();
        unknown.sort_by_key(|&u| seen_by[u].unwrap_or(shared));
        let mut order = vec![0; n];
        for (place, &u) in unknown.iter().enumerate() {
            order[u] = place;
        }
        let held = prior.moment.len();
        let mut lower = Lower::zeros(n);
        let mut moment = vec![0.0; n];
        let mut first: Vec<usize> = (0..n).collect();
        for i in 0..n {
            let u = unknown[i];
            lower.diagonal[i] = 1.0;
            if u >= held {
                continue;
            }
            moment[i] = prior.moment[u];
            let row = &prior.precision[u * held..(u + 1) * held];
            if row[u] != 0.0 {
                lower.diagonal[i] = row[u];
            }
            for (k, &v) in unknown[..i].iter().enumerate() {
                if v < held && row[v] != 0.0 {
                    *lower.at_mut(i, k) = row[v];
                    first[i] = first[i].min(k);
                }
            }
        }
        let joints: Vec<Joint> = joints
            .iter()
            .map(|joint| Joint::new(joint, &order))
            .collect();
        for joint in &joints {
            for &at in &joint.places {
                first[at] = first[at].min(joint.places[0]);
            }
        }
        Self {
            joints,
            prior: lower,
            moment,
            first,
            unknown,
        }
    }

    /// H and its right-hand side.
    fn weighted(&self, weights: &[f64]) -> (Lower, Vec<f64>) {
        let (mut precision, mut moment) = (self.prior.clone(), self.moment.clone());
        for (joint, w) in self.joints.iter().zip(weights) {
            for &(a, b, entry) in &joint.pairs {
                *precision.at_mut(a as usize, b as usize) += w * entry;
            }
            for ((&at, square), g) in joint.places.iter().zip(&joint.squares).zip(&joint.moment) {
                precision.diagonal[at] += w * square;
                moment[at] += w * g;
            }
        }
        (precision, moment)
    }
}

/// `H = D^-1 (L L' - rounding) D^-1` with unit diagonal in the middle: so the factor loses no digits to units.
struct Factor {
    /// L; its diagonal holds the reciprocals.
    root: Lower,
    /// D.
    scale: Vec<f64>,
    log_det: f64,
}

impl Factor {
    #[inline(always)]
    fn new<L: Lanes>(precision: &Lower, first: &[usize]) -> Result<Self, OfflineError> {
        let n = first.len();
        let scale: Vec<f64> = precision
            .diagonal
            .iter()
            .map(|x| x.sqrt().recip())
            .collect();
        let mut root = Lower::zeros(n);
        let mut log_det = 0.0;
        let stride = root.stride;
        for i in 0..n {
            let (above, rest) = root.numbers.split_at_mut(i * stride);
            let row = &mut rest[..stride];
            for k in first[i]..i {
                let from = first[i].max(first[k]) / MOST_LANES;
                let until = k.div_ceil(MOST_LANES).max(from);
                let other = &above[k * stride + from..k * stride + until];
                let known = product::<L>(&row[from..until], other);
                let entry = precision.at(i, k) * scale[i] * scale[k];
                row[k / MOST_LANES][k % MOST_LANES] = (entry - known) * root.diagonal[k];
            }
            let own =
                &row[first[i] / MOST_LANES..i.div_ceil(MOST_LANES).max(first[i] / MOST_LANES)];
            let pivot = 1.0 + ROUNDING - product::<L>(own, own);
            if !(pivot > 0.0 && (pivot * scale[i]).is_finite()) {
                return Err(OfflineError::NonFinite {
                    what: "linear model of all joints",
                });
            }
            root.diagonal[i] = pivot.sqrt().recip();
            log_det += pivot.ln() + precision.diagonal[i].ln();
        }
        Ok(Self {
            root,
            scale,
            log_det,
        })
    }

    /// `H^-1 b`
    #[inline(always)]
    fn solve<L: Lanes>(&self, b: &[f64], first: &[usize]) -> Vec<f64> {
        let n = b.len();
        let mut x = vec![[0.0; MOST_LANES]; self.root.stride];
        for i in 0..n {
            let part = first[i] / MOST_LANES..i.div_ceil(MOST_LANES).max(first[i] / MOST_LANES);
            let known = product::<L>(self.root.row(i, first[i]..i.max(first[i])), &x[part]);
            x[i / MOST_LANES][i % MOST_LANES] =
                (b[i] * self.scale[i] - known) * self.root.diagonal[i];
        }
        for i in (0..n).rev() {
            let own = x[i / MOST_LANES][i % MOST_LANES] * self.root.diagonal[i];
            let part = first[i] / MOST_LANES..i.div_ceil(MOST_LANES).max(first[i] / MOST_LANES);
            subtract::<L>(&mut x[part], own, self.root.row(i, first[i]..i));
            x[i / MOST_LANES][i % MOST_LANES] = own;
        }
        x.as_flattened()
            .iter()
            .zip(&self.scale)
            .map(|(x, s)| x * s)
            .collect()
    }

    /// `L^-1`, the diagonal in the rows, and where every row begins.
    #[inline(always)]
    fn inverse<L: Lanes>(&self, first: &[usize]) -> (Lower, Vec<usize>) {
        let n = first.len();
        let mut inverse = Lower::zeros(n);
        let mut begins: Vec<usize> = (0..n).collect();
        let stride = inverse.stride;
        for i in 0..n {
            let (above, rest) = inverse.numbers.split_at_mut(i * stride);
            let row = &mut rest[..stride];
            for k in first[i]..i {
                let share = self.root.at(i, k);
                if share != 0.0 {
                    let part = begins[k] / MOST_LANES..k / MOST_LANES + 1;
                    let other = &above[k * stride + part.start..k * stride + part.end];
                    subtract::<L>(&mut row[part], share, other);
                    begins[i] = begins[i].min(begins[k]);
                }
            }
            row[i / MOST_LANES][i % MOST_LANES] = 1.0;
            let pivot = self.root.diagonal[i];
            for x in row[begins[i] / MOST_LANES..=i / MOST_LANES].as_flattened_mut() {
                *x *= pivot;
            }
        }
        (inverse, begins)
    }
}

/// `W' W` left of the diagonal and on it, where H is other than zero.
#[inline(always)]
fn squared<L: Lanes>(inverse: &Lower, begins: &[usize], first: &[usize]) -> Lower {
    let n = first.len();
    let mut square = Lower::zeros(n);
    let stride = square.stride;
    for i in 0..n {
        for a in begins[i]..=i {
            let share = inverse.at(i, a);
            if share == 0.0 {
                continue;
            }
            let part = begins[i].max(first[a]) / MOST_LANES..a / MOST_LANES + 1;
            if part.start < part.end {
                let other = &inverse.numbers[i * stride + part.start..i * stride + part.end];
                let to = &mut square.numbers[a * stride + part.start..a * stride + part.end];
                subtract::<L>(to, -share, other);
            }
        }
    }
    square
}

/// `H x`
#[inline(always)]
fn times<L: Lanes>(precision: &Lower, x: &[f64], first: &[usize]) -> Vec<f64> {
    let mut rows = vec![[0.0; MOST_LANES]; precision.stride];
    rows.as_flattened_mut()[..x.len()].copy_from_slice(x);
    let mut sum = vec![[0.0; MOST_LANES]; precision.stride];
    for (i, own) in x.iter().enumerate() {
        let part = first[i] / MOST_LANES..i.div_ceil(MOST_LANES).max(first[i] / MOST_LANES);
        let row = precision.row(i, first[i]..i);
        let along = product::<L>(row, &rows[part.clone()]);
        subtract::<L>(&mut sum[part], -own, row);
        sum[i / MOST_LANES][i % MOST_LANES] += along + precision.diagonal[i] * own;
    }
    sum.as_flattened()[..x.len()].to_vec()
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
                let covariance =
                    |a: usize, b: usize| square.at(a, b) * factor.scale[a] * factor.scale[b];
                let taken = weights[j] * joint.along(covariance);
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
