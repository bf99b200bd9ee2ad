//! A physically consistent set of parameters: bodies that could be built, beside the torque model that is fitted freely.

use nalgebra::Cholesky;

use crate::dynamics::check_length;
use crate::error::CoreError;
use crate::link_params::{pseudo_inertia, LinkParams, N_LINK_PARAMS};

/// Standard parameters of an arm that other programs accept. SI, whatever the unit of the model's torque channel.
///
/// A separate answer: the torque model is evaluated without it.
#[derive(Clone, Debug, PartialEq)]
pub struct PhysicalSet {
    /// Ten parameters per link, `10 n` values; masses positive, pseudo-inertias positive definite.
    pub phi: Vec<f64>,
    /// Rotor inertia reflected to the link side, at least 0 \[kg·m², kg\].
    pub rotor_inertia: Vec<f64>,
    /// Viscous friction of both directions, at least 0 \[N·m·s/rad, N·s/m\].
    pub damping: Vec<f64>,
    /// Coulomb friction of both directions, at least 0 \[N·m, N\].
    pub friction: Vec<f64>,
    /// Torque per unit of the model's torque channel, positive \[N·m per N·m or A\]; ones where torques were fitted.
    pub drive_gain: Vec<f64>,
}

impl PhysicalSet {
    /// Checks every length and number for an arm of `n` joints.
    ///
    /// # Errors
    /// [`CoreError`] naming what does not fit.
    pub fn check(&self, n: usize) -> Result<(), CoreError> {
        let parts = [
            ("physical.phi", &self.phi, N_LINK_PARAMS * n),
            ("physical.rotor_inertia", &self.rotor_inertia, n),
            ("physical.damping", &self.damping, n),
            ("physical.friction", &self.friction, n),
            ("physical.drive_gain", &self.drive_gain, n),
        ];
        for (what, values, expected) in parts {
            check_length(what, values, expected)?;
            if !values.iter().all(|x| x.is_finite()) {
                return Err(CoreError::NonFiniteParameter);
            }
        }
        for (what, values, _) in &parts[1..4] {
            if values.iter().any(|x| *x < 0.0) {
                return Err(CoreError::Range { what });
            }
        }
        if self.drive_gain.iter().any(|x| *x <= 0.0) {
            return Err(CoreError::Range {
                what: "physical.drive_gain",
            });
        }
        for link in self.links() {
            if Cholesky::new(pseudo_inertia(link)).is_none() {
                return Err(CoreError::Range {
                    what: "physical.phi (a pseudo-inertia that is not positive definite)",
                });
            }
        }
        Ok(())
    }

    /// The parameters link by link.
    pub fn links(&self) -> impl Iterator<Item = &LinkParams> {
        self.phi.as_chunks::<N_LINK_PARAMS>().0.iter()
    }
}
