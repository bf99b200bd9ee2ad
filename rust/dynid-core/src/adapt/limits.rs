//! Where an estimate is stopped, and when that is said.

use super::adapted::{INTERVAL, N_PAYLOAD};
use super::Adaptation;
use crate::slices::{at, copy, set};

/// Rows that have to agree, five seconds of motion: a load that was just hung on is not where it seems at first.
const PATIENCE: u32 = 25;

impl Adaptation {
    /// Where the estimate stands within the limits; it goes beyond by no more than two of the rows' own intervals, so that it
    /// comes back at once.
    pub(super) fn limit(&mut self) {
        let [least, most] = self.settings.factor;
        for j in 0..self.n_friction() {
            let half = INTERVAL * self.squares.variance(j).sqrt();
            let (low, high) = (least - 1.0, most - 1.0);
            let x = between(at(&self.squares.estimate, j), low, high, 2.0 * half);
            set(&mut self.squares.estimate, j, x);
            let beyond = (x - high).max(low - x);
            self.note_limit(j, beyond, half);
            set(&mut self.friction.target, j, x.min(high).max(low));
        }
        if self.settings.payload {
            self.limit_load();
        }
    }

    fn limit_load(&mut self) {
        let (k, reach, most) = (self.n_friction(), self.settings.reach, self.settings.mass);
        let [mut halves, mut load] = [[0.0; N_PAYLOAD]; 2];
        for (m, (half, x)) in halves.iter_mut().zip(&mut load).enumerate() {
            *half = INTERVAL * self.squares.variance(k + m).sqrt();
            *x = at(&self.squares.estimate, k + m);
        }
        let ([half, hx, hy, hz], [mass, x, y, z]) = (halves, load);
        let mass = between(mass, 0.0, most, 2.0 * half);
        let used = mass.max(0.0).min(most);
        let far = (x * x + y * y + z * z).sqrt();
        let of_moments = hx.max(hy).max(hz);
        let widest = reach * used + 2.0 * of_moments;
        let [shrink, within] =
            [widest, reach * used].map(|most| if far > most { most / far } else { 1.0 });
        let estimate = [mass, shrink * x, shrink * y, shrink * z];
        for (m, x) in estimate.into_iter().enumerate() {
            set(&mut self.squares.estimate, k + m, x);
        }
        let beyond = (mass - most).max(-mass) / half.max(f64::MIN_POSITIVE);
        let too_far = (far * shrink - reach * used) / of_moments.max(f64::MIN_POSITIVE);
        let place = self.tau.len();
        self.note_limit(place, beyond.max(too_far), 1.0);
        let target = [used, within * x, within * y, within * z];
        copy(&target, &mut self.payload.target);
    }

    /// Something is at its limit once so many rows in a row have said that it lies beyond by half of their interval, until they
    /// say that it lies within.
    fn note_limit(&mut self, place: usize, beyond: f64, half: f64) {
        let found = self
            .at_limit
            .get_mut(place)
            .zip(self.rows_beyond.get_mut(place));
        let Some((is, rows)) = found else { return };
        *rows = if beyond > half {
            rows.saturating_add(1)
        } else {
            0
        };
        *is = *rows >= PATIENCE || (*is && beyond > 0.0);
    }
}

/// A number at most `more` beyond two ends.
fn between(x: f64, low: f64, high: f64, more: f64) -> f64 {
    x.min(high + more).max(low - more)
}
