//! What a watch says: a change by its name, with its size, and what became of it.

use super::settings::Kind;

/// Half of an interval of 95 % over its standard deviation.
pub(super) const INTERVAL: f64 = 1.96;

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

/// Whether what is left of a joint is another one with a change.
pub(super) fn touches(change: &Change, joint: usize) -> bool {
    of_arm(change.kind) || change.joint == joint
}

/// Whether a change shows on all joints.
pub(super) fn of_arm(kind: Kind) -> bool {
    matches!(kind, Kind::Load | Kind::Slip)
}
