//! What a watch has learnt, as a row of numbers: it goes on with them after a restart.
//!
//! Only what was judged to its end is in them; the row in the making is lost with the program.

use super::frozen::{Channel, Spoken};
use super::judging::{LONGEST, SETTLED};
use super::solve::{LoadSums, PLACES};
use super::{Change, Kind, Phase, Said, Watch};
use crate::dynamics::check_length;
use crate::error::CoreError;

/// Sizes beyond it are those of no arm.
pub(super) const LARGEST: f64 = 1e100;

/// Numbers of a phase and of the change that it is about.
pub(super) const N_PHASE: usize = 11;

const KINDS: [Kind; 7] = [
    Kind::Friction,
    Kind::Gain,
    Kind::Offset,
    Kind::Load,
    Kind::Unknown,
    Kind::Delay,
    Kind::Slip,
];

/// What a number may be.
#[derive(Clone, Copy)]
pub(super) enum Range {
    Any,
    Positive,
    NotNegative,
    /// What has been said of a channel.
    Code,
}

impl Range {
    fn holds(self, x: f64) -> bool {
        match self {
            Self::Any => x.abs() <= LARGEST,
            Self::Positive => x > 0.0 && x <= LARGEST,
            Self::NotNegative => (0.0..=LARGEST).contains(&x),
            Self::Code => [0.0, 1.0, 2.0].contains(&x),
        }
    }
}

impl Watch {
    /// How many numbers it remembers.
    #[must_use]
    pub fn n_remembered(&self) -> usize {
        let of_tests: usize = self.tests.iter().map(|named| named.test.r.len() + 2).sum();
        let load = self.load_test.r.len() + LoadSums::N;
        let known = self.known.load.len() + self.known.variance.len();
        11 * self.memory.len() + known + of_tests + load + N_PHASE
    }

    /// Writes what it knows to `numbers` and says so; within a row that is being judged it does neither.
    ///
    /// # Errors
    /// [`CoreError`] if the length is not [`Self::n_remembered`].
    pub fn remember(&mut self, numbers: &mut [f64]) -> Result<bool, CoreError> {
        check_length("remembered", numbers, self.n_remembered())?;
        if self.next < self.tests.len() + PLACES.len() {
            return Ok(false);
        }
        let (phase, rest) = numbers.split_at_mut_checked(N_PHASE).unwrap_or_default();
        for (place, number) in phase.iter_mut().zip(numbers_of(&self.phase)) {
            *place = number;
        }
        let mut places = rest.iter_mut();
        self.each_number(|number, _| {
            if let Some(place) = places.next() {
                *place = *number;
            }
        });
        Ok(true)
    }

    /// Goes on with what a watch of the same model and settings remembered.
    ///
    /// # Errors
    /// [`CoreError`] if the length is wrong or a number is none that a watch remembers; the watch stays as it was.
    pub fn recall(&mut self, numbers: &[f64]) -> Result<(), CoreError> {
        const WRONG: CoreError = CoreError::Range { what: "remembered" };
        check_length("remembered", numbers, self.n_remembered())?;
        let (phase, rest) = numbers.split_at_checked(N_PHASE).unwrap_or_default();
        let phase = phase_of(phase, self.memory.len()).ok_or(WRONG)?;
        let (mut places, mut holds) = (rest.iter(), true);
        self.each_number(|_, range| holds &= places.next().is_some_and(|x| range.holds(*x)));
        if !holds {
            return Err(WRONG);
        }
        let mut places = rest.iter();
        self.each_number(|number, _| {
            if let Some(place) = places.next() {
                *number = *place;
            }
        });
        self.phase = phase;
        Ok(())
    }

    /// Every number but the phase's, always in the same order.
    pub(super) fn each_number(&mut self, mut each: impl FnMut(&mut f64, Range)) {
        let known = &mut self.known;
        let [friction, gain] = [&mut known.friction, &mut known.gain];
        let [offset, delay, slip] = [&mut known.offset, &mut known.delay, &mut known.slip];
        for sizes in [friction, gain, offset, delay, slip, &mut known.unknown] {
            sizes.iter_mut().for_each(|x| each(x, Range::Any));
        }
        known
            .variance
            .iter_mut()
            .for_each(|x| each(x, Range::NotNegative));
        known.load.iter_mut().for_each(|x| each(x, Range::Any));
        for scales in [&mut self.inflation, &mut self.deviation] {
            scales.iter_mut().for_each(|x| each(x, Range::Positive));
        }
        for channel in &mut self.channels.all {
            channel.each_number(&mut each);
        }
        for named in &mut self.tests {
            let sums = named.test.r.iter_mut();
            sums.for_each(|x| each(x, Range::NotNegative));
            each(&mut named.window.moment, Range::Any);
            each(&mut named.window.information, Range::Any);
        }
        let sums = self.load_test.r.iter_mut();
        sums.for_each(|x| each(x, Range::NotNegative));
        self.load.each_number(|x| each(x, Range::Any));
    }
}

impl Channel {
    /// What has been said of it, which value it shows, and for how long it has.
    fn each_number(&mut self, each: &mut impl FnMut(&mut f64, Range)) {
        let mut numbers = match self.spoken {
            Spoken::Nothing => [0.0; 3],
            Spoken::Named => [1.0, self.shown, self.time],
            Spoken::Settled => [2.0, self.shown, self.time],
        };
        let before = numbers;
        let ranges = [Range::Code, Range::Any, Range::NotNegative];
        for (number, range) in numbers.iter_mut().zip(ranges) {
            each(number, range);
        }
        if numbers != before {
            let [code, shown, time] = numbers;
            let spoken = match code {
                1.0 => Spoken::Named,
                2.0 => Spoken::Settled,
                _ => Spoken::Nothing,
            };
            *self = Self::recalled(spoken, shown, time);
        }
    }
}

/// Which phase, rows, and the change: kind, joint, size, deviation, moments, and what else it may be.
fn numbers_of(phase: &Phase) -> [f64; N_PHASE] {
    let index = |kind: Kind| KINDS.iter().position(|other| *other == kind).unwrap_or(0) as f64;
    let (code, rows, change) = match phase {
        Phase::Quiet => return [0.0; N_PHASE],
        Phase::Telling(rows) => (1.0, *rows, None),
        Phase::Settling(rows, change) => (2.0, *rows, Some(change)),
    };
    let none = [
        code,
        f64::from(rows),
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
    ];
    change.map_or(none, |change| {
        let [x, y, z] = change.moments;
        let (or, at) = change
            .or
            .map_or((-1.0, 0), |(kind, joint)| (index(kind), joint));
        let (kind, joint) = (index(change.kind), change.joint as f64);
        [
            code,
            f64::from(rows),
            kind,
            joint,
            change.size,
            change.std,
            x,
            y,
            z,
            or,
            at as f64,
        ]
    })
}

/// [`numbers_of`] backwards; none if there is no such phase on an arm of `n` joints.
fn phase_of(numbers: &[f64], n: usize) -> Option<Phase> {
    let numbers: &[f64; N_PHASE] = numbers.first_chunk()?;
    let [code, rows, kind, joint, size, std, x, y, z, or_kind, or_joint] = *numbers;
    let rows = whole(rows, LONGEST.max(SETTLED) as usize)? as u32;
    let joint_of = |x: f64| whole(x, n.checked_sub(1)?);
    let kind_of = |x: f64| KINDS.get(whole(x, KINDS.len())?).copied();
    match whole(code, 2)? {
        0 => Some(Phase::Quiet),
        1 => Some(Phase::Telling(rows)),
        _ => {
            let sizes = [size, std, x, y, z];
            let change = Change {
                kind: kind_of(kind)?,
                joint: joint_of(joint)?,
                size,
                std,
                moments: [x, y, z],
                said: Said::Named,
                or: match or_kind {
                    -1.0 => None,
                    other => Some((kind_of(other)?, joint_of(or_joint)?)),
                },
            };
            let holds = sizes.iter().all(|x| Range::Any.holds(*x));
            holds.then_some(Phase::Settling(rows, change))
        }
    }
}

/// A whole number from 0 to `most`.
fn whole(x: f64, most: usize) -> Option<usize> {
    let fits = (0.0..=most as f64).contains(&x) && x.fract() == 0.0;
    fits.then_some(x as usize)
}
