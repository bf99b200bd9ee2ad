//! What a column of a run spans: looked at once for everything that asks whether a channel is alive.

use dynid_core::lanes::{self, Kernel, Lanes, MOST_LANES};

/// Of every column of a matrix.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Extent {
    /// Smallest and largest number.
    pub lowest: Vec<f64>,
    /// Largest number.
    pub highest: Vec<f64>,
    /// Largest way from one row to the next.
    pub largest_step: Vec<f64>,
    /// Rows of the longest stretch of equal neighbours; 1 where there are none.
    pub longest_equal: Vec<f64>,
}

/// Extent of every column of `x` (n × width, row-major) with n > 0 finite rows.
#[must_use]
pub fn extent(x: &[f64], width: usize) -> Extent {
    lanes::run_narrow(Look { x, width })
}

struct Look<'a> {
    x: &'a [f64],
    width: usize,
}

impl Kernel for Look<'_> {
    type Output = Extent;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Extent {
        let mut found = Extent::default();
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        for first in (0..self.width).step_by(L::LEN) {
            let n = L::LEN.min(self.width - first);
            let start = L::load_some(self.x.get(first..first + n).unwrap_or(&[]));
            let (mut before, mut low, mut high) = (start, start, start);
            let (mut step, mut equal, mut longest) = (zero, one, one);
            for row in 1..self.x.len() / self.width {
                let at = row * self.width + first;
                // Columns beyond the last are the next row's: nobody looks at what comes of them.
                let here = match self.x.get(at..at + L::LEN) {
                    Some(row) => L::load(row),
                    None => L::load_some(&self.x[at..at + n]),
                };
                let way = (here - before).abs();
                before = here;
                low = low.at_most(here);
                high = high.at_least(here);
                step = step.at_least(way);
                equal = zero.if_less(way, one, equal + one);
                longest = longest.at_least(equal);
            }
            for (to, from) in [
                (&mut found.lowest, low),
                (&mut found.highest, high),
                (&mut found.largest_step, step),
                (&mut found.longest_equal, longest),
            ] {
                let mut numbers = [0.0; MOST_LANES];
                from.store(&mut numbers);
                to.extend_from_slice(&numbers[..n]);
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_is_seen_alone() {
        for width in [1, 3, 8, 11] {
            let n = 40;
            let number = |row: usize, c: usize| {
                let held = if c % 2 == 1 && (10..10 + 5 + c).contains(&row) {
                    10
                } else {
                    row
                };
                ((held * 37 + c * 11) % 17) as f64 - 8.0
            };
            let x: Vec<f64> = (0..n * width)
                .map(|i| number(i / width, i % width))
                .collect();
            let found = extent(&x, width);
            for c in 0..width {
                let column: Vec<f64> = (0..n).map(|row| number(row, c)).collect();
                let steps: Vec<f64> = column
                    .windows(2)
                    .map(|two| (two[1] - two[0]).abs())
                    .collect();
                assert_eq!(
                    found.lowest[c],
                    column.iter().copied().fold(f64::MAX, f64::min)
                );
                assert_eq!(
                    found.highest[c],
                    column.iter().copied().fold(f64::MIN, f64::max)
                );
                assert_eq!(
                    found.largest_step[c],
                    steps.iter().copied().fold(0.0, f64::max)
                );
                let longest = steps
                    .split(|way| *way > 0.0)
                    .map(<[f64]>::len)
                    .max()
                    .unwrap_or(0)
                    + 1;
                assert_eq!(found.longest_equal[c], longest as f64);
            }
        }
    }
}
