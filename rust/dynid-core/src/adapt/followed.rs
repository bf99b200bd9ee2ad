//! What is used, on its way to what the data say: no faster than a rate.

use crate::slices::{at, mirror_fields, set, Mirror};

/// Numbers that follow an estimate.
#[derive(Clone, Debug)]
pub(super) struct Followed {
    pub target: Vec<f64>,
    pub used: Vec<f64>,
    pub said: Vec<f64>,
    /// Most that `used` moves in a second.
    pub rate: Vec<f64>,
}

impl Followed {
    pub fn new(rate: Vec<f64>) -> Self {
        let zeros = vec![0.0; rate.len()];
        Self {
            target: zeros.clone(),
            used: zeros.clone(),
            said: zeros,
            rate,
        }
    }

    /// What was said stays: that it is put back has to be said.
    pub fn reset(&mut self) {
        self.target.fill(0.0);
        self.used.fill(0.0);
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
        mirror_fields!(self, of; target, used, said, rate; copied; kept);
    }
}
