//! One state in, one torque per term out: no allocation, no panic, a finite answer always.

pub(crate) mod late;
mod live;
mod terms;

use std::sync::Arc;

use crate::dynamics::{check_length, Torque, Workspace};
use crate::effects::{EffectInput, TAU_MOTOR};
use crate::error::CoreError;
use crate::intake::Intake;
use crate::lanes::{self, Kernel, Lanes};
use crate::model::{check_step, EncoderError, TorqueModel};
use crate::residual::{Load, ResidualTorque};
use crate::slices::{at, copy, rows_mut, set};
use crate::state::{align_link_side, true_motion, State};
use crate::step::{StepRows, Sum, Take};
use late::Late;
use terms::Terms;

/// What was unusual about a step, as bits. Zero is a good step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Status(u32);

impl Status {
    /// Nothing unusual.
    pub const OK: Self = Self(0);
    /// The state held a NaN, an infinity or a number beyond 1e100, or the torque overflowed; the last good torque is
    /// repeated.
    pub const NON_FINITE: Self = Self(1);
    /// The state is outside the box that the model was trained on.
    pub const OUTSIDE_DOMAIN: Self = Self(2);
    /// The third loop was asked far from its data; its torque was faded out.
    pub const RESIDUAL_FADED: Self = Self(4);
    /// An effect needs a signal that the state does not have (a temperature); its torque is zero on that joint.
    pub const SIGNAL_MISSING: Self = Self(8);
    /// Nothing new could be used; the last good torque is repeated.
    pub const REPEATED: Self = Self(16);
    /// The state is older than one that came already, and is not used.
    pub const OUT_OF_ORDER: Self = Self(32);
    /// The state's time went back. It is not used if states are numbered; otherwise it begins the stream again.
    pub const TIME_BACKWARDS: Self = Self(64);
    /// Nothing new for two cycles or more.
    pub const STALE: Self = Self(128);
    /// States were lost before this one, or the sender began again.
    pub const LOST: Self = Self(256);
    /// Velocities and accelerations cannot be told from the positions yet, and the last good torque is repeated; or, where
    /// the torque channel is late, states do not reach back far enough yet, and the oldest one is evaluated.
    pub const SETTLING: Self = Self(512);
    /// A position stands still in the sensor while the joint moves.
    pub const STUCK: Self = Self(1024);
    /// Something pushes the arm.
    pub const CONTACT: Self = Self(2048);
    /// The state lies beyond the model's limits ([`crate::limits`]); it was evaluated at them.
    pub const BEYOND_LIMITS: Self = Self(4096);

    /// Something of the model no longer holds, and was named at this step.
    pub const CHANGED: Self = Self(8192);
    /// What follows the arm has moved, or was stopped, and that was said at this step.
    pub const ADAPTED: Self = Self(16_384);
    /// What follows the arm stands at its limit, and the data lie beyond.
    pub const AT_LIMIT: Self = Self(32_768);

    /// The bits.
    #[must_use]
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// True if every bit of `other` is set.
    #[must_use]
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// The bits of both.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The bits that `other` has too.
    #[must_use]
    pub const fn only(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    pub(crate) fn set(&mut self, other: Self, on: bool) {
        if on {
            self.0 |= other.0;
        }
    }
}

/// Owns the memory; the model is shared.
///
/// It predicts what the torque channels show. Where they are late ([`TorqueModel::torque_delay`]) this is the torque of
/// an earlier state, so that states have to come in order of time, [`Self::step`] apart; where they are early, the states
/// that it belongs to have not come yet, and the torque is that of the state. Where one joint's channel is later than the
/// others', its terms are those of a while ago, and the rest that is told of a step belongs to the others.
#[derive(Clone, Debug)]
pub struct TorqueEstimator {
    intake: Intake,
    own: Evaluation,
    late: Option<Late>,
    /// How far ahead of a sample the states that come are \[s\], zero or negative.
    lead: f64,
}

/// Evaluates a state.
#[derive(Clone, Debug)]
struct Evaluation {
    model: Arc<TorqueModel>,
    workspace: Workspace,
    /// The true state, on the motor channel's clock.
    link: [Vec<f64>; 3],
    motor: [Vec<f64>; 3],
    /// The model's numbers that every step asks for.
    rows: StepRows,
    /// Rigid-body torque before the channel's scale.
    tau_link: Vec<f64>,
    /// Torque of the motors before undeclared effects, and which effects read it, if any.
    tau_motor: Vec<f64>,
    of_motor: Vec<bool>,
    any_of_motor: bool,
    /// Variance of what the model leaves.
    noise_variance: Vec<f64>,
    /// Joints on which an effect follows the temperature.
    wants_temperature: Vec<bool>,
    wants_any: bool,
    /// Time between samples.
    step: f64,
    /// What the effects remember, after the last good step and after this one.
    memory: Vec<f64>,
    next_memory: Vec<f64>,
    /// Terms of this step, `n_terms` rows of `n_joints`.
    scratch: Vec<f64>,
    /// Terms of the last good step.
    terms: Vec<f64>,
    total: Vec<f64>,
    /// Variances of this step and of the last good one.
    scratch_variance: Vec<f64>,
    variance: Vec<f64>,
}

impl TorqueEstimator {
    /// The last allocation.
    #[must_use]
    pub fn new(model: Arc<TorqueModel>) -> Self {
        let n = model.robot().n_joints();
        let n_terms = model.n_terms();
        let effects = model.effects().iter();
        let n_memory = effects.map(|term| term.effect().memory_len(n)).sum();
        let of_motor = model.effects().iter();
        let of_motor: Vec<bool> = of_motor
            .map(|term| term.effect().entry().needs(TAU_MOTOR))
            .collect();
        let noise_variance: Vec<f64> = model.noise_std().iter().map(|std| std * std).collect();
        let step = model.step().unwrap_or(0.0);
        let own = Evaluation {
            workspace: Workspace::new(model.robot()),
            link: std::array::from_fn(|_| vec![0.0; n]),
            motor: std::array::from_fn(|_| vec![0.0; n]),
            rows: StepRows::new(&model),
            tau_link: vec![0.0; n],
            tau_motor: vec![0.0; n],
            any_of_motor: of_motor.contains(&true),
            of_motor,
            wants_any: model.wants_temperature().contains(&true),
            wants_temperature: model.wants_temperature(),
            step,
            memory: vec![0.0; n_memory],
            next_memory: vec![0.0; n_memory],
            scratch: vec![0.0; n * n_terms],
            terms: vec![0.0; n * n_terms],
            total: vec![0.0; n],
            scratch_variance: vec![0.0; n],
            variance: noise_variance.clone(),
            noise_variance,
            model,
        };
        Self {
            intake: Intake::new(&own.model, step),
            late: Late::of_terms(&own.model, 0.0, step).unwrap_or_default(),
            lead: 0.0,
            own,
        }
    }

    /// The same estimator for samples `step` seconds apart, where that is not what the model says.
    ///
    /// # Errors
    /// [`CoreError::Range`] if `step` is not positive, or so short that the torque's delay asks for too many states.
    pub fn with_step(mut self, step: f64) -> Result<Self, CoreError> {
        check_step(step)?;
        let intake = self.intake.with_step(&self.own.model, step);
        self.intake = intake.ok_or(CoreError::Range { what: "step" })?;
        let late = Late::of_terms(&self.own.model, self.lead, step);
        self.late = late.ok_or(CoreError::Range { what: "step" })?;
        self.own.step = step;
        Ok(self)
    }

    /// Goes over a record, in which states are known before their time: how far ahead of every sample the next ones have to
    /// be taken \[s\], zero or negative, for channels that are early.
    ///
    /// # Errors
    /// [`CoreError::Range`] if the step is so short that the delays between channels ask for too many of them.
    pub fn look_ahead(&mut self) -> Result<f64, CoreError> {
        let delays = self.own.model.torque_delay().iter();
        let lead = delays.copied().fold(0.0, f64::min);
        if lead != self.lead {
            let late = Late::of_terms(&self.own.model, lead, self.own.step);
            self.late = late.ok_or(CoreError::Range { what: "step" })?;
            self.lead = lead;
        }
        Ok(lead)
    }

    /// The same estimator, which evaluates a state beyond the model's limits as it came; the status says so all the same.
    #[must_use]
    pub fn unlimited(mut self) -> Self {
        self.intake.set_unlimited(true);
        self
    }

    /// Back to how [`Self::new`] left it: nothing remembered, no torque yet. Allocates nothing; the step stays.
    pub fn reset(&mut self) {
        self.begin_anew();
        let own = &mut self.own;
        for numbers in [&mut own.memory, &mut own.terms, &mut own.total] {
            numbers.fill(0.0);
        }
        for (variance, std) in own.variance.iter_mut().zip(own.model.noise_std()) {
            *variance = std * std;
        }
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &TorqueModel {
        &self.own.model
    }

    /// True if an effect of the model follows a measured temperature.
    #[must_use]
    pub fn wants_temperature(&self) -> bool {
        self.own.wants_any
    }

    /// Torque of every term at the last step, `n_terms` rows of `n_joints`, row-major, in the order of
    /// [`TorqueModel::term_names`] \[torque unit\].
    #[must_use]
    pub fn terms(&self) -> &[f64] {
        &self.own.terms
    }

    /// Standard deviation that the model expects of measured minus predicted torque at the last step, written to `std`
    /// (n values) \[torque unit\]: of what the model leaves, and where a third loop acts, its own by the law of total
    /// variance, which holds that noise too. Parameters count as known.
    ///
    /// # Errors
    /// [`CoreError::Length`] if `std` has the wrong length.
    pub fn predicted_std_into(&self, std: &mut [f64]) -> Result<(), CoreError> {
        check_length("std", std, self.own.variance.len())?;
        for (std, variance) in std.iter_mut().zip(&self.own.variance) {
            *std = variance.sqrt();
        }
        Ok(())
    }

    /// Sum of the terms (Eq. 26; Eq. 1 without contact, which no term stands for), written to `tau` (n values).
    ///
    /// Output is finite whatever comes in: a NaN, an infinity or an overflow repeats the last good torque (zeros
    /// before the first) and says so in the status; what effects remember stays as it was.
    ///
    /// # Errors
    /// [`CoreError::Length`] if a slice has the wrong length; nothing is written then.
    pub fn estimate_into(
        &mut self,
        state: &State<'_>,
        tau: &mut [f64],
    ) -> Result<Status, CoreError> {
        let Self {
            intake, own, late, ..
        } = self;
        let n = own.model.robot().n_joints();
        state.check(n)?;
        check_length("tau", tau, n)?;
        let (shown, mut taken) = intake.take(state, own.step);
        let status = lanes::run(Step {
            own,
            shown: &shown,
            tau,
        });
        if let Some(late) = late {
            let is_good = !status.contains(Status::NON_FINITE);
            let stands_for_another = taken.contains(Status::SETTLING);
            taken.set(Status::SETTLING, !own.show(late, is_good, tau));
            if stands_for_another {
                late.reset();
            }
        }
        // Of what is no state nothing else is said.
        Ok(if status.contains(Status::NON_FINITE) {
            status
        } else {
            status.and(taken)
        })
    }
}

impl Evaluation {
    /// Puts the terms that the channels show in the place of this step's, where it was good; true if they are known.
    #[inline(never)]
    fn show(&mut self, late: &mut Late, is_good: bool, tau: &mut [f64]) -> bool {
        if !is_good {
            late.pass(self.step);
            return true;
        }
        let reached = late.show(&mut self.terms, &mut self.variance, self.step);
        lanes::run(Sum {
            terms: &self.terms,
            total: &mut self.total,
        });
        copy(&self.total, tau);
        reached
    }

    fn misses_temperature(&self, state: &State<'_>) -> bool {
        let known = |j: usize| state.temperature.is_some_and(|t| at(t, j).is_finite());
        let mut wanted = self.wants_temperature.iter().enumerate();
        wanted.any(|(j, wants)| *wants && !known(j))
    }
}

/// One step on one path from beginning to end: pieces that each choose theirs cannot be compiled into one.
struct Step<'a> {
    own: &'a mut Evaluation,
    shown: &'a State<'a>,
    tau: &'a mut [f64],
}

impl Kernel for Step<'_> {
    type Output = Status;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Status {
        let own = self.own;
        let taken = Take {
            rows: &own.rows,
            shown: self.shown,
            link: &mut own.link,
            motor: &mut own.motor,
        };
        let taken = taken.run::<S, L>();
        let mut status = Status::OK;
        let usable = taken.finite && {
            let faded = own.evaluate::<S, L>(self.shown);
            status.set(Status::RESIDUAL_FADED, faded);
            let remembers = own.next_memory.iter().all(|x| x.is_finite());
            let sum = Sum {
                terms: &own.scratch,
                total: &mut own.total,
            };
            remembers && sum.run::<S, L>()
        };
        if usable {
            status.set(Status::OUTSIDE_DOMAIN, !taken.inside_domain);
            status.set(
                Status::SIGNAL_MISSING,
                own.wants_any && own.misses_temperature(self.shown),
            );
            // What was the last good step becomes the next one's scratch.
            core::mem::swap(&mut own.terms, &mut own.scratch);
            core::mem::swap(&mut own.variance, &mut own.scratch_variance);
            core::mem::swap(&mut own.memory, &mut own.next_memory);
        } else {
            status = Status::NON_FINITE;
        }
        lanes::copy::<L>(&own.total, self.tau);
        status
    }
}

impl Evaluation {
    /// Every term into `scratch`; true if the third loop was faded.
    #[inline(always)]
    fn evaluate<S: Lanes<Raw = [f64; 1]>, L: Lanes>(&mut self, shown: &State<'_>) -> bool {
        let model = &*self.model;
        let n = model.robot().n_joints();
        if let Some(error) = model.encoder_error() {
            take_true_state(
                shown,
                error,
                model.encoder_delay(),
                &mut self.link,
                &mut self.motor,
            );
        }
        let [q, dq, ddq] = &self.link;
        let [q_motor, dq_motor, ddq_motor] = &self.motor;
        let state = &State {
            q,
            dq,
            ddq,
            q_motor,
            dq_motor,
            ddq_motor,
            temperature: shown.temperature,
        };
        let (scaled, rest) = self.scratch.split_at_mut_checked(n).unwrap_or_default();
        let rigid_body = Torque {
            robot: model.robot(),
            workspace: &mut self.workspace,
            motion: [q, dq, ddq],
            phi: model.phi(),
            tau: &mut self.tau_link,
        };
        rigid_body.run::<S, L>();
        scale::<L>(&self.tau_link, model.torque_scale(), scaled);
        let input = EffectInput {
            state: *state,
            tau_link: &self.tau_link,
            tau_motor: &[],
            step: self.step,
            sign: None,
        };
        lanes::copy::<L>(&self.memory, &mut self.next_memory);
        let n_effects = model.effects().len();
        let (effects, rest) = rest.split_at_mut_checked(n_effects * n).unwrap_or_default();
        let mut terms = Terms {
            effects: model.effects(),
            of_motor: &self.of_motor,
            memory: &mut self.next_memory,
            rows: effects,
        };
        terms.evaluate::<L>(&input, false);
        if self.any_of_motor {
            terms.motor_torque_into(scaled, &mut self.tau_motor);
            let tau_motor = &self.tau_motor;
            terms.evaluate::<L>(&EffectInput { tau_motor, ..input }, true);
        }
        lanes::copy::<L>(&self.noise_variance, &mut self.scratch_variance);
        match (model.residual(), rows_mut(rest, n).next()) {
            (Some(residual), Some(row)) => {
                let torque = ResidualTorque {
                    residual,
                    state,
                    load: Load {
                        tau_link: &self.tau_link,
                        scaled,
                    },
                    tau: row,
                    variance: &mut self.scratch_variance,
                };
                torque.run::<S, L>()
            }
            _ => false,
        }
    }
}

/// Torques as the channel shows them.
#[inline(always)]
fn scale<L: Lanes>(tau: &[f64], factors: &[f64], scaled: &mut [f64]) {
    let rows = tau.chunks(L::LEN).zip(factors.chunks(L::LEN));
    for (scaled, (tau, factors)) in scaled.chunks_mut(L::LEN).zip(rows) {
        (L::load_some(tau) * L::load_some(factors)).store_some(scaled);
    }
}

/// What the channels show, less the encoders' error, all on the motor channel's clock.
#[inline(never)]
fn take_true_state(
    shown: &State<'_>,
    error: &EncoderError,
    delay: &[f64],
    link: &mut [Vec<f64>; 3],
    motor: &mut [Vec<f64>; 3],
) {
    for (j, (delay, parts)) in delay.iter().zip(&error.cos_sin).enumerate() {
        // An encoder's error is that of the angle at the time that it shows, so it goes before the delay does.
        let of = |signals: [&[f64]; 3]| signals.map(|signal| at(signal, j));
        let [q, dq, ddq] = of([shown.q, shown.dq, shown.ddq]);
        let [q, dq, ddq] = true_motion(q, dq, ddq, *parts);
        let [q, dq] = align_link_side(q, dq, ddq, *delay);
        for (to, x) in link.iter_mut().zip([q, dq, ddq]) {
            set(to, j, x);
        }
        if error.both_sides {
            let [q, dq, ddq] = of([shown.q_motor, shown.dq_motor, shown.ddq_motor]);
            for (to, x) in motor.iter_mut().zip(true_motion(q, dq, ddq, *parts)) {
                set(to, j, x);
            }
        }
    }
}
