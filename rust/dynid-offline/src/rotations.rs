//! Singular values of small matrices: rows are turned in pairs until all are orthogonal (Jacobi's method, one-sided), and
//! tall matrices are made orthonormal first. As good as any method for small values too, and short: the rest of a library of
//! linear algebra would weigh more than everything else here together.

use dynid_core::lanes::{self, Kernel, Lanes, MOST_LANES};

use crate::triangle::{product, subtract, Rows};

/// Rows whose angle's cosine is below this are orthogonal: what products of a hundred numbers round to.
const ORTHOGONAL: f64 = 1e-14;
/// Rounds over all pairs; seven to ten are usual, and each at least squares what is left near the end.
const MOST_ROUNDS: usize = 40;
/// Lengths squared up to here are nothing: their products would be no numbers.
const NOTHING: f64 = 1e-200;
/// A column of which less than this is left is a sum of earlier ones.
const DEPENDENT: f64 = 1e-13;

/// Singular values of a square matrix, largest first, and a unit left singular vector for each (as rows). Of a symmetric
/// matrix without negative eigenvalues: its eigenvalues and eigenvectors.
pub(crate) struct Singular {
    pub(crate) values: Vec<f64>,
    pub(crate) vectors: Vec<f64>,
}

/// Of `matrix` (n × n, row-major), which has to be finite.
pub(crate) fn singular(matrix: &[f64], n: usize) -> Singular {
    struct Turn<'a>(&'a [f64], usize);
    impl Kernel for Turn<'_> {
        type Output = Singular;

        #[inline(always)]
        fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Singular {
            turned::<L>(self.0, self.1)
        }
    }
    lanes::run(Turn(matrix, n))
}

#[inline(always)]
fn turned<L: Lanes>(matrix: &[f64], n: usize) -> Singular {
    let blocks = n.div_ceil(MOST_LANES);
    // Each row beside its row of the identity: whatever turns the one turns the other.
    let mut rows = vec![[0.0; MOST_LANES]; 2 * blocks * n];
    for (i, row) in rows.chunks_exact_mut(2 * blocks).enumerate() {
        let (own, turn) = row.split_at_mut(blocks);
        own.as_flattened_mut()[..n].copy_from_slice(&matrix[i * n..(i + 1) * n]);
        turn.as_flattened_mut()[i] = 1.0;
    }
    let mut squares = vec![0.0; n];
    for _ in 0..MOST_ROUNDS {
        for (row, square) in rows.chunks_exact(2 * blocks).zip(&mut squares) {
            *square = product::<L>(&row[..blocks], &row[..blocks]);
        }
        if !round::<L>(&mut rows, &mut squares, blocks) {
            break;
        }
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| squares[j].total_cmp(&squares[i]));
    let turn = |i: usize| &rows[(2 * i + 1) * blocks..(2 * i + 2) * blocks];
    Singular {
        values: order.iter().map(|&i| squares[i].sqrt()).collect(),
        vectors: order
            .iter()
            .flat_map(|&i| turn(i).as_flattened()[..n].iter().copied())
            .collect(),
    }
}

/// Every pair once; whether any had to be turned. `squares` are kept up roughly: a pair is only turned better for them.
#[inline(always)]
fn round<L: Lanes>(rows: &mut [Rows], squares: &mut [f64], blocks: usize) -> bool {
    let n = squares.len();
    let mut any = false;
    for i in 0..n {
        for j in i + 1..n {
            let (before, after) = rows.split_at_mut(2 * j * blocks);
            let one = &mut before[2 * i * blocks..][..2 * blocks];
            let two = &mut after[..2 * blocks];
            let (a, b) = (squares[i], squares[j]);
            let along = product::<L>(&one[..blocks], &two[..blocks]);
            if along.abs() <= (ORTHOGONAL * (a * b).max(0.0).sqrt()).max(NOTHING) {
                continue;
            }
            any = true;
            // The smaller of both angles that make them orthogonal.
            let slope = (b - a) / (2.0 * along);
            let tangent = (slope.abs() + slope.mul_add(slope, 1.0).sqrt())
                .recip()
                .copysign(slope);
            let cosine = tangent.mul_add(tangent, 1.0).sqrt().recip();
            turn::<L>(one, two, cosine, cosine * tangent);
            squares[i] = a - tangent * along;
            squares[j] = b + tangent * along;
        }
    }
    any
}

/// `(x, y) <- (cosine x - sine y, sine x + cosine y)`
#[inline(always)]
fn turn<L: Lanes>(x: &mut [Rows], y: &mut [Rows], cosine: f64, sine: f64) {
    let (cosine, sine, minus) = (L::splat(cosine), L::splat(sine), L::splat(-sine));
    for (x, y) in x.iter_mut().zip(y) {
        for first in (0..MOST_LANES).step_by(L::LEN) {
            let (old_x, old_y) = (L::load(&x[first..]), L::load(&y[first..]));
            old_x.mul_add(cosine, old_y * minus).store(&mut x[first..]);
            old_y.mul_add(cosine, old_x * sine).store(&mut y[first..]);
        }
    }
}

/// Orthonormal directions that span the columns of `rows` (m × width, row-major, finite), row-major, and how strong the
/// columns are along each, strongest first. Columns that are sums of others bring none.
pub(crate) fn orthonormal(rows: &[f64], width: usize) -> (Vec<f64>, Vec<f64>) {
    struct Orthonormal<'a>(&'a [f64], usize);
    impl Kernel for Orthonormal<'_> {
        type Output = (Vec<f64>, Vec<f64>);

        #[inline(always)]
        fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> (Vec<f64>, Vec<f64>) {
            directions::<L>(self.0, self.1)
        }
    }
    lanes::run(Orthonormal(rows, width))
}

#[inline(always)]
fn directions<L: Lanes>(rows: &[f64], width: usize) -> (Vec<f64>, Vec<f64>) {
    let m = rows.len() / width;
    let blocks = m.div_ceil(MOST_LANES);
    let mut columns = vec![[0.0; MOST_LANES]; blocks * width];
    for (c, column) in columns.chunks_exact_mut(blocks).enumerate() {
        let column = column.as_flattened_mut();
        for (to, row) in column.iter_mut().zip(rows.chunks_exact(width)) {
            *to = row[c];
        }
    }
    let triangle = gram_schmidt::<L>(&mut columns, blocks, width);
    let Singular { values, vectors } = turned::<L>(&triangle, width);
    let strongest = values.first().copied().unwrap_or(0.0);
    let rank = values
        .iter()
        .take_while(|value| **value > DEPENDENT * strongest)
        .count();
    let mut out = vec![0.0; m * rank];
    let mut sum = vec![[0.0; MOST_LANES]; blocks];
    for (k, vector) in vectors.chunks_exact(width).take(rank).enumerate() {
        sum.fill([0.0; MOST_LANES]);
        for (column, share) in columns.chunks_exact(blocks).zip(vector) {
            subtract::<L>(&mut sum, -share, column);
        }
        for (to, x) in out[k..].iter_mut().step_by(rank).zip(sum.as_flattened()) {
            *to = *x;
        }
    }
    (out, values[..rank].to_vec())
}

/// Makes the columns orthonormal, or zero where they depend on earlier ones, and gives the factor that takes them back.
/// Each passes the earlier ones twice, or what is left of it would not be orthogonal to them.
#[inline(always)]
fn gram_schmidt<L: Lanes>(columns: &mut [Rows], blocks: usize, width: usize) -> Vec<f64> {
    let mut factor = vec![0.0; width * width];
    for k in 0..width {
        let (done, rest) = columns.split_at_mut(k * blocks);
        let own = &mut rest[..blocks];
        let length = product::<L>(own, own).sqrt();
        for _ in 0..2 {
            for (i, other) in done.chunks_exact(blocks).enumerate() {
                let share = product::<L>(other, own);
                factor[i * width + k] += share;
                subtract::<L>(own, share, other);
            }
        }
        let left = product::<L>(own, own).sqrt();
        let dependent = left <= (DEPENDENT * length).max(NOTHING);
        let scale = if dependent { 0.0 } else { left.recip() };
        factor[k * width + k] = left * f64::from(!dependent);
        for x in own.as_flattened_mut() {
            *x *= scale;
        }
    }
    factor
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(n: usize, pace: f64) -> Vec<f64> {
        (0..n).map(|k| (k as f64 * pace + 0.3).sin()).collect()
    }

    fn dot(x: impl Iterator<Item = f64>, y: impl Iterator<Item = f64>) -> f64 {
        x.zip(y).map(|(x, y)| x * y).sum()
    }

    /// Products of all pairs of vectors against the identity's.
    fn assert_orthonormal(vectors: &[f64], length: usize) {
        for (i, x) in vectors.chunks_exact(length).enumerate() {
            for (j, y) in vectors.chunks_exact(length).enumerate() {
                let along = dot(x.iter().copied(), y.iter().copied());
                let expected = f64::from(u8::from(i == j));
                assert!((along - expected).abs() < 1e-13, "{i} {j} {along}");
            }
        }
    }

    #[test]
    fn eigenvectors_of_a_gram_matrix_put_it_together_again() {
        for n in [1, 2, 7, 8, 33, 60] {
            let rows = numbers(3 * n * n, 1.7);
            let column = |i: usize| rows[i..].iter().copied().step_by(n);
            let gram: Vec<f64> = (0..n * n)
                .map(|k| dot(column(k / n), column(k % n)))
                .collect();
            let Singular { values, vectors } = singular(&gram, n);
            assert_orthonormal(&vectors, n);
            assert!(values.is_sorted_by(|a, b| a >= b));
            for i in 0..n {
                for j in 0..n {
                    let again: f64 = (0..n)
                        .map(|k| values[k] * vectors[k * n + i] * vectors[k * n + j])
                        .sum();
                    let error = (again - gram[i * n + j]).abs();
                    assert!(error < 1e-13 * values[0], "{i} {j} {error}");
                }
            }
        }
    }

    #[test]
    fn columns_that_depend_on_others_bring_no_direction() {
        let (m, width) = (50, 5);
        let mut rows = numbers(m * width, 0.7);
        let wild: Vec<f64> = numbers(m * width, 31.1).iter().map(|x| x * x * x).collect();
        for (row, wild) in rows.chunks_exact_mut(width).zip(wild.chunks_exact(width)) {
            row[..3].copy_from_slice(&wild[..3]);
            row[3] = row[0] - 2.0 * row[1];
            row[4] = 0.0;
        }
        let (directions, strengths) = orthonormal(&rows, width);
        assert_eq!(strengths.len(), 3);
        let columns: Vec<f64> = (0..3)
            .flat_map(|k| directions[k..].iter().copied().step_by(3))
            .collect();
        assert_orthonormal(&columns, m);
        // What the columns hold is along the directions, and as much as the strengths say.
        let mut total = 0.0;
        for c in 0..width {
            let column = || rows[c..].iter().copied().step_by(width);
            let along: f64 = columns
                .chunks_exact(m)
                .map(|x| dot(column(), x.iter().copied()).powi(2))
                .sum();
            let whole = dot(column(), column());
            assert!((along - whole).abs() < 1e-12 * m as f64);
            total += whole;
        }
        let squares: f64 = strengths.iter().map(|s| s * s).sum();
        assert!((squares - total).abs() < 1e-12 * total);
    }

    #[test]
    fn nothing_has_no_directions() {
        let Singular { values, vectors } = singular(&[0.0; 9], 3);
        assert_eq!(values, [0.0; 3]);
        assert_orthonormal(&vectors, 3);
        assert_eq!(orthonormal(&[0.0; 12], 3), (Vec::new(), Vec::new()));
    }
}
