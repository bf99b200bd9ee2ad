//! What the regressions of the third loop see: a pair of a joint's signals, or signals by name.

use core::ops::Range;

use crate::error::CoreError;
use crate::lanes::{Lanes, Portable};
use crate::signal::{Signal, SignalKind, MAX_INPUTS};
use crate::slices::part;
use crate::state::State;

/// What the regressions see. Section 5 of the paper names the first two pairs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ResidualInputs {
    /// Deflection `q_motor - q` and its rate, channel delay taken out (two encoders).
    Deflection,
    /// Motor-side position and velocity of the joint.
    JointState,
    /// Deflection less what the link's own torque winds up, `q_motor - q - compliance * tau_link` with the **predicted**
    /// rigid-body torque, and the deflection's rate. What the gear holds back is left over; the load, which is a
    /// hundred times larger and already in the rigid body, is not.
    LoadFreeDeflection,
    /// Signals by name, of any joint: one list per joint, at most [`MAX_INPUTS`] long, empty where there is no regression.
    Signals(Vec<Vec<Signal>>),
}

impl ResidualInputs {
    /// The pairs that have a name of their own.
    pub const PAIRS: [Self; 3] = [Self::Deflection, Self::JointState, Self::LoadFreeDeflection];

    /// Name in files.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Deflection => "deflection",
            Self::JointState => "joint_state",
            Self::LoadFreeDeflection => "load_free_deflection",
            Self::Signals(_) => "signals",
        }
    }

    /// True if they need an encoder on either side of the gear: signals do where they name both sides of one.
    #[must_use]
    pub fn two_encoders(&self) -> bool {
        match self {
            Self::JointState => false,
            Self::Deflection | Self::LoadFreeDeflection => true,
            Self::Signals(joints) => joints.iter().any(|signals| names_both_sides(signals)),
        }
    }

    /// Signals by name, one list per joint; `None` for the pairs.
    #[must_use]
    pub fn signals(&self) -> Option<&[Vec<Signal>]> {
        match self {
            Self::Signals(joints) => Some(joints),
            _ => None,
        }
    }

    /// Number of inputs of joint `j`.
    #[must_use]
    pub fn len(&self, j: usize) -> usize {
        self.signals()
            .map_or(2, |joints| joints.get(j).map_or(0, Vec::len))
    }

    /// The inputs of joint `j` at a state, [`Self::len`] of them in front. `wind_up` is `compliance * tau_link` \[rad\], read
    /// by the load-free deflection; `tau_link` is read by signals of that name.
    #[must_use]
    pub fn at(
        &self,
        j: usize,
        state: &State<'_>,
        wind_up: f64,
        tau_link: &[f64],
    ) -> [f64; MAX_INPUTS] {
        let mut u = [0.0; MAX_INPUTS];
        match self.signals() {
            None => {
                let [first, second] =
                    self.pairs::<Portable<1, false>>(state, j..j + 1, Lanes::splat(wind_up));
                [u[0], u[1]] = [first.raw()[0], second.raw()[0]];
            }
            Some(joints) => {
                let own = joints.get(j).map_or(&[][..], Vec::as_slice);
                for (u, signal) in u.iter_mut().zip(own) {
                    *u = signal.at(state, tau_link);
                }
            }
        }
        u
    }

    /// The pairs of a row of joints; zeros for signals by name.
    #[inline(always)]
    pub(super) fn pairs<L: Lanes>(
        &self,
        state: &State<'_>,
        joints: Range<usize>,
        wind_up: L,
    ) -> [L; 2] {
        let row = |signal| L::load_some(part(signal, joints.start, joints.end));
        let motor = [row(state.q_motor), row(state.dq_motor)];
        let [deflection, rate] = [motor[0] - row(state.q), motor[1] - row(state.dq)];
        match self {
            Self::Deflection => [deflection, rate],
            Self::JointState => motor,
            Self::LoadFreeDeflection => [deflection - wind_up, rate],
            Self::Signals(_) => [L::splat(0.0); 2],
        }
    }

    /// # Errors
    /// [`CoreError`] if signals are not one list per joint, too many, or of joints that there are not.
    pub(super) fn check(&self, n_joints: usize) -> Result<(), CoreError> {
        let Some(joints) = self.signals() else {
            return Ok(());
        };
        if joints.len() != n_joints {
            return Err(CoreError::Length {
                what: "residual signals",
                expected: n_joints,
                actual: joints.len(),
            });
        }
        for (joint, signals) in joints.iter().enumerate() {
            if signals.len() > MAX_INPUTS {
                return Err(CoreError::Range {
                    what: "number of signals of a joint's residual",
                });
            }
            if let Some(signal) = signals.iter().find(|signal| signal.joint >= n_joints) {
                return Err(CoreError::SignalJoint {
                    joint,
                    other: signal.joint,
                });
            }
        }
        Ok(())
    }
}

fn names_both_sides(signals: &[Signal]) -> bool {
    use SignalKind::{Ddq, DdqMotor, Dq, DqMotor, QMotor, Q};
    let names = |kind, joint| signals.contains(&Signal { kind, joint });
    signals.iter().any(|signal| match signal.kind {
        Q => names(QMotor, signal.joint),
        Dq => names(DqMotor, signal.joint),
        Ddq => names(DdqMotor, signal.joint),
        _ => false,
    })
}
