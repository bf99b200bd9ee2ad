//! The joints' Gram matrices and the prior in the order of the factor.

use super::factor::Lower;
use super::{JointGram, NormalPrior};

/// One joint in the order of the factor.
pub(super) struct Joint {
    /// Row, column, entry of the Gram matrix left of the diagonal.
    pairs: Vec<(u32, u32, f64)>,
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
    pub(super) fn along(&self, x: impl Fn(usize, usize) -> f64) -> f64 {
        let twice = |&(a, b, entry): &(u32, u32, f64)| entry * x(a as usize, b as usize);
        let once = |(&at, entry): (&usize, &f64)| entry * x(at, at);
        let own: f64 = self.places.iter().zip(&self.squares).map(once).sum();
        2.0 * self.pairs.iter().map(twice).sum::<f64>() + own
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
        (self.square - 2.0 * mixed + self.along(|a, b| x[a] * x[b])).max(0.0)
    }
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
    pub(super) fn weighted(&self, weights: &[f64]) -> (Lower, Vec<f64>) {
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
