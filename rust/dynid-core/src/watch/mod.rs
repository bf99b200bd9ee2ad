//! Does the model still hold? A sequential test per change that has a name, while the arm works.
//!
//! A row is the mean, over a fifth of a second, of what the model leaves of the measured torque, and of what each change
//! would add to it per unit: friction's own torque, the whole torque, one deviation, how fast the torque
//! falls, the torque of a mass at the last link, and of a position that is shown too far.
//! Means are linear, so a change adds the same to both. Rows in which a joint stands, or in which the arm leaves what the
//! model was trained on, say nothing. `sequential.rs` is the test and where its threshold comes from; `settings.rs` what is
//! tolerated. A change that has been named is taken off from then on, so that the next one can be seen beside it. Torque channels
//! that stand still are no changes of the model, and are seen in the samples: `frozen.rs`.

mod frozen;
mod known;
mod naming;
mod remembered;
pub(crate) mod rows;
mod sequential;
mod settings;
mod solve;

use std::sync::Arc;

use crate::dynamics::check_length;
use crate::error::CoreError;
use crate::estimator::TorqueEstimator;
use crate::model::{check_step, TorqueModel};
use crate::slices::{at, mirror_fields, rows as rows_of, set, Mirror};
use frozen::Channels;
pub use frozen::Repeats;
use known::Known;
use rows::{Row, Rows};
use sequential::{log_ratio, log_ratio_of_deviation, step, Evidence, SequentialTest, GROWN, SIZES};
pub use settings::{Healthy, Kind, WatchSettings};
use solve::{mass_in, LoadSums, PLACES};

/// A name has to be this much likelier than any other for the same joints: 19 to 1.
const SURE: f64 = 2.944_438_979_166_440_3;

/// Half of an interval of 95 % over its standard deviation.
const INTERVAL: f64 = 1.96;

/// Rows after the first test has passed before a name is given: a cause on several joints is not the first that shows.
const LEAST_ROWS: u32 = 5;

/// Rows in which names that are nearly as likely have to part; then the likeliest is told with the next.
const PATIENCE: u32 = 25;

/// Rows after which something that may be tolerated or not is let go.
const LONGEST: u32 = 200;

/// Rows after a name that its size does not go by, so that what has passed by then is seen to; then rows in which it settles.
const PASSING: u32 = 25;
const SETTLED: u32 = PASSING + 75;

/// A load is weighed for longer, [`LONGEST`] rows at most, while its interval is more than this part of its mass to either side:
/// it is for a controller to be told.
const ROUGH: f64 = 0.05;

/// A change that was named.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// What has changed.
    pub kind: Kind,
    /// On which joint; a load is on all, and has the last.
    pub joint: usize,
    /// By how much, in the unit that [`Kind`] says; of a frozen channel what it shows.
    pub size: f64,
    /// Standard deviation of the size.
    pub std: f64,
    /// Of a load, its first moments in the last link's frame \[kg m\].
    pub moments: [f64; 3],
    /// Whether it was named just now, or what became of it.
    pub said: Said,
    /// What else it may be, on which joint, if the data do not tell yet.
    pub or: Option<(Kind, usize)>,
}

impl Change {
    /// Where the size lies with 95 %.
    #[must_use]
    pub fn interval(&self) -> [f64; 2] {
        let half = INTERVAL * self.std;
        [self.size - half, self.size + half]
    }
}

/// A change is said twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Said {
    /// It was named just now.
    Named,
    /// Its size has settled, and is taken for granted from now on.
    Settled,
    /// It has passed, or turned out to be as small as what is tolerated.
    Withdrawn,
}

impl Said {
    /// In files and reports.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Named => "named",
            Self::Settled => "settled",
            Self::Withdrawn => "withdrawn",
        }
    }
}

/// The test of a change on one joint.
#[derive(Clone, Copy, Debug)]
struct Named {
    kind: Kind,
    joint: usize,
    tolerated: f64,
    test: SequentialTest<{ SIZES.len() }>,
    /// What rows have said since the alarm.
    window: Evidence,
}

/// What a watch is about.
#[derive(Clone, Copy, Debug)]
enum Phase {
    /// Nothing has passed its threshold.
    Quiet,
    /// Something has, so many rows ago: what is it?
    Telling(u32),
    /// It was named, so many rows ago: how large is it?
    Settling(u32, Change),
}

/// The test of a load.
type LoadTest = SequentialTest<{ SIZES.len() * PLACES.len() }>;

/// Watches one arm. All memory is taken in `new`.
#[derive(Clone, Debug)]
pub struct Watch {
    settings: WatchSettings,
    threshold: f64,
    rows: Rows,
    /// Variance of a joint's rows over what the model expects, and how many are worth an independent one.
    inflation: Vec<f64>,
    memory: Vec<f64>,
    /// What a joint's rows usually leave \[torque unit\].
    deviation: Vec<f64>,
    known: Known,
    channels: Channels,
    /// The row that is being judged, which test comes next (those of a load's places last), and whether one has passed.
    row: Row,
    next: usize,
    passed: bool,
    per_step: usize,
    tests: Vec<Named>,
    load_test: LoadTest,
    /// Of the rows since the alarm.
    load: LoadSums,
    phase: Phase,
    n_rows: u64,
}

impl Watch {
    /// # Errors
    /// [`CoreError`] if a setting is none, the model expects no error, or [`Healthy::check`] refuses what healthy runs say.
    pub fn new(
        model: Arc<TorqueModel>,
        settings: WatchSettings,
        healthy: &Healthy,
    ) -> Result<Self, CoreError> {
        settings.check()?;
        let n = model.robot().n_joints();
        healthy.check(n)?;
        if !model.noise_std().iter().all(|std| *std > 0.0) {
            return Err(CoreError::Range { what: "noise_std" });
        }
        let usual = model.noise_std().iter().zip(&healthy.inflation);
        let deviation = usual.map(|(std, more)| std * more.sqrt()).collect();
        let own = [
            (Kind::Friction, settings.friction),
            (Kind::Gain, settings.gain),
            (Kind::Offset, settings.offset),
            (Kind::Delay, settings.delay),
            (Kind::Slip, settings.slip),
            (Kind::Unknown, settings.unknown),
        ];
        let test = |kind, joint, tolerated| Named {
            kind,
            joint,
            tolerated,
            test: SequentialTest::new(),
            window: Evidence::default(),
        };
        let tests: Vec<_> = (0..n)
            .flat_map(|j| own.map(|(kind, tolerated)| test(kind, j, tolerated)))
            .collect();
        Ok(Self {
            threshold: settings.threshold(settings::n_tests(n)),
            rows: Rows::new(model, settings.row, healthy.least_speed.clone()),
            inflation: healthy.inflation.clone(),
            memory: healthy.memory.clone(),
            deviation,
            known: Known::new(n),
            channels: Channels::new(healthy, settings.row),
            row: Row::new(n),
            next: tests.len() + PLACES.len(),
            passed: false,
            per_step: 1,
            tests,
            load_test: LoadTest::new(),
            load: LoadSums::default(),
            phase: Phase::Quiet,
            n_rows: 0,
            settings,
        })
    }

    /// Rows that were finished, and of the last one what was left less what was named before \[torque unit\], the variance that
    /// the model expects, and which joints say something; n values each.
    #[must_use]
    pub fn row(&self) -> (u64, &[f64], &[f64], &[bool]) {
        (
            self.n_rows,
            &self.row.left,
            &self.row.variance,
            &self.row.moves,
        )
    }

    /// Mean speeds of that row (n) \[rad/s, m/s\].
    #[must_use]
    pub fn row_speed(&self) -> &[f64] {
        &self.row.speed
    }

    /// What does not hold now: what has settled, put together by kind and joint, and what was named and is still open.
    pub fn standing(&self) -> impl Iterator<Item = Change> + '_ {
        let open = match self.phase {
            Phase::Settling(_, change) => Some(change),
            Phase::Quiet | Phase::Telling(_) => None,
        };
        self.known.all().chain(self.channels.standing()).chain(open)
    }

    /// How values of the torque channels repeat, joint by joint: what a frozen channel is known by where runs are healthy.
    pub fn repeats(&self) -> impl Iterator<Item = Repeats> + '_ {
        self.channels.repeats()
    }

    /// How it watches.
    #[must_use]
    pub fn settings(&self) -> &WatchSettings {
        &self.settings
    }

    /// Takes the sample that `estimator` has just answered, with the torque that was measured at it (n values
    /// \[torque unit\]), the last one that came as it came (`shown`, the same where nothing is filtered), `elapsed` seconds
    /// after the one before; says what has changed when it is sure. Of a sample that is not `good` (not a state that the model
    /// was trained on) the whole row says nothing.
    ///
    /// # Errors
    /// [`CoreError`] if a length is wrong, the estimator has another number of joints, or the time is not positive.
    pub fn step(
        &mut self,
        estimator: &TorqueEstimator,
        tau: &[f64],
        shown: &[f64],
        elapsed: f64,
        good: bool,
    ) -> Result<Option<Change>, CoreError> {
        check_step(elapsed)?;
        check_length("tau", shown, self.memory.len())?;
        let (mut named, n_tests) = (None, self.tests.len() + PLACES.len());
        let is_full = self.rows.is_full();
        if is_full {
            named = self.judge(n_tests);
            let fine = self.known.has_load() || !matches!(self.phase, Phase::Quiet);
            self.rows.finish(&mut self.row, fine)?;
            self.per_step = 2 * n_tests / self.row.n.max(1) as usize + 1;
            self.known.take_off(&mut self.row);
            self.n_rows += 1;
            (self.next, self.passed) = (0, false);
        }
        let is_busy = self.rows.take(estimator, tau, elapsed, good)? || is_full;
        // Tests wait for samples at which nothing else is evaluated, but in the second half of a row, which has room for all of
        // them, for none: what is known is remembered between two rows only.
        let waits = is_busy && self.per_step == 1 && self.rows.is_young();
        let named = named.or(if waits {
            None
        } else {
            self.judge(self.per_step)
        });
        let moves = self.rows.any_moves(estimator);
        self.channels.take(shown, estimator.total(), elapsed, moves);
        // Two things are said one after the other.
        let named = named.or_else(|| self.say_frozen());
        self.channels.silence(self.rows.sums_mut());
        Ok(named)
    }

    /// Runs up to `most` of the tests that the row has not been through; after the last one says what has changed.
    fn judge(&mut self, most: usize) -> Option<Change> {
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
                        self.begin_anew(&change);
                        self.phase = Phase::Quiet;
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
        if now.joint != before.joint {
            self.begin_anew(&before);
        }
        now
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

    fn begin_anew(&mut self, change: &Change) {
        self.passed = false;
        self.load_test = LoadTest::new();
        for named in &mut self.tests {
            if named.kind == Kind::Slip || touches(change, named.joint) {
                named.test = SequentialTest::new();
            }
        }
    }
}

/// Whether what is left of a joint is another one with a change.
fn touches(change: &Change, joint: usize) -> bool {
    of_arm(change.kind) || change.joint == joint
}

/// Whether a change shows on all joints.
fn of_arm(kind: Kind) -> bool {
    matches!(kind, Kind::Load | Kind::Slip)
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

impl Mirror for Watch {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(
            self, of;
            rows, inflation, memory, deviation, known, channels, row, tests;
            copied settings, threshold, next, passed, per_step, load_test, load, phase, n_rows;
            kept
        );
    }
}

#[cfg(test)]
mod tests;
