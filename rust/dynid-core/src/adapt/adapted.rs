//! What is said of a change of the model, and a model with the change in it.

use crate::effects::EffectTerm;
use crate::error::CoreError;
use crate::link_params::N_LINK_PARAMS;
use crate::model::{TorqueModel, TorqueModelParts};
use crate::slices::{at, set};
use crate::watch::rows::friction_terms;

/// Mass and first moments of a load.
pub const N_PAYLOAD: usize = 4;

/// Half of an interval of 95 % over its standard deviation.
pub(super) const INTERVAL: f64 = 1.96;

/// What follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The factor on all friction of a joint.
    Friction,
    /// The load at the last link.
    Payload,
}

impl Part {
    /// In files and reports.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Friction => "friction",
            Self::Payload => "payload",
        }
    }
}

/// Why something is said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// It has moved by as much as is said.
    Followed,
    /// It stands at its limit, and the data lie beyond.
    Limit,
    /// The data came back from beyond its limit.
    Within,
    /// It was put back to the model as it was identified.
    Reset,
}

impl Reason {
    /// In files and reports.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Followed => "followed",
            Self::Limit => "limit",
            Self::Within => "within",
            Self::Reset => "reset",
        }
    }
}

/// A change of what is added to the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adapted {
    /// What has moved.
    pub part: Part,
    /// On which joint; a load is on all, and has the last.
    pub joint: usize,
    /// Factor on friction, or mass \[kg\], that was said before, and that is used now.
    pub from: f64,
    /// See `from`.
    pub to: f64,
    /// What the data say; `to` follows it slowly, and stops at its limits.
    pub estimate: f64,
    /// Standard deviation of the estimate, with how far it is behind what grows steadily.
    pub std: f64,
    /// Of a load, the first moments that are used now, in the last link's frame \[kg m\].
    pub moments: [f64; 3],
    /// Why it is said.
    pub reason: Reason,
}

impl Adapted {
    /// Where the data say it is, with 95 %.
    #[must_use]
    pub fn interval(&self) -> [f64; 2] {
        let half = INTERVAL * self.std;
        [self.estimate - half, self.estimate + half]
    }
}

/// `model` with these factors on the friction of its joints, and with a load at its last link.
///
/// The model is another one, to be written to another file. Friction that grows with the load sees the load here, which the
/// torque of an [`Adaptation`](super::Adaptation) does not. The friction of standard parameters ([`TorqueModel::physical`])
/// takes the same factors; they are those of the arm alone, and stay behind where there is a load.
///
/// # Errors
/// [`CoreError`] if a length is wrong or a number is none that a model may have.
pub fn adapted_model(
    model: &TorqueModel,
    factors: &[f64],
    load: &[f64; N_PAYLOAD],
) -> Result<TorqueModel, CoreError> {
    let n = model.robot().n_joints();
    crate::dynamics::check_length("factors", factors, n)?;
    let mut phi = model.phi().to_vec();
    let first = N_LINK_PARAMS * (n - 1);
    for (k, more) in load.iter().enumerate() {
        let own = at(&phi, first + k);
        set(&mut phi, first + k, own + more);
    }
    let scaled = |term: &EffectTerm| {
        let width = term.effect().n_columns().max(1);
        let rows = term.coefficients().chunks(width).zip(factors);
        let numbers = rows.flat_map(|(row, factor)| row.iter().map(move |x| factor * x));
        EffectTerm::new(term.effect().clone(), numbers.collect(), n)
    };
    let terms = model.effects().iter().zip(friction_terms(model));
    let effects = terms.map(|(term, is_friction)| {
        if is_friction {
            scaled(term)
        } else {
            Ok(term.clone())
        }
    });
    let made = TorqueModel::new(TorqueModelParts {
        robot: model.robot().clone(),
        phi,
        torque_scale: model.torque_scale().to_vec(),
        effects: effects.collect::<Result<_, _>>()?,
        residual: model.residual().cloned(),
        encoder_delay: model.encoder_delay().to_vec(),
        noise_std: model.noise_std().to_vec(),
        domain: model.domain().clone(),
        torque_unit: model.torque_unit().to_owned(),
        step: model.step(),
    })?;
    let made = match model.encoder_error() {
        Some(error) => made.with_encoder_error(error.clone())?,
        None => made,
    };
    let made = made.with_torque_delay(model.torque_delay())?;
    let made = match model.band() {
        Some(band) => made.with_band(*band)?,
        None => made,
    };
    match model.physical() {
        Some(physical) if *load == [0.0; N_PAYLOAD] => {
            let mut physical = physical.clone();
            for values in [&mut physical.damping, &mut physical.friction] {
                for (value, factor) in values.iter_mut().zip(factors) {
                    *value *= factor;
                }
            }
            made.with_physical(physical)
        }
        _ => Ok(made),
    }
}
