//! Small dense QR in lanes: eight rows of a column side by side.
//!
//! Modified Gram and Schmidt. To the factor it is Householder's method on the rows with zeros above them (Björck), so R is as
//! good; Q is not kept. Rows are sorted by their leading zeros, which no step fills: column k then ends before the first
//! row that starts behind it, and a stack of triangles or of blocks costs what its entries are worth.

use dynid_core::lanes::{self, Kernel, Lanes, MOST_LANES};

/// Eight rows of a column.
pub(crate) type Rows = [f64; MOST_LANES];

/// Sums of squares up to here are nothing: their reciprocals would be infinite.
const NOTHING: f64 = 1e-200;

/// Columns that are freed of another one together.
const TILE: usize = 4;

/// A matrix by columns.
pub(crate) struct Columns {
    numbers: Vec<Rows>,
    /// Where column k begins; one more for the end. Longer from column to column.
    begins: Vec<usize>,
}

impl Columns {
    /// Zeros; column k has `8 * lengths(k)` rows, no fewer than the one before.
    pub(crate) fn zeros(lengths: impl Iterator<Item = usize>) -> Self {
        let mut begins = vec![0];
        let mut end = 0;
        for length in lengths {
            end += length;
            begins.push(end);
        }
        Self {
            numbers: vec![[0.0; MOST_LANES]; end],
            begins,
        }
    }

    /// Of `rows` (m × width, row-major), sorted by where they begin.
    pub(crate) fn of_rows(rows: &[f64], width: usize) -> Self {
        let leading = |row: &[f64]| row.iter().take_while(|x| **x == 0.0).count();
        let leads: Vec<usize> = rows.chunks_exact(width).map(leading).collect();
        // Counting sort: which rows stay in the order they came in.
        let mut next = vec![0_usize; width + 1];
        for lead in &leads {
            next[*lead] += 1;
        }
        let mut before = 0_usize;
        for count in &mut next {
            (*count, before) = (before, before + *count);
        }
        let ends = (0..width).map(|k| next.get(k + 1).map_or(before, |start| *start));
        let mut columns = Self::zeros(ends.map(|end| end.div_ceil(MOST_LANES)));
        for (row, lead) in rows.chunks_exact(width).zip(leads) {
            let place = next[lead];
            next[lead] += 1;
            for (x, begin) in row.iter().zip(&columns.begins).skip(lead) {
                columns.numbers[begin + place / MOST_LANES][place % MOST_LANES] = *x;
            }
        }
        columns
    }

    pub(crate) fn width(&self) -> usize {
        self.begins.len() - 1
    }

    /// Rows of column k.
    #[inline(always)]
    pub(crate) fn column(&mut self, k: usize) -> &mut [Rows] {
        &mut self.numbers[self.begins[k]..self.begins[k + 1]]
    }

    /// Triangular factor, width × width, row-major, with non-negative diagonal. The columns are used up.
    ///
    /// A few columns at a time are freed of all that are done, so that these come from far away once for all of them.
    #[inline(always)]
    pub(crate) fn factor<L: Lanes>(&mut self) -> Vec<f64> {
        self.factor_above::<L>(NOTHING)
    }

    /// [`Self::factor`], in which columns whose sums of squares are at most `nothing` once they are freed of those before
    /// them count as zero: their rows are zeros.
    #[inline(always)]
    pub(crate) fn factor_above<L: Lanes>(&mut self, nothing: f64) -> Vec<f64> {
        let width = self.width();
        let mut factor = vec![0.0; width * width];
        let mut inverses = vec![0.0; width];
        for first in (0..width).step_by(TILE) {
            let (done, tile) = self.numbers.split_at_mut(self.begins[first]);
            let begins = &self.begins[first..=width.min(first + TILE)];
            for k in 0..first {
                let own = &done[self.begins[k]..self.begins[k + 1]];
                let (norm, inverse) = (factor[k * width + k], inverses[k]);
                if inverse == 0.0 {
                    continue;
                }
                let row = &mut factor[k * width + first..(k + 1) * width];
                if begins.len() == TILE + 1 {
                    let mut shares = products::<L>(own, tile, begins);
                    for (share, to) in shares.iter_mut().zip(row) {
                        *share *= inverse;
                        *to = *share * norm;
                    }
                    subtract_all::<L>(own, shares, tile, begins);
                } else {
                    for (begin, to) in begins[..begins.len() - 1].iter().zip(row) {
                        let begin = begin - begins[0];
                        let other = &mut tile[begin..begin + own.len()];
                        let share = product::<L>(own, other) * inverse;
                        *to = share * norm;
                        subtract::<L>(other, share, own);
                    }
                }
            }
            for k in first..width.min(first + TILE) {
                let (own, rest) = tile.split_at_mut(self.begins[k + 1] - self.begins[first]);
                let own = &own[self.begins[k] - self.begins[first]..];
                let squares = product::<L>(own, own);
                if squares <= nothing {
                    continue;
                }
                let (norm, inverse) = (squares.sqrt(), squares.recip());
                inverses[k] = inverse;
                let row = &mut factor[k * width..(k + 1) * width];
                row[k] = norm;
                let others = row.iter_mut().enumerate().take(first + TILE).skip(k + 1);
                for (c, to) in others {
                    let begin = self.begins[c] - self.begins[k + 1];
                    let other = &mut rest[begin..begin + own.len()];
                    let share = product::<L>(own, other) * inverse;
                    *to = share * norm;
                    subtract::<L>(other, share, own);
                }
            }
        }
        factor
    }
}

/// [`product`] of `x` with as many rows of every column of a tile that begin at `begins`; the same bits.
#[inline(always)]
fn products<L: Lanes>(x: &[Rows], tile: &[Rows], begins: &[usize]) -> [f64; TILE] {
    let mut sums = [[0.0; MOST_LANES]; TILE];
    let at = |c: usize| &tile[begins[c] - begins[0]..][..x.len()];
    let columns: [&[Rows]; TILE] = [at(0), at(1), at(2), at(3)];
    for first in (0..MOST_LANES).step_by(L::LEN) {
        let (mut even, mut odd) = ([L::splat(0.0); TILE], [L::splat(0.0); TILE]);
        let mut k = 0;
        while k + 1 < x.len() {
            let (here, next) = (L::load(&x[k][first..]), L::load(&x[k + 1][first..]));
            for c in 0..TILE {
                even[c] = here.mul_add(L::load(&columns[c][k][first..]), even[c]);
                odd[c] = next.mul_add(L::load(&columns[c][k + 1][first..]), odd[c]);
            }
            k += 2;
        }
        if k < x.len() {
            let here = L::load(&x[k][first..]);
            for c in 0..TILE {
                even[c] = here.mul_add(L::load(&columns[c][k][first..]), even[c]);
            }
        }
        for c in 0..TILE {
            (even[c] + odd[c]).store(&mut sums[c][first..]);
        }
    }
    let mut products = [0.0; TILE];
    for (product, sums) in products.iter_mut().zip(&sums) {
        *product = total(sums);
    }
    products
}

/// [`subtract`] from as many rows of every column of a tile that begin at `begins`; the same bits.
#[inline(always)]
fn subtract_all<L: Lanes>(x: &[Rows], shares: [f64; TILE], tile: &mut [Rows], begins: &[usize]) {
    let n = x.len();
    let (one, rest) = tile.split_at_mut(begins[1] - begins[0]);
    let (two, rest) = rest.split_at_mut(begins[2] - begins[1]);
    let (three, four) = rest.split_at_mut(begins[3] - begins[2]);
    let columns: [&mut [Rows]; TILE] = [
        &mut one[..n],
        &mut two[..n],
        &mut three[..n],
        &mut four[..n],
    ];
    let mut minus = [L::splat(0.0); TILE];
    for (minus, share) in minus.iter_mut().zip(shares) {
        *minus = L::splat(-share);
    }
    for k in 0..n {
        for first in (0..MOST_LANES).step_by(L::LEN) {
            let own = L::load(&x[k][first..]);
            for c in 0..TILE {
                let to = &mut columns[c][k][first..];
                own.mul_add(minus[c], L::load(to)).store(to);
            }
        }
    }
}

/// Inner product; on every processor that fuses to the same bits.
#[inline(always)]
pub(crate) fn product<L: Lanes>(x: &[Rows], y: &[Rows]) -> f64 {
    let mut sums = [0.0; MOST_LANES];
    for first in (0..MOST_LANES).step_by(L::LEN) {
        let (mut even, mut odd) = (L::splat(0.0), L::splat(0.0));
        let (mut left, mut right) = (x.chunks_exact(2), y.chunks_exact(2));
        for (x, y) in left.by_ref().zip(right.by_ref()) {
            even = L::load(&x[0][first..]).mul_add(L::load(&y[0][first..]), even);
            odd = L::load(&x[1][first..]).mul_add(L::load(&y[1][first..]), odd);
        }
        for (x, y) in left.remainder().iter().zip(right.remainder()) {
            even = L::load(&x[first..]).mul_add(L::load(&y[first..]), even);
        }
        (even + odd).store(&mut sums[first..]);
    }
    total(&sums)
}

/// Sum over the lanes.
#[inline(always)]
pub(crate) fn total(sums: &Rows) -> f64 {
    let [a, b, c, d, e, f, g, h] = sums;
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}

/// `to -= share * x`
#[inline(always)]
pub(crate) fn subtract<L: Lanes>(to: &mut [Rows], share: f64, x: &[Rows]) {
    let share = L::splat(-share);
    for (to, x) in to.iter_mut().zip(x) {
        for first in (0..MOST_LANES).step_by(L::LEN) {
            let left = L::load(&x[first..]).mul_add(share, L::load(&to[first..]));
            left.store(&mut to[first..]);
        }
    }
}

/// Triangular factor of `rows` (m × width, row-major) in one piece.
pub(crate) fn factor_once(rows: &[f64], width: usize) -> Vec<f64> {
    struct Factor(Columns);
    impl Kernel for Factor {
        type Output = Vec<f64>;

        #[inline(always)]
        fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(mut self) -> Vec<f64> {
            self.0.factor::<L>()
        }
    }
    lanes::run(Factor(Columns::of_rows(rows, width)))
}
