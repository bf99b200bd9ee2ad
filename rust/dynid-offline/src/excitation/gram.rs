//! Rows of the regressor as they come out of the lanes, and the Gram matrix of them.

use std::slice::ChunksExactMut;

use dynid_core::lanes::{self, Kernel, Lanes, MOST_LANES};

use crate::triangle::{total, Rows};

/// Columns of a square of the Gram matrix: its sums stay in registers.
const TILE: usize = 4;

/// Rows of one matrix: joint by joint, column by column, the samples in groups of eight; zeros where samples end and where a
/// joint does not move a column's link.
#[derive(Debug, Default)]
pub(super) struct LaneRows {
    numbers: Vec<Rows>,
    width: usize,
    n_groups: usize,
    n_samples: usize,
}

impl LaneRows {
    /// Memory for so many rows. What stands there is zero at first and is from the same places afterwards; another number
    /// of samples starts anew, for narrow lanes do not reach the last places of a group that is not full.
    pub(super) fn reserve(&mut self, n_joints: usize, width: usize, n_samples: usize) {
        let n_groups = n_samples.div_ceil(MOST_LANES);
        let length = n_joints * width * n_groups;
        if [self.width, self.n_samples, self.numbers.len()] != [width, n_samples, length] {
            self.numbers.clear();
            self.numbers.resize(length, [0.0; MOST_LANES]);
            (self.width, self.n_groups, self.n_samples) = (width, n_groups, n_samples);
        }
    }

    /// Column `c` in the rows of joint `j`.
    #[inline(always)]
    pub(super) fn column(&self, j: usize, c: usize) -> &[Rows] {
        let start = (j * self.width + c) * self.n_groups;
        &self.numbers[start..start + self.n_groups]
    }

    /// Columns from `c` on in the rows of joint `j`.
    #[inline(always)]
    pub(super) fn columns_from(&mut self, j: usize, c: usize) -> ChunksExactMut<'_, Rows> {
        let own = (j * self.width + c) * self.n_groups..(j + 1) * self.width * self.n_groups;
        self.numbers[own].chunks_exact_mut(self.n_groups)
    }

    /// Group `g` of column `c` in the rows of joint `j`.
    #[inline(always)]
    pub(super) fn at(&mut self, j: usize, c: usize, g: usize) -> &mut Rows {
        &mut self.numbers[(j * self.width + c) * self.n_groups + g]
    }

    /// (n_samples · n_joints) × width, row-major, sample by sample.
    pub(super) fn row_major(&self, n_samples: usize, n_joints: usize) -> Vec<f64> {
        let mut out = Vec::with_capacity(n_samples * n_joints * self.width);
        for k in 0..n_samples {
            for j in 0..n_joints {
                let row = (0..self.width).map(|c| self.column(j, c));
                out.extend(row.map(|column| column[k / MOST_LANES][k % MOST_LANES]));
            }
        }
        out
    }

    /// `W'W`, row-major, both triangles. `reach[c]`: joints, from the first on, whose rows column `c` may stand in; never
    /// falling.
    pub(super) fn gram(&self, reach: &[usize]) -> Vec<f64> {
        lanes::run(Gram { rows: self, reach })
    }
}

struct Gram<'a> {
    rows: &'a LaneRows,
    reach: &'a [usize],
}

impl Kernel for Gram<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Vec<f64> {
        let width = self.rows.width;
        let mut gram = vec![0.0; width * width];
        for a in (0..width).step_by(TILE) {
            for b in (a..width).step_by(TILE) {
                let tile = self.tile::<L>(a, b);
                for (i, row) in (a..width).zip(&tile) {
                    for (j, sums) in (b..width).zip(row) {
                        gram[i * width + j] = total(sums);
                        gram[j * width + i] = gram[i * width + j];
                    }
                }
            }
        }
        gram
    }
}

impl Gram<'_> {
    /// Products of the columns from `a` on with those from `b` on, summed lane by lane.
    #[inline(always)]
    fn tile<L: Lanes>(&self, a: usize, b: usize) -> [[Rows; TILE]; TILE] {
        let last = self.rows.width - 1;
        let mut tile = [[[0.0; MOST_LANES]; TILE]; TILE];
        for first in (0..MOST_LANES).step_by(L::LEN) {
            let mut sums = [[L::splat(0.0); TILE]; TILE];
            for j in 0..self.reach[(a + TILE - 1).min(last)] {
                // Beyond the last column it comes again, to nobody's use.
                let column = |c: usize| &self.rows.column(j, c.min(last))[..self.rows.n_groups];
                let [a0, a1, a2, a3] = [column(a), column(a + 1), column(a + 2), column(a + 3)];
                let [b0, b1, b2, b3] = [column(b), column(b + 1), column(b + 2), column(b + 3)];
                for g in 0..self.rows.n_groups {
                    let x = [
                        L::load(&a0[g][first..]),
                        L::load(&a1[g][first..]),
                        L::load(&a2[g][first..]),
                        L::load(&a3[g][first..]),
                    ];
                    let y = [
                        L::load(&b0[g][first..]),
                        L::load(&b1[g][first..]),
                        L::load(&b2[g][first..]),
                        L::load(&b3[g][first..]),
                    ];
                    for (sums, x) in sums.iter_mut().zip(x) {
                        for (sum, y) in sums.iter_mut().zip(y) {
                            *sum = x.mul_add(y, *sum);
                        }
                    }
                }
            }
            for (tile, sums) in tile.iter_mut().zip(&sums) {
                for (tile, sum) in tile.iter_mut().zip(sums) {
                    sum.store(&mut tile[first..]);
                }
            }
        }
        tile
    }
}
