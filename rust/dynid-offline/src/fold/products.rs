//! Sums of products of a joint's columns, and their factor where it is as good as that of reflections: half the
//! arithmetic, and none of it waits.
//!
//! Products lose what reflections keep: with columns of length one and the factor R, errors e of the sums become up to
//! `|R^-1|² e` of what follows from them. So the inverse is looked at; where it is long there is no factor, and the
//! samples are reflected.

use dynid_core::lanes::Lanes;

use super::{Folding, JointRows};
use crate::triangle::{total, Columns};
use crate::weighted::invert;

/// Samples of one lane that are multiplied at a time: sums come from far away once for all of them.
pub(super) const DEPTH: usize = 16;

/// Columns on the left and on the right of a tile of products: its sums stay in sixteen registers.
const LEFT: usize = 4;
const RIGHT: usize = 3;

/// Sums of squares up to here are nothing, as they are for reflections.
const NOTHING: f64 = 1e-200;

/// Columns of the inverse this long make rounding in the sums (1e-15) 4e-9 of what follows from them.
const LONG: f64 = 2e3;

/// Sums of products, lane by lane.
pub(super) struct Products;

impl Folding<DEPTH> for Products {
    #[inline(always)]
    fn absorb<L: Lanes>(joint: &mut JointRows<L::Raw, DEPTH>) {
        let mut sums = &mut joint.triangle[..];
        let mut columns = &joint.rows[..];
        while columns.len() >= LEFT {
            let n = columns.len();
            let (own, below) = sums.split_at_mut(LEFT * n - 6);
            // Where column 0 of each row of sums would stand.
            let starts = [0, n - 1, 2 * n - 3, 3 * n - 6];
            let (left, rest) = columns.split_at(LEFT);
            tile::<L, LEFT, LEFT, true>(left, left, own, starts);
            let mut right = rest;
            while right.len() >= RIGHT {
                let starts = starts.map(|start| start + n - right.len());
                tile::<L, LEFT, RIGHT, false>(left, right, own, starts);
                right = &right[RIGHT..];
            }
            let starts = starts.map(|start| start + n - right.len());
            match right.len() {
                1 => tile::<L, LEFT, 1, false>(left, right, own, starts),
                2 => tile::<L, LEFT, 2, false>(left, right, own, starts),
                _ => {}
            }
            (columns, sums) = (rest, below);
        }
        match columns.len() {
            1 => tile::<L, 1, 1, true>(columns, columns, sums, [0; LEFT]),
            2 => tile::<L, 2, 2, true>(columns, columns, sums, [0, 1, 0, 0]),
            3 => tile::<L, 3, 3, true>(columns, columns, sums, [0, 2, 3, 0]),
            _ => {}
        }
    }

    /// Cholesky's factor of the sums with columns of length one, and these lengths again.
    #[inline(always)]
    fn factor<L: Lanes>(sums: &mut Columns) -> Option<Vec<f64>> {
        let width = sums.width();
        let mut squares = vec![0.0; width];
        for (c, own) in squares.iter_mut().enumerate() {
            *own = total(&sums.column(c)[c]);
        }
        // Columns of zeros stay zeros; the others are those of a smaller matrix.
        let there: Vec<usize> = (0..width).filter(|&c| squares[c] > NOTHING).collect();
        let lengths: Vec<f64> = there.iter().map(|&c| squares[c].sqrt()).collect();
        let n = there.len();
        let mut r = vec![0.0; n * n];
        for i in 0..n {
            for k in i..n {
                let product = total(&sums.column(there[k])[there[i]]);
                r[i * n + k] = product / (lengths[i] * lengths[k]);
            }
        }
        cholesky(&mut r, n)?;
        let inverse = invert(&r, n, n);
        let squares = |c: usize| (0..=c).map(|i| inverse[i * n + c].powi(2)).sum::<f64>();
        if !(0..n).all(|c| squares(c) < LONG * LONG) {
            return None;
        }
        let mut factor = vec![0.0; width * width];
        for i in 0..n {
            for k in i..n {
                factor[there[i] * width + there[k]] = r[i * n + k] * lengths[k];
            }
        }
        Some(factor)
    }
}

/// Products of columns `left` and `right`, added to the sums from `starts` on; on the diagonal without those below it.
#[inline(always)]
fn tile<L: Lanes, const A: usize, const B: usize, const DIAGONAL: bool>(
    left: &[[L::Raw; DEPTH]],
    right: &[[L::Raw; DEPTH]],
    sums: &mut [L::Raw],
    starts: [usize; LEFT],
) {
    let (Some(left), Some(right)) = (left.first_chunk::<A>(), right.first_chunk::<B>()) else {
        return;
    };
    let mut own = [[L::splat(0.0); B]; A];
    for (i, own) in own.iter_mut().enumerate() {
        let first = if DIAGONAL { i } else { 0 };
        let sums = &sums[starts[i]..starts[i] + B];
        for c in first..B {
            own[c] = L::from_raw(sums[c]);
        }
    }
    for k in 0..DEPTH {
        let mut y = [L::splat(0.0); B];
        for (y, right) in y.iter_mut().zip(right) {
            *y = L::from_raw(right[k]);
        }
        for (i, (own, left)) in own.iter_mut().zip(left).enumerate() {
            let first = if DIAGONAL { i } else { 0 };
            let x = L::from_raw(left[k]);
            for c in first..B {
                own[c] = x.mul_add(y[c], own[c]);
            }
        }
    }
    for (i, own) in own.iter().enumerate() {
        let first = if DIAGONAL { i } else { 0 };
        let sums = &mut sums[starts[i]..starts[i] + B];
        for c in first..B {
            sums[c] = own[c].raw();
        }
    }
}

/// The upper triangle (n × n, row-major) replaced by its factor; nothing where it is not positive definite.
#[inline(always)]
fn cholesky(r: &mut [f64], n: usize) -> Option<()> {
    for i in 0..n {
        let (done, below) = r.split_at_mut((i + 1) * n);
        let row = &mut done[i * n..];
        if row[i].is_nan() || row[i] <= 0.0 {
            return None;
        }
        let norm = row[i].sqrt();
        for x in &mut row[i..] {
            *x /= norm;
        }
        for (k, other) in (i + 1..n).zip(below.chunks_exact_mut(n)) {
            let share = row[k];
            for (x, y) in other[k..].iter_mut().zip(&row[k..]) {
                *x -= share * y;
            }
        }
    }
    Some(())
}
