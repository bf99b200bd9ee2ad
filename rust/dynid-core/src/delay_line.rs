//! The state of a while ago: what a torque channel shows now that comes late against the encoders.

use crate::intake::state_of;
use crate::slices::{copy, mirror_fields, part, part_mut, Mirror};
use crate::state::State;

/// More rows than a delay may need; keeps a hostile file from asking for memory.
pub const MOST_DELAY_ROWS: usize = 4096;

/// Signals of motion in a row.
const SIGNALS: usize = 6;

/// The last states, in a ring that is taken at once and never grows.
#[derive(Clone, Debug)]
pub(crate) struct DelayLine {
    delay: f64,
    n: usize,
    /// As many rows of six signals as `apart` has values.
    rows: Vec<f64>,
    /// Time from the row before \[s\], of every row.
    apart: Vec<f64>,
    newest: usize,
    count: usize,
    /// Time since the newest row in which nothing could be kept \[s\].
    passed: f64,
    past: Vec<f64>,
}

/// Rows that hold `delay` \[s\] of states `step` \[s\] apart; `None` if they are more than [`MOST_DELAY_ROWS`].
#[must_use]
pub fn n_delay_rows(delay: f64, step: f64) -> Option<usize> {
    let steps = (delay.abs() / step).ceil();
    // Written so that a NaN is too many.
    (steps <= (MOST_DELAY_ROWS - 2) as f64).then_some(steps as usize + 2)
}

impl DelayLine {
    pub fn new(n: usize, delay: f64, n_rows: usize) -> Self {
        Self {
            delay,
            n,
            rows: vec![0.0; SIGNALS * n * n_rows],
            apart: vec![0.0; n_rows],
            newest: 0,
            count: 0,
            passed: 0.0,
            past: vec![0.0; SIGNALS * n],
        }
    }

    pub fn reset(&mut self) {
        (self.count, self.passed) = (0, 0.0);
    }

    /// `elapsed` seconds went by, and brought no state that can be kept.
    pub fn pass(&mut self, elapsed: f64) {
        self.passed += elapsed;
    }

    /// Keeps `state`, finite and `elapsed` seconds after the one before. True if states reach back far enough; until then
    /// the oldest one stands for what was before it.
    pub fn push(&mut self, state: &State<'_>, elapsed: f64) -> bool {
        self.newest = if self.newest + 1 < self.apart.len() {
            self.newest + 1
        } else {
            0
        };
        self.count = self.apart.len().min(self.count + 1);
        let (width, n) = (SIGNALS * self.n, self.n);
        let start = self.newest * width;
        for (k, (_, signal)) in state.signals().into_iter().enumerate() {
            copy(
                signal,
                part_mut(&mut self.rows, start + k * n, start + (k + 1) * n),
            );
        }
        if let Some(apart) = self.apart.get_mut(self.newest) {
            *apart = elapsed + self.passed;
        }
        self.passed = 0.0;
        self.look_back(width)
    }

    /// The state of `delay` ago into `past`, on the straight line between its neighbours.
    fn look_back(&mut self, width: usize) -> bool {
        let (mut at, mut age) = (self.newest, 0.0);
        for _ in 1..self.count {
            let before = if at == 0 {
                self.apart.len() - 1
            } else {
                at - 1
            };
            let older = age + self.apart.get(at).copied().unwrap_or(f64::NAN);
            if older >= self.delay {
                let weight = (self.delay - age) / (older - age);
                let row = |k: usize| part(&self.rows, k * width, (k + 1) * width);
                let pairs = row(at).iter().zip(row(before));
                for (past, (late, early)) in self.past.iter_mut().zip(pairs) {
                    *past = between(*late, *early, weight);
                }
                return true;
            }
            (at, age) = (before, older);
        }
        copy(
            part(&self.rows, at * width, (at + 1) * width),
            &mut self.past,
        );
        false
    }

    /// What [`Self::push`] found, with the temperature of now: it changes over minutes.
    pub fn past<'a>(&'a self, temperature: Option<&'a [f64]>) -> State<'a> {
        state_of(&self.past, self.n, temperature)
    }

    /// Takes over the states of another line of as many joints, the newest where not all have room.
    pub fn continue_from(&mut self, before: &Self) {
        self.reset();
        if before.n != self.n {
            return;
        }
        let width = SIGNALS * self.n;
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
        mirror_fields!(self, of; rows, apart, past; copied n, newest, count, passed; kept delay);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pushed(line: &mut DelayLine, x: f64, elapsed: f64) -> (f64, bool) {
        let row = [x];
        let full = line.push(&State::single(&row, &row, &row), elapsed);
        (line.past(None).q[0], full)
    }

    proptest! {
        /// Of a signal that grows evenly the line shows, at any step and through losses, the value of `delay` before.
        #[test]
        fn a_ramp_comes_late(delay in 1e-4..0.2f64, step in 1e-3..1e-2f64, lost in 1..5u8) {
            let rows = n_delay_rows(delay, step).unwrap();
            let mut line = DelayLine::new(1, delay, rows);
            let mut t = 0.0;
            for k in 0..(3 * rows) {
                let elapsed = if k % 7 == 3 { f64::from(lost) * step } else { step };
                t += if k == 0 { 0.0 } else { elapsed };
                let (past, full) = pushed(&mut line, t, elapsed);
                prop_assert_eq!(full, t >= delay * (1.0 - 1e-12) && k > 0);
                let expected = if full { t - delay } else { 0.0 };
                prop_assert!((past - expected).abs() < 1e-12, "{} {}", past, expected);
            }
        }
    }

    #[test]
    fn a_whole_number_of_steps_gives_the_state_itself() {
        let mut line = DelayLine::new(1, 0.5, n_delay_rows(0.5, 0.25).unwrap());
        let shown = [1.1, 2.3, 3.7, 5.9, 7.1].map(|x| pushed(&mut line, x, 0.25));
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
        let mut line = DelayLine::new(1, 0.5, n_delay_rows(0.5, 0.25).unwrap());
        pushed(&mut line, 0.0, 0.25);
        line.pass(0.25);
        line.pass(0.25);
        let (past, full) = pushed(&mut line, 0.75, 0.25);
        assert!(full);
        assert!((past - 0.25).abs() < 1e-15);
    }

    #[test]
    fn a_longer_or_shorter_line_goes_on_where_the_other_was() {
        for (own, other) in [(0.5, 0.125), (0.125, 0.5), (0.5, 0.5)] {
            let line = |delay| DelayLine::new(1, delay, n_delay_rows(delay, 0.125).unwrap());
            let (mut before, mut new) = (line(other), line(own));
            for k in 0..9 {
                pushed(&mut before, f64::from(k) * 0.125, 0.125);
            }
            new.continue_from(&before);
            let (past, full) = pushed(&mut new, 9.0 * 0.125, 0.125);
            // What the shorter line held is all there is.
            assert_eq!(full, own <= other);
            assert!(!full || past == 9.0 * 0.125 - own);
        }
    }

    #[test]
    fn no_delay_asks_for_more_memory_than_there_is() {
        assert_eq!(n_delay_rows(0.5, 1e-9), None);
        assert_eq!(n_delay_rows(f64::NAN, 1e-3), None);
        assert_eq!(n_delay_rows(-0.01, 1e-3), Some(12));
    }
}
