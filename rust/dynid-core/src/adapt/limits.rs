//! Where an estimate is stopped, and when that is said.

use super::adapted::{INTERVAL, N_PAYLOAD};
use super::Adaptation;
use crate::slices::{at, copy, set};

impl Adaptation {
    /// Where the estimate stands within the limits; it goes beyond by no more than two of the rows' own intervals, so that it
    /// comes back at once.
    pub(super) fn limit(&mut self) {
        let [least, most] = self.settings.factor;
        for j in 0..self.n_friction() {
            let half = INTERVAL * self.squares.std(j);
            let (low, high) = (least - 1.0, most - 1.0);
            let beyond = 2.0 * INTERVAL * self.squares.variance(j).sqrt();
            let x = between(at(&self.squares.estimate, j), low, high, beyond);
            set(&mut self.squares.estimate, j, x);
            let beyond = (x - high).max(low - x);
            note_limit(&mut self.at_limit, j, beyond, half);
            set(&mut self.friction.target, j, x.min(high).max(low));
        }
        if self.settings.payload {
            self.limit_load();
        }
    }

    fn limit_load(&mut self) {
        let (k, reach, most) = (self.n_friction(), self.settings.reach, self.settings.mass);
        let [mut halves, mut margins, mut load] = [[0.0; N_PAYLOAD]; 3];
        let numbers = halves.iter_mut().zip(&mut margins).zip(&mut load);
        for (m, ((half, margin), x)) in numbers.enumerate() {
            *half = INTERVAL * self.squares.std(k + m);
            *margin = 2.0 * INTERVAL * self.squares.variance(k + m).sqrt();
            *x = at(&self.squares.estimate, k + m);
        }
        let ([half, hx, hy, hz], [mass, x, y, z]) = (halves, load);
        let [margin, mx, my, mz] = margins;
        let mass = between(mass, 0.0, most, margin);
        let used = mass.max(0.0).min(most);
        let far = (x * x + y * y + z * z).sqrt();
        let of_moments = hx.max(hy).max(hz);
        let widest = reach * used + mx.max(my).max(mz);
        let [shrink, within] =
            [widest, reach * used].map(|most| if far > most { most / far } else { 1.0 });
        let estimate = [mass, shrink * x, shrink * y, shrink * z];
        for (m, x) in estimate.into_iter().enumerate() {
            set(&mut self.squares.estimate, k + m, x);
        }
        let beyond = (mass - most).max(-mass) / half.max(f64::MIN_POSITIVE);
        let too_far = (far * shrink - reach * used) / of_moments.max(f64::MIN_POSITIVE);
        let place = self.tau.len();
        note_limit(&mut self.at_limit, place, beyond.max(too_far), 1.0);
        let target = [used, within * x, within * y, within * z];
        copy(&target, &mut self.payload.target);
    }
}

/// A number at most `more` beyond two ends.
fn between(x: f64, low: f64, high: f64, more: f64) -> f64 {
    x.min(high + more).max(low - more)
}

/// Something is at its limit once the data lie beyond it by half of their interval, until they lie within.
fn note_limit(flags: &mut [bool], place: usize, beyond: f64, half: f64) {
    if let Some(flag) = flags.get_mut(place) {
        *flag = beyond > half || (*flag && beyond > 0.0);
    }
}
