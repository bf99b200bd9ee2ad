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
    #[inline(always)]
    pub(crate) fn factor(&mut self) -> Vec<f64> {
        let width = self.width();
        let mut factor = vec![0.0; width * width];
        for k in 0..width {
            let (done, rest) = self.numbers.split_at_mut(self.begins[k + 1]);
            let own = &done[self.begins[k]..];
            let squares = product(own, own);
            if squares <= NOTHING {
                continue;
            }
            let (norm, inverse) = (squares.sqrt(), squares.recip());
            let row = &mut factor[k * width..(k + 1) * width];
            row[k] = norm;
            for c in k + 1..width {
                let begin = self.begins[c] - self.begins[k + 1];
                let other = &mut rest[begin..begin + own.len()];
                let share = product(own, other) * inverse;
                row[c] = share * norm;
                subtract(other, share, own);
            }
        }
        factor
    }
}

/// Inner product, the same on every processor.
#[inline(always)]
pub(crate) fn product(x: &[Rows], y: &[Rows]) -> f64 {
    let mut sums = [[0.0; MOST_LANES]; 2];
    let (mut left, mut right) = (x.chunks_exact(2), y.chunks_exact(2));
    for (x, y) in left.by_ref().zip(right.by_ref()) {
        for (half, sums) in sums.iter_mut().enumerate() {
            for (lane, sum) in sums.iter_mut().enumerate() {
                *sum += x[half][lane] * y[half][lane];
            }
        }
    }
    for (x, y) in left.remainder().iter().zip(right.remainder()) {
        for (lane, sum) in sums[0].iter_mut().enumerate() {
            *sum += x[lane] * y[lane];
        }
    }
    let [a, b] = sums;
    let mut four = [0.0; MOST_LANES / 2];
    for (lane, sum) in four.iter_mut().enumerate() {
        *sum = (a[lane] + b[lane]) + (a[lane + 4] + b[lane + 4]);
    }
    (four[0] + four[2]) + (four[1] + four[3])
}

/// `to -= share * x`
#[inline(always)]
pub(crate) fn subtract(to: &mut [Rows], share: f64, x: &[Rows]) {
    for (to, x) in to.iter_mut().zip(x) {
        for lane in 0..MOST_LANES {
            to[lane] -= share * x[lane];
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
            self.0.factor()
        }
    }
    lanes::run(Factor(Columns::of_rows(rows, width)))
}
