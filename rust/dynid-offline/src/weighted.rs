//! Weighted least squares on the joints' triangular factors: base parameters, effects, noise and standard deviations,
//! without the data.
//!
//! An effect's columns on joint j stand in that joint's rows alone, and first, so its factor splits:
//!
//! ```text
//! R_j = [E_j  X_j  y_j]      effects of joint j follow from the base parameters by back substitution
//!       [ 0   S_j  z_j]      rows on the base parameters alone: stacked over the joints, each over its noise
//! ```

use dynid_core::link_params::N_LINK_PARAMS;

use crate::error::OfflineError;
use crate::triangle::factor_once;

/// Parameters with their standard deviations.
#[derive(Clone, Debug, PartialEq)]
pub struct WeightedFit {
    /// Base parameters, in the order of the pivots.
    pub base: Vec<f64>,
    /// Their standard deviations.
    pub base_std: Vec<f64>,
    /// Coefficients of the effects, joint by joint.
    pub effects: Vec<f64>,
    /// Their standard deviations.
    pub effects_std: Vec<f64>,
    /// Standard deviation of what is left, per joint: the reciprocal root of the weights.
    pub noise_std: Vec<f64>,
}

/// Diagonal entries below this part of the largest column count as zero.
const DEPENDENT: f64 = 1e-13;

/// Least squares over all joints, `n_reweightings` times weighted by the joints' own noise.
///
/// `factors`: per joint, width × width, columns `[effects | base columns of links j and beyond | torque]` as
/// [`crate::fold()`] gives them; `pivots`: base columns, ascending; `n_rows`: rows behind each factor.
///
/// # Errors
/// [`OfflineError`] if sizes disagree, there are no more rows than parameters, a number is not finite or the columns are
/// not independent in these data.
pub fn weighted_fit(
    factors: &[&[f64]],
    pivots: &[usize],
    n_rows: usize,
    n_reweightings: usize,
) -> Result<WeightedFit, OfflineError> {
    let joints = split(factors, pivots)?;
    let (n, n_base, n_effects) = (joints.len(), pivots.len(), joints[0].n_effects);
    let n_parameters = n_base + n * n_effects;
    if n_rows * n <= n_parameters {
        return Err(OfflineError::TooFewSamples {
            actual: n_rows,
            needed: n_parameters / n + 1,
        });
    }
    // Every joint gives up its share of the degrees of freedom.
    let freedom = n_rows as f64 - n_parameters as f64 / n as f64;
    let mut noise_std = vec![1.0; n];
    let (mut base, mut r) = solve_base(&joints, n_base, &noise_std)?;
    for round in 0..=n_reweightings {
        for (noise, joint) in noise_std.iter_mut().zip(&joints) {
            *noise = (joint.rest(&base) / freedom).sqrt();
        }
        if round < n_reweightings {
            // A joint that fits exactly would outweigh all others without bound.
            let floor = 1e-12 * noise_std.iter().fold(f64::MIN_POSITIVE, |a, b| a.max(*b));
            let weights: Vec<f64> = noise_std.iter().map(|noise| noise.max(floor)).collect();
            (base, r) = solve_base(&joints, n_base, &weights)?;
        }
    }
    // Without weights the covariance is that of equal noise on all joints.
    let common = if n_reweightings > 0 {
        1.0
    } else {
        (noise_std.iter().map(|s| s * s).sum::<f64>() / n as f64).sqrt()
    };
    // Rows of the inverse factor: covariance = inverse inverse'.
    let inverse = invert(&r, n_base + 1, n_base);
    let base_std = inverse
        .chunks_exact(n_base.max(1))
        .map(|row| common * norm(row))
        .collect();
    let (mut effects, mut effects_std) = (Vec::new(), Vec::new());
    for (joint, noise) in joints.iter().zip(&noise_std) {
        let own = if n_reweightings > 0 { *noise } else { common };
        joint.effects(&base, &inverse, own, common, &mut effects, &mut effects_std)?;
    }
    let fit = WeightedFit {
        base,
        base_std,
        effects,
        effects_std,
        noise_std,
    };
    Ok(fit)
}

/// A joint's factor, and where its base columns stand among all.
struct JointFactor<'a> {
    r: &'a [f64],
    width: usize,
    n_effects: usize,
    first: usize,
}

fn split<'a>(
    factors: &[&'a [f64]],
    pivots: &[usize],
) -> Result<Vec<JointFactor<'a>>, OfflineError> {
    let shape = OfflineError::Shape { what: "factor" };
    if factors.is_empty() || factors.iter().any(|r| !r.iter().all(|x| x.is_finite())) {
        return Err(OfflineError::NonFinite { what: "factor" });
    }
    let mut joints = Vec::with_capacity(factors.len());
    for (j, r) in factors.iter().enumerate() {
        let width = r.len().isqrt();
        let first = pivots.partition_point(|&pivot| pivot < j * N_LINK_PARAMS);
        let others = pivots.len() - first + 1;
        if width * width != r.len() || width < others {
            return Err(shape);
        }
        joints.push(JointFactor {
            r,
            width,
            n_effects: width - others,
            first,
        });
    }
    let same = joints
        .iter()
        .all(|joint| joint.n_effects == joints[0].n_effects);
    if same {
        Ok(joints)
    } else {
        Err(shape)
    }
}

impl JointFactor<'_> {
    /// Row `i` from its diagonal on.
    fn row(&self, i: usize) -> &[f64] {
        &self.r[i * self.width + i..(i + 1) * self.width]
    }

    /// Sum of squares that the base parameters leave; effects take the rest of the rows to zero.
    fn rest(&self, base: &[f64]) -> f64 {
        let own = &base[self.first..];
        (self.n_effects..self.width)
            .map(|i| {
                let row = self.row(i);
                let (torque, columns) = (row[row.len() - 1], &row[..row.len() - 1]);
                let from = own.len() - columns.len();
                let fitted: f64 = columns.iter().zip(&own[from..]).map(|(a, b)| a * b).sum();
                (torque - fitted).powi(2)
            })
            .sum()
    }

    /// Coefficients of the joint's effects and their standard deviations, by back substitution. `inverse`: of the base
    /// parameters' factor, in units of `common`; `noise`: of this joint.
    fn effects(
        &self,
        base: &[f64],
        inverse: &[f64],
        noise: f64,
        common: f64,
        values: &mut Vec<f64>,
        stds: &mut Vec<f64>,
    ) -> Result<(), OfflineError> {
        let (e, n_base) = (self.n_effects, base.len());
        let size = (0..e).map(|i| self.row(i)[0]).fold(0.0, f64::max);
        let mut own = vec![0.0; e];
        // Row i: the effect's error as a combination of the joint's noise and of the base parameters' errors.
        let mut spread = vec![vec![0.0; e + n_base]; e];
        for i in (0..e).rev() {
            let row = self.row(i);
            if row[0] <= DEPENDENT * size {
                return Err(OfflineError::Dependent { what: "effects" });
            }
            let (among, others) = row[1..].split_at(e - 1 - i);
            let torque = others[others.len() - 1];
            let base_columns = &others[..others.len() - 1];
            let mut sum = torque;
            let mut error = vec![0.0; e + n_base];
            error[i] = noise;
            for (r, k) in among.iter().zip(i + 1..) {
                sum -= r * own[k];
                for (x, y) in error.iter_mut().zip(&spread[k]) {
                    *x -= r * y;
                }
            }
            for (r, k) in base_columns.iter().zip(self.first..) {
                sum -= r * base[k];
                let row = &inverse[k * n_base..(k + 1) * n_base];
                for (x, y) in error[e..].iter_mut().zip(row) {
                    *x -= r * common * y;
                }
            }
            own[i] = sum / row[0];
            for (to, x) in spread[i].iter_mut().zip(error) {
                *to = x / row[0];
            }
        }
        values.extend(own);
        stds.extend(spread.iter().map(|row| norm(row)));
        Ok(())
    }
}

/// Base parameters, and the factor of their rows, each joint's over its noise.
fn solve_base(
    joints: &[JointFactor<'_>],
    n_base: usize,
    noise: &[f64],
) -> Result<(Vec<f64>, Vec<f64>), OfflineError> {
    let width = n_base + 1;
    let mut rows = Vec::new();
    for (joint, noise) in joints.iter().zip(noise) {
        for i in joint.n_effects..joint.width - 1 {
            let own = joint.row(i);
            rows.extend(std::iter::repeat_n(0.0, width - own.len()));
            rows.extend(own.iter().map(|x| x / noise));
        }
    }
    let r = factor_once(&rows, width);
    let size = (0..n_base).map(|i| r[i * width + i]).fold(0.0, f64::max);
    let mut base = vec![0.0; n_base];
    for i in (0..n_base).rev() {
        let row = &r[i * width..(i + 1) * width];
        if row[i] <= DEPENDENT * size {
            return Err(OfflineError::Dependent {
                what: "base columns",
            });
        }
        let later: f64 = (i + 1..n_base).map(|k| row[k] * base[k]).sum();
        base[i] = (row[n_base] - later) / row[i];
    }
    Ok((base, r))
}

/// Inverse (n × n) of the upper triangle in the first n columns of `r` (rows `width` long).
#[inline(always)]
pub(crate) fn invert(r: &[f64], width: usize, n: usize) -> Vec<f64> {
    let mut inverse = vec![0.0; n * n];
    // Row by row from the last one: what is summed stands side by side.
    for i in (0..n).rev() {
        let (above, below) = inverse.split_at_mut((i + 1) * n);
        let (own, shares) = (&mut above[i * n + i..], &r[i * width + i..i * width + n]);
        for (k, (share, other)) in shares[1..].iter().zip(below.chunks_exact(n)).enumerate() {
            for (x, y) in own[k + 1..].iter_mut().zip(&other[i + k + 1..]) {
                *x -= share * y;
            }
        }
        own[0] = 1.0;
        for x in own {
            *x /= shares[0];
        }
    }
    inverse
}

fn norm(row: &[f64]) -> f64 {
    row.iter().map(|x| x * x).sum::<f64>().sqrt()
}
