//! What rows say: every test goes on, the likeliest name is told, its size settles.

use super::changes::touches;
use super::rows::Row;
use super::sequential::{
    log_ratio, log_ratio_of_deviation, step, Evidence, SequentialTest, GROWN, SIZES,
};
use super::solve::{mass_in, LoadSums, PLACES};
use super::{Change, Kind, LoadTest, Phase, Said, Watch};
use crate::slices::{at, rows as rows_of, set};

/// A name has to be this much likelier than any other for the same joints: 19 to 1.
pub(super) const SURE: f64 = 2.944_438_979_166_440_3;

/// Rows after the first test has passed before a name is given: a cause on several joints is not the first that shows.
const LEAST_ROWS: u32 = 5;

/// Rows in which names that are nearly as likely have to part; then the likeliest is told with the next.
const PATIENCE: u32 = 25;

/// Rows after which something that may be tolerated or not is let go.
pub(super) const LONGEST: u32 = 200;

/// Rows after a name that its size does not go by, so that what has passed by then is seen to; then rows in which it settles.
const PASSING: u32 = 25;
pub(super) const SETTLED: u32 = PASSING + 75;

/// A load is weighed for longer, [`LONGEST`] rows at most, while its interval is more than this part of its mass to either side:
/// it is for a controller to be told.
pub(super) const ROUGH: f64 = 0.05;

impl Watch {
    /// Runs up to `most` of the tests that the row has not been through; after the last one says what has changed.
    pub(super) fn judge(&mut self, most: usize) -> Option<Change> {
        let (first, n_tests) = (self.next, self.tests.len() + PLACES.len());
        if first >= n_tests {
            return None;
        }
        self.next = first.saturating_add(most);
        let row = &self.row;
        let is_quiet = matches!(self.phase, Phase::Quiet);
        for named in self.tests.iter_mut().skip(first).take(most) {
            // One that has passed while something else was settled, too.
            self.passed |= is_quiet && named.test.mean() > self.threshold;
            let (j, tolerated) = (named.joint, named.tolerated);
            let variance = at(&row.variance, j) * at(&self.inflation, j);
            let memory = at(&self.memory, j);
            let weight = weight(variance, memory, row.moves.get(j) == Some(&true));
            if weight == 0.0 && named.kind != Kind::Slip {
                continue;
            }
            let left = at(&row.left, j);
            let per_unit = match named.kind {
                Kind::Friction => at(&row.friction, j),
                Kind::Gain => at(&row.torque, j),
                Kind::Delay => at(&row.late, j),
                _ => at(&self.deviation, j),
            };
            let mut seen = Evidence {
                moment: weight * per_unit * left,
                information: weight * per_unit * per_unit,
            };
            if named.kind == Kind::Slip {
                let columns = rows_of(&row.slip, row.left.len()).nth(j);
                seen = of_all_joints(row, columns.unwrap_or(&[]), &self.inflation, &self.memory);
            }
            let mut ratios = SIZES.map(|size| log_ratio(size, tolerated, seen));
            if named.kind == Kind::Slip {
                // What is told by all joints together is not what each of them may have: an error that has grown a little.
                let least = 1.0 + self.settings.unknown;
                ratios = ratios.map(|ratio| ratio / (least * least));
            }
            if named.kind == Kind::Unknown {
                let square = left * left / variance;
                let of_size = |size| log_ratio_of_deviation(size, tolerated, square, memory);
                ratios = GROWN.map(of_size);
                seen = Evidence {
                    moment: square / memory,
                    information: 1.0 / memory,
                };
            }
            match self.phase {
                Phase::Quiet => {
                    named.test.step(ratios);
                    self.passed |= named.test.mean() > self.threshold;
                }
                Phase::Telling(_) => named.window.add(seen),
                Phase::Settling(_, change) => {
                    named.window.add(seen);
                    if named.kind != Kind::Slip && !touches(&change, j) {
                        named.test.step(ratios);
                    }
                }
            }
        }
        let places = first.max(self.tests.len())..self.next.min(n_tests);
        for place in places {
            self.judge_load(place - self.tests.len());
        }
        if self.next < n_tests {
            return None;
        }
        self.go_on()
    }

    /// The test of a load in one of [`PLACES`]; once something has passed the row is added in the first place's turn.
    fn judge_load(&mut self, place: usize) {
        let row = &self.row;
        let variances = row.variance.iter().zip(&self.inflation);
        let weights = variances.zip(&self.memory).zip(&row.moves);
        let weights = weights.map(|(((v, more), m), moves)| weight(v * more, *m, *moves));
        if !matches!(self.phase, Phase::Quiet) {
            if place == 0 {
                self.load.add_row(&row.load, &row.left, weights);
            }
            return;
        }
        let (tests, _) = self.load_test.r.as_chunks_mut::<{ SIZES.len() }>();
        if let (Some(r), Some(centre)) = (tests.get_mut(place), PLACES.get(place)) {
            let seen = mass_in(*centre, &row.load, &row.left, weights);
            step(
                r,
                SIZES.map(|size| log_ratio(size, self.settings.load, seen)),
            );
        }
    }

    /// Alarm, name, size: one after the other. An arm that stands says nothing, and no time passes.
    fn go_on(&mut self) -> Option<Change> {
        if !self.row.moves.iter().any(|moves| *moves) {
            return None;
        }
        match self.phase {
            Phase::Quiet => {
                if self.passed || self.load_test.mean() > self.threshold {
                    self.begin_window();
                    self.phase = Phase::Telling(0);
                }
                None
            }
            Phase::Telling(rows) => {
                let rows = rows.saturating_add(1);
                self.phase = Phase::Telling(rows);
                let (change, lead) = self.likeliest();
                let is_open = self.may_be_tolerated(&change);
                let is_told = lead > SURE && change.kind != Kind::Unknown && !is_open;
                if rows < if is_told { LEAST_ROWS } else { PATIENCE } {
                    return None;
                }
                // What is tolerated after all was passing by, and observers are for that; what may be either takes longer.
                if is_open {
                    if self.is_tolerated(&change, change.size.abs()) || rows >= LONGEST {
                        self.let_go(&change);
                    }
                    return None;
                }
                self.phase = Phase::Settling(0, change);
                Some(change)
            }
            Phase::Settling(rows, change)
                if rows < SETTLED || (rows < LONGEST && self.is_rough(&change)) =>
            {
                if rows == PASSING {
                    self.begin_window();
                }
                self.phase = Phase::Settling(rows.saturating_add(1), change);
                None
            }
            Phase::Settling(_, before) => {
                self.phase = Phase::Quiet;
                Some(self.settle(before))
            }
        }
    }

    /// What a change is, and how large, by the rows since it had time to pass.
    fn settle(&mut self, before: Change) -> Change {
        let mut now = self.sized(before);
        if before.kind != Kind::Unknown {
            let (likeliest, _) = self.likeliest();
            if likeliest.kind != Kind::Unknown {
                now = likeliest;
            }
        }
        now.said = if self.may_be_tolerated(&now) {
            Said::Withdrawn
        } else {
            Said::Settled
        };
        if now.said == Said::Settled {
            self.take_up(&now);
        } else {
            self.begin_anew(&now);
        }
        if (now.kind, now.joint) != (before.kind, before.joint) {
            self.begin_anew(&before);
        }
        now
    }

    /// What passed by is judged: whichever tests it had set off begin anew, for the window spoke of all of them.
    fn let_go(&mut self, change: &Change) {
        self.begin_anew(change);
        for named in &mut self.tests {
            if named.test.mean() > self.threshold {
                named.test = SequentialTest::new();
            }
        }
        self.phase = Phase::Quiet;
    }

    fn begin_window(&mut self) {
        self.load = LoadSums::default();
        for named in &mut self.tests {
            named.window = Evidence::default();
        }
    }

    /// From now on the change is a part of what is expected, and its joints begin anew.
    fn take_up(&mut self, change: &Change) {
        if change.kind == Kind::Unknown {
            let j = change.joint;
            let grown = (1.0 + change.size) * (1.0 + change.size);
            let now = at(&self.inflation, j) * grown.max(1.0);
            set(&mut self.inflation, j, now);
        }
        self.known.add(change, &self.solved_load().sizes);
        self.begin_anew(change);
    }

    pub(super) fn begin_anew(&mut self, change: &Change) {
        self.passed = false;
        self.load_test = LoadTest::new();
        for named in &mut self.tests {
            if named.kind == Kind::Slip || touches(change, named.joint) {
                named.test = SequentialTest::new();
            }
        }
    }
}

/// What a row says of a change of which all joints have a column.
fn of_all_joints(row: &Row, columns: &[f64], inflation: &[f64], memory: &[f64]) -> Evidence {
    let variances = row.variance.iter().zip(inflation).zip(memory);
    let joints = columns.iter().zip(&row.left).zip(&row.moves).zip(variances);
    let mut seen = Evidence::default();
    for (((column, left), moves), ((variance, more), memory)) in joints {
        let weight = weight(variance * more, *memory, *moves);
        seen.add(Evidence {
            moment: weight * column * left,
            information: weight * column * column,
        });
    }
    seen
}

/// Weight of a row: nothing where its joint stands.
fn weight(variance: f64, memory: f64, moves: bool) -> f64 {
    if moves && variance > 0.0 {
        1.0 / (variance * memory)
    } else {
        0.0
    }
}
