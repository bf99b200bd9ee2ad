//! Two eigenvalues of a small symmetric matrix and their eigenvectors, without the others.
//!
//! Householder's tridiagonal form; Sturm's count of eigenvalues below eight points at a time, so that every pass takes a
//! bracket to a ninth; inverse iteration on the tridiagonal form, turned back by the reflections.

use dynid_core::lanes::{self, Kernel, Lanes, MOST_LANES};

use crate::triangle::{product, subtract, Rows};

/// Passes of eight points: a bracket shrinks below the last bit of its upper end.
const PASSES: usize = 18;

/// Pivots of a matrix of zeros: their reciprocals are finite.
const LEAST: f64 = 1e-200;

/// `d` on the diagonal, `e` beside it, and the reflections that led there: row k holds `v_k` with `1 - 2 v v' / v'v`.
pub(super) struct Tridiagonal {
    d: Vec<f64>,
    e: Vec<f64>,
    reflections: Vec<Rows>,
    blocks: usize,
}

impl Tridiagonal {
    /// Of a symmetric matrix (n × n, row-major, both triangles).
    pub(super) fn new(matrix: &[f64], n: usize) -> Self {
        struct Reduce<'a>(&'a [f64], usize);
        impl Kernel for Reduce<'_> {
            type Output = Tridiagonal;

            #[inline(always)]
            fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Tridiagonal {
                reduce::<L>(self.0, self.1)
            }
        }
        lanes::run(Reduce(matrix, n))
    }

    /// Eigenvalues number `wanted` from below. Where one is negative by rounding it comes out as zero: the matrix is a
    /// Gram matrix.
    pub(super) fn values(&self, wanted: [usize; 2]) -> [f64; 2] {
        struct Count<'a>(&'a Tridiagonal, [usize; 2]);
        impl Kernel for Count<'_> {
            type Output = [f64; 2];

            #[inline(always)]
            fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> [f64; 2] {
                sections::<L>(self.0, self.1)
            }
        }
        lanes::run(Count(self, wanted))
    }

    /// Unit eigenvector of an eigenvalue.
    pub(super) fn vector(&self, value: f64) -> Vec<f64> {
        let n = self.d.len();
        let size = self
            .d
            .iter()
            .chain(&self.e)
            .fold(0.0_f64, |a, b| a.max(b.abs()));
        let least = (f64::EPSILON * size).max(LEAST);
        let mut x = vec![1.0; n];
        // From a vector that is orthogonal to no eigenvector in practice, two steps reach rounding.
        for (i, x) in x.iter_mut().enumerate() {
            *x += 0.1 * (i as f64 * 2.4).sin();
        }
        for _ in 0..3 {
            self.solve_shifted(value, least, &mut x);
            let norm = x.iter().map(|x| x * x).sum::<f64>().sqrt();
            x.iter_mut().for_each(|x| *x /= norm);
        }
        for (k, v) in self.reflections.chunks_exact(self.blocks).enumerate().rev() {
            let v = &v.as_flattened()[..n];
            let squares: f64 = v[k + 1..].iter().map(|v| v * v).sum();
            if squares > 0.0 {
                let share: f64 = v.iter().zip(&x).map(|(v, x)| v * x).sum::<f64>() * 2.0 / squares;
                x.iter_mut().zip(v).for_each(|(x, v)| *x -= share * v);
            }
        }
        x
    }

    /// `(T - value) x = x` by elimination with exchanges; pivots are at least `least`, and x is scaled against overflow.
    fn solve_shifted(&self, value: f64, least: f64, x: &mut [f64]) {
        let n = x.len();
        // Row i after elimination: diagonal and two entries right of it.
        let mut rows = vec![[0.0; 3]; n];
        let entry = |i: usize| self.e.get(i).copied().unwrap_or(0.0);
        let mut now = [self.d[0] - value, entry(0), 0.0];
        for i in 0..n {
            if i + 1 < n {
                let below = [self.e[i], self.d[i + 1] - value, entry(i + 1)];
                let (mut upper, mut lower) = (now, below);
                if below[0].abs() > now[0].abs() {
                    (upper, lower) = (below, now);
                    x.swap(i, i + 1);
                }
                upper[0] = at_least(upper[0], least);
                let factor = lower[0] / upper[0];
                x[i + 1] -= factor * x[i];
                now = [
                    lower[1] - factor * upper[1],
                    lower[2] - factor * upper[2],
                    0.0,
                ];
                rows[i] = upper;
            } else {
                rows[i] = [at_least(now[0], least), 0.0, 0.0];
            }
        }
        for i in (0..n).rev() {
            let one = x.get(i + 1).copied().unwrap_or(0.0);
            let two = x.get(i + 2).copied().unwrap_or(0.0);
            x[i] = (x[i] - rows[i][1] * one - rows[i][2] * two) / rows[i][0];
        }
        let most = x.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        x.iter_mut().for_each(|x| *x /= most);
    }
}

/// `x`, or `least` with its sign where it is nearer to zero.
fn at_least(x: f64, least: f64) -> f64 {
    x.abs().max(least).copysign(x)
}

#[inline(always)]
fn reduce<L: Lanes>(matrix: &[f64], n: usize) -> Tridiagonal {
    let blocks = n.div_ceil(MOST_LANES);
    let mut a = vec![[0.0; MOST_LANES]; n * blocks];
    for (to, row) in a.chunks_exact_mut(blocks).zip(matrix.chunks_exact(n)) {
        to.as_flattened_mut()[..n].copy_from_slice(row);
    }
    let (mut d, mut e) = (vec![0.0; n], vec![0.0; n.saturating_sub(1)]);
    let mut reflections = vec![[0.0; MOST_LANES]; n.saturating_sub(2) * blocks];
    let mut p = vec![[0.0; MOST_LANES]; blocks];
    for k in 0..n {
        let (done, rest) = a.split_at_mut((k + 1) * blocks);
        let row = done[k * blocks..].as_flattened();
        d[k] = row[k];
        if k + 1 == n {
            break;
        }
        e[k] = row[k + 1];
        if k + 2 == n {
            continue;
        }
        // Blocks before the first one that is at work are zeros.
        let first = (k + 1) / MOST_LANES;
        let v = &mut reflections[k * blocks..(k + 1) * blocks];
        v.as_flattened_mut()[k + 1..n].copy_from_slice(&row[k + 1..n]);
        let v_own = &mut v[first..];
        let norm = product::<L>(v_own, v_own).sqrt().copysign(-e[k]);
        let head = (k + 1) % MOST_LANES;
        v_own[0][head] -= norm;
        let squares = product::<L>(v_own, v_own);
        if squares == 0.0 {
            continue;
        }
        e[k] = norm;
        let p = &mut p[first..];
        p.fill([0.0; MOST_LANES]);
        let factor = |at: usize| -2.0 / squares * v_own[at / MOST_LANES - first][at % MOST_LANES];
        let mut at = k + 1;
        let mut four = rest.chunks_exact(4 * blocks);
        for rows in &mut four {
            let row = |i: usize| &rows[i * blocks + first..(i + 1) * blocks];
            let factors = [factor(at), factor(at + 1), factor(at + 2), factor(at + 3)];
            subtract_each::<L, 4>(p, factors, [row(0), row(1), row(2), row(3)]);
            at += 4;
        }
        for row in four.remainder().chunks_exact(blocks) {
            subtract::<L>(p, factor(at), &row[first..]);
            at += 1;
        }
        // w = p - (p.v / v.v) v; A <- A - v w' - w v'.
        let share = product::<L>(p, v_own) / squares;
        subtract::<L>(p, share, v_own);
        for (i, row) in rest.chunks_exact_mut(blocks).enumerate() {
            let at = k + 1 + i;
            let (block, lane) = (at / MOST_LANES - first, at % MOST_LANES);
            let (v_i, w_i) = (v_own[block][lane], p[block][lane]);
            subtract_each::<L, 2>(&mut row[first..], [v_i, w_i], [p, v_own]);
        }
    }
    Tridiagonal {
        d,
        e,
        reflections,
        blocks,
    }
}

/// [`subtract`] of one after the other, to the same bits: what is left stays in a register meanwhile.
#[inline(always)]
fn subtract_each<L: Lanes, const N: usize>(to: &mut [Rows], shares: [f64; N], x: [&[Rows]; N]) {
    let n = to.len();
    let x = x.map(|x| &x[..n]);
    for (k, to) in to.iter_mut().enumerate() {
        for first in (0..MOST_LANES).step_by(L::LEN) {
            let mut left = L::load(&to[first..]);
            for (x, share) in x.iter().zip(shares) {
                left = L::load(&x[k][first..]).mul_add(L::splat(-share), left);
            }
            left.store(&mut to[first..]);
        }
    }
}

#[inline(always)]
fn sections<L: Lanes>(t: &Tridiagonal, wanted: [usize; 2]) -> [f64; 2] {
    let n = t.d.len();
    let beside = |i: usize| t.e.get(i).map_or(0.0, |e| e.abs());
    let mut upper = 0.0_f64;
    for i in 0..n {
        let before = if i > 0 { beside(i - 1) } else { 0.0 };
        upper = upper.max(t.d[i] + beside(i) + before);
    }
    let tiny = L::splat(f64::MIN_POSITIVE.max(upper * upper * 1e-300));
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let mut brackets = [[0.0, upper]; 2];
    for _ in 0..PASSES {
        let mut points = [[0.0; MOST_LANES]; 2];
        for (points, [low, high]) in points.iter_mut().zip(&brackets) {
            for (lane, x) in points.iter_mut().enumerate() {
                *x = low + (high - low) * ((lane + 1) as f64 / 9.0);
            }
        }
        let mut counts = [[0.0; MOST_LANES]; 2];
        for first in (0..MOST_LANES).step_by(L::LEN) {
            let x = [L::load(&points[0][first..]), L::load(&points[1][first..])];
            let (mut q, mut below) = ([one; 2], [zero; 2]);
            let mut square = zero;
            for i in 0..n {
                let d = L::splat(t.d[i]);
                for which in 0..2 {
                    let pivot = (d - x[which]) - square / q[which];
                    let pivot = pivot.abs().if_less(tiny, -tiny, pivot);
                    below[which] = below[which] + pivot.if_less(zero, one, zero);
                    q[which] = pivot;
                }
                if i + 1 < n {
                    square = L::splat(t.e[i] * t.e[i]);
                }
            }
            below[0].store(&mut counts[0][first..]);
            below[1].store(&mut counts[1][first..]);
        }
        for which in 0..2 {
            // The first point with more than `wanted` eigenvalues below it is the new upper end.
            let many = wanted[which] as f64;
            let place = counts[which]
                .iter()
                .take_while(|count| **count <= many)
                .count();
            let points = &points[which];
            let bracket = &mut brackets[which];
            let low = if place > 0 {
                points[place - 1]
            } else {
                bracket[0]
            };
            let high = if place < MOST_LANES {
                points[place]
            } else {
                bracket[1]
            };
            *bracket = [low, high];
        }
    }
    brackets.map(|[low, high]| 0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eigenvalues of the second difference are known: `2 - 2 cos(k pi / (n + 1))`; turned by a reflection, so that it is
    /// no tridiagonal matrix any more.
    #[test]
    fn ends_of_a_known_spectrum() {
        for n in [1_usize, 2, 3, 7, 8, 9, 36] {
            let u: Vec<f64> = (0..n).map(|i| 1.0 + (i as f64 * 0.7).cos()).collect();
            let squares: f64 = u.iter().map(|u| u * u).sum();
            let h = |i: usize, j: usize| f64::from(i == j) - 2.0 * u[i] * u[j] / squares;
            let t = |i: usize, j: usize| match i.abs_diff(j) {
                0 => 2.0,
                1 => -1.0,
                _ => 0.0,
            };
            let mut matrix = vec![0.0; n * n];
            for i in 0..n {
                for j in 0..n {
                    for (a, b) in (0..n).flat_map(|a| (0..n).map(move |b| (a, b))) {
                        matrix[i * n + j] += h(i, a) * t(a, b) * h(b, j);
                    }
                }
            }
            let exact =
                |k: usize| 2.0 - 2.0 * (k as f64 * std::f64::consts::PI / (n as f64 + 1.0)).cos();
            let reduced = Tridiagonal::new(&matrix, n);
            let found = reduced.values([n - 1, 0]);
            for (value, expected) in found.iter().zip([exact(n), exact(1)]) {
                assert!(
                    (value - expected).abs() < 1e-14 * n as f64,
                    "{n} {value} {expected}"
                );
                let vector = reduced.vector(*value);
                for (i, x) in vector.iter().enumerate() {
                    let product: f64 = (0..n).map(|j| matrix[i * n + j] * vector[j]).sum();
                    assert!((product - value * x).abs() < 1e-13, "{n} {i}");
                }
            }
        }
    }
}
