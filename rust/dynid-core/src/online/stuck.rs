//! Sensors that repeat themselves while the motion goes on.

use super::{OnlineEstimator, Sample};
use crate::slices::{copy, rows_mut};

/// A position that does not change by a bit while its velocity covers this way stands still in the sensor only \[rad, m\].
/// Coarser encoders are not in use on arms.
const STUCK_WAY: f64 = 5e-4;

impl OnlineEstimator {
    /// True if a sensor repeats itself while the motion goes on; keeps what it needs for the next sample.
    pub(super) fn is_stuck(&mut self, sample: &Sample<'_>, elapsed: f64) -> bool {
        let n = self.tau.len();
        let moves = |signal: Option<&[f64]>| signal.is_some_and(|dq| dq.iter().any(|x| *x != 0.0));
        let mut all_same = self.has_before && (moves(sample.motion[1]) || moves(sample.motion[4]));
        let mut stuck = false;
        let has_before = self.has_before;
        let sides = sample.motion.chunks_exact(3);
        let before = rows_mut(&mut self.before, 3 * n);
        for ((side, before), way) in sides.zip(before).zip(&mut self.way) {
            let [q, dq, _] = side else { continue };
            if let (Some(q), Some(dq)) = (q, dq) {
                let joints = q
                    .iter()
                    .zip(dq.iter())
                    .zip(before.iter())
                    .zip(way.iter_mut());
                for (((q, dq), before), way) in joints {
                    let same = has_before && q.to_bits() == before.to_bits();
                    *way = if same {
                        *way + (dq * elapsed).abs()
                    } else {
                        0.0
                    };
                    stuck |= *way > STUCK_WAY;
                }
            }
            for (signal, before) in side.iter().zip(rows_mut(before, n)) {
                if let Some(signal) = signal {
                    let mut pairs = signal.iter().zip(before.iter());
                    all_same &= pairs.all(|(now, before)| now.to_bits() == before.to_bits());
                    copy(signal, before);
                }
            }
        }
        self.has_before = true;
        stuck || all_same
    }
}
