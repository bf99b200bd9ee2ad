//! The third loop online: one regression per joint on a pair of signals of that joint.

use crate::error::CoreError;
use crate::mixture::{GaussianMixtureRegression, Prediction};
use crate::rbf::NormalisedRbf;
use crate::state::State;

/// The two signals that a joint's regression sees. Section 5 of the paper names the first two pairs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResidualInputs {
    /// Deflection `q_motor - q` and its rate, channel delay taken out (two encoders).
    Deflection,
    /// Motor-side position and velocity of the joint.
    JointState,
    /// Deflection less what the link's own torque winds up, `q_motor - q - compliance * tau_link` with the **predicted**
    /// rigid-body torque, and the deflection's rate. What the gear holds back is left over; the load, which is a
    /// hundred times larger and already in the rigid body, is not.
    LoadFreeDeflection,
}

impl ResidualInputs {
    /// Every choice.
    pub const ALL: [Self; 3] = [Self::Deflection, Self::JointState, Self::LoadFreeDeflection];

    /// Name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Deflection => "deflection",
            Self::JointState => "joint_state",
            Self::LoadFreeDeflection => "load_free_deflection",
        }
    }

    /// True if they need an encoder on either side of the gear.
    #[must_use]
    pub fn two_encoders(self) -> bool {
        !matches!(self, Self::JointState)
    }

    /// The two inputs of joint `j` at a state; `wind_up` is `compliance * tau_link` \[rad\], read by the last choice.
    #[must_use]
    pub fn at(self, j: usize, state: &State<'_>, wind_up: f64) -> [f64; 2] {
        let [deflection, rate] = state.deflection(j);
        match self {
            Self::Deflection => [deflection, rate],
            Self::JointState => [state.q_motor[j], state.dq_motor[j]],
            Self::LoadFreeDeflection => [deflection - wind_up, rate],
        }
    }
}

/// How a joint's residual torque follows from the two inputs. The choice is the user's.
#[derive(Clone, Debug, PartialEq)]
pub enum Regression {
    /// Eqs. 31-39.
    Mixture(GaussianMixtureRegression),
    /// Eqs. 27-30.
    Rbf(NormalisedRbf),
}

impl Regression {
    /// Name in files and for people.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Mixture(_) => "mixture",
            Self::Rbf(_) => "rbf",
        }
    }

    /// Inputs that it takes.
    #[must_use]
    pub fn n_inputs(&self) -> usize {
        match self {
            Self::Mixture(mixture) => mixture.n_inputs(),
            Self::Rbf(rbf) => rbf.n_inputs(),
        }
    }

    /// Mean, variance and distance from the data at `u`.
    #[must_use]
    pub fn predict(&self, u: &[f64]) -> Prediction {
        match self {
            Self::Mixture(mixture) => mixture.predict(u),
            Self::Rbf(rbf) => rbf.predict(u),
        }
    }

    fn second_moment(&self) -> f64 {
        match self {
            Self::Mixture(mixture) => mixture.second_moment(),
            Self::Rbf(rbf) => rbf.second_moment(),
        }
    }
}

impl From<GaussianMixtureRegression> for Regression {
    fn from(mixture: GaussianMixtureRegression) -> Self {
        Self::Mixture(mixture)
    }
}

impl From<NormalisedRbf> for Regression {
    fn from(rbf: NormalisedRbf) -> Self {
        Self::Rbf(rbf)
    }
}

/// Residual torque `tau_u` of Eq. 26.
#[derive(Clone, Debug, PartialEq)]
pub struct Residual {
    inputs: ResidualInputs,
    compliance: Vec<f64>,
    joints: Vec<Option<Regression>>,
}

/// Distance in widths up to which a regression is trusted fully, and the one from which it is not trusted at all.
/// Between them its torque fades, so that leaving the data is not a step.
const TRUSTED: (f64, f64) = (4.0, 6.0);

/// Greater variances are an overflow.
const MOST_VARIANCE: f64 = 1e300;

impl Residual {
    /// `joints`: one regression per joint, `None` where the third loop did not pay.
    ///
    /// # Errors
    /// [`CoreError::Range`] if a regression does not have two inputs.
    pub fn new(inputs: ResidualInputs, joints: Vec<Option<Regression>>) -> Result<Self, CoreError> {
        if joints.iter().flatten().any(|joint| joint.n_inputs() != 2) {
            return Err(CoreError::Range {
                what: "number of residual inputs",
            });
        }
        Ok(Self {
            inputs,
            compliance: vec![0.0; joints.len()],
            joints,
        })
    }

    /// With the gears' compliance \[rad per torque unit\], one per joint; zeros until it is given.
    ///
    /// # Errors
    /// [`CoreError`] if the length is wrong or a number negative or not finite.
    pub fn with_compliance(mut self, compliance: Vec<f64>) -> Result<Self, CoreError> {
        crate::dynamics::check_length("compliance", &compliance, self.joints.len())?;
        if !compliance.iter().all(|c| c.is_finite() && *c >= 0.0) {
            return Err(CoreError::Range { what: "compliance" });
        }
        self.compliance = compliance;
        Ok(self)
    }

    /// Which signals the regressions see.
    #[must_use]
    pub fn inputs(&self) -> ResidualInputs {
        self.inputs
    }

    /// Compliance of the gears \[rad per torque unit\], one per joint.
    #[must_use]
    pub fn compliance(&self) -> &[f64] {
        &self.compliance
    }

    /// The regressions, one per joint.
    #[must_use]
    pub fn joints(&self) -> &[Option<Regression>] {
        &self.joints
    }

    /// Torque of every joint \[N·m\] into `tau`; true if some joint was so far from the data that its torque was faded.
    ///
    /// `tau_link` is the predicted rigid-body torque. `variance` \[(N·m)²\] comes with what the model leaves on each
    /// joint. Where a regression is trusted it is replaced by the regression's own, which holds that noise too; where
    /// it fades, by that of a residual about which nothing is known, on top of the noise.
    pub fn torque_into(
        &self,
        state: &State<'_>,
        tau_link: &[f64],
        tau: &mut [f64],
        variance: &mut [f64],
    ) -> bool {
        let mut faded = false;
        let outputs = tau.iter_mut().zip(variance);
        for (j, (joint, (tau, variance))) in self.joints.iter().zip(outputs).enumerate() {
            *tau = 0.0;
            let Some(joint) = joint else { continue };
            let u = self.inputs.at(j, state, self.compliance[j] * tau_link[j]);
            let prediction = joint.predict(&u);
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
            *variance = (1.0 - trust) * (*variance + joint.second_moment());
            if trust > 0.0 {
                *tau = trust * prediction.mean;
                *variance += trust * prediction.variance;
            }
            *variance = variance.min(MOST_VARIANCE);
        }
        faded
    }
}
