//! What is used, on its way to what the data say: no faster than a rate.

use core::ops::Range;

use crate::slices::{at, mirror_fields, set, Mirror};

/// Numbers that follow an estimate.
#[derive(Clone, Debug)]
pub(super) struct Followed {
    pub target: Vec<f64>,
    pub used: Vec<f64>,
    pub said: Vec<f64>,
    /// Most that `used` moves in a second.
    rate: Vec<f64>,
    /// What a move is a part of, where it is said.
    size: Vec<f64>,
}

impl Followed {
    /// `rate` per second; moves are said by parts of `size`.
    pub fn new(rate: Vec<f64>, size: Vec<f64>) -> Self {
        let zeros = vec![0.0; rate.len()];
        Self {
            target: zeros.clone(),
            used: zeros.clone(),
            said: zeros,
            rate,
            size,
        }
    }

    /// What was said stays: that it is put back has to be said.
    pub fn reset(&mut self) {
        self.target.fill(0.0);
        self.used.fill(0.0);
    }

    /// Whether one of these has moved by such a part since something was said; by nothing is any move.
    pub fn moved(&self, own: &Range<usize>, part: f64) -> bool {
        own.clone().any(|k| {
            let by = (at(&self.used, k) - at(&self.said, k)).abs();
            by > 0.0 && by >= part * at(&self.size, k)
        })
    }

    /// Whether these are where they are to go.
    pub fn is_there(&self, own: &Range<usize>) -> bool {
        own.clone()
            .all(|k| at(&self.used, k) == at(&self.target, k))
    }

    /// These are said.
    pub fn note(&mut self, own: &Range<usize>) {
        for k in own.clone() {
            set(&mut self.said, k, at(&self.used, k));
        }
    }

    /// One number by itself.
    pub fn follow(&mut self, k: usize, seconds: f64) {
        let most = at(&self.rate, k) * seconds;
        let (used, target) = (at(&self.used, k), at(&self.target, k));
        let away = target - used;
        let now = if away.abs() <= most {
            target
        } else {
            used + most.copysign(away)
        };
        set(&mut self.used, k, now);
    }

    /// All of them along the straight line: between two loads that can be there is none that cannot.
    pub fn follow_together(&mut self, seconds: f64) {
        let mut periods: f64 = 1.0;
        for ((target, used), rate) in self.target.iter().zip(&self.used).zip(&self.rate) {
            periods = periods.max((target - used).abs() / (rate * seconds));
        }
        for (used, target) in self.used.iter_mut().zip(&self.target) {
            *used = if periods > 1.0 {
                *used + (target - *used) / periods
            } else {
                *target
            };
        }
    }
}

impl Mirror for Followed {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(self, of; target, used, said, rate, size; copied; kept);
    }
}
