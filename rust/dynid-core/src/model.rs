//! A torque model: facts only, immutable, shared.

use crate::delay_line::{n_delay_rows, shared_and_own, MOST_DELAY_VALUES};
use crate::dynamics::check_length;
use crate::effects::EffectTerm;
use crate::error::CoreError;
use crate::link_params::N_LINK_PARAMS;
use crate::physical::PhysicalSet;
use crate::residual::Residual;
use crate::robot::{Joint, JointKind, RobotModel};

/// What the encoders show too much, because their discs are not centred: once per turn of the joint.
#[derive(Clone, Debug, PartialEq)]
pub struct EncoderError {
    /// `[cosine, sine]` per joint \[rad\]: the link encoder shows `cosine cos q + sine sin q` too much.
    pub cos_sin: Vec<[f64; 2]>,
    /// True where every joint has one encoder, so that the motor side is the same signal and shows the same error.
    pub both_sides: bool,
}

/// Most that a torque channel may be late or early \[s\].
pub const MOST_TORQUE_DELAY: f64 = 0.5;

/// Highest rate or cutoff of an [`ErrorBand`] \[Hz\].
pub const MOST_BAND_RATE: f64 = 1e6;

/// Where the model's errors are told, so that they can be told again of the same run. Evaluation does not use it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorBand {
    /// Of the zero-phase low-pass through which measured and predicted torque are compared \[Hz\].
    pub cutoff: f64,
    /// Of the grid that runs are brought to \[Hz\].
    pub rate: f64,
    /// Whether what stands still is compared too.
    pub standstill: bool,
}

/// The box of states that the model was trained on; outside of it the answer is an extrapolation.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Domain {
    /// Least and greatest position per joint \[rad\].
    pub q: Vec<[f64; 2]>,
    /// Greatest speed per joint \[rad/s\].
    pub dq: Vec<f64>,
    /// Greatest acceleration per joint \[rad/s²\].
    pub ddq: Vec<f64>,
}

/// `tau = rigid body + effects + residual`, every number that evaluation needs.
#[derive(Clone, Debug, PartialEq)]
pub struct TorqueModel {
    robot: RobotModel,
    phi: Vec<f64>,
    torque_scale: Vec<f64>,
    effects: Vec<EffectTerm>,
    residual: Option<Residual>,
    encoder_delay: Vec<f64>,
    encoder_error: Option<EncoderError>,
    torque_delay: Vec<f64>,
    noise_std: Vec<f64>,
    domain: Domain,
    torque_unit: String,
    step: Option<f64>,
    band: Option<ErrorBand>,
    physical: Option<PhysicalSet>,
}

/// What a [`TorqueModel`] is made of; see its accessors for the meaning of each part.
#[derive(Clone, Debug)]
pub struct TorqueModelParts {
    /// Kinematics and gravity.
    pub robot: RobotModel,
    /// Ten parameters per link (lifted base parameters), `10 n` values.
    pub phi: Vec<f64>,
    /// What the torque channel shows per unit of link torque, per joint, positive: ones for torques; for currents the
    /// reciprocal drive gains, relative to the first joint's. Multiplies the rigid-body term.
    pub torque_scale: Vec<f64>,
    /// Effects, summed in this order.
    pub effects: Vec<EffectTerm>,
    /// Third loop, if it paid.
    pub residual: Option<Residual>,
    /// Delay of the link channel behind the motor channel per joint \[s\]; zeros with one encoder.
    pub encoder_delay: Vec<f64>,
    /// Standard deviation of what the model leaves, per joint \[torque unit\].
    pub noise_std: Vec<f64>,
    /// States that were trained on.
    pub domain: Domain,
    /// `"N*m"`, or `"A"` where currents were identified without a drive gain.
    pub torque_unit: String,
    /// Time between the samples that will come \[s\]; needed where an effect remembers in time, or the torque channel is late.
    pub step: Option<f64>,
}

/// Largest size of a parameter \[SI\]: the strongest arms hold loads of 1e5 N m and inertias of 1e5 kg m², and a
/// coefficient of a torque is at most so much per unit of its column. Ten thousand times that is a slip or a forgery, and
/// the torque of a forged model would be finite all the same.
pub const MOST: f64 = 1e9;
/// Longest unit of torque \[characters\].
const MOST_UNIT: usize = 16;

impl TorqueModel {
    /// Checks every length and every number.
    ///
    /// # Errors
    /// [`CoreError`] naming what does not fit.
    pub fn new(parts: TorqueModelParts) -> Result<Self, CoreError> {
        let n = parts.robot.n_joints();
        check_length("phi", &parts.phi, N_LINK_PARAMS * n)?;
        check_length("torque_scale", &parts.torque_scale, n)?;
        check_length("encoder_delay", &parts.encoder_delay, n)?;
        check_length("noise_std", &parts.noise_std, n)?;
        check_length("domain.dq", &parts.domain.dq, n)?;
        check_length("domain.ddq", &parts.domain.ddq, n)?;
        let lengths = [
            ("domain.q", parts.domain.q.len()),
            (
                "residual.joints",
                parts.residual.as_ref().map_or(n, |r| r.joints().len()),
            ),
        ];
        for (what, actual) in lengths {
            if actual != n {
                return Err(CoreError::Length {
                    what,
                    expected: n,
                    actual,
                });
            }
        }
        if let Some(step) = parts.step {
            check_step(step)?;
        }
        for term in &parts.effects {
            term.effect().check(n)?;
            if parts.step.is_none() && term.effect().entry().needs("step") {
                return Err(CoreError::NoStep {
                    kind: term.effect().kind(),
                });
            }
            check_length(
                "coefficients",
                term.coefficients(),
                n * term.effect().n_columns(),
            )?;
        }
        let numbers = parts
            .phi
            .iter()
            .chain(&parts.torque_scale)
            .chain(&parts.encoder_delay)
            .chain(&parts.noise_std)
            .chain(parts.domain.q.iter().flatten())
            .chain(&parts.domain.dq)
            .chain(&parts.domain.ddq);
        if !numbers.into_iter().all(|x| x.is_finite()) {
            return Err(CoreError::NonFiniteParameter);
        }
        let sizes = parts.phi.iter().chain(&parts.torque_scale);
        let sizes = sizes.chain(&parts.noise_std).chain(&parts.encoder_delay);
        if sizes.into_iter().any(|x| x.abs() > MOST) {
            return Err(CoreError::TooLarge { what: "a number" });
        }
        let mut terms = parts.effects.iter();
        if terms.any(|term| term.coefficients().iter().any(|x| x.abs() > MOST)) {
            return Err(CoreError::TooLarge {
                what: "a coefficient",
            });
        }
        if parts.torque_unit.chars().count() > MOST_UNIT {
            return Err(CoreError::Range {
                what: "torque_unit",
            });
        }
        if parts.torque_scale.iter().any(|x| *x <= 0.0) {
            return Err(CoreError::Range {
                what: "torque_scale",
            });
        }
        if parts.noise_std.iter().any(|x| *x < 0.0) {
            return Err(CoreError::Range { what: "noise_std" });
        }
        let TorqueModelParts {
            robot,
            phi,
            torque_scale,
            effects,
            residual,
            encoder_delay,
            noise_std,
            domain,
            torque_unit,
            step,
        } = parts;
        Ok(Self {
            robot,
            phi,
            torque_scale,
            effects,
            residual,
            encoder_delay,
            encoder_error: None,
            torque_delay: vec![0.0; n],
            noise_std,
            domain,
            torque_unit,
            step,
            band: None,
            physical: None,
        })
    }

    /// The same model for encoders that show too much. Zeros are no error.
    ///
    /// # Errors
    /// [`CoreError`] if the length is wrong, a number is not finite, or a joint that slides has an error.
    pub fn with_encoder_error(self, error: EncoderError) -> Result<Self, CoreError> {
        let what = "encoder_error";
        let joints = self.robot.joints();
        if error.cos_sin.len() != joints.len() {
            return Err(CoreError::Length {
                what,
                expected: joints.len(),
                actual: error.cos_sin.len(),
            });
        }
        if !error.cos_sin.iter().flatten().all(|x| x.is_finite()) {
            return Err(CoreError::NonFiniteParameter);
        }
        let none = |parts: &[f64; 2]| *parts == [0.0; 2];
        let turns = |joint: &Joint| joint.kind == JointKind::Revolute;
        let mut pairs = error.cos_sin.iter().zip(joints);
        if !pairs.all(|(parts, joint)| none(parts) || turns(joint)) {
            return Err(CoreError::Range { what });
        }
        let encoder_error = (!error.cos_sin.iter().all(none)).then_some(error);
        Ok(Self {
            encoder_error,
            ..self
        })
    }

    /// What the encoders show too much, where they do.
    #[must_use]
    pub fn encoder_error(&self) -> Option<&EncoderError> {
        self.encoder_error.as_ref()
    }

    /// The same model for torque channels that are late behind the encoders by `delays` seconds, one per joint (early, if
    /// negative).
    ///
    /// # Errors
    /// [`CoreError`] if there is not one per joint, a delay is longer than [`MOST_TORQUE_DELAY`] either way or asks for
    /// more than [`MOST_DELAY_ROWS`](crate::delay_line::MOST_DELAY_ROWS) states, or the model has no step to count it in.
    pub fn with_torque_delay(self, delays: &[f64]) -> Result<Self, CoreError> {
        let what = "torque_delay (at most 0.5 s either way, and 4094 steps)";
        check_length("torque_delay", delays, self.robot.n_joints())?;
        if !delays.iter().all(|delay| delay.is_finite()) {
            return Err(CoreError::NonFiniteParameter);
        }
        if delays.iter().any(|delay| delay.abs() > MOST_TORQUE_DELAY) {
            return Err(CoreError::Range { what });
        }
        if delays.iter().any(|delay| *delay != 0.0) {
            let kind = "torque_delay";
            let step = self.step.ok_or(CoreError::NoStep { kind })?;
            // From the earliest channel to the latest one, which is what is to be kept of a record.
            let (shared, own) = shared_and_own(delays, -MOST_TORQUE_DELAY);
            let between = own.iter().copied().fold(0.0, f64::max);
            n_delay_rows(shared.abs(), step).ok_or(CoreError::Range { what })?;
            let n_rows = n_delay_rows(between, step).ok_or(CoreError::Range { what })?;
            // Every term, and the variance.
            let width = (self.n_terms() + 1) * delays.len();
            if between > 0.0 && n_rows * width > MOST_DELAY_VALUES {
                let what = "torque_delay (as many steps of as many terms)";
                return Err(CoreError::Range { what });
            }
        }
        Ok(Self {
            torque_delay: delays.to_vec(),
            ..self
        })
    }

    /// How late the torque channel of each joint is behind the encoders \[s\]; negative where it is early. The model
    /// predicts what the channel shows, which is the torque of the state of that long ago.
    #[must_use]
    pub fn torque_delay(&self) -> &[f64] {
        &self.torque_delay
    }

    /// The same model with the band in which its errors are told.
    ///
    /// # Errors
    /// [`CoreError::Range`] if the cutoff or the rate is not positive, or higher than [`MOST_BAND_RATE`].
    pub fn with_band(self, band: ErrorBand) -> Result<Self, CoreError> {
        let numbers = [("band.cutoff", band.cutoff), ("band.rate", band.rate)];
        for (what, x) in numbers {
            // Written so that a NaN is none.
            if !(x > 0.0 && x <= MOST_BAND_RATE) {
                return Err(CoreError::Range { what });
            }
        }
        Ok(Self {
            band: Some(band),
            ..self
        })
    }

    /// Where its errors are told, if it says so.
    #[must_use]
    pub fn band(&self) -> Option<&ErrorBand> {
        self.band.as_ref()
    }

    /// The same model with a physically consistent set beside it.
    ///
    /// # Errors
    /// [`CoreError`] naming what does not fit.
    pub fn with_physical(self, physical: PhysicalSet) -> Result<Self, CoreError> {
        physical.check(self.robot.n_joints())?;
        Ok(Self {
            physical: Some(physical),
            ..self
        })
    }

    /// The physically consistent set, where one was identified; evaluation does not use it.
    #[must_use]
    pub fn physical(&self) -> Option<&PhysicalSet> {
        self.physical.as_ref()
    }

    /// Kinematics and gravity.
    #[must_use]
    pub fn robot(&self) -> &RobotModel {
        &self.robot
    }

    /// Ten parameters per link; exact for torque, not necessarily a physical inertia.
    #[must_use]
    pub fn phi(&self) -> &[f64] {
        &self.phi
    }

    /// Torque channel per unit of link torque, per joint.
    #[must_use]
    pub fn torque_scale(&self) -> &[f64] {
        &self.torque_scale
    }

    /// Effects in order of summation.
    #[must_use]
    pub fn effects(&self) -> &[EffectTerm] {
        &self.effects
    }

    /// Third loop, if it paid.
    #[must_use]
    pub fn residual(&self) -> Option<&Residual> {
        self.residual.as_ref()
    }

    /// Delay of the link channel behind the motor channel \[s\].
    #[must_use]
    pub fn encoder_delay(&self) -> &[f64] {
        &self.encoder_delay
    }

    /// Standard deviation of what the model leaves \[torque unit\].
    #[must_use]
    pub fn noise_std(&self) -> &[f64] {
        &self.noise_std
    }

    /// States that were trained on.
    #[must_use]
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// `"N*m"` or `"A"`.
    #[must_use]
    pub fn torque_unit(&self) -> &str {
        &self.torque_unit
    }

    /// Time between samples \[s\], where the model has one.
    #[must_use]
    pub fn step(&self) -> Option<f64> {
        self.step
    }

    /// Rigid body, effects, third loop.
    #[must_use]
    pub fn n_terms(&self) -> usize {
        1 + self.effects.len() + usize::from(self.residual.is_some())
    }

    /// Per joint, whether an effect with a size there follows its measured temperature.
    #[must_use]
    pub fn wants_temperature(&self) -> Vec<bool> {
        let mut wants = vec![false; self.robot.n_joints()];
        for term in &self.effects {
            if term.effect().entry().needs("temperature") {
                let rows = term.coefficients().chunks_exact(term.effect().n_columns());
                for (wants, row) in wants.iter_mut().zip(rows) {
                    *wants |= row.iter().any(|c| *c != 0.0);
                }
            }
        }
        wants
    }

    /// Names of the terms in order of summation: `rigid_body`, the effects, `residual`. Of a kind that comes again the
    /// second is called kind2, and so on.
    #[must_use]
    pub fn term_names(&self) -> Vec<String> {
        let kinds = self.effects.iter().map(|term| term.effect().kind());
        let names: Vec<&str> = std::iter::once("rigid_body")
            .chain(kinds)
            .chain(self.residual.as_ref().map(|_| "residual"))
            .collect();
        let earlier = |k: usize| names[..k].iter().filter(|name| **name == names[k]).count();
        (0..names.len())
            .map(|k| match earlier(k) {
                0 => names[k].to_owned(),
                count => format!("{}{}", names[k], count + 1),
            })
            .collect()
    }
}

/// # Errors
/// [`CoreError::Range`] if the time between samples is not positive.
pub fn check_step(step: f64) -> Result<(), CoreError> {
    if step > 0.0 && step.is_finite() {
        Ok(())
    } else {
        Err(CoreError::Range { what: "step" })
    }
}
