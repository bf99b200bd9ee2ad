//! A load from its sums: four unknowns of a linear model.

use super::rows::N_LOAD;
use super::sequential::Evidence;

/// Distance of a load's centre from the last link's origin \[m\], of hands and what they hold.
pub(super) const REACH: f64 = 0.2;
/// Rounds in which mass and the spread of its moments settle.
const SETTLING: usize = 4;
/// Centres of a load that are tried: the origin, and [`REACH`] along the axes.
pub(super) const PLACES: [[f64; 3]; 7] = [
    [0.0, 0.0, 0.0],
    [REACH, 0.0, 0.0],
    [-REACH, 0.0, 0.0],
    [0.0, REACH, 0.0],
    [0.0, -REACH, 0.0],
    [0.0, 0.0, REACH],
    [0.0, 0.0, -REACH],
];

/// `sum w c c^T` and `sum w c e` over rows and joints; c are the columns of mass and first moments.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LoadSums {
    gram: [[f64; N_LOAD]; N_LOAD],
    moment: [f64; N_LOAD],
}

impl LoadSums {
    /// Numbers that they are.
    pub const N: usize = N_LOAD * (N_LOAD + 1);

    /// Every one of them, always in the same order.
    pub fn each_number(&mut self, mut each: impl FnMut(&mut f64)) {
        self.gram.as_flattened_mut().iter_mut().for_each(&mut each);
        self.moment.iter_mut().for_each(each);
    }

    /// Of one row; a weight per joint.
    pub fn of(
        columns: &[Vec<f64>; N_LOAD],
        left: &[f64],
        weights: impl Iterator<Item = f64>,
    ) -> Self {
        let [mass, x, y, z] = columns;
        let joints = mass.iter().zip(x).zip(y).zip(z).zip(left).zip(weights);
        let mut sums = Self::default();
        for (((((mass, x), y), z), left), weight) in joints {
            let column = [*mass, *x, *y, *z];
            for ((row, sum), a) in sums.gram.iter_mut().zip(&mut sums.moment).zip(column) {
                *sum += weight * a * left;
                for (entry, b) in row.iter_mut().zip(column) {
                    *entry += weight * a * b;
                }
            }
        }
        sums
    }

    pub fn add(&mut self, other: &Self) {
        for (own, other) in self
            .gram
            .as_flattened_mut()
            .iter_mut()
            .zip(other.gram.as_flattened())
        {
            *own += other;
        }
        for (own, other) in self.moment.iter_mut().zip(other.moment) {
            *own += other;
        }
    }

    /// What it says of a mass, with its centre in each of [`PLACES`].
    pub fn masses(&self) -> [Evidence; PLACES.len()] {
        PLACES.map(|[x, y, z]| {
            let unit = [1.0, x, y, z];
            let mut seen = Evidence::default();
            for ((row, moment), a) in self.gram.iter().zip(self.moment).zip(unit) {
                seen.moment += a * moment;
                for (entry, b) in row.iter().zip(unit) {
                    seen.information += a * entry * b;
                }
            }
            seen
        })
    }

    /// By how much the load takes the rows' weighted squares down.
    pub fn gain(&self, usual: f64) -> f64 {
        let (mass, [x, y, z], ..) = self.solved(usual);
        let sizes = [mass, x, y, z];
        let mut gain = 0.0;
        for ((row, moment), a) in self.gram.iter().zip(self.moment).zip(sizes) {
            gain += 2.0 * a * moment;
            for (entry, b) in row.iter().zip(sizes) {
                gain -= a * entry * b;
            }
        }
        gain
    }

    /// Mass and first moments, the mass's standard deviation, and the logarithm of the evidence that there is such a load, of a
    /// mass of about `usual` beforehand. A motion that does not show where the load's centre is leaves it within `REACH` of the
    /// last link's origin.
    pub fn solved(&self, usual: f64) -> (f64, [f64; 3], f64, f64) {
        let mut spread = usual;
        let mut solved = (0.0, [0.0; 3], 0.0, 0.0);
        for _ in 0..SETTLING {
            let of_moments = REACH * spread;
            let prior = [spread, of_moments, of_moments, of_moments];
            let mut a = self.gram;
            let mut unit = [1.0, 0.0, 0.0, 0.0];
            let mut x = self.moment;
            for ((k, row), std) in a.iter_mut().enumerate().zip(prior) {
                if let Some(entry) = row.get_mut(k) {
                    *entry += 1.0 / (std * std);
                }
            }
            let log_det = eliminate(&mut a, &mut x, &mut unit);
            let scale: f64 = prior.iter().map(|std| 2.0 * std.ln()).sum();
            let gain: f64 = x.iter().zip(self.moment).map(|(x, b)| x * b).sum();
            let ([mass, mx, my, mz], [variance, ..]) = (x, unit);
            let log_evidence = 0.5 * (gain - log_det - scale);
            solved = (mass, [mx, my, mz], variance.max(0.0).sqrt(), log_evidence);
            spread = mass.abs().max(usual);
        }
        solved
    }
}

/// Solves `a x = b` for two right sides in place; a is symmetric and positive definite, so no exchange is needed. The logarithm
/// of its determinant.
fn eliminate(a: &mut [[f64; N_LOAD]; N_LOAD], x: &mut [f64; N_LOAD], y: &mut [f64; N_LOAD]) -> f64 {
    let mut log_det = 0.0;
    for k in 0..N_LOAD {
        let (pivot, px, py) = (a[k], x[k], y[k]);
        log_det += pivot[k].abs().max(f64::MIN_POSITIVE).ln();
        for i in 0..N_LOAD {
            if i == k {
                continue;
            }
            let factor = a[i][k] / pivot[k];
            for c in 0..N_LOAD {
                a[i][c] -= factor * pivot[c];
            }
            x[i] -= factor * px;
            y[i] -= factor * py;
        }
    }
    for k in 0..N_LOAD {
        x[k] /= a[k][k];
        y[k] /= a[k][k];
    }
    log_det
}
