//! What was a while ago: what a torque channel shows now that comes late against the encoders.

use crate::slices::{at, copy, mirror_fields, part, part_mut, Mirror};

/// More rows than a delay may need; keeps a hostile file from asking for memory.
pub const MOST_DELAY_ROWS: usize = 4096;

/// More numbers than the terms of a delay may need, 32 MB, for the same reason.
pub const MOST_DELAY_VALUES: usize = 4_000_000;

/// The last rows of `width` numbers, in a ring that is taken at once and never grows.
#[derive(Clone, Debug)]
pub(crate) struct DelayLine {
    width: usize,
    /// As many rows as `apart` has values.
    rows: Vec<f64>,
    /// Time from the row before \[s\], of every row.
    apart: Vec<f64>,
    newest: usize,
    count: usize,
    /// Time since the newest row in which nothing could be kept \[s\].
    passed: f64,
}

/// Where a while ago lies in a line: between two of its rows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Past {
    late: usize,
    early: usize,
    weight: f64,
    /// False if rows do not reach back far enough yet; the oldest one stands for what was before it.
    pub reached: bool,
}

/// Rows that hold `delay` \[s\] of states `step` \[s\] apart; `None` if they are more than [`MOST_DELAY_ROWS`].
#[must_use]
pub fn n_delay_rows(delay: f64, step: f64) -> Option<usize> {
    let steps = (delay.abs() / step).ceil();
    // Written so that a NaN is too many.
    (steps <= (MOST_DELAY_ROWS - 2) as f64).then_some(steps as usize + 2)
}

/// What all of `delays` \[s\] have together, at least `lead`, and what each has beyond that: of what comes before its time
/// nobody knows more than is known `lead` (zero or negative) ahead.
#[must_use]
pub fn shared_and_own(delays: &[f64], lead: f64) -> (f64, Vec<f64>) {
    let mut own: Vec<f64> = delays.iter().map(|delay| delay.max(lead)).collect();
    let shared = own.iter().copied().fold(f64::INFINITY, f64::min);
    for delay in &mut own {
        *delay -= shared;
    }
    (shared, own)
}

impl DelayLine {
    pub fn new(width: usize, n_rows: usize) -> Self {
        Self {
            width,
            rows: vec![0.0; width * n_rows],
            apart: vec![0.0; n_rows],
            newest: 0,
            count: 0,
            passed: 0.0,
        }
    }

    pub fn reset(&mut self) {
        (self.count, self.passed) = (0, 0.0);
    }

    /// `elapsed` seconds went by, and brought nothing that can be kept.
    pub fn pass(&mut self, elapsed: f64) {
        self.passed += elapsed;
    }

    /// Keeps a row, all of its finite `parts` under each other, `elapsed` seconds after the one before.
    pub fn push<'a>(&mut self, parts: impl IntoIterator<Item = &'a [f64]>, elapsed: f64) {
        self.newest = if self.newest + 1 < self.apart.len() {
            self.newest + 1
        } else {
            0
        };
        self.count = self.apart.len().min(self.count + 1);
        let mut start = self.newest * self.width;
        for values in parts {
            copy(
                values,
                part_mut(&mut self.rows, start, start + values.len()),
            );
            start += values.len();
        }
        if let Some(apart) = self.apart.get_mut(self.newest) {
            *apart = elapsed + self.passed;
        }
        self.passed = 0.0;
    }

    /// Where the time of `delay` before the newest row lies.
    pub fn look_back(&self, delay: f64) -> Past {
        let (mut late, mut age) = (self.newest, 0.0);
        for _ in 1..self.count {
            let early = if late == 0 {
                self.apart.len() - 1
            } else {
                late - 1
            };
            let older = age + at(&self.apart, late);
            if older >= delay {
                return Past {
                    late,
                    early,
                    weight: (delay - age) / (older - age),
                    reached: true,
                };
            }
            (late, age) = (early, older);
        }
        Past {
            late,
            early: late,
            weight: 0.0,
            reached: false,
        }
    }

    /// Value `k` of a row then, on the straight line between its neighbours.
    pub fn value(&self, past: Past, k: usize) -> f64 {
        let of = |row: usize| at(&self.rows, row * self.width + k);
        between(of(past.late), of(past.early), past.weight)
    }

    /// The whole row then.
    pub fn row_into(&self, past: Past, row: &mut [f64]) {
        let of = |row: usize| part(&self.rows, row * self.width, (row + 1) * self.width);
        let pairs = of(past.late).iter().zip(of(past.early));
        for (x, (late, early)) in row.iter_mut().zip(pairs) {
            *x = between(*late, *early, past.weight);
        }
    }

    /// Takes over the rows of another line of the same width, the newest where not all have room.
    pub fn continue_from(&mut self, before: &Self) {
        self.reset();
        if before.width != self.width {
            return;
        }
        let width = self.width;
        let kept = before.count.min(self.apart.len());
        for k in 0..kept {
            // From the oldest that has room to the newest, which comes to lie in the last of `kept` rows.
            let back = kept - 1 - k;
            let from = if before.newest >= back {
                before.newest - back
            } else {
                before.newest + before.apart.len() - back
            };
            let source = part(&before.rows, from * width, (from + 1) * width);
            copy(source, part_mut(&mut self.rows, k * width, (k + 1) * width));
            if let (Some(to), Some(apart)) = (self.apart.get_mut(k), before.apart.get(from)) {
                *to = *apart;
            }
        }
        (self.count, self.passed) = (kept, before.passed);
        self.newest = kept.saturating_sub(1);
    }
}

/// On the straight line from `one` (weight 0) to `other` (weight 1); either end to the last bit.
#[must_use]
pub fn between(one: f64, other: f64, weight: f64) -> f64 {
    (1.0 - weight) * one + weight * other
}

impl Mirror for DelayLine {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(self, of; rows, apart; copied width, newest, count, passed; kept);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What a line of `delay` shows once `x` has come, both as one value and as a row.
    fn pushed(line: &mut DelayLine, delay: f64, x: f64, elapsed: f64) -> (f64, bool) {
        line.push([&[x][..]], elapsed);
        let past = line.look_back(delay);
        let mut row = [0.0];
        line.row_into(past, &mut row);
        assert_eq!(row[0], line.value(past, 0));
        (row[0], past.reached)
    }

    proptest! {
        /// Of a signal that grows evenly the line shows, at any step and through losses, the value of `delay` before.
        #[test]
        fn a_ramp_comes_late(delay in 1e-4..0.2f64, step in 1e-3..1e-2f64, lost in 1..5u8) {
            let rows = n_delay_rows(delay, step).unwrap();
            let mut line = DelayLine::new(1, rows);
            let mut t = 0.0;
            for k in 0..(3 * rows) {
                let elapsed = if k % 7 == 3 { f64::from(lost) * step } else { step };
                t += if k == 0 { 0.0 } else { elapsed };
                let (past, full) = pushed(&mut line, delay, t, elapsed);
                prop_assert_eq!(full, t >= delay * (1.0 - 1e-12) && k > 0);
                let expected = if full { t - delay } else { 0.0 };
                prop_assert!((past - expected).abs() < 1e-12, "{} {}", past, expected);
            }
        }
    }

    #[test]
    fn a_whole_number_of_steps_gives_the_state_itself() {
        let mut line = DelayLine::new(1, n_delay_rows(0.5, 0.25).unwrap());
        let shown = [1.1, 2.3, 3.7, 5.9, 7.1].map(|x| pushed(&mut line, 0.5, x, 0.25));
        assert_eq!(
            shown,
            [
                (1.1, false),
                (1.1, false),
                (1.1, true),
                (2.3, true),
                (3.7, true)
            ]
        );
    }

    #[test]
    fn time_that_brought_nothing_counts() {
        let mut line = DelayLine::new(1, n_delay_rows(0.5, 0.25).unwrap());
        pushed(&mut line, 0.5, 0.0, 0.25);
        line.pass(0.25);
        line.pass(0.25);
        let (past, full) = pushed(&mut line, 0.5, 0.75, 0.25);
        assert!(full);
        assert!((past - 0.25).abs() < 1e-15);
    }

    #[test]
    fn a_longer_or_shorter_line_goes_on_where_the_other_was() {
        for (own, other) in [(0.5, 0.125), (0.125, 0.5), (0.5, 0.5)] {
            let line = |delay| DelayLine::new(1, n_delay_rows(delay, 0.125).unwrap());
            let (mut before, mut new) = (line(other), line(own));
            for k in 0..9 {
                pushed(&mut before, other, f64::from(k) * 0.125, 0.125);
            }
            new.continue_from(&before);
            let (past, full) = pushed(&mut new, own, 9.0 * 0.125, 0.125);
            // What the shorter line held is all there is.
            assert_eq!(full, own <= other);
            assert!(!full || past == 9.0 * 0.125 - own);
        }
    }

    /// Early channels are as early as is known ahead, and late ones as late beside them.
    #[test]
    fn what_delays_have_together_is_told_from_what_each_has() {
        let delays = [0.003, -0.002, 0.0];
        for (lead, shared, own) in [
            (0.0, 0.0, [0.003, 0.0, 0.0]),
            (-0.002, -0.002, [0.005, 0.0, 0.002]),
        ] {
            assert_eq!(shared_and_own(&delays, lead), (shared, own.to_vec()));
        }
        let same = shared_and_own(&[0.004; 2], 0.0);
        assert_eq!(same, (0.004, vec![0.0; 2]));
    }

    #[test]
    fn no_delay_asks_for_more_memory_than_there_is() {
        assert_eq!(n_delay_rows(0.5, 1e-9), None);
        assert_eq!(n_delay_rows(f64::NAN, 1e-3), None);
        assert_eq!(n_delay_rows(-0.01, 1e-3), Some(12));
    }
}
