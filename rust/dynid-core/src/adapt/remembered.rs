//! What an adaptation has learnt, as a row of numbers: it goes on with them after a restart.

use super::{Adaptation, N_PAYLOAD};
use crate::dynamics::check_length;
use crate::error::CoreError;
use crate::slices::{at, copy};

impl Adaptation {
    /// True unless a row is being taken.
    #[must_use]
    pub fn is_between_rows(&self) -> bool {
        self.next > self.tau.len()
    }

    /// How many numbers it remembers.
    #[must_use]
    pub fn n_remembered(&self) -> usize {
        let n = self.squares.first().len();
        2 * n + n * n + self.tau.len() + N_PAYLOAD
    }

    /// Writes what it knows to `numbers` and says so; within a row that is being taken it does neither.
    ///
    /// # Errors
    /// [`CoreError`] if the length is not [`Self::n_remembered`].
    pub fn remember(&self, numbers: &mut [f64]) -> Result<bool, CoreError> {
        check_length("remembered", numbers, self.n_remembered())?;
        if !self.is_between_rows() {
            return Ok(false);
        }
        let mut rest = numbers;
        for part in [
            &self.squares.estimate,
            &self.squares.mean,
            &self.squares.covariance,
            &self.friction.used,
            &self.payload.used,
        ] {
            let (own, others) = rest.split_at_mut_checked(part.len()).unwrap_or_default();
            copy(part, own);
            rest = others;
        }
        Ok(true)
    }

    /// Goes on with what an adaptation of the same model and settings remembered. What is used is used at once.
    ///
    /// # Errors
    /// [`CoreError`] if the length is wrong or a number is none that an adaptation remembers; it stays as it was.
    pub fn recall(&mut self, numbers: &[f64]) -> Result<(), CoreError> {
        check_length("remembered", numbers, self.n_remembered())?;
        let n = self.squares.first().len();
        let mut found = self.clone();
        let mut rest = numbers;
        for part in [
            &mut found.squares.estimate,
            &mut found.squares.mean,
            &mut found.squares.covariance,
            &mut found.friction.used,
            &mut found.payload.used,
        ] {
            let (own, others) = rest.split_at_checked(part.len()).unwrap_or_default();
            copy(own, part);
            rest = others;
        }
        if !found.could_be(n) {
            return Err(CoreError::Range { what: "remembered" });
        }
        for followed in [&mut found.friction, &mut found.payload] {
            copy(&followed.used, &mut followed.said);
            copy(&followed.used, &mut followed.target);
        }
        found.limit();
        for (was, is) in found.was_at_limit.iter_mut().zip(&found.at_limit) {
            *was = *is;
        }
        *self = found;
        Ok(())
    }

    /// Whether the numbers are those of an adaptation of these limits.
    fn could_be(&self, n: usize) -> bool {
        const ROUNDING: f64 = 1.0 + 1e-9;
        let squares = &self.squares;
        // As they are followed: taken from one and added again, a limit may lie an ulp within itself.
        let [least, most] = self.settings.factor.map(|factor| factor - 1.0);
        let entry = |a: usize, b: usize| at(&squares.covariance, a * n + b);
        let variances = (0..n).all(|a| {
            let own = entry(a, a);
            own > 0.0 && own <= ROUNDING * at(squares.first(), a)
        });
        // Symmetric, and no two of them closer than the same.
        let pairs = (0..n).all(|a| {
            (0..a).all(|b| {
                let both = entry(a, b);
                both == entry(b, a) && both * both <= ROUNDING * entry(a, a) * entry(b, b)
            })
        });
        let within = |x: &f64| self.settings.friction && (least..=most).contains(x);
        let of_friction = self.friction.used.iter().all(|x| *x == 0.0 || within(x));
        let [mass, x, y, z] = self.load().0;
        let far = (x * x + y * y + z * z).sqrt();
        let of_load = if self.settings.payload {
            (0.0..=self.settings.mass).contains(&mass)
                && far <= ROUNDING * self.settings.reach * mass
        } else {
            mass == 0.0 && far == 0.0
        };
        // Beyond its limits an estimate goes by two intervals at most, and they are no wider than in the beginning.
        let estimates = squares.estimate.iter().chain(&squares.mean);
        let sizes = squares.first().iter().chain(squares.first());
        let near = estimates.zip(sizes).all(|(x, first)| {
            x.abs() <= 20.0 * first.sqrt() // `limit` brings them in
        });
        variances && pairs && of_friction && of_load && near
    }
}
