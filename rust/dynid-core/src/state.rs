//! One instant of a robot, link side and motor side.

use crate::dynamics::check_length;
use crate::error::CoreError;
use crate::lanes::{Lanes, Portable};
use crate::slices::{self, at};

/// One state, borrowed. With a single encoder the motor side *is* the link side: [`State::single`].
#[derive(Clone, Copy, Debug)]
pub struct State<'a> {
    /// Link-side position \[rad, m\].
    pub q: &'a [f64],
    /// Link-side velocity \[rad/s\].
    pub dq: &'a [f64],
    /// Link-side acceleration \[rad/s²\].
    pub ddq: &'a [f64],
    /// Motor position divided by the gear ratio \[rad\].
    pub q_motor: &'a [f64],
    /// Motor velocity divided by the gear ratio \[rad/s\].
    pub dq_motor: &'a [f64],
    /// Motor acceleration divided by the gear ratio \[rad/s²\].
    pub ddq_motor: &'a [f64],
    /// Measured temperature per joint \[degC\], where there is one; NaN for joints where it is not known.
    pub temperature: Option<&'a [f64]>,
}

impl<'a> State<'a> {
    /// State of a robot with one encoder per joint.
    #[must_use]
    pub fn single(q: &'a [f64], dq: &'a [f64], ddq: &'a [f64]) -> Self {
        Self {
            q,
            dq,
            ddq,
            q_motor: q,
            dq_motor: dq,
            ddq_motor: ddq,
            temperature: None,
        }
    }

    /// The six signals of motion with their names, in the order of the fields.
    #[must_use]
    pub fn signals(&self) -> [(&'static str, &'a [f64]); 6] {
        [
            ("q", self.q),
            ("dq", self.dq),
            ("ddq", self.ddq),
            ("q_motor", self.q_motor),
            ("dq_motor", self.dq_motor),
            ("ddq_motor", self.ddq_motor),
        ]
    }

    /// # Errors
    /// [`CoreError::Length`] if a signal does not have `n_joints` values.
    pub fn check(&self, n_joints: usize) -> Result<(), CoreError> {
        self.signals()
            .iter()
            .try_for_each(|(name, signal)| check_length(name, signal, n_joints))?;
        self.temperature.map_or(Ok(()), |temperature| {
            check_length("temperature", temperature, n_joints)
        })
    }

    /// True if every number of the motion is finite. A temperature need not be.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.signals()
            .iter()
            .all(|(_, signal)| slices::all_finite(signal))
    }

    /// Deflection of joint `j` and its rate: motor minus link \[rad, rad/s\]. The channels must be on one clock
    /// ([`align_link_side`]).
    #[must_use]
    pub fn deflection(&self, j: usize) -> [f64; 2] {
        [
            at(self.q_motor, j) - at(self.q, j),
            at(self.dq_motor, j) - at(self.dq, j),
        ]
    }
}

/// Brings one joint's link channel to the motor channel's clock: `(q + d dq + d^2/2 ddq, dq + d ddq)` \[rad, rad/s\].
///
/// `delay` d \[s\]: how much later the link channel shows a position than the motor channel. Taylor's series holds because
/// d (milliseconds) is short against the motion; the acceleration is left as it is.
#[must_use]
pub fn align_link_side(q: f64, dq: f64, ddq: f64, delay: f64) -> [f64; 2] {
    let one = Portable::<1, false>::splat;
    let [q, dq] = align_row(one(q), one(dq), one(ddq), one(delay));
    [q.raw()[0], dq.raw()[0]]
}

/// [`align_link_side`] of a row of joints.
#[inline(always)]
pub(crate) fn align_row<L: Lanes>(q: L, dq: L, ddq: L, delay: L) -> [L; 2] {
    // Products and sums on their own, so that a delay of zero changes no bit.
    let half = L::splat(0.5) * delay * delay;
    [q + delay * dq + half * ddq, dq + delay * ddq]
}

/// Steps of Newton's method for the true angle; each squares the error, which begins at the amplitude.
const NEWTON_STEPS: usize = 4;

/// One joint's true motion from what an eccentric encoder shows: `[q, dq, ddq]` \[rad, rad/s, rad/s²\] with
/// `q + e(q) = shown`, `e(q) = cosine cos q + sine sin q` what it shows too much.
#[must_use]
pub fn true_motion(shown: f64, dq: f64, ddq: f64, [cosine, sine]: [f64; 2]) -> [f64; 3] {
    // e and de/dq; the second derivative is -e.
    let error = |q: f64| {
        let (s, c) = q.sin_cos();
        (cosine * c + sine * s, sine * c - cosine * s)
    };
    let mut q = shown;
    for _ in 0..NEWTON_STEPS {
        let (e, rate) = error(q);
        q -= (q + e - shown) / (1.0 + rate);
    }
    let (e, rate) = error(q);
    let dq = dq / (1.0 + rate);
    [q, dq, (ddq + e * dq * dq) / (1.0 + rate)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// What an eccentric disc shows, computed forwards, comes back.
        #[test]
        fn an_encoder_error_is_taken_out(
            q in -7.0..7.0f64, dq in -3.0..3.0f64, ddq in -9.0..9.0f64,
            amplitude in 0.0..0.3f64, phase in -3.2..3.2f64,
        ) {
            let (s, c) = (q + phase).sin_cos();
            let slope = 1.0 + amplitude * c;
            let shown = [q + amplitude * s, slope * dq, slope * ddq - amplitude * s * dq * dq];
            let parts = [amplitude * phase.sin(), amplitude * phase.cos()];
            let [q_true, dq_true, ddq_true] = true_motion(shown[0], shown[1], shown[2], parts);
            prop_assert!((q_true - q).abs() <= 1e-13);
            prop_assert!((dq_true - dq).abs() <= 1e-13 * (1.0 + dq.abs()));
            prop_assert!((ddq_true - ddq).abs() <= 1e-12 * (1.0 + ddq.abs() + dq * dq));
        }

        /// Velocity and acceleration are the derivatives of the position that comes with them.
        #[test]
        fn the_chain_rule_holds(
            q in -7.0..7.0f64, dq in -3.0..3.0f64, ddq in -9.0..9.0f64, a in -0.3..0.3f64, b in -0.3..0.3f64,
        ) {
            let h = 1e-4;
            let at = |t: f64| true_motion(q + dq * t + 0.5 * ddq * t * t, dq + ddq * t, ddq, [a, b]);
            let (before, now, after) = (at(-h), at(0.0), at(h));
            for k in 0..2 {
                let difference = (after[k] - before[k]) / (2.0 * h);
                prop_assert!((difference - now[k + 1]).abs() < 1e-4, "{k}: {difference} {}", now[k + 1]);
            }
        }
    }

    #[test]
    fn no_error_changes_nothing() {
        assert_eq!(true_motion(0.3, -1.0, 2.0, [0.0; 2]), [0.3, -1.0, 2.0]);
    }
}
