//! Whether states come at the rate that thresholds of contacts were learned at.
//!
//! The observer counts the step of `contact.json`, so at another rate both its torques and its thresholds are wrong, and
//! nothing else would show it. No allocation, and about as much work for every state.

use crate::changes::Told;
use crate::cycle::Settings;

/// So many steps tell a rate.
const ENOUGH: usize = 100;

/// Relative difference of rates that are one, as `dynid contact` has it.
const SAME: f64 = 0.02;

/// What the states' times have shown so far.
#[derive(Debug)]
pub struct Rate {
    /// Time between the samples of the healthy runs \[s\]; none: there is nothing to compare, or all is said.
    learned: Option<f64>,
    before: f64,
    /// Time that passed \[s\], and states that came in it.
    passed: (f64, f64),
    /// The first `n` are steps, the smallest first \[s\].
    steps: [f64; ENOUGH],
    n: usize,
}

impl Rate {
    /// Of a stream for which thresholds were learned, or not.
    pub fn new(settings: &Settings) -> Self {
        Self {
            learned: settings.contacts.as_ref().map(|contacts| contacts.step),
            before: f64::NAN,
            passed: (0.0, 0.0),
            steps: [0.0; ENOUGH],
            n: 0,
        }
    }

    /// Takes the time of a state, which may be NaN \[s\]; says once, as soon as enough came, if they come at another rate.
    pub fn note(&mut self, time: f64) -> Option<Told> {
        let learned = self.learned?;
        let step = time - self.before;
        self.before = time;
        if !(0.0..f64::INFINITY).contains(&step) {
            return None; // the first one, or the stream began again
        }
        self.passed = (self.passed.0 + step, self.passed.1 + 1.0);
        if step == 0.0 {
            return None; // sent again, or by a clock that is coarser than the states
        }
        let place = self.steps[..self.n].partition_point(|other| *other < step);
        self.steps.copy_within(place..self.n, place + 1);
        self.steps[place] = step;
        self.n += 1;
        if self.n < ENOUGH {
            return None;
        }
        self.learned = None;
        let median = 0.5 * (self.steps[(ENOUGH - 1) / 2] + self.steps[ENOUGH / 2]);
        let differs = |step: f64| (learned / step - 1.0).abs() > SAME;
        // Lost states, states sent twice and breaks leave the median as it is, rounded times the mean.
        let is_other = differs(median) && differs(self.passed.0 / self.passed.1);
        is_other.then_some(Told::Rate {
            comes: 1.0 / median,
            learned: 1.0 / learned,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(times: impl Iterator<Item = f64>) -> Vec<Told> {
        let mut rate = Rate {
            learned: Some(0.001),
            ..Rate::new(&Settings::default())
        };
        times.filter_map(|time| rate.note(time)).collect()
    }

    fn every(step: f64, n: usize) -> impl Iterator<Item = f64> + Clone {
        (0..n).map(move |k| k as f64 * step)
    }

    #[test]
    fn another_rate_is_told_once_and_not_before_it_is_sure() {
        assert_eq!(told(every(0.004, ENOUGH)), []);
        let [Told::Rate { comes, learned }] = told(every(0.004, 1000))[..] else {
            panic!("not told, or more than once")
        };
        assert!((comes - 250.0).abs() < 1e-6 && (learned - 1000.0).abs() < 1e-9);
        assert_eq!(told(every(0.00103, 1000)).len(), 1);
    }

    #[test]
    fn the_same_rate_is_not_told_whatever_the_times_are() {
        assert_eq!(told(every(0.00101, 1000)), []);
        let jitter = every(0.001, 1000).map(|t| t + 4e-4 * (1e6 * t).sin());
        assert_eq!(told(jitter), []);
        let lost = every(0.001, 1000).filter(|t| !(0.02..3.0).contains(t) && (t * 1e3) % 9.0 > 0.5);
        assert_eq!(told(lost), []);
        let twice = every(0.001, 1000).flat_map(|t| [t, t]);
        assert_eq!(told(twice), []);
        let again = every(0.001, 30).chain(every(0.001, 30)).cycle().take(1000);
        assert_eq!(told(again), []);
        assert_eq!(told(std::iter::repeat_n(f64::NAN, 1000)), []);
        // A clock of 4 ms behind a stream of 1 kHz.
        let coarse = every(0.001, 1000).map(|t| (t / 0.004).floor() * 0.004);
        assert_eq!(told(coarse), []);
    }

    #[test]
    fn without_thresholds_there_is_nothing_to_compare() {
        let mut rate = Rate::new(&Settings::default());
        assert!(every(0.1, 1000).all(|time| rate.note(time).is_none()));
    }
}
