//! The third loop online: one mixture regression per joint on a pair of signals of that joint.

use crate::error::CoreError;
use crate::mixture::GaussianMixtureRegression;
use crate::state::State;

/// The two signals that a joint's mixture sees. Section 5 of the paper names both pairs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResidualInputs {
    /// Deflection `q_motor - q` and its rate, channel delay taken out (two encoders).
    Deflection,
    /// Motor-side position and velocity of the joint.
    JointState,
}

impl ResidualInputs {
    /// Name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Deflection => "deflection",
            Self::JointState => "joint_state",
        }
    }
}

/// Residual torque `tau_u` of Eq. 26.
#[derive(Clone, Debug, PartialEq)]
pub struct Residual {
    inputs: ResidualInputs,
    joints: Vec<Option<GaussianMixtureRegression>>,
}

/// Mahalanobis distance up to which the mixture is trusted fully, and the one from which it is not trusted at all.
/// Between them its torque fades, so that leaving the data is not a step.
const TRUSTED: (f64, f64) = (4.0, 6.0);

impl Residual {
    /// `joints`: one mixture per joint, `None` where the third loop did not pay.
    ///
    /// # Errors
    /// [`CoreError::Range`] if a mixture does not have two inputs.
    pub fn new(
        inputs: ResidualInputs,
        joints: Vec<Option<GaussianMixtureRegression>>,
    ) -> Result<Self, CoreError> {
        if joints
            .iter()
            .flatten()
            .any(|mixture| mixture.n_inputs() != 2)
        {
            return Err(CoreError::Range {
                what: "number of mixture inputs",
            });
        }
        Ok(Self { inputs, joints })
    }

    /// Which signals the mixtures see.
    #[must_use]
    pub fn inputs(&self) -> ResidualInputs {
        self.inputs
    }

    /// The mixtures, one per joint.
    #[must_use]
    pub fn joints(&self) -> &[Option<GaussianMixtureRegression>] {
        &self.joints
    }

    /// The two inputs of joint `j` at a state.
    #[must_use]
    pub fn inputs_at(inputs: ResidualInputs, j: usize, state: &State<'_>) -> [f64; 2] {
        match inputs {
            ResidualInputs::Deflection => state.deflection(j),
            ResidualInputs::JointState => [state.q_motor[j], state.dq_motor[j]],
        }
    }

    /// Torque of every joint \[N·m\] into `tau`; true if some joint was so far from the data that its torque was faded.
    pub fn torque_into(&self, state: &State<'_>, tau: &mut [f64]) -> bool {
        let mut faded = false;
        for (j, (mixture, tau)) in self.joints.iter().zip(tau).enumerate() {
            *tau = 0.0;
            let Some(mixture) = mixture else { continue };
            let u = Self::inputs_at(self.inputs, j, state);
            let prediction = mixture.predict(&u);
            let distance = prediction.distance_squared.sqrt();
            let (near, far) = TRUSTED;
            // A NaN distance (an overflow) compares false everywhere and so trusts nothing.
            let trust = if distance <= near {
                1.0
            } else if distance < far {
                (far - distance) / (far - near)
            } else {
                0.0
            };
            faded |= trust < 1.0;
            if trust > 0.0 {
                *tau = trust * prediction.mean;
            }
        }
        faded
    }
}
