//! How far a model is believed: a state beyond is evaluated at the nearest one within, because a formula gives any torque for
//! a speed that no arm has.

use crate::model::TorqueModel;
use crate::slices::{part, rows_mut};
use crate::state::State;

/// Speeds and accelerations are believed at least and at most so many times beyond the greatest that were trained; in
/// between, the robot's own limit decides.
const TRUSTED: [f64; 2] = [2.0, 10.0];

/// A joint without limits of position is believed so far beyond the trained positions \[rad, m\]: it may have turned often.
const OFTEN_TURNED: f64 = 1e4;

/// No sensor shows such a number: it is a fault, and no state.
const NO_NUMBER: f64 = 1e100;

/// True if every number of the motion may be one that a sensor shows.
pub(crate) fn is_state(shown: &State<'_>) -> bool {
    let all = |signal: &[f64]| {
        signal
            .iter()
            .fold(true, |all, x| all & (x.abs() < NO_NUMBER))
    };
    shown.signals().iter().all(|(_, signal)| all(signal))
}

/// Least and greatest believed position, speed and acceleration, one row per signal.
#[derive(Clone, Debug, Default)]
pub(crate) struct Limits {
    low: Vec<f64>,
    high: Vec<f64>,
}

impl Limits {
    pub fn of(model: &TorqueModel) -> Self {
        let mut limits = Self::default();
        let per_joint = believed(model);
        for k in 0..3 {
            limits.low.extend(per_joint.iter().map(|joint| joint[k][0]));
            limits
                .high
                .extend(per_joint.iter().map(|joint| joint[k][1]));
        }
        limits
    }

    /// Whether a number of the motion lies beyond; the motion within then stands in `row` (six signals).
    pub fn hold(&self, shown: &State<'_>, row: &mut [f64], n: usize) -> bool {
        let mut beyond = false;
        for (k, (_, signal)) in shown.signals().into_iter().enumerate() {
            let (low, high) = self.of_signal(k, n);
            for ((x, low), high) in signal.iter().zip(low).zip(high) {
                beyond |= *x < *low || *x > *high;
            }
        }
        if !beyond {
            return false;
        }
        for (k, (row, (_, signal))) in rows_mut(row, n).zip(shown.signals()).enumerate() {
            let (low, high) = self.of_signal(k, n);
            for (((to, x), low), high) in row.iter_mut().zip(signal).zip(low).zip(high) {
                *to = x.min(*high).max(*low);
            }
        }
        true
    }

    /// Limits of signal `k` of six: the motor side's are the link side's.
    fn of_signal(&self, k: usize, n: usize) -> (&[f64], &[f64]) {
        let k = if k < 3 { k } else { k - 3 };
        (
            part(&self.low, k * n, (k + 1) * n),
            part(&self.high, k * n, (k + 1) * n),
        )
    }
}

/// Per joint, `[least, greatest]` believed position, speed and acceleration.
#[must_use]
pub fn believed(model: &TorqueModel) -> Vec<[[f64; 2]; 3]> {
    let domain = model.domain();
    let joints = model.robot().joints().iter();
    let both = |x: f64| [-x, x];
    joints
        .enumerate()
        .map(|(j, joint)| {
            let [low, high] = domain.q[j];
            let [least, most] = TRUSTED;
            let rate = |trained: f64, limit: f64| {
                // What never moved says nothing of how fast it may.
                if trained > 0.0 {
                    limit.max(least * trained).min(most * trained)
                } else {
                    limit
                }
            };
            let width = high - low;
            let beyond = |limit: f64, trained: f64| {
                if limit.is_finite() {
                    limit
                } else {
                    trained + OFTEN_TURNED.copysign(limit)
                }
            };
            let position = [
                beyond(joint.limits.lower, low).min(low - width),
                beyond(joint.limits.upper, high).max(high + width),
            ];
            [
                position,
                both(rate(domain.dq[j], joint.limits.velocity)),
                both(rate(domain.ddq[j], joint.limits.acceleration)),
            ]
        })
        .collect()
}
