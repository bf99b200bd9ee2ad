//! One instant of a robot, link side and motor side.

use crate::dynamics::check_length;
use crate::error::CoreError;

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
        }
    }

    /// The six signals with their names, in the order of the fields.
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
            .try_for_each(|(name, signal)| check_length(name, signal, n_joints))
    }

    /// True if every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.signals()
            .iter()
            .all(|(_, signal)| signal.iter().all(|x| x.is_finite()))
    }

    /// Deflection of joint `j` and its rate: motor minus link \[rad, rad/s\]. The channels must be on one clock
    /// ([`align_link_side`]).
    #[must_use]
    pub fn deflection(&self, j: usize) -> [f64; 2] {
        [self.q_motor[j] - self.q[j], self.dq_motor[j] - self.dq[j]]
    }
}

/// Brings one joint's link channel to the motor channel's clock: `(q + d dq + d^2/2 ddq, dq + d ddq)` \[rad, rad/s\].
///
/// `delay` d \[s\]: how much later the link channel shows a position than the motor channel. Taylor's series holds because
/// d (milliseconds) is short against the motion; the acceleration is left as it is.
#[must_use]
pub fn align_link_side(q: f64, dq: f64, ddq: f64, delay: f64) -> [f64; 2] {
    [q + delay * dq + 0.5 * delay * delay * ddq, dq + delay * ddq]
}
