//! Does the model still hold? A sequential test per change that has a name, while the arm works.
//!
//! A row is the mean, over a fifth of a second, of what the model leaves of the measured torque, and of what each change
//! would add to it per unit: friction's own torque, the whole torque, one deviation, how fast the torque
//! falls, the torque of a mass at the last link, and of a position that is shown too far.
//! Means are linear, so a change adds the same to both. Rows in which a joint stands, or in which the arm leaves what the
//! model was trained on, say nothing. `sequential.rs` is the test and where its threshold comes from; `settings.rs` what is
//! tolerated. A change that has been named is taken off from then on, so that the next one can be seen beside it. Torque channels
//! that stand still are no changes of the model, and are seen in the samples: `frozen.rs`.

mod changes;
mod frozen;
mod judging;
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
use crate::slices::{mirror_fields, Mirror};
pub use changes::{Change, Said};
use frozen::Channels;
pub use frozen::Repeats;
use known::Known;
use rows::{Row, Rows};
use sequential::{Evidence, SequentialTest, SIZES};
pub use settings::{Healthy, Kind, WatchSettings};
use solve::{LoadSums, PLACES};

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
