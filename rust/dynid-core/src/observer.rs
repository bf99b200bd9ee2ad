//! External torque from the generalised momentum, without acceleration, and whether it is a contact.
//!
//! ```text
//! dp/dt = tau - rest(q, dq) - g(q) + C(q, dq)^T dq + tau_ext            p = M(q) dq
//! T dr/dt = tau_ext - r                                                  r is what the observer says
//! ```
//!
//! The residual of A. De Luca and R. Mattone (ICRA 2003, 2005); names as in S. Haddadin, A. De Luca and A. Albu-Schaeffer,
//! "Robot collisions: a survey" (IEEE Trans. Robot. 33(6), 2017), section V. `rest` is friction and every other effect of the
//! model and its third loop, at the state; rotors and coupled rotors, whose torque is linear in the acceleration, count with
//! their momentum instead. From one sample to the next that is, exactly for an external torque that is constant between them,
//!
//! ```text
//! r' = a r + (1 - a) ((p' - p) / dt - mean of the torques),   a = exp(-dt / T)
//! ```
//!
//! Where a joint's torque channel is later than the others' by d, its p, g and C^T dq are those of d before, as its terms are.
//!
//! Thresholds follow from the identified uncertainty. What the model leaves has the standard deviation s (the estimator's, at
//! this state) and forgets with a correlation time c, so r has, of it,
//!
//! ```text
//! s_r = s sqrt(c / (c + T))          a first-order low-pass on noise with the spectrum 2 s^2 c / (1 + (w c)^2)
//! ```
//!
//! and crosses a level k s_r so often per second (S. O. Rice, Bell Syst. Tech. J. 24, 1945: the slope's deviation is
//! s_r / sqrt(c T)): `2 n / (2 pi sqrt(c T)) exp(-k^2 / 2)` for n joints and two signs. k is what makes that the false contacts that
//! are asked for. Where c is not known nothing is taken for granted: s_r = s, and k as if c were T. With an
//! [`Uncertainty`] both follow from it instead: s_r from the state, k from how often healthy runs pass it.
//!
//! Hand guiding takes what of r lies beyond the threshold d = k s_r, smoothly over one deviation w = d / k:
//!
//! ```text
//! x = |r| - d         guide = 0 for x <= 0,  sign(r) x^2 / (x + w) beyond
//! ```
//!
//! so an arm that follows it does not move by itself where the model knows little, more often than contacts are faked.

mod settings;
mod threshold;

use std::sync::Arc;

use crate::dynamics::{check_length, inverse_dynamics_into, Workspace};
use crate::effects::EffectInput;
use crate::error::CoreError;
use crate::estimator::late::Late;
use crate::estimator::TorqueEstimator;
use crate::model::{check_step, TorqueModel};
use crate::momentum::{momentum_into, MomentumWorkspace};
pub(crate) use crate::rest::rest_speeds;
use crate::rest::{at_rest, of_state};
use crate::slices::{copy, mirror_fields, rows, Mirror};
use crate::state::State;
use crate::uncertainty::{Deviation, Doing, Uncertainty};

pub use settings::ObserverSettings;

/// The momentum of samples further apart than so many time constants is not compared.
const LONGEST: f64 = 10.0;

/// Beyond this a torque is an overflow.
const OVERFLOW: f64 = 1e300;

/// What it saw at the sample before.
#[derive(Clone, Debug)]
struct Memory {
    momentum: Vec<f64>,
    torque: Vec<f64>,
    valid: bool,
}

/// The observer of one arm. All memory is taken in `new`.
#[derive(Clone, Debug)]
pub struct MomentumObserver {
    model: Arc<TorqueModel>,
    settings: ObserverSettings,
    /// k of every joint.
    factors: Vec<f64>,
    workspace: Workspace,
    momenta: MomentumWorkspace,
    /// Torque that remains of a joint that stands without load, less what follows the angle, and the speed below which it may.
    at_rest: Vec<[f64; 2]>,
    /// Friction that grows with the load or follows the angle, and the speed of every joint at which its step is passed.
    of_state: Vec<(usize, Vec<f64>)>,
    /// Torque that remains of a joint that stands, with what its load and its angle add.
    holds: Vec<f64>,
    /// Time since each joint moved slowly \[s\].
    since_rest: Vec<f64>,
    zeros: Vec<f64>,
    before: Memory,
    momentum: Vec<f64>,
    torque: Vec<f64>,
    /// Gravity, and what the links' momentum drifts by, n values each.
    of_links: Vec<f64>,
    /// Where a channel is later than the others: momentum, gravity and drift of the last samples.
    late: Option<Late>,
    scratch: Vec<f64>,
    std: Vec<f64>,
    external: Vec<f64>,
    threshold: Vec<f64>,
    /// What of the threshold is friction at rest.
    rest: Vec<f64>,
    /// What of `external` a hand may guide the arm by.
    guide: Vec<f64>,
    contact: bool,
    /// From state to state, where it is known.
    deviation: Option<Deviation>,
}

impl MomentumObserver {
    /// The last allocation.
    ///
    /// # Errors
    /// [`CoreError::Range`] if a setting is none.
    pub fn new(model: Arc<TorqueModel>, settings: ObserverSettings) -> Result<Self, CoreError> {
        settings.check()?;
        let n = model.robot().n_joints();
        let (mut at_rest, of_state) = (at_rest(&model), of_state(&model));
        for (_, speeds) in &of_state {
            for ([_, speed], own) in at_rest.iter_mut().zip(speeds) {
                *speed = speed.max(*own);
            }
        }
        Ok(Self {
            factors: vec![settings.threshold_factor(n); n],
            settings,
            workspace: Workspace::new(model.robot()),
            momenta: MomentumWorkspace::new(model.robot()),
            at_rest,
            of_state,
            holds: vec![0.0; n],
            since_rest: vec![0.0; n],
            zeros: vec![0.0; n],
            before: Memory {
                momentum: vec![0.0; n],
                torque: vec![0.0; n],
                valid: false,
            },
            momentum: vec![0.0; n],
            torque: vec![0.0; n],
            of_links: vec![0.0; 2 * n],
            late: late(&model, model.step().unwrap_or(0.0)).unwrap_or_default(),
            scratch: vec![0.0; n],
            std: vec![0.0; n],
            external: vec![0.0; n],
            threshold: vec![f64::INFINITY; n],
            rest: vec![0.0; n],
            guide: vec![0.0; n],
            contact: false,
            deviation: None,
            model,
        })
    }

    /// The same observer for samples `step` seconds apart, where that is not what the model says.
    ///
    /// # Errors
    /// [`CoreError::Range`] if `step` is not positive, or so short that the delays between channels ask for too many samples.
    pub fn with_step(mut self, step: f64) -> Result<Self, CoreError> {
        check_step(step)?;
        self.late = late(&self.model, step).ok_or(CoreError::Range { what: "step" })?;
        Ok(self)
    }

    /// The same observer, whose thresholds follow from how far off it is at each state.
    ///
    /// # Errors
    /// [`CoreError`] if `uncertainty` is not of this model.
    pub fn with_uncertainty(mut self, uncertainty: Arc<Uncertainty>) -> Result<Self, CoreError> {
        let factors = uncertainty.factors(self.settings.false_per_hour);
        let deviation = Deviation::new(uncertainty, &self.model)?;
        self.factors = factors;
        self.deviation = Some(deviation);
        Ok(self)
    }

    /// How it listens.
    #[must_use]
    pub fn settings(&self) -> &ObserverSettings {
        &self.settings
    }

    /// r, n values \[torque unit\]: what pushes the arm, in the sense of the torques. Finite.
    #[must_use]
    pub fn external(&self) -> &[f64] {
        &self.external
    }

    /// Beyond these it is a contact, n values \[torque unit\]; infinite before the first sample.
    #[must_use]
    pub fn threshold(&self) -> &[f64] {
        &self.threshold
    }

    /// What of the thresholds is friction of joints that stand or stood just now, n values \[torque unit\].
    #[must_use]
    pub fn rest(&self) -> &[f64] {
        &self.rest
    }

    /// What of r lies beyond the thresholds, n values \[torque unit\]: what an arm may follow that a hand guides. Zero where the
    /// last sample could not be used.
    #[must_use]
    pub fn guide(&self) -> &[f64] {
        &self.guide
    }

    /// Nothing guides the arm until the next sample.
    pub fn let_go(&mut self) {
        self.guide.fill(0.0);
    }

    /// Where thresholds follow from the state: what every joint does, and the variance by parameters that are not known
    /// well, n values each \[torque unit²\].
    #[must_use]
    pub fn sources(&self) -> Option<(&[Doing], &[f64])> {
        let deviation = self.deviation.as_ref()?;
        Some((deviation.doing(), deviation.of_parameters()))
    }

    /// True from when a joint's r passes its threshold until all are below half of theirs.
    #[must_use]
    pub fn contact(&self) -> bool {
        self.contact
    }

    /// The samples before are not compared with the next ones: something is missing between them. r stays, and nothing guides.
    pub fn interrupt(&mut self) {
        if let Some(late) = &mut self.late {
            late.reset();
        }
        self.pause();
    }

    /// The sample before is not compared with the next one.
    fn pause(&mut self) {
        self.before.valid = false;
        self.let_go();
    }

    /// Goes on with what `before` saw, under this one's model.
    pub fn continue_from(&mut self, before: &Self) {
        self.interrupt();
        if before.external.len() == self.external.len() {
            copy(&before.external, &mut self.external);
            self.contact = before.contact;
        }
    }

    /// Takes the sample that `estimator` has just answered well, with the torque that was measured at it (n values
    /// \[torque unit\]), `elapsed` seconds after the one before. The acceleration of that sample is read by the estimator's
    /// load-dependent terms only; without one, give it zeros.
    ///
    /// # Errors
    /// [`CoreError`] if a length is wrong, the estimator has another number of joints, or the time is not positive.
    pub fn step(
        &mut self,
        estimator: &TorqueEstimator,
        tau: &[f64],
        elapsed: f64,
    ) -> Result<(), CoreError> {
        check_step(elapsed)?;
        let n = self.external.len();
        check_length("tau", tau, n)?;
        check_length("terms", estimator.terms(), n * self.model.n_terms())?;
        estimator.predicted_std_into(&mut self.std)?;
        let state = estimator.true_state();
        self.sum_torques(estimator, tau);
        self.sum_links(&state)?;
        let is_known = self.show(elapsed);
        let numbers = self.momentum.iter().chain(&self.torque);
        if !numbers.into_iter().all(|x| x.abs() < OVERFLOW) {
            self.interrupt();
            return Ok(());
        }
        if !is_known {
            self.pause();
            return Ok(());
        }
        if self.before.valid && elapsed < LONGEST * self.settings.time_constant {
            self.advance(elapsed);
        }
        copy(&self.momentum, &mut self.before.momentum);
        copy(&self.torque, &mut self.before.torque);
        self.before.valid = true;
        self.sum_rest(&state, estimator.tau_link());
        self.judge(state.dq_motor, elapsed);
        if let Some(deviation) = &mut self.deviation {
            let (slow, time) = (&self.at_rest, self.settings.time_constant);
            deviation.step(
                &self.model,
                estimator,
                slow,
                &self.since_rest,
                elapsed,
                time,
            )?;
            self.judge_by_state();
        }
        self.decide();
        Ok(())
    }

    /// Measured torque less all terms of the model that do not accelerate, but the links'.
    fn sum_torques(&mut self, estimator: &TorqueEstimator, tau: &[f64]) {
        copy(tau, &mut self.torque);
        let n = tau.len();
        let effects = self.model.effects().iter().map(Some);
        let terms = rows(estimator.terms(), n).skip(1);
        for (term, effect) in terms.zip(effects.chain([None])) {
            if effect.is_some_and(|effect| effect.effect().entry().needs(ACCELERATION)) {
                continue;
            }
            for (torque, term) in self.torque.iter_mut().zip(term) {
                *torque -= term;
            }
        }
    }

    /// Gravity, momentum of links and rotors, and what the links' momentum drifts by, as the channels' scale shows them.
    fn sum_links(&mut self, state: &State<'_>) -> Result<(), CoreError> {
        let (robot, phi) = (self.model.robot(), self.model.phi());
        let momentum = &mut self.momentum;
        let n = momentum.len();
        let (gravity, drift) = self.of_links.split_at_mut_checked(n).unwrap_or_default();
        let zeros = &self.zeros;
        inverse_dynamics_into(
            robot,
            &mut self.workspace,
            state.q,
            zeros,
            zeros,
            phi,
            gravity,
        )?;
        momentum_into(
            robot,
            &mut self.momenta,
            state.q,
            state.dq,
            phi,
            momentum,
            drift,
        )?;
        for row in [&mut *momentum, gravity, drift] {
            for (x, scale) in row.iter_mut().zip(self.model.torque_scale()) {
                *x *= scale;
            }
        }
        // Linear in the acceleration with constant coefficients: at the velocity it is the momentum.
        let input = EffectInput {
            state: State {
                ddq: state.dq,
                ddq_motor: state.dq_motor,
                ..*state
            },
            tau_link: &self.zeros,
            tau_motor: &self.zeros,
            step: 0.0,
            sign: None,
        };
        let mut effects = self.model.effects().iter();
        while let Some(effect) = effects.find(|e| e.effect().entry().needs(ACCELERATION)) {
            effect.torque_into(&input, &mut [], &mut self.scratch);
            for (momentum, own) in self.momentum.iter_mut().zip(&self.scratch) {
                *momentum += own;
            }
        }
        Ok(())
    }

    /// Takes gravity and drift to the torques, of every joint at the time that its channel shows; false while that is not known.
    fn show(&mut self, elapsed: f64) -> bool {
        let is_known = self
            .late
            .as_mut()
            .is_none_or(|late| late.show(&mut self.momentum, &mut self.of_links, elapsed));
        let n = self.torque.len();
        let (gravity, drift) = self.of_links.split_at_checked(n).unwrap_or_default();
        for (torque, (gravity, drift)) in self.torque.iter_mut().zip(gravity.iter().zip(drift)) {
            *torque -= gravity;
            *torque += drift;
        }
        is_known
    }

    fn advance(&mut self, elapsed: f64) {
        let keep = (-elapsed / self.settings.time_constant).exp();
        let momenta = self.momentum.iter().zip(&self.before.momentum);
        let torques = self.torque.iter().zip(&self.before.torque);
        for (external, ((p, p0), (u, u0))) in self.external.iter_mut().zip(momenta.zip(torques)) {
            let now = (p - p0) / elapsed - 0.5 * (u + u0);
            let next = keep * *external + (1.0 - keep) * now;
            if next.abs() < OVERFLOW {
                *external = next;
            }
        }
    }
}

/// Keeps momentum, gravity and drift.
fn late(model: &TorqueModel, step: f64) -> Option<Option<Late>> {
    Late::of(model, 0.0, step, 3)
}

/// The signal of effects that are momentum.
const ACCELERATION: &str = "ddq_motor";

impl Mirror for Memory {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(self, of; momentum, torque; copied valid; kept);
    }
}

impl Mirror for MomentumObserver {
    fn mirror(&mut self, of: &Self) {
        if let (Some(own), Some(of)) = (&mut self.deviation, &of.deviation) {
            own.mirror(of);
        }
        if let (Some(own), Some(of)) = (&mut self.late, &of.late) {
            own.mirror(of);
        }
        mirror_fields!(
            self, of;
            workspace, momenta, at_rest, holds, since_rest, zeros, before, momentum, torque, of_links, scratch, std, external, threshold, rest, guide;
            copied settings, contact;
            kept model, deviation, factors, late, of_state
        );
    }
}
