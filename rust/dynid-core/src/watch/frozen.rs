//! Torque channels that show the same value all the time, seen sample by sample.
//!
//! Values of a healthy channel repeat too: its steps are coarse, its noise is slow, or it is read more often than it is
//! measured. Healthy runs say how far the model's torque goes meanwhile, and how long a value lasts where it goes fast
//! ([`Repeats`]); what lasts a multiple of both while the arm moves (`Watch.fit` derives it from the false alarms that are
//! put up with) is no torque. Coarse steps last as long as the torque is slow, so that time alone tells them late.

use super::rows::Row;
use super::sequential::{Evidence, SequentialTest};
use super::{Change, Healthy, Kind, Phase, Said, Watch};
use crate::slices::{mirror_fields, Mirror};

/// No sample, however late, counts for more than this \[s\]: what a channel showed in between is not known.
const LATE: f64 = 0.01;

/// The model's torque is averaged over so long \[s\]: its noise goes no way, nor does friction that changes its sign with every
/// sample where a joint stands. A fifth of the least time after which a value is none; what it was before a value came is not
/// in it, as it would be of a filter's.
const MEAN: f64 = 0.01;

/// For as long a frozen channel is *named*, then *settled*, as other changes are \[rows\].
const SETTLED: f64 = super::judging::SETTLED as f64;

/// How values of a channel repeat while the arm moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Repeats {
    /// Values that were shown.
    pub n: u64,
    /// For how long all of them together \[s\].
    pub time: f64,
    /// The longest of those while which the model's torque went faster than it did on average \[s\].
    pub longest: f64,
    /// How far the model's torque went, at most, while one was shown \[torque unit\].
    pub way: f64,
}

/// What has been said of a channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Spoken {
    #[default]
    Nothing,
    Named,
    Settled,
}

/// The model's torque while the arm moves.
#[derive(Clone, Copy, Debug, Default)]
struct Going {
    /// The mean in the making: its sum, its samples and its time \[s\], and whether several values are shown meanwhile.
    sum: f64,
    n: u32,
    time: f64,
    is_of_several: bool,
    /// The mean before, how far they all went \[torque unit\], and in how long \[s\].
    before: Option<f64>,
    path: f64,
    since: f64,
}

impl Going {
    /// Takes a sample; the mean that it completes, and whether that is of one value.
    fn take(&mut self, torque: f64, moved: f64) -> Option<(f64, bool)> {
        self.sum += torque;
        self.n = self.n.saturating_add(1);
        self.time += moved;
        if self.time < MEAN {
            return None;
        }
        let (mean, is_of_one) = (self.sum / f64::from(self.n), !self.is_of_several);
        self.path += self.before.map_or(0.0, |before| (mean - before).abs());
        self.since += self.time;
        *self = Self {
            before: Some(mean),
            path: self.path,
            since: self.since,
            ..Self::default()
        };
        Some((mean, is_of_one))
    }

    /// Whether it has gone more slowly, on average, than such a way in such a time.
    fn is_slower_than(&self, way: f64, time: f64) -> bool {
        way * self.since > self.path * time
    }
}

/// One joint's.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Channel {
    /// The value, and whether there is one.
    pub shown: f64,
    is_there: bool,
    /// For how long it has been shown while the arm moves \[s\].
    pub time: f64,
    going: Going,
    /// The least and the greatest of the means of the model's torque meanwhile.
    range: Option<(f64, f64)>,
    pub spoken: Spoken,
    /// It has changed since, which is still to be said.
    is_over: bool,
    repeats: Repeats,
}

/// All channels.
#[derive(Clone, Debug)]
pub(super) struct Channels {
    pub all: Vec<Channel>,
    /// After how long a value is none, and how far the model's torque goes meanwhile.
    after: Vec<f64>,
    way: Vec<f64>,
    /// Time of motion after the name \[s\].
    settles: f64,
}

impl Channel {
    /// As it is recalled: without a value where nothing was said of it.
    pub fn recalled(spoken: Spoken, shown: f64, time: f64) -> Self {
        Self {
            shown,
            is_there: spoken != Spoken::Nothing,
            time,
            spoken,
            ..Self::default()
        }
    }

    /// Takes a sample: what is shown, what the model says, and how long after the one before, of which the arm moved `moved`.
    fn take(&mut self, shown: f64, predicted: f64, moved: f64) {
        if self.is_there && shown.to_bits() == self.shown.to_bits() {
            self.time += moved;
        } else {
            self.is_over |= self.spoken != Spoken::Nothing;
            if self.is_there && moved > 0.0 {
                self.time += moved;
                self.count();
                self.repeats.n = self.repeats.n.saturating_add(1);
                self.repeats.time += self.time;
            }
            (self.is_there, self.shown, self.time) = (true, shown, 0.0);
            (self.going.is_of_several, self.range) = (self.going.n > 0, None);
        }
        if moved > 0.0 {
            if let Some((mean, true)) = self.going.take(predicted, moved) {
                let (low, high) = self.range.unwrap_or((mean, mean));
                self.range = Some((low.min(mean), high.max(mean)));
            }
            // A value that the run ends with is one too.
            self.count();
        }
    }

    /// A value that has been shown for so long.
    fn count(&mut self) {
        let way = self.way();
        self.repeats.way = self.repeats.way.max(way);
        if self.going.is_slower_than(way, self.time) {
            self.repeats.longest = self.repeats.longest.max(self.time);
        }
    }

    /// How far the model's torque has gone while the value is shown.
    fn way(&self) -> f64 {
        self.range.map_or(0.0, |(low, high)| high - low)
    }
}

impl Channels {
    pub fn new(healthy: &Healthy, row: f64) -> Self {
        let n = healthy.frozen_after.len();
        Self {
            all: vec![Channel::default(); n],
            after: healthy.frozen_after.clone(),
            way: healthy.frozen_way.clone(),
            settles: SETTLED * row,
        }
    }

    pub fn repeats(&self) -> impl Iterator<Item = Repeats> + '_ {
        self.all.iter().map(|channel| channel.repeats)
    }

    /// Takes what the channels show, `elapsed` seconds after the sample before, beside the model's torque.
    pub fn take(&mut self, shown: &[f64], predicted: &[f64], elapsed: f64, moves: bool) {
        let moved = if moves { elapsed.min(LATE) } else { 0.0 };
        let samples = shown.iter().zip(predicted);
        for (channel, (shown, predicted)) in self.all.iter_mut().zip(samples) {
            channel.take(*shown, *predicted, moved);
        }
    }

    /// The next thing that is to be said, if any: a channel that does not change any more, or one that does again.
    pub fn say(&mut self) -> Option<Change> {
        let limits = self.after.iter().zip(&self.way);
        for (joint, (channel, (time, way))) in self.all.iter_mut().zip(limits).enumerate() {
            let said = if channel.is_over {
                (channel.is_over, channel.spoken) = (false, Spoken::Nothing);
                Said::Withdrawn
            } else {
                let goes_on = channel.time >= *time && channel.way() > *way;
                match channel.spoken {
                    Spoken::Nothing if goes_on => {
                        channel.spoken = Spoken::Named;
                        Said::Named
                    }
                    Spoken::Named if channel.time >= time + self.settles => {
                        channel.spoken = Spoken::Settled;
                        Said::Settled
                    }
                    _ => continue,
                }
            };
            return Some(change(joint, channel.shown, said));
        }
        None
    }

    /// A channel that shows no torque says nothing of the model.
    pub fn silence(&self, row: &mut Row) {
        for (moves, channel) in row.moves.iter_mut().zip(&self.all) {
            *moves &= channel.spoken == Spoken::Nothing;
        }
    }

    /// What stands.
    pub fn standing(&self) -> impl Iterator<Item = Change> + '_ {
        let channels = self.all.iter().enumerate();
        channels.filter_map(|(joint, channel)| match channel.spoken {
            Spoken::Nothing => None,
            Spoken::Named => Some(change(joint, channel.shown, Said::Named)),
            Spoken::Settled => Some(change(joint, channel.shown, Said::Settled)),
        })
    }
}

impl Watch {
    /// What a channel does that shows no torque. Rows that it is in already are forgotten.
    pub(super) fn say_frozen(&mut self) -> Option<Change> {
        let change = self.channels.say()?;
        if change.said == Said::Named {
            self.begin_anew(&change);
            if let Phase::Telling(_) = self.phase {
                self.phase = Phase::Quiet;
                for named in &mut self.tests {
                    named.test = SequentialTest::new();
                }
            }
            for named in &mut self.tests {
                if named.joint == change.joint || named.kind == Kind::Slip {
                    named.window = Evidence::default();
                }
            }
        }
        Some(change)
    }
}

fn change(joint: usize, shown: f64, said: Said) -> Change {
    Change {
        kind: Kind::Frozen,
        joint,
        size: shown,
        std: 0.0,
        moments: [0.0; 3],
        said,
        or: None,
    }
}

impl Mirror for Channels {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(self, of; all; copied settles; kept after, way);
    }
}
