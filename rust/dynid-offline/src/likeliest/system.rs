//! The joints' Gram matrices and the prior in the order of the factor.

use std::ops::Range;

use dynid_core::lanes::MOST_LANES;

use super::factor::Lower;
use super::{JointGram, NormalPrior};
use crate::triangle::total;

/// One joint in the order of the factor.
pub(super) struct Joint {
    /// Entries of the Gram matrix left of the diagonal, row by row.
    entries: Vec<f64>,
    /// Where they stand among all unknowns: row, and columns that follow each other.
    runs: Vec<(usize, Range<usize>)>,
    /// Entries on it, in the order of `places`.
    squares: Vec<f64>,
    pub(super) places: Vec<usize>,
    /// `M' y`
    pub(super) moment: Vec<f64>,
    /// `y' y`
    square: f64,
}

impl Joint {
    /// `order[u]`: where unknown u stands in the factor.
    pub(super) fn new(joint: &JointGram<'_>, order: &[usize]) -> Self {
        let k = joint.places.len();
        let mut columns: Vec<usize> = (0..k).collect();
        columns.sort_by_key(|&c| order[joint.places[c]]);
        let place = |c: usize| order[joint.places[c]];
        let places: Vec<usize> = columns.iter().map(|&c| place(c)).collect();
        let mut entries = Vec::with_capacity(k * k / 2);
        let mut runs = Vec::new();
        for (a, &row) in columns.iter().enumerate() {
            let gram = &joint.gram[row * (k + 1)..(row + 1) * (k + 1)];
            entries.extend(columns[..a].iter().map(|&column| gram[column]));
            let alike = places[..a].chunk_by(|here, next| here + 1 == *next);
            runs.extend(alike.map(|run| (places[a], run[0]..run[0] + run.len())));
        }
        Self {
            entries,
            runs,
            squares: columns.iter().map(|&c| joint.gram[c * (k + 2)]).collect(),
            places,
            moment: columns
                .iter()
                .map(|&c| joint.gram[c * (k + 1) + k])
                .collect(),
            square: joint.gram[(k + 1) * (k + 1) - 1],
        }
    }

    /// Row, columns and entries left of the diagonal, as far as columns follow each other.
    #[inline(always)]
    fn pieces(&self) -> impl Iterator<Item = (usize, Range<usize>, &[f64])> {
        self.runs.iter().scan(0, |first, (row, columns)| {
            let entries = &self.entries[*first..*first + columns.len()];
            *first += columns.len();
            Some((*row, columns.clone(), entries))
        })
    }

    /// `tr(G D X D)` of a symmetric X with the diagonal matrix D.
    #[inline(always)]
    pub(super) fn trace(&self, x: &Lower, scale: &[f64]) -> f64 {
        let twice = |(row, columns, entries): (usize, Range<usize>, &[f64])| {
            let x = &x.flat(row)[columns.clone()];
            scale[row] * sum(entries, |k| x[k] * scale[columns.start + k])
        };
        let once = |(&at, entry): (&usize, &f64)| entry * x.at(at, at) * scale[at] * scale[at];
        let own: f64 = self.places.iter().zip(&self.squares).map(once).sum();
        2.0 * self.pieces().map(twice).sum::<f64>() + own
    }

    /// `x' G x`
    #[inline(always)]
    fn along(&self, x: &[f64]) -> f64 {
        let twice = |(row, columns, entries): (usize, Range<usize>, &[f64])| {
            let other = &x[columns];
            x[row] * sum(entries, |k| other[k])
        };
        let once = |(&at, entry): (&usize, &f64)| entry * x[at] * x[at];
        let own: f64 = self.places.iter().zip(&self.squares).map(once).sum();
        2.0 * self.pieces().map(twice).sum::<f64>() + own
    }

    /// `|y - M x|^2`
    #[inline(always)]
    pub(super) fn power(&self, x: &[f64]) -> f64 {
        let mixed: f64 = self
            .places
            .iter()
            .zip(&self.moment)
            .map(|(&at, g)| g * x[at])
            .sum();
        (self.square - 2.0 * mixed + self.along(x)).max(0.0)
    }
}

/// Sum of entries times what belongs to each, in [`MOST_LANES`] parts side by side.
#[inline(always)]
fn sum(entries: &[f64], of: impl Fn(usize) -> f64) -> f64 {
    let mut parts = [0.0; MOST_LANES];
    let (eights, rest) = entries.as_chunks::<MOST_LANES>();
    for (block, eight) in eights.iter().enumerate() {
        for (lane, (part, entry)) in parts.iter_mut().zip(eight).enumerate() {
            *part += entry * of(block * MOST_LANES + lane);
        }
    }
    for (lane, (part, entry)) in parts.iter_mut().zip(rest).enumerate() {
        *part += entry * of(eights.len() * MOST_LANES + lane);
    }
    total(&parts)
}

/// All joints and the prior in the order of the factor.
pub(super) struct System {
    pub(super) joints: Vec<Joint>,
    pub(super) prior: Lower,
    pub(super) moment: Vec<f64>,
    /// Where every row of H begins.
    pub(super) first: Vec<usize>,
    /// Which unknown stands at each place.
    pub(super) unknown: Vec<usize>,
}

impl System {
    pub(super) fn new(joints: &[JointGram<'_>], n: usize, prior: NormalPrior<'_>) -> Self {
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
    #[inline(always)]
    pub(super) fn weighted(&self, weights: &[f64]) -> (Lower, Vec<f64>) {
        let (mut precision, mut moment) = (self.prior.clone(), self.moment.clone());
        for (joint, w) in self.joints.iter().zip(weights) {
            for (row, columns, entries) in joint.pieces() {
                let to = &mut precision.flat_mut(row)[columns];
                for (to, entry) in to.iter_mut().zip(entries) {
                    *to += w * entry;
                }
            }
            for ((&at, square), g) in joint.places.iter().zip(&joint.squares).zip(&joint.moment) {
                precision.diagonal[at] += w * square;
                moment[at] += w * g;
            }
        }
        (precision, moment)
    }
}
