//! Symmetric and triangular matrices whose rows begin where something is other than zero.

use std::ops::Range;

use dynid_core::lanes::{Lanes, MOST_LANES};

use crate::error::OfflineError;
use crate::triangle::{product, subtract, Rows};

/// Relative precision that every direction has beside its own, so that rounding cannot make H indefinite.
const ROUNDING: f64 = 1e-12;

/// Rows of a symmetric or a triangular matrix left of the diagonal, zeros from there on, in whole [`Rows`].
#[derive(Clone)]
pub(super) struct Lower {
    numbers: Vec<Rows>,
    pub(super) diagonal: Vec<f64>,
    stride: usize,
}

impl Lower {
    pub(super) fn zeros(n: usize) -> Self {
        let stride = n.div_ceil(MOST_LANES);
        Self {
            numbers: vec![[0.0; MOST_LANES]; n * stride],
            diagonal: vec![0.0; n],
            stride,
        }
    }

    /// Row i, as far as it can be other than zero.
    #[inline(always)]
    pub(super) fn row(&self, i: usize, columns: Range<usize>) -> &[Rows] {
        let first = i * self.stride;
        &self.numbers[first + columns.start / MOST_LANES..first + columns.end.div_ceil(MOST_LANES)]
    }

    /// The numbers of row i.
    #[inline(always)]
    pub(super) fn flat(&self, i: usize) -> &[f64] {
        self.numbers[i * self.stride..(i + 1) * self.stride].as_flattened()
    }

    /// [`Self::flat`], to be written.
    #[inline(always)]
    pub(super) fn flat_mut(&mut self, i: usize) -> &mut [f64] {
        self.numbers[i * self.stride..(i + 1) * self.stride].as_flattened_mut()
    }

    #[inline(always)]
    pub(super) fn at(&self, i: usize, k: usize) -> f64 {
        self.numbers[i * self.stride + k / MOST_LANES][k % MOST_LANES]
    }

    #[inline(always)]
    pub(super) fn at_mut(&mut self, i: usize, k: usize) -> &mut f64 {
        &mut self.numbers[i * self.stride + k / MOST_LANES][k % MOST_LANES]
    }
}

/// `H = D^-1 (L L' - rounding) D^-1` with unit diagonal in the middle: so the factor loses no digits to units.
pub(super) struct Factor {
    /// L; its diagonal holds the reciprocals.
    root: Lower,
    /// D.
    pub(super) scale: Vec<f64>,
    pub(super) log_det: f64,
}

impl Factor {
    #[inline(always)]
    pub(super) fn new<L: Lanes>(precision: &Lower, first: &[usize]) -> Result<Self, OfflineError> {
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
    pub(super) fn solve<L: Lanes>(&self, b: &[f64], first: &[usize]) -> Vec<f64> {
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
    pub(super) fn inverse<L: Lanes>(&self, first: &[usize]) -> (Lower, Vec<usize>) {
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
pub(super) fn squared<L: Lanes>(inverse: &Lower, begins: &[usize], first: &[usize]) -> Lower {
    let n = first.len();
    let mut square = Lower::zeros(n);
    let stride = square.stride;
    for (i, &begin) in begins.iter().enumerate() {
        for (a, &start) in first.iter().enumerate().take(i + 1).skip(begin) {
            let share = inverse.at(i, a);
            if share == 0.0 {
                continue;
            }
            let part = begin.max(start) / MOST_LANES..a / MOST_LANES + 1;
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
pub(super) fn times<L: Lanes>(precision: &Lower, x: &[f64], first: &[usize]) -> Vec<f64> {
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
