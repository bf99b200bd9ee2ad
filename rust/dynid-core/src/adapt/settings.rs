//! What may follow the arm, how slowly, and how far.

use crate::error::CoreError;

/// How many rows are worth an independent one where healthy runs have not said it: two seconds of rows, as in
/// `dynid_rs.Watch`.
pub const UNKNOWN_MEMORY: f64 = 10.0;

/// What is adapted, and its limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdaptSettings {
    /// Whether a factor on all friction of a joint follows.
    pub friction: bool,
    /// Whether mass and first moments of a load at the last link follow.
    pub payload: bool,
    /// Time over which what the model leaves is averaged \[s\]; that of the watch.
    pub row: f64,
    /// Motion after which a row counts 1/e \[s\].
    ///
    /// Friction of the size F that grows by g per second is followed g T behind, with a deviation of
    /// `sqrt(m v / F^2 row / (2 T))` by rows of variance v, m of which are worth one; the sum of both squares is smallest at
    /// `T^3 = m v / F^2 row / (4 g^2)`. With v / F^2 = 0.05^2 and m = 10 that is 23 s for friction that grows by a fifth in
    /// ten minutes, and 75 s for a fifth in an hour; a minute lies between.
    pub memory: f64,
    /// Least and greatest factor on friction. Cold or new grease has been seen to double it.
    pub factor: [f64; 2],
    /// Greatest mass of a load \[kg; in ampere: kg times what the channel shows per N m\]; what the arm may carry. Positive
    /// where a payload follows.
    pub mass: f64,
    /// Greatest distance of a load's centre from the last link's origin \[m\].
    pub reach: f64,
    /// A move of this part is said: of friction as it was identified, or of the greatest mass.
    pub said: f64,
}

impl Default for AdaptSettings {
    fn default() -> Self {
        Self {
            friction: true,
            payload: false,
            row: 0.2,
            memory: 60.0,
            factor: [0.5, 2.0],
            mass: 0.0,
            reach: 0.2,
            said: 0.05,
        }
    }
}

impl AdaptSettings {
    /// # Errors
    /// [`CoreError::Range`] naming what is none.
    pub fn check(&self) -> Result<(), CoreError> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let [least, most] = self.factor;
        let all = [
            ("adapt", self.friction || self.payload),
            ("row", positive(self.row)),
            ("memory", positive(self.memory) && self.memory >= self.row),
            (
                "factor",
                (0.0..1.0).contains(&least) && most > 1.0 && most <= MOST_FACTOR,
            ),
            (
                "mass",
                !self.payload || (positive(self.mass) && self.mass <= MOST_MASS),
            ),
            ("reach", positive(self.reach) && self.reach <= MOST_REACH),
            ("said", positive(self.said)),
        ];
        let wrong = all.into_iter().find(|(_, holds)| !holds);
        wrong.map_or(Ok(()), |(what, _)| Err(CoreError::Range { what }))
    }
}

/// Factors beyond it are those of no friction, masses and distances of no load.
const MOST_FACTOR: f64 = 100.0;
const MOST_MASS: f64 = 1e5;
const MOST_REACH: f64 = 100.0;
