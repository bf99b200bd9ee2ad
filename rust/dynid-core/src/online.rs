//! A stream of measurements in, torques out: what came late, twice, broken or not at all is said in the status, and no
//! torque follows from it.
//!
//! ```text
//! sample -> is it new? -> (derivatives, if positions came alone) -> TorqueEstimator -> torque, deviation, status
//! ```

mod adapting;
mod listening;
mod stuck;
mod windowed;

use std::sync::Arc;

use crate::adapt::{Adaptation, Adapted};
use crate::differentiator::{usual_window, Differentiator};
use crate::dynamics::check_length;
use crate::error::CoreError;
use crate::estimator::late::Late;
use crate::estimator::{Status, TorqueEstimator};
use crate::model::TorqueModel;
use crate::observer::MomentumObserver;
use crate::slices::{copy, mirror_fields, Mirror};
use crate::state::State;
use crate::stream::{Place, Stream};
use crate::track::{Track, MOST_STEPS};
use crate::watch::{Change, Watch};

/// Signals of motion: q, dq, ddq of the link side, then of the motor side, as in [`State`].
pub const N_MOTION: usize = 6;

/// Channels that are filtered together: the motion and the measured torque.
pub(crate) const N_CHANNELS: usize = N_MOTION + 1;
const TORQUE: usize = N_MOTION;

/// So many cycles without a new state are stale input.
const STALE_AFTER: u32 = 2;

/// A position that would have needed this many times the greatest trained speed since the one before is none, and neither
/// is one that would have needed [`LEAST_JUMP`] \[rad/s, m/s\].
const JUMP: f64 = 10.0;
const LEAST_JUMP: f64 = 100.0;

/// A measured torque beyond it is no number: squares of what is left of it have to be numbers too \[torque unit\].
const LARGEST_TORQUE: f64 = 1e100;

/// The last good torque is repeated at such a step.
const REPEATS: Status = Status::NON_FINITE.and(Status::REPEATED);

/// No state of such a step belongs to the measured torque.
const UNUSABLE: Status = REPEATS.and(Status::SETTLING);

/// The model was not trained on such a state, or does not see all of it.
const ELSEWHERE: Status = Status::OUTSIDE_DOMAIN
    .and(Status::BEYOND_LIMITS)
    .and(Status::SIGNAL_MISSING);

/// One measurement, borrowed; every signal has one value per joint.
#[derive(Clone, Copy, Debug)]
pub struct Sample<'a> {
    /// Its number, counted up by the sender; `None` where the transport keeps the order.
    pub sequence: Option<u64>,
    /// Its time \[s\]; NaN where it has none.
    pub time: f64,
    /// q, dq, ddq, q_motor, dq_motor, ddq_motor, as in [`State`]. Only q is needed. Without dq or ddq everything is
    /// filtered and differentiated; a motor side that is not given equals the link side.
    pub motion: [Option<&'a [f64]>; N_MOTION],
    /// Measured temperature \[degC\], where there is one.
    pub temperature: Option<&'a [f64]>,
    /// Measured torque \[torque unit\], which only an observer needs.
    pub tau: Option<&'a [f64]>,
}

/// An estimator at the end of a stream. All memory is taken in `new`.
#[derive(Clone, Debug)]
pub struct OnlineEstimator {
    estimator: TorqueEstimator,
    stream: Stream,
    track: Track,
    /// Samples that contradict the track, but not each other: once they are believed they are the track.
    suspects: Track,
    /// The usual time between samples.
    step: f64,
    /// One row of channels, and the signals that the estimator sees.
    row: Vec<f64>,
    motion: [Vec<f64>; N_MOTION],
    measured: Vec<f64>,
    /// Holds the measured torque of channels that are early until its state has come.
    early: Option<Late>,
    /// The motion as it came the time before, and how far each side went since its position changed.
    before: Vec<f64>,
    way: [Vec<f64>; 2],
    has_before: bool,
    /// Cycles since the last new state.
    misses: u32,
    /// Greatest plausible speed per joint.
    most_speed: Vec<f64>,
    tau: Vec<f64>,
    observer: Option<MomentumObserver>,
    watch: Option<Watch>,
    /// What the watch named at the last step.
    change: Option<Change>,
    adaptation: Option<Adaptation>,
    /// What the adaptation said at the last step.
    adapted: Option<Adapted>,
    /// Measured torque less what the adaptation adds.
    rest: Vec<f64>,
    /// Time of the last sample that observer, watch and adaptation took \[s\].
    observed: f64,
}

/// Time between samples where neither the model nor the caller says one \[s\].
pub const USUAL_STEP: f64 = 0.001;

impl OnlineEstimator {
    /// For samples `step` seconds apart (none: as the model says, else [`USUAL_STEP`]), differentiated over `window` samples
    /// (none: [`usual_window`]) where positions come alone.
    ///
    /// # Errors
    /// [`CoreError::Range`] if the step or the window is none.
    pub fn new(
        model: Arc<TorqueModel>,
        step: Option<f64>,
        window: Option<usize>,
    ) -> Result<Self, CoreError> {
        let n = model.robot().n_joints();
        let step_of_model = model.step();
        let ahead = model.torque_delay().iter().map(|delay| (-delay).max(0.0));
        let ahead: Vec<f64> = ahead.collect();
        let most_speed = model.domain().dq.iter();
        let most_speed = most_speed.map(|dq| (JUMP * dq).max(LEAST_JUMP)).collect();
        let mut estimator = TorqueEstimator::new(model);
        if let Some(step) = step {
            estimator = estimator.with_step(step)?;
        }
        let step = step.or(step_of_model).unwrap_or(USUAL_STEP);
        let early = Late::by(ahead, step, 1).ok_or(CoreError::Range { what: "step" })?;
        let window = window.unwrap_or_else(|| usual_window(step));
        let track = Track::new(Differentiator::new(N_CHANNELS * n, step, window)?);
        Ok(Self {
            estimator,
            stream: Stream::default(),
            suspects: track.clone(),
            track,
            step,
            row: vec![0.0; N_CHANNELS * n],
            motion: std::array::from_fn(|_| vec![0.0; n]),
            measured: vec![f64::NAN; n],
            early,
            before: vec![0.0; N_MOTION * n],
            way: std::array::from_fn(|_| vec![0.0; n]),
            has_before: false,
            misses: 0,
            most_speed,
            tau: vec![0.0; n],
            observer: None,
            watch: None,
            change: None,
            adaptation: None,
            adapted: None,
            rest: vec![0.0; n],
            observed: f64::NAN,
        })
    }

    /// The same, which evaluates states beyond the model's limits as they came.
    #[must_use]
    pub fn unlimited(mut self) -> Self {
        self.estimator = self.estimator.unlimited();
        self
    }

    /// Torque of the last good step, n values \[torque unit\]; zeros before the first. Finite.
    #[must_use]
    pub fn tau(&self) -> &[f64] {
        let own = self.adaptation.as_ref().map(Adaptation::tau);
        own.unwrap_or(&self.tau)
    }

    /// The estimator: terms and deviation of the last good step.
    #[must_use]
    pub fn estimator(&self) -> &TorqueEstimator {
        &self.estimator
    }

    /// Delay of the answers where positions come alone \[s\].
    #[must_use]
    pub fn delay(&self) -> f64 {
        self.track.filter.delay()
    }

    /// Puts another model in its place. What effects remember goes over where the effects are the same
    /// ([`TorqueEstimator::continue_from`]); `new` comes ready made, so nothing is allocated or freed here. The old estimator
    /// stands in `new` afterwards.
    ///
    /// # Errors
    /// [`CoreError::Length`] if `new` is of another number of joints; nothing changes then.
    pub fn swap(&mut self, new: &mut Self) -> Result<(), CoreError> {
        check_length("tau", &new.tau, self.tau.len())?;
        new.estimator.continue_from(&self.estimator);
        if let Some(adaptation) = &mut new.adaptation {
            adaptation.begin_from(self.tau());
        } else if let Some(adaptation) = &self.adaptation {
            copy(adaptation.tau(), &mut self.tau);
        }
        core::mem::swap(&mut self.estimator, &mut new.estimator);
        core::mem::swap(&mut self.most_speed, &mut new.most_speed);
        core::mem::swap(&mut self.early, &mut new.early);
        if let (Some(new), Some(old)) = (&mut new.observer, &self.observer) {
            new.continue_from(old);
        }
        core::mem::swap(&mut self.observer, &mut new.observer);
        // What another model leaves is something else: its watch begins anew, and so does its adaptation.
        core::mem::swap(&mut self.watch, &mut new.watch);
        core::mem::swap(&mut self.adaptation, &mut new.adaptation);
        Ok(())
    }

    /// A cycle in which nothing came: the last good torque stands.
    pub fn hold(&mut self) -> Status {
        self.misses = self.misses.saturating_add(1);
        (self.change, self.adapted) = (None, None);
        let mut status = Status::REPEATED;
        let is_stale = self.misses >= STALE_AFTER;
        status.set(Status::STALE, is_stale);
        // An arm does not follow a hand that was felt long ago.
        if let Some(observer) = self.observer.as_mut().filter(|_| is_stale) {
            observer.let_go();
        }
        status.and(self.standing())
    }

    /// What holds for as long as no torque is heard.
    fn standing(&self) -> Status {
        let (observer, adaptation) = (self.observer.as_ref(), self.adaptation.as_ref());
        let mut status = Status::OK;
        let in_contact = observer.is_some_and(MomentumObserver::contact);
        status.set(Status::CONTACT, in_contact);
        let is_at_limit = adaptation.is_some_and(Adaptation::is_at_limit);
        status.set(Status::AT_LIMIT, is_at_limit);
        status
    }

    /// Takes a sample. Whatever it holds, [`Self::tau`] stays finite; a sample that is not used leaves it as it was.
    ///
    /// # Errors
    /// [`CoreError::Length`] if a signal has the wrong length or q is missing; nothing changes then.
    pub fn step(&mut self, sample: &Sample<'_>) -> Result<Status, CoreError> {
        self.check(sample)?;
        (self.change, self.adapted) = (None, None);
        let row = self.stream.suspects();
        let place = self.stream.place(sample.sequence, sample.time);
        if !place.is_new() {
            if place != Place::Repeated {
                self.suspect(sample, row)?;
            }
            let mut status = self.hold();
            status.set(Status::OUT_OF_ORDER, place == Place::OutOfOrder);
            status.set(Status::TIME_BACKWARDS, place == Place::TimeBackwards);
            status.set(Status::NON_FINITE, place == Place::NoTime);
            return Ok(status);
        }
        self.misses = 0;
        let mut status = Status::OK;
        let numbered = sample.sequence.is_some();
        status.set(Status::LOST, numbered && place != Place::Next { lost: 0 });
        status.set(Status::TIME_BACKWARDS, !numbered && place == Place::Restart);
        let present = self.present(sample);
        if place == Place::Restart {
            // Without a row of suspects nothing is known of the new stream.
            if row == 0 {
                self.suspects.filter.reset();
            }
            core::mem::swap(&mut self.track, &mut self.suspects);
            self.suspects.filter.reset();
            self.has_before = false;
            self.estimator.begin_anew();
        }
        if present != self.track.present {
            self.track.begin(present);
            self.has_before = false;
        }
        let lost = if let Place::Next { lost } = place {
            lost
        } else {
            0
        };
        let elapsed = lost.saturating_add(1).min(MOST_STEPS) as f64 * self.step;
        self.track.go_on(sample, self.step);
        status.set(Status::STUCK, numbered && self.is_stuck(sample, elapsed));
        let is_direct = direct(&present);
        let answered = if is_direct {
            self.answer(sample, elapsed, numbered)?
        } else {
            self.answer_filtered(sample, elapsed, numbered)?
        };
        self.correct(answered)?;
        let status = status.and(answered);
        let heard = self.listen(sample.tau, is_direct, status)?;
        Ok(status.and(heard))
    }

    /// What observer, watch and adaptation say of the measured torque at the state that was just answered.
    fn listen(
        &mut self,
        tau: Option<&[f64]>,
        is_direct: bool,
        answered: Status,
    ) -> Result<Status, CoreError> {
        if !self.listens() {
            return Ok(Status::OK);
        }
        let tau = tau.filter(|tau| tau.iter().all(|x| x.abs() < LARGEST_TORQUE));
        let mut status = Status::OK;
        status.set(Status::SIGNAL_MISSING, tau.is_none());
        let tau = tau.filter(|_| answered.only(UNUSABLE) == Status::OK);
        let Some(tau) = tau else {
            if let Some(early) = &mut self.early {
                early.reset();
            }
            self.interrupt();
            return Ok(status.and(self.standing()));
        };
        let raw = tau;
        let apart = self.track.time - self.observed;
        // Written so that a NaN, before the first sample, is no time either.
        let follows = apart > 0.0;
        let apart = if follows { apart } else { self.step };
        self.observed = self.track.time;
        if !follows {
            self.interrupt();
        }
        let mut shown = is_direct.then_some(raw);
        if let Some(early) = &mut self.early {
            if !follows {
                early.reset();
            }
            if let Some(raw) = shown.take() {
                copy(raw, &mut self.measured);
            }
            if !early.show(&mut self.measured, &mut [], apart) {
                self.interrupt();
                return Ok(status.and(self.standing()));
            }
        }
        if self.adaptation.is_some() {
            // Without this a friction that has grown would be a contact, in which nothing follows.
            self.take_off_added(shown);
        }
        let tau = shown.unwrap_or(&self.measured);
        if let Some(observer) = &mut self.observer {
            let rest = if self.adaptation.is_some() {
                &self.rest
            } else {
                tau
            };
            observer.step(&self.estimator, rest, apart)?;
            status.set(Status::CONTACT, observer.contact());
        }
        if let Some(watch) = &mut self.watch {
            // What pushes the arm may be what has changed: a contact hides nothing from the watch.
            let good = answered.only(ELSEWHERE) == Status::OK;
            self.change = watch.step(&self.estimator, tau, raw, apart, good)?;
            status.set(Status::CHANGED, self.change.is_some());
        }
        let adapted = self.adapt(shown, apart, answered)?;
        Ok(status.and(adapted))
    }

    /// No torque that is held against the one before.
    fn interrupt(&mut self) {
        if let Some(observer) = &mut self.observer {
            observer.interrupt();
        }
    }

    /// True if something listens to the measured torque.
    fn listens(&self) -> bool {
        self.observer.is_some() || self.watch.is_some() || self.adaptation.is_some()
    }

    fn check(&self, sample: &Sample<'_>) -> Result<(), CoreError> {
        let n = self.tau.len();
        check_length("q", sample.motion[0].unwrap_or(&[]), n)?;
        let rest = self
            .channels(sample)
            .into_iter()
            .chain([sample.temperature]);
        rest.flatten()
            .try_for_each(|signal| check_length("signal", signal, n))
    }

    /// Which channels a sample holds. A loop, so that no function of an array that may unwind is called.
    fn present(&self, sample: &Sample<'_>) -> [bool; N_CHANNELS] {
        let mut present = [false; N_CHANNELS];
        for (there, channel) in present.iter_mut().zip(self.channels(sample)) {
            *there = channel.is_some();
        }
        present
    }

    fn channels<'a>(&self, sample: &Sample<'a>) -> [Option<&'a [f64]>; N_CHANNELS] {
        let [q, dq, ddq, q_motor, dq_motor, ddq_motor] = sample.motion;
        let tau = sample.tau.filter(|_| self.listens());
        [q, dq, ddq, q_motor, dq_motor, ddq_motor, tau]
    }

    /// The state as it came.
    fn answer(
        &mut self,
        sample: &Sample<'_>,
        elapsed: f64,
        numbered: bool,
    ) -> Result<Status, CoreError> {
        let [Some(q), Some(dq), Some(ddq), q_motor, dq_motor, ddq_motor] = sample.motion else {
            return Ok(Status::SETTLING);
        };
        let state = State {
            q,
            dq,
            ddq,
            q_motor: q_motor.unwrap_or(q),
            dq_motor: dq_motor.unwrap_or(dq),
            ddq_motor: ddq_motor.unwrap_or(ddq),
            temperature: sample.temperature,
        };
        estimate(
            &mut self.estimator,
            &state,
            &mut self.tau,
            numbered.then_some(elapsed),
        )
    }
}

/// True if the state needs no filter.
fn direct(present: &[bool; N_CHANNELS]) -> bool {
    present.iter().take(3).all(|there| *there)
}

fn estimate(
    estimator: &mut TorqueEstimator,
    state: &State<'_>,
    tau: &mut [f64],
    elapsed: Option<f64>,
) -> Result<Status, CoreError> {
    let step = estimator.step();
    // After lost samples the effects' time goes on by all of them; without a step there is no effect that counts it.
    let Some(elapsed) = elapsed.filter(|_| step > 0.0) else {
        return estimator.estimate_into(state, tau);
    };
    estimator.set_step(elapsed)?;
    let status = estimator.estimate_into(state, tau);
    estimator.set_step(step)?;
    status
}

impl OnlineEstimator {
    /// Becomes like `of`, a clone of which it was once, in all but the model: a step of this one is then what the next step
    /// of `of` would be, and everything that step needs has been read. Takes no memory; `of` is only looked at.
    pub fn mirror(&mut self, of: &Self) {
        if let (Some(own), Some(of)) = (&mut self.observer, &of.observer) {
            own.mirror(of);
        }
        if let (Some(own), Some(of)) = (&mut self.watch, &of.watch) {
            own.mirror(of);
        }
        if let (Some(own), Some(of)) = (&mut self.adaptation, &of.adaptation) {
            own.mirror(of);
        }
        if let (Some(own), Some(of)) = (&mut self.early, &of.early) {
            own.mirror(of);
        }
        mirror_fields!(
            self, of;
            estimator, track, suspects, row, motion, measured, before, way, most_speed, tau, rest;
            copied stream, step, has_before, misses, change, adapted, observed;
            kept observer, watch, adaptation, early
        );
    }
}
