//! Effects: torques that are linear in their coefficients. A torque model is a sum of them.
//!
//! `tau_j = columns_j(state; shape) · coefficients_j`. One file per effect; the shape parameters are its fields. The
//! same columns are fitted offline and summed online, so the two cannot drift apart.

mod friction;
mod rotor_inertia;
mod torque_offset;

pub use friction::{friction_columns, Friction, FRICTION_NAMES, N_FRICTION};
pub use rotor_inertia::RotorInertia;
pub use torque_offset::TorqueOffset;

use crate::dynamics::check_length;
use crate::error::CoreError;
use crate::state::State;

/// Upper bound on [`Effect::n_columns`]; columns of one joint fit in an array of this length.
pub const MAX_COLUMNS: usize = N_FRICTION;

/// Every kind of effect, with its shape parameters.
#[derive(Clone, Debug, PartialEq)]
pub enum Effect {
    /// Reflected rotor inertia.
    RotorInertia(RotorInertia),
    /// Constant torque (sensor offset, or the even part of friction).
    TorqueOffset(TorqueOffset),
    /// The paper's friction, Eqs. 9-11.
    Friction(Friction),
}

impl Effect {
    /// Name in files and reports.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::RotorInertia(_) => "rotor_inertia",
            Self::TorqueOffset(_) => "torque_offset",
            Self::Friction(_) => "friction",
        }
    }

    /// Names of the coefficients of one joint.
    #[must_use]
    pub fn coefficient_names(&self) -> &'static [&'static str] {
        match self {
            Self::RotorInertia(_) => &["rotor_inertia"],
            Self::TorqueOffset(_) => &["torque_offset"],
            Self::Friction(_) => &FRICTION_NAMES,
        }
    }

    /// Columns per joint.
    #[must_use]
    pub fn n_columns(&self) -> usize {
        self.coefficient_names().len()
    }

    /// Torque of joint `j` per unit coefficient, written to `columns` (length [`Self::n_columns`]).
    pub fn columns_into(&self, j: usize, state: &State<'_>, columns: &mut [f64]) {
        match self {
            Self::RotorInertia(effect) => effect.columns_into(j, state, columns),
            Self::TorqueOffset(effect) => effect.columns_into(columns),
            Self::Friction(effect) => effect.columns_into(j, state, columns),
        }
    }

    /// # Errors
    /// [`CoreError`] if the shape parameters do not fit `n_joints` or are out of range.
    pub fn check(&self, n_joints: usize) -> Result<(), CoreError> {
        match self {
            Self::RotorInertia(_) | Self::TorqueOffset(_) => Ok(()),
            Self::Friction(effect) => effect.check(n_joints),
        }
    }
}

/// An effect with its size: what a model stores and an estimator sums.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectTerm {
    effect: Effect,
    coefficients: Vec<f64>,
}

impl EffectTerm {
    /// `coefficients`: `n_joints` rows of [`Effect::n_columns`] values, row-major.
    ///
    /// # Errors
    /// [`CoreError`] if a length is wrong, a number is not finite or a shape parameter is out of range.
    pub fn new(effect: Effect, coefficients: Vec<f64>, n_joints: usize) -> Result<Self, CoreError> {
        effect.check(n_joints)?;
        check_length("coefficients", &coefficients, n_joints * effect.n_columns())?;
        if !coefficients.iter().all(|x| x.is_finite()) {
            return Err(CoreError::NonFiniteParameter);
        }
        Ok(Self {
            effect,
            coefficients,
        })
    }

    /// The effect and its shape.
    #[must_use]
    pub fn effect(&self) -> &Effect {
        &self.effect
    }

    /// Coefficients, row-major by joint.
    #[must_use]
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients
    }

    /// Torque of every joint \[N·m\], written to `tau`.
    pub fn torque_into(&self, state: &State<'_>, tau: &mut [f64]) {
        let width = self.effect.n_columns();
        let mut columns = [0.0; MAX_COLUMNS];
        for (j, (tau, coefficients)) in tau
            .iter_mut()
            .zip(self.coefficients.chunks_exact(width))
            .enumerate()
        {
            self.effect.columns_into(j, state, &mut columns[..width]);
            *tau = columns
                .iter()
                .zip(coefficients)
                .map(|(column, coefficient)| column * coefficient)
                .sum();
        }
    }
}
