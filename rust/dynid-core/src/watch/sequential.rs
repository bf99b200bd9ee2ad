//! The sequential test of one change.
//!
//! A change by d adds `d phi` to what a row leaves. Tolerated is `|d| <= d0`. Against a change to d beyond it the
//! likelihood ratio of a row of variance v, m of which are worth one independent one, is at least as small as
//!
//! ```text
//! l = (d - d0) b - (d^2 - d0^2) g / 2        b = phi e / (v m), g = phi^2 / (v m), d0 with the sign of d
//! ```
//!
//! in that `E exp(l) <= 1` at every tolerated change. Summed over all rows at which it may have begun (A. N. Shiryaev, Theory
//! Probab. Appl. 8, 1963; S. W. Roberts, Technometrics 8, 1966),
//!
//! ```text
//! R' = (1 + R) exp(l)
//! ```
//!
//! grows by at most one per row, so it passes A within n rows with a chance of at most n / A (Doob). So does its mean over
//! several d. Rows that remember each other are given less weight, by m; that bounds how fast R grows, not each row's expectation.

use super::remembered::LARGEST;

/// What a row says of a change: b and g above.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evidence {
    /// Sum of `phi e / (v m)`.
    pub moment: f64,
    /// Sum of `phi^2 / (v m)`.
    pub information: f64,
}

/// Of one change; `N` sizes are tried. R is kept up to [`LARGEST`], which is beyond any threshold.
#[derive(Clone, Copy, Debug)]
pub struct SequentialTest<const N: usize> {
    pub(super) r: [f64; N],
}

impl Evidence {
    /// Takes what another row says.
    pub fn add(&mut self, row: Self) {
        self.moment += row.moment;
        self.information += row.information;
    }

    /// Size and its standard deviation.
    pub fn size(&self) -> (f64, f64) {
        let information = self.information.max(f64::MIN_POSITIVE);
        (self.moment / information, information.sqrt().recip())
    }

    /// Logarithm of the evidence for a change of about `usual` against none.
    pub fn log_evidence(&self, usual: f64) -> f64 {
        let known = usual * usual * self.information;
        0.5 * (self.moment * self.moment * usual * usual / (1.0 + known) - known.ln_1p())
    }
}

/// Sizes of a change that are tried, over what is tolerated.
pub const SIZES: [f64; 6] = [2.0, 4.0, 8.0, -2.0, -4.0, -8.0];

/// `l` of a change to `size` times what is tolerated, for a row.
pub fn log_ratio(size: f64, tolerated: f64, row: Evidence) -> f64 {
    let (change, none) = (size * tolerated, tolerated.copysign(size));
    (change - none) * row.moment - 0.5 * (change * change - none * none) * row.information
}

/// The same of a deviation that has grown: `square` is `e^2 / v`, `memory` is m. Tolerated is a factor of `1 + tolerated`; the
/// ratio of two normal distributions is `-ln(k / k0) / 2 + square (1 / k0 - 1 / k) / 2` at factors k of the variance.
pub fn log_ratio_of_deviation(size: f64, tolerated: f64, square: f64, memory: f64) -> f64 {
    let none = (1.0 + tolerated) * (1.0 + tolerated);
    let more = size * size;
    0.5 * (square / none * (1.0 - 1.0 / more) - more.ln()) / memory
}

/// Deviations that are tried, over the greatest that is tolerated.
pub const GROWN: [f64; 6] = [1.5, 2.0, 3.0, 4.0, 6.0, 8.0];

/// R of several sizes take a row.
pub(super) fn step<const N: usize>(r: &mut [f64; N], log_ratios: [f64; N]) {
    for (r, log_ratio) in r.iter_mut().zip(log_ratios) {
        *r = ((1.0 + *r) * log_ratio.exp()).min(LARGEST);
    }
}

impl<const N: usize> SequentialTest<N> {
    /// Nothing seen.
    pub fn new() -> Self {
        Self { r: [0.0; N] }
    }

    /// Takes a row: the logarithm of its ratio for every size.
    pub fn step(&mut self, log_ratios: [f64; N]) {
        step(&mut self.r, log_ratios);
    }

    /// Mean of R over the sizes that are tried.
    pub fn mean(&self) -> f64 {
        self.r.iter().sum::<f64>() / N as f64
    }
}
