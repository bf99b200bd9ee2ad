//! Householder reflections with samples in lanes: every lane keeps a triangular factor of its own.

use dynid_core::lanes::Lanes;

use super::{Folding, JointRows};
use crate::triangle::Columns;

/// Samples of one lane that are folded at a time: their column stays in registers while the others pass by.
pub(super) const DEPTH: usize = 8;

/// Sums of squares up to here are nothing: where columns depend on each other, what is left of them falls with every
/// reflection and would end in numbers whose reciprocals are infinite.
const NOTHING: f64 = 1e-200;

/// `1 - scale v v'` with `v = (first, the column of the rows)`; `first` stands on the factor's row.
#[derive(Clone, Copy)]
struct Reflection<L> {
    first: L,
    scale: L,
}

/// Factors, one per lane.
pub(super) struct Reflections;

impl Folding<DEPTH> for Reflections {
    /// Folds the rows into the factors; diagonals stay non-negative.
    ///
    /// Two reflections pass over the other columns at a time, so that these are loaded and stored half as often. The next
    /// two are found as soon as their own columns have been passed: their square roots and divisions wait beside the rest.
    #[inline(always)]
    fn absorb<L: Lanes>(joint: &mut JointRows<L::Raw, DEPTH>) {
        let mut factor = &mut joint.triangle[..];
        let mut rows = &mut joint.rows[..];
        let mut next = None;
        while let [left, right, rest @ ..] = rows {
            let (one_row, below) = factor.split_at_mut(rest.len() + 2);
            let (two_row, below) = below.split_at_mut(rest.len() + 1);
            let (one, two, both) = match next {
                Some(found) => found,
                None => pair::<L>(left, right, one_row, two_row),
            };
            let (x, y) = (column::<L>(left), column::<L>(right));
            let (one_row, two_row) = (&mut one_row[2..], &mut two_row[1..]);
            let near = rest.len().min(2);
            for i in 0..near {
                pass(
                    &x,
                    &y,
                    one,
                    two,
                    both,
                    &mut rest[i],
                    &mut one_row[i],
                    &mut two_row[i],
                );
            }
            next = match &mut *rest {
                [left, right, after @ ..] => {
                    let (one_row, below) = below.split_at_mut(after.len() + 2);
                    Some(pair::<L>(left, right, one_row, below))
                }
                _ => None,
            };
            let far = rest[near..]
                .iter_mut()
                .zip(&mut one_row[near..])
                .zip(&mut two_row[near..]);
            for ((column, one_head), two_head) in far {
                pass(&x, &y, one, two, both, column, one_head, two_head);
            }
            (rows, factor) = (rest, below);
        }
        if let ([last], [head, ..]) = (rows, factor) {
            reflection::<L>(last, head);
        }
    }

    #[inline(always)]
    fn factor<L: Lanes>(factors: &mut Columns) -> Option<Vec<f64>> {
        Some(factors.factor::<L>())
    }
}

#[inline(always)]
fn column<L: Lanes>(raw: &[L::Raw; DEPTH]) -> [L; DEPTH] {
    let mut column = [L::splat(0.0); DEPTH];
    for (x, raw) in column.iter_mut().zip(raw) {
        *x = L::from_raw(*raw);
    }
    column
}

/// `addend + x . y`
#[inline(always)]
fn dot<L: Lanes>(x: &[L; DEPTH], y: &[L; DEPTH], addend: L) -> L {
    let (mut even, mut odd) = (addend, x[1] * y[1]);
    for i in 0..DEPTH / 2 {
        even = x[2 * i].mul_add(y[2 * i], even);
        if i > 0 {
            odd = x[2 * i + 1].mul_add(y[2 * i + 1], odd);
        }
    }
    even + odd
}

/// The reflection that takes a column of the rows to the `head` above it.
#[inline(always)]
fn reflection<L: Lanes>(rows: &[L::Raw; DEPTH], head: &mut L::Raw) -> Reflection<L> {
    let zero = L::splat(0.0);
    let x = column::<L>(rows);
    let squares = dot(&x, &x, zero);
    let old = L::from_raw(*head);
    let norm = old.mul_add(old, squares).sqrt();
    // first = old - norm, without cancellation, and scale = 2 / (first² + squares). Nothing is reflected where there is
    // nothing to remove.
    let nothing = L::splat(NOTHING);
    let sum = old + norm;
    let first = nothing.if_less(squares, -(squares / sum), zero);
    let scale = nothing.if_less(squares, sum / (norm * squares), zero);
    *head = nothing.if_less(squares, norm, old).raw();
    Reflection { first, scale }
}

/// Reflections of two neighbouring columns, the first of which has passed over the second; and the product of what they
/// hold of the rows.
#[inline(always)]
fn pair<L: Lanes>(
    left: &[L::Raw; DEPTH],
    right: &mut [L::Raw; DEPTH],
    one_row: &mut [L::Raw],
    two_row: &mut [L::Raw],
) -> (Reflection<L>, Reflection<L>, L) {
    let one = reflection::<L>(left, &mut one_row[0]);
    let (x, mut y) = (column::<L>(left), column::<L>(right));
    let head = L::from_raw(one_row[1]);
    let share = -(dot(&x, &y, one.first * head) * one.scale);
    one_row[1] = one.first.mul_add(share, head).raw();
    for ((raw, y), x) in right.iter_mut().zip(&mut y).zip(&x) {
        *y = x.mul_add(share, *y);
        *raw = y.raw();
    }
    let two = reflection::<L>(right, &mut two_row[0]);
    (one, two, dot(&x, &y, L::splat(0.0)))
}

/// Both reflections over one column: of the rows, and of the two heads above them.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "what stays in registers")]
fn pass<L: Lanes>(
    x: &[L; DEPTH],
    y: &[L; DEPTH],
    one: Reflection<L>,
    two: Reflection<L>,
    both: L,
    raw: &mut [L::Raw; DEPTH],
    one_head: &mut L::Raw,
    two_head: &mut L::Raw,
) {
    let c = column::<L>(raw);
    let (h1, h2) = (L::from_raw(*one_head), L::from_raw(*two_head));
    // Both with the sign turned: the compiler would rather keep x and -x than subtract a product.
    let first = -(dot(x, &c, one.first * h1) * one.scale);
    // What the first leaves of the column, as the second sees it.
    let second = -(first.mul_add(both, dot(y, &c, two.first * h2)) * two.scale);
    *one_head = one.first.mul_add(first, h1).raw();
    *two_head = two.first.mul_add(second, h2).raw();
    for (((raw, c), x), y) in raw.iter_mut().zip(&c).zip(x).zip(y) {
        *raw = y.mul_add(second, x.mul_add(first, *c)).raw();
    }
}
