//! Samples of one motion that are differentiated together.

use crate::differentiator::Differentiator;
use crate::error::CoreError;
use crate::online::{Sample, N_CHANNELS};
use crate::slices::{mirror_fields, rows, Mirror};

/// A sample longer after the one before it does not count more than this many steps.
pub(crate) const MOST_STEPS: u64 = 1000;

/// So many samples that go on from each other are believed against any number that they contradict.
const BELIEVED: usize = 3;

/// What became of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Taken {
    /// It cannot follow from the one before it, and was not taken.
    Jump,
    /// It is a whole window after the one before it, and was not taken.
    Over,
    /// It was taken, but the window holds too little for an answer.
    Settling,
    /// There is an answer.
    Answer,
}

/// A window with the clock of what is in it.
#[derive(Clone, Debug)]
pub(crate) struct Track {
    pub filter: Differentiator,
    /// Which signals the samples have; another set begins a new track.
    pub present: [bool; N_CHANNELS],
    /// Time of the newest sample \[s\], the sender's, or counted.
    pub time: f64,
    sequence: Option<u64>,
}

impl Track {
    pub fn new(filter: Differentiator) -> Self {
        Self {
            filter,
            present: [false; N_CHANNELS],
            time: 0.0,
            sequence: None,
        }
    }

    /// Forgets what came, for samples with these signals.
    pub fn begin(&mut self, present: [bool; N_CHANNELS]) {
        self.filter.reset();
        self.present = present;
    }

    /// The time of the next sample, where samples are usually `step` seconds apart.
    pub fn go_on(&mut self, sample: &Sample<'_>, step: f64) {
        let ahead = match (sample.sequence, self.sequence) {
            (Some(number), Some(before)) => number.wrapping_sub(before),
            _ => 1,
        };
        self.time = if sample.time.is_finite() {
            sample.time
        } else {
            self.time + ahead.clamp(1, MOST_STEPS) as f64 * step
        };
        self.sequence = sample.sequence;
    }

    /// Takes a row of channels, unless a position is farther from the one before than `most_speed` of its joint reaches.
    pub fn take(&mut self, row: &[f64], most_speed: &[f64]) -> Result<Taken, CoreError> {
        if let Some((time, newest)) = self.filter.newest() {
            let elapsed = self.time - time;
            // Longer than the window: the old position says nothing. Written so that a NaN is too long.
            if !(elapsed > 0.0 && elapsed < 2.0 * self.filter.delay()) {
                return Ok(Taken::Over);
            }
            if jumps(row, newest, most_speed, elapsed) {
                return Ok(Taken::Jump);
            }
        }
        Ok(if self.filter.push(self.time, row)? {
            Taken::Answer
        } else {
            Taken::Settling
        })
    }

    /// The same, beginning again where that is needed for the row to be taken.
    pub fn take_anew(&mut self, row: &[f64], most_speed: &[f64]) -> Result<Taken, CoreError> {
        let taken = self.take(row, most_speed)?;
        if !matches!(taken, Taken::Jump | Taken::Over) {
            return Ok(taken);
        }
        self.filter.reset();
        self.take(row, most_speed)
    }

    /// True if this is enough to be believed.
    pub fn is_believed(&self) -> bool {
        self.filter.n_samples() >= BELIEVED
    }
}

/// True if a position of either side is too far from the one `elapsed` seconds before to follow from it.
fn jumps(row: &[f64], before: &[f64], most_speed: &[f64], elapsed: f64) -> bool {
    let n = most_speed.len();
    let mut positions = rows(row, n).zip(rows(before, n)).step_by(3).take(2);
    positions.any(|(now, before)| {
        let mut joints = now.iter().zip(before).zip(most_speed);
        joints.any(|((now, before), most)| (now - before).abs() > most * elapsed)
    })
}

impl Mirror for Track {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(self, of; filter; copied present, time, sequence; kept);
    }
}
