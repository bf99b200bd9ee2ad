//! Signals by name: what a regression of the third loop may be told to look at.

use core::fmt;

use crate::state::State;

/// Most signals that one regression sees.
pub const MAX_INPUTS: usize = 6;

/// What is read of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SignalKind {
    /// Link-side position.
    Q,
    /// Link-side velocity.
    Dq,
    /// Link-side acceleration.
    Ddq,
    /// Motor-side position, reduced by the gear ratio like the next two.
    QMotor,
    /// Motor-side velocity.
    DqMotor,
    /// Motor-side acceleration.
    DdqMotor,
    /// Rigid-body torque that the model predicts, before the torque channel's scale. Never a measured one.
    TauLink,
}

impl SignalKind {
    /// Every kind.
    pub const ALL: [Self; 7] = [
        Self::Q,
        Self::Dq,
        Self::Ddq,
        Self::QMotor,
        Self::DqMotor,
        Self::DdqMotor,
        Self::TauLink,
    ];

    /// Name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Q => "q",
            Self::Dq => "dq",
            Self::Ddq => "ddq",
            Self::QMotor => "q_motor",
            Self::DqMotor => "dq_motor",
            Self::DdqMotor => "ddq_motor",
            Self::TauLink => "tau_link",
        }
    }
}

/// One signal of one joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signal {
    /// What is read.
    pub kind: SignalKind,
    /// Index along the chain.
    pub joint: usize,
}

impl Signal {
    /// The signal `name` of `joint`.
    ///
    /// # Errors
    /// [`UnknownSignal`] if there is none of that name.
    pub fn named(name: &str, joint: usize) -> Result<Self, UnknownSignal> {
        SignalKind::ALL
            .into_iter()
            .find(|kind| kind.name() == name)
            .map(|kind| Self { kind, joint })
            .ok_or_else(|| UnknownSignal(name.to_owned()))
    }

    /// Its value at a state, with the rigid-body torque `tau_link` that the model predicts there \[N·m\].
    #[must_use]
    pub fn at(self, state: &State<'_>, tau_link: &[f64]) -> f64 {
        let signal = match self.kind {
            SignalKind::Q => state.q,
            SignalKind::Dq => state.dq,
            SignalKind::Ddq => state.ddq,
            SignalKind::QMotor => state.q_motor,
            SignalKind::DqMotor => state.dq_motor,
            SignalKind::DdqMotor => state.ddq_motor,
            SignalKind::TauLink => tau_link,
        };
        crate::slices::at(signal, self.joint)
    }
}

/// There is no signal of this name. Only construction meets it, so it may allocate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownSignal(String);

impl fmt::Display for UnknownSignal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = SignalKind::ALL.map(SignalKind::name).join(", ");
        write!(
            f,
            "there is no signal {:?}, expected one of {names}",
            self.0
        )
    }
}

impl core::error::Error for UnknownSignal {}
