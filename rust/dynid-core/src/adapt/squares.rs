//! Recursive least squares that forget what is seen again, and nothing else.
//!
//! Rows `left = phi . x + noise` of variance r, an estimate x and its covariance P:
//!
//! ```text
//! g = P phi,   x += g (left - phi . x) / (r + phi . g),   P -= g g^T / (r + phi . g)
//! ```
//!
//! Then every unknown that the row has seen is forgotten by its own factor (A. Vahidi, A. Stefanopoulou, H. Peng, Vehicle
//! System Dynamics 43, 2005): `P -> D P D` with `D = 1 / sqrt(keep)` there and 1 elsewhere, which keeps P positive. D is
//! less where P would pass what it was in the beginning, so P is bounded whatever comes (as in M. E. Salgado, G. C. Goodwin,
//! R. H. Middleton, Int. J. Control 47, 1988): an unknown that nothing excites stays as sure as it was, and one that is
//! hardly excited is at most as open as before the first row. That is why nothing winds up.

use crate::slices::{at, mirror_fields, rows_mut, set, Mirror};

/// A variance is never less than this part of what it was in the beginning, so that rounding leaves it positive.
const LEAST: f64 = 1e-12;

#[derive(Clone, Debug)]
pub(super) struct Squares {
    /// x, and P row by row.
    pub estimate: Vec<f64>,
    pub covariance: Vec<f64>,
    /// Mean of the estimate over the memory: it is as far behind the estimate as that is behind what grows steadily (the two
    /// means of R. G. Brown, Smoothing, Forecasting and Prediction, 1963).
    pub mean: Vec<f64>,
    /// P's diagonal in the beginning.
    first: Vec<f64>,
    /// phi of the row in the making, and P phi.
    column: Vec<f64>,
    gain: Vec<f64>,
    /// What rows have seen since [`Self::forget`].
    seen: Vec<bool>,
    keep: f64,
    scale: Vec<f64>,
}

impl Squares {
    /// Nothing known but variances of the unknowns, whose mean is zero; a row of age k counts `keep^k`.
    pub fn new(first: Vec<f64>, keep: f64) -> Self {
        let n = first.len();
        let mut own = Self {
            estimate: vec![0.0; n],
            covariance: vec![0.0; n * n],
            mean: vec![0.0; n],
            first,
            column: vec![0.0; n],
            gain: vec![0.0; n],
            seen: vec![false; n],
            keep,
            scale: vec![1.0; n],
        };
        own.reset();
        own
    }

    /// Back to how [`Self::new`] left it.
    pub fn reset(&mut self) {
        let n = self.first.len();
        for numbers in [&mut self.estimate, &mut self.mean, &mut self.covariance] {
            numbers.fill(0.0);
        }
        for (k, first) in self.first.iter().enumerate() {
            set(&mut self.covariance, k * n + k, *first);
        }
        self.seen.fill(false);
    }

    pub fn first(&self) -> &[f64] {
        &self.first
    }

    /// Variance of an unknown as rows say it.
    pub fn variance(&self, k: usize) -> f64 {
        at(&self.covariance, k * self.first.len() + k)
    }

    /// Standard deviation of an unknown, with how far it is behind what grows steadily.
    pub fn std(&self, k: usize) -> f64 {
        let behind = at(&self.estimate, k) - at(&self.mean, k);
        (self.variance(k) + behind * behind).max(0.0).sqrt()
    }

    /// Where phi of the next row goes; zeros.
    pub fn begin(&mut self) -> &mut [f64] {
        self.column.fill(0.0);
        &mut self.column
    }

    /// Takes the row whose phi was written; one that says nothing, or is none, is left out.
    pub fn take(&mut self, left: f64, variance: f64) {
        let n = self.first.len();
        let (mut spread, mut expected) = (0.0, 0.0);
        for (a, gain) in self.gain.iter_mut().enumerate() {
            *gain = 0.0;
            for (b, phi) in self.column.iter().enumerate() {
                *gain += at(&self.covariance, a * n + b) * phi;
            }
            let phi = at(&self.column, a);
            spread += phi * *gain;
            expected += phi * at(&self.estimate, a);
        }
        let step = (left - expected) / (variance + spread);
        let usable = variance > 0.0 && spread > 0.0 && (variance + spread).is_finite();
        if !usable || !step.is_finite() {
            return;
        }
        let share = (variance + spread).recip();
        for (x, gain) in self.estimate.iter_mut().zip(&self.gain) {
            *x += gain * step;
        }
        for (a, row) in rows_mut(&mut self.covariance, n).enumerate() {
            let of_row = at(&self.gain, a);
            for (entry, gain) in row.iter_mut().zip(&self.gain) {
                *entry -= of_row * gain * share;
            }
            let least = LEAST * at(&self.first, a);
            let variance = at(row, a).max(least);
            set(row, a, variance);
        }
        for (seen, phi) in self.seen.iter_mut().zip(&self.column) {
            *seen |= *phi != 0.0;
        }
    }

    /// Forgets a little of what was seen.
    pub fn forget(&mut self) {
        let n = self.first.len();
        for k in 0..n {
            let mut scale = 1.0;
            if self.seen.get(k) == Some(&true) {
                let most = at(&self.first, k) / self.variance(k);
                scale = self.keep.recip().min(most).max(1.0).sqrt();
                let mean = at(&self.mean, k);
                let now = mean + (1.0 - self.keep) * (at(&self.estimate, k) - mean);
                set(&mut self.mean, k, now);
            }
            set(&mut self.scale, k, scale);
        }
        for (a, row) in rows_mut(&mut self.covariance, n).enumerate() {
            let of_row = at(&self.scale, a);
            for (entry, scale) in row.iter_mut().zip(&self.scale) {
                *entry *= of_row * scale;
            }
        }
        self.seen.fill(false);
    }
}

impl Mirror for Squares {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(
            self, of;
            estimate, covariance, mean, column, gain, seen, scale;
            copied keep;
            kept first
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bits(x: &[f64]) -> Vec<u64> {
        x.iter().map(|x| x.to_bits()).collect()
    }

    /// The weighted sum of squares in one go: every row by its age, the beginning by its own.
    #[test]
    fn what_is_recursive_is_least_squares_with_weights() {
        let (keep, first) = (0.95_f64, 2.0);
        let mut squares = Squares::new(vec![first], keep);
        let (mut top, mut bottom) = (0.0, 0.0);
        for k in 0..200 {
            let (phi, left) = (1.5 + (0.3 * k as f64).sin(), (0.7 * k as f64).cos());
            let variance = 0.5 + 0.1 * (k % 3) as f64;
            squares.begin()[0] = phi;
            squares.take(left, variance);
            bottom = if k == 0 { 1.0 / first } else { keep * bottom };
            bottom += phi * phi / variance;
            top = keep * top + phi * left / variance;
            assert!((squares.estimate[0] - top / bottom).abs() < 1e-12);
            assert!((squares.variance(0) * bottom - 1.0).abs() < 1e-10);
            squares.forget();
        }
    }

    #[test]
    fn nothing_opens_beyond_its_beginning_and_unseen_is_not_forgotten() {
        let mut squares = Squares::new(vec![1.0, 4.0], 0.5);
        squares.begin().copy_from_slice(&[3.0, 2.0]);
        squares.take(5.0, 0.1);
        let (sure, estimate) = (squares.variance(1), squares.estimate.clone());
        for _ in 0..10_000 {
            // Hardly excited, and the other not at all.
            squares.begin()[0] = 1e-9;
            squares.take(0.0, 0.1);
            squares.forget();
            assert!(squares.variance(0) <= 1.0 + 1e-12 && squares.variance(0) > 0.0);
        }
        assert!((squares.variance(0) - 1.0).abs() < 1e-6);
        squares.begin().fill(0.0);
        squares.take(1e9, 0.1);
        squares.forget();
        assert!(squares.variance(1) <= 4.0 && squares.variance(1) >= sure);
        let mut other = Squares::new(vec![1.0, 4.0], 0.5);
        other.begin()[1] = 2.0;
        other.take(5.0, 0.1);
        other.forget();
        let sure = bits(&[other.variance(1), other.estimate[1]]);
        for _ in 0..1000 {
            other.begin()[0] = 1.0;
            other.take(0.3, 0.1);
            other.forget();
        }
        assert_eq!(sure, bits(&[other.variance(1), other.estimate[1]]));
        assert!((squares.estimate[0] - estimate[0]).abs() < 1.0);
    }

    #[test]
    fn numbers_that_are_none_leave_no_trace() {
        let mut squares = Squares::new(vec![1.0, 4.0], 0.9);
        let before = bits(&squares.covariance);
        for (phi, left, variance) in [
            (f64::NAN, 1.0, 1.0),
            (1e200, 1.0, 1.0),
            (1.0, f64::INFINITY, 1.0),
            (1.0, 1.0, f64::NAN),
            (1.0, 1.0, 0.0),
            (1.0, 1.0, -1.0),
        ] {
            squares.begin()[0] = phi;
            squares.take(left, variance);
            assert_eq!(bits(&squares.covariance), before, "{phi} {left} {variance}");
            assert_eq!(squares.estimate, [0.0; 2]);
        }
    }
}
