//! A load from its sums: ten unknowns of a linear model, those of a link.

use super::rows::{product, N_LOAD};
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

/// `sum w c c^T` and `sum w c e` over rows and joints; c are the columns of a load's ten parameters.
///
/// The inertias are unknowns of their own: a body has at least that of its mass at its centre, `m |c|^2`, about the last
/// link's origin, which is no tolerated error on a wrist of little noise, and its own about its centre besides.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LoadSums {
    gram: [[f64; N_LOAD]; N_LOAD],
    moment: [f64; N_LOAD],
}

/// A load as its sums show it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solved {
    /// Mass, first moments, and inertias about the last link's origin, in the order of [`crate::link_params`].
    pub sizes: [f64; N_LOAD],
    /// Standard deviation of the mass.
    pub std: f64,
    /// Logarithm of the evidence that there is such a load.
    pub log_evidence: f64,
}

/// What a row says of a mass with its centre in a place.
pub(super) fn mass_in(
    place: [f64; 3],
    columns: &[[f64; N_LOAD]],
    left: &[f64],
    weights: impl Iterator<Item = f64>,
) -> Evidence {
    let mut seen = Evidence::default();
    let unit = point(place);
    for ((columns, left), weight) in columns.iter().zip(left).zip(weights) {
        if weight == 0.0 {
            continue;
        }
        let per_mass = product(columns, &unit);
        seen.moment += weight * per_mass * left;
        seen.information += weight * per_mass * per_mass;
    }
    seen
}

/// The ten parameters of a mass of 1 kg in a point.
fn point([x, y, z]: [f64; 3]) -> [f64; N_LOAD] {
    let [xx, yy, zz] = [x * x, y * y, z * z];
    [
        1.0,
        x,
        y,
        z,
        yy + zz,
        -x * y,
        xx + zz,
        -x * z,
        -y * z,
        xx + yy,
    ]
}

impl LoadSums {
    /// Numbers that they are.
    pub const N: usize = N_LOAD * (N_LOAD + 1);

    /// Every one of them, always in the same order.
    pub fn each_number(&mut self, mut each: impl FnMut(&mut f64)) {
        self.gram.as_flattened_mut().iter_mut().for_each(&mut each);
        self.moment.iter_mut().for_each(each);
    }

    /// Takes a row; a weight per joint.
    pub fn add_row(
        &mut self,
        columns: &[[f64; N_LOAD]],
        left: &[f64],
        weights: impl Iterator<Item = f64>,
    ) {
        for ((columns, left), weight) in columns.iter().zip(left).zip(weights) {
            if weight == 0.0 {
                continue;
            }
            for ((row, sum), a) in self.gram.iter_mut().zip(&mut self.moment).zip(columns) {
                *sum += weight * a * left;
                for (entry, b) in row.iter_mut().zip(columns) {
                    *entry += weight * a * b;
                }
            }
        }
    }

    /// By how much a load takes the rows' weighted squares down.
    pub fn gain(&self, sizes: &[f64; N_LOAD]) -> f64 {
        let sums = self.gram.iter().zip(self.moment).zip(sizes);
        sums.map(|((row, moment), a)| a * (2.0 * moment - product(row, sizes)))
            .sum()
    }

    /// The load, of a mass of about `usual` beforehand. A motion that does not show where its centre is leaves it within
    /// [`REACH`] of the last link's origin, and one that does not show its inertia leaves that of a mass no further out.
    pub fn solved(&self, usual: f64) -> Solved {
        let mut spread = usual;
        let mut solved = Solved {
            sizes: [0.0; N_LOAD],
            std: 0.0,
            log_evidence: 0.0,
        };
        for _ in 0..SETTLING {
            let (m, h, i) = (spread, REACH * spread, REACH * REACH * spread);
            let prior = [m, h, h, h, i, i, i, i, i, i];
            let mut a = self.gram;
            let mut unit = [0.0; N_LOAD];
            if let Some(first) = unit.first_mut() {
                *first = 1.0;
            }
            let mut x = self.moment;
            for ((k, row), std) in a.iter_mut().enumerate().zip(prior) {
                if let Some(entry) = row.get_mut(k) {
                    *entry += 1.0 / (std * std);
                }
            }
            let log_det = eliminate(&mut a, &mut x, &mut unit);
            let scale: f64 = prior.iter().map(|std| 2.0 * std.ln()).sum();
            let gain: f64 = x.iter().zip(self.moment).map(|(x, b)| x * b).sum();
            let ([mass, ..], [variance, ..]) = (x, unit);
            solved = Solved {
                sizes: x,
                std: variance.max(0.0).sqrt(),
                log_evidence: 0.5 * (gain - log_det - scale),
            };
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
