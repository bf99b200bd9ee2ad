//! Which change it is, and how large: by the rows since the alarm, on which no test was decided.
//!
//! A name is as probable as the data are with a change of a usual size of its kind, less what a name costs. A load or a slip
//! explains all joints at once; the best names of single joints together are its rival. A name that does not take half of what is left
//! off is none. A change is one only if its interval lies beyond what is tolerated.

use super::changes::{of_arm, INTERVAL};
use super::judging::{ROUGH, SURE};
use super::sequential::Evidence;
use super::solve::{Solved, REACH};
use super::{Change, Kind, Named, Said, Watch};
use crate::slices::at;

/// Usual size of a change over what is tolerated.
const USUAL: f64 = 4.0;

/// Sizes of a change beforehand that are compared, over the usual one.
const WIDTHS: [f64; 3] = [1.0, 4.0, 16.0];

/// A name takes at least this part of what is left above the usual off: else something else is there.
const EXPLAINED: f64 = 0.5;

impl Watch {
    /// The likeliest name for what the window holds, and by how much it is likelier than any other.
    ///
    /// A load or a slip explains all joints at once; the best names of single joints, each for what a name costs, are its rival.
    pub(super) fn likeliest(&self) -> (Change, f64) {
        let cost = (self.tests.len() as f64).ln();
        let last = self.memory.len().saturating_sub(1);
        let mut apart = 0.0;
        let (mut best, mut second) = ((Kind::Unknown, 0, 0.0), f64::NEG_INFINITY);
        let mut or = None;
        for joint in 0..=last {
            let (own, value, next, runner_up) = self.best_of(joint);
            apart += (value - cost).max(0.0);
            if value - cost > best.2 {
                best = (own, joint, value - cost);
                second = next - cost;
                or = Some((runner_up, joint));
            }
        }
        let (arm, other) = self.best_of_arm(last);
        let whole = arm.2 - cost;
        let (found, lead, or) = if whole > apart && whole > 0.0 {
            let or = if other.2 - cost > apart {
                (other.0, other.1)
            } else {
                (best.0, best.1)
            };
            let lead = whole - apart.max(other.2 - cost);
            ((arm.0, arm.1), lead, Some(or))
        } else {
            let rival = second.max(whole - apart + best.2);
            let or = if second >= rival {
                or
            } else {
                Some((arm.0, arm.1))
            };
            ((best.0, best.1), best.2 - rival, or)
        };
        let (kind, joint) = if found.0 == Kind::Unknown || !self.explains(found) {
            (Kind::Unknown, self.most_unlike())
        } else {
            found
        };
        let change = self.sized(Change {
            kind,
            joint,
            size: 0.0,
            std: 0.0,
            moments: [0.0; 3],
            said: Said::Named,
            or: or.filter(|(other, _)| {
                lead < SURE && kind != Kind::Unknown && *other != Kind::Unknown
            }),
        });
        (change, lead)
    }

    /// Of the names that explain all joints at once the likeliest and the next, with the logarithms of their evidence.
    fn best_of_arm(&self, last: usize) -> ((Kind, usize, f64), (Kind, usize, f64)) {
        let mut best = (Kind::Load, last, self.solved_load().log_evidence);
        let mut next = (Kind::Unknown, 0, f64::NEG_INFINITY);
        for named in self.tests.iter().filter(|named| named.kind == Kind::Slip) {
            let one = (Kind::Slip, named.joint, log_evidence(named));
            if one.2 > best.2 {
                (best, next) = (one, best);
            } else if one.2 > next.2 {
                next = one;
            }
        }
        (best, next)
    }

    /// Whether the window does not tell a load's mass well enough yet.
    pub(super) fn is_rough(&self, change: &Change) -> bool {
        if change.kind != Kind::Load {
            return false;
        }
        let solved = self.solved_load();
        let [mass, ..] = solved.sizes;
        INTERVAL * solved.std > ROUGH * mass.abs()
    }

    /// The load that the window shows.
    pub(super) fn solved_load(&self) -> Solved {
        self.load.solved(USUAL * self.settings.load)
    }

    /// Whether an arm can have it: neither friction nor what a channel shows of a torque turns round, so that with what was named
    /// before no more than all of it is lost. A size beyond, interval and all, is something else's.
    fn is_possible(&self, named: &Named) -> bool {
        let known = match named.kind {
            Kind::Friction => at(&self.known.friction, named.joint),
            Kind::Gain => at(&self.known.gain, named.joint),
            _ => return true,
        };
        let (size, std) = named.window.size();
        size + INTERVAL * std >= -1.0 - known
    }

    /// Of a joint's names the likeliest and the next, with the logarithms of their evidence.
    fn best_of(&self, joint: usize) -> (Kind, f64, f64, Kind) {
        let none = f64::NEG_INFINITY;
        let mut found = (Kind::Unknown, none, none, Kind::Unknown);
        let own = self.tests.iter().filter(|named| named.joint == joint);
        let own = own.filter(|named| !matches!(named.kind, Kind::Unknown | Kind::Slip));
        for named in own.filter(|named| self.is_possible(named)) {
            let value = log_evidence(named);
            if value > found.1 {
                found = (named.kind, value, found.1, found.0);
            } else if value > found.2 {
                (found.2, found.3) = (value, named.kind);
            }
        }
        found
    }

    /// Whether a name leaves no more of its joints in the window than is tolerated of what has none, or takes most of it off.
    fn explains(&self, (kind, joint): (Kind, usize)) -> bool {
        let all = |other: &&Named| of_arm(kind) || other.joint == joint;
        let (mut left, mut gain) = (Evidence::default(), 0.0);
        for named in self.tests.iter().filter(all) {
            if named.kind == Kind::Unknown {
                left.add(named.window);
            } else if (named.kind, named.joint) == (kind, joint) {
                gain = named.window.moment * named.window.size().0;
            }
        }
        if kind == Kind::Load {
            gain = self.load.gain(&self.solved_load().sizes);
        }
        let most = (1.0 + self.settings.unknown) * (1.0 + self.settings.unknown);
        let more = left.moment - left.information;
        left.moment - gain <= most * left.information || gain >= EXPLAINED * more
    }

    /// Joint whose deviation has grown most.
    fn most_unlike(&self) -> usize {
        let own = self
            .tests
            .iter()
            .filter(|named| named.kind == Kind::Unknown);
        let grown = own.max_by(|a, b| a.window.size().0.total_cmp(&b.window.size().0));
        grown.map_or(0, |named| named.joint)
    }

    /// The same with the size that the window says now.
    pub(super) fn sized(&self, change: Change) -> Change {
        let joint = change.joint;
        let own = self.tests.iter();
        let mut own = own.filter(|named| (named.kind, named.joint) == (change.kind, joint));
        let window = own.next().map_or(Evidence::default(), |named| named.window);
        let (mut size, mut std) = window.size();
        let mut moments = [0.0; 3];
        match change.kind {
            Kind::Offset => {
                let unit = at(&self.deviation, joint);
                (size, std) = (size * unit, std * unit);
            }
            Kind::Unknown => {
                size = size.max(0.0).sqrt() - 1.0;
                // Squares forget sooner than what is squared: of an AR(1) n rows are worth 2 m / (1 + m^2) n, not n / m.
                let m = at(&self.memory, joint);
                std *= 0.5 * (size + 1.0) * (1.0 + 1.0 / (m * m)).sqrt();
            }
            Kind::Load => {
                let solved = self.solved_load();
                let [mass, x, y, z, ..] = solved.sizes;
                (size, moments, std) = (mass, [x, y, z], solved.std);
            }
            Kind::Friction | Kind::Gain | Kind::Delay | Kind::Slip | Kind::Frozen => {}
        }
        Change {
            size,
            std,
            moments,
            ..change
        }
    }

    /// Whether a change may be as small as what is tolerated of its kind.
    pub(super) fn may_be_tolerated(&self, change: &Change) -> bool {
        self.is_tolerated(change, change.size.abs() - INTERVAL * change.std)
    }

    /// Whether a change of this kind, at least so large, is tolerated.
    pub(super) fn is_tolerated(&self, change: &Change, least: f64) -> bool {
        let j = change.joint;
        match change.kind {
            Kind::Friction => least <= self.settings.friction,
            Kind::Gain => least <= self.settings.gain,
            Kind::Offset => least <= self.settings.offset * at(&self.deviation, j),
            Kind::Delay => least <= self.settings.delay,
            Kind::Slip => least <= self.settings.slip,
            Kind::Unknown => least <= self.settings.unknown,
            Kind::Frozen => false,
            // A small load far out is none that is tolerated.
            Kind::Load => {
                let [x, y, z] = change.moments;
                let far = (x * x + y * y + z * z).sqrt();
                least <= self.settings.load && far <= REACH * self.settings.load
            }
        }
    }
}

/// Logarithm of the evidence for a name, whose size was none of the usual ones beforehand.
fn log_evidence(named: &Named) -> f64 {
    let widths = WIDTHS.map(|width| width * USUAL * named.tolerated);
    let values = widths.map(|usual| named.window.log_evidence(usual));
    let most = values.into_iter().fold(f64::NEG_INFINITY, f64::max);
    most - (WIDTHS.len() as f64).ln()
}
