//! One cycle: a measurement in, an answer out. No allocation, no lock, no system call.

use std::path::PathBuf;
use std::sync::Arc;

use dynid_core::adapt::UNKNOWN_MEMORY;
use dynid_core::online::USUAL_STEP;
use dynid_core::watch::{Change, Watch};
use dynid_core::{
    AdaptSettings, Adaptation, CoreError, MomentumObserver, ObserverSettings, OnlineEstimator,
    Sample, Status, TorqueModel,
};
use dynid_io::remembered::{identity_of, Identity};
use dynid_io::{ContactFile, WatchFile};

use crate::changes::Told;
use crate::frame::Frame;
use crate::output::Answer;
use crate::stop::Stop;
use crate::wire;

/// How answers are made.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Settings {
    /// Time between measurements \[s\]; none: as the model says.
    pub step: Option<f64>,
    /// Samples that are differentiated over, where positions come alone; none: [`usual_window`](dynid_core::differentiator::usual_window).
    pub window: Option<usize>,
    /// Whether states beyond the model's limits are evaluated as they come.
    pub unlimited: bool,
    /// How the observer listens; none: there is no observer.
    pub observer: Option<ObserverSettings>,
    /// How far off the observer is at each state; none: as the model expects.
    pub contacts: Option<Arc<ContactFile>>,
    /// Whether it is said what a hand may guide the arm by.
    pub guide: bool,
    /// How the model is watched; none: it is not.
    pub watch: Option<Arc<WatchFile>>,
    /// What follows the arm; none: nothing does.
    pub adapt: Option<AdaptSettings>,
    /// Where watch and adaptation keep what they remember.
    pub remember: Option<PathBuf>,
}

impl Settings {
    /// Whether something wants the measured torque.
    pub fn wants_torque(&self) -> bool {
        self.observer.is_some() || self.learns()
    }

    /// Whether something learns from it.
    pub fn learns(&self) -> bool {
        self.watch.is_some() || self.adapt.is_some()
    }

    /// Whether something may have to be said while states come.
    pub fn speaks(&self) -> bool {
        self.learns() || self.contacts.is_some()
    }

    /// An observer as the file says, for the samples that it was made of; `per_hour` false contacts, if given.
    pub fn take_contacts(&mut self, file: ContactFile, per_hour: Option<f64>) {
        (self.step, self.window) = (Some(file.step), file.window);
        let mut observer = file.settings;
        observer.false_per_hour = per_hour.unwrap_or(observer.false_per_hour);
        self.observer = Some(observer);
        self.contacts = Some(Arc::new(file));
    }
}

/// What is said of every state of a cycle, not of the newest alone.
const PASSING: Status = Status::LOST
    .and(Status::CHANGED)
    .and(Status::ADAPTED)
    .and(Status::OUT_OF_ORDER)
    .and(Status::TIME_BACKWARDS)
    .and(Status::STUCK);

/// The memory of a running estimator.
#[derive(Clone, Debug)]
pub struct Cycle {
    online: OnlineEstimator,
    step_seconds: f64,
    std: Vec<f64>,
    status: Status,
    /// Of this cycle's states so far.
    passing: Status,
    any_new: bool,
    guides: bool,
    /// Of the model and what learns beside it, if something does.
    identity: Identity,
    follows_temperature: bool,
}

impl Cycle {
    /// The last allocation.
    ///
    /// # Errors
    /// [`Stop`] if the settings do not fit.
    pub fn new(model: Arc<TorqueModel>, settings: &Settings) -> Result<Self, Stop> {
        let n = model.robot().n_joints();
        let follows_temperature = model.wants_temperature().contains(&true);
        let step_seconds = settings.step.or(model.step()).unwrap_or(USUAL_STEP);
        let stop = |error: CoreError| Stop::Because(error.to_string());
        let mut online =
            OnlineEstimator::new(model, settings.step, settings.window).map_err(stop)?;
        if settings.unlimited {
            online = online.unlimited();
        }
        if let Some(observer) = settings.observer {
            online = online.observing(observer).map_err(stop)?;
        }
        if let Some(contacts) = &settings.contacts {
            let mend =
                "write it with `dynid contact MODEL.json --healthy RUN --save` of this model";
            check_joints(
                online.estimator().model(),
                &contacts.joints,
                "--contacts",
                mend,
            )?;
            let unit = online.estimator().model().torque_unit();
            if contacts.torque_unit != unit {
                return Err(Stop::Because(format!(
                    "--contacts: in another unit than the model, which is in {unit}; {mend}"
                )));
            }
            let known = online.knowing(Arc::new(contacts.uncertainty.clone()));
            online = known.map_err(|error| {
                Stop::Because(format!("--contacts: of another model: {error}; {mend}"))
            })?;
        }
        let mut own = Identity::default();
        if let Some(watch) = &settings.watch {
            let mend = "write them with `dynid watch MODEL.json --save`";
            check_joints(online.estimator().model(), &watch.joints, "--changes", mend)?;
            let watching = online.watching(watch.settings, &watch.healthy);
            online = watching.map_err(|error| {
                Stop::Because(format!("--changes: the model cannot be watched: {error}"))
            })?;
        }
        if let Some(adapt) = settings.adapt {
            let known = settings.watch.as_ref();
            let healthy = known.map(|watch| &watch.healthy);
            let inflation = healthy.map_or(vec![1.0; n], |own| own.inflation.clone());
            let memory = healthy.map_or(vec![UNKNOWN_MEMORY; n], |own| own.memory.clone());
            let adapts = Some((&adapt, &inflation[..], &memory[..]));
            own = identity_of(online.estimator().model(), known.map(Arc::as_ref), adapts)?;
            let adapting = online.adapting(adapt, &inflation, &memory);
            online = adapting.map_err(|error| {
                Stop::Because(format!("--adapt: the model cannot be adapted: {error}"))
            })?;
        } else if let Some(watch) = &settings.watch {
            own = identity_of(online.estimator().model(), Some(watch), None)?;
        }
        let mut cycle = Self {
            online,
            step_seconds,
            std: vec![0.0; n],
            status: Status::OK,
            passing: Status::OK,
            any_new: false,
            guides: settings.guide,
            identity: own,
            follows_temperature,
        };
        cycle.take_deviation().map_err(stop)?;
        Ok(cycle)
    }

    /// By how much answers are late where positions come alone \[s\].
    pub fn delay(&self) -> f64 {
        self.online.delay()
    }

    /// Usual time between measurements \[s\].
    pub fn step_seconds(&self) -> f64 {
        self.step_seconds
    }

    /// The same with every page of its memory and of its code in place, so that the first cycle is like the others: memory
    /// of zeros is only there once something was written to it, and a copy was.
    pub fn warm(&self) -> Self {
        let mut copy = self.clone();
        let zeros = vec![0.0; self.std.len()];
        let bad = [f64::NAN, 1e200].map(|x| vec![x; zeros.len()]);
        // Good states, alone and with derivatives, one that came already, and bad ones.
        for (k, q) in [&zeros, &zeros, &bad[0], &bad[1]]
            .into_iter()
            .cycle()
            .take(24)
            .enumerate()
        {
            let derivative = Some(&zeros[..]).filter(|_| k < 12);
            let sample = Sample {
                sequence: Some(k as u64 - u64::from(k % 5 == 4)),
                time: k as f64 * self.step_seconds,
                motion: [Some(&q[..]), derivative, derivative, None, None, None],
                temperature: None,
                tau: Some(&zeros[..]),
            };
            copy.begin();
            // The answer is of no interest, and neither is a refusal.
            let _ = copy.step(&sample);
            let answer = copy.answer(None);
            let mut bytes = vec![0xff; wire::answer_bytes(zeros.len(), answer.terms.len())];
            wire::encode(&answer, 0, &mut bytes);
            let mut frame = Frame::new(zeros.len());
            let _ = wire::decode(&wire::zero_state(zeros.len()), zeros.len(), &mut frame);
            let _ = wire::decode(&bytes, zeros.len(), &mut frame);
            copy.hold();
        }
        self.clone()
    }

    /// A new cycle: nothing has come yet.
    pub fn begin(&mut self) {
        self.passing = Status::OK;
        self.any_new = false;
    }

    /// Uses a measurement.
    ///
    /// # Errors
    /// [`CoreError`] if it is not one of this robot.
    pub fn step(&mut self, sample: &Sample<'_>) -> Result<(), CoreError> {
        let status = self.online.step(sample)?;
        self.passing = self.passing.and(status.only(PASSING));
        let is_new = !status.contains(Status::REPEATED);
        if is_new || !self.any_new {
            self.status = status;
        }
        self.any_new |= is_new;
        self.take_deviation()
    }

    /// Nothing came in this cycle.
    pub fn hold(&mut self) {
        self.status = self.online.hold();
    }

    /// Goes on with another model; this one stands in `new` afterwards. One of another number of joints is not taken.
    pub fn swap(&mut self, new: &mut Self) {
        if self.online.swap(&mut new.online).is_ok() {
            std::mem::swap(&mut self.step_seconds, &mut new.step_seconds);
            std::mem::swap(&mut self.identity, &mut new.identity);
            std::mem::swap(&mut self.follows_temperature, &mut new.follows_temperature);
        }
    }

    /// Becomes like `of`, a clone of which it was once, in all but the model; takes no memory.
    pub fn mirror(&mut self, of: &Self) {
        self.online.mirror(&of.online);
        self.std.copy_from_slice(&of.std);
        (self.step_seconds, self.identity) = (of.step_seconds, of.identity);
        (self.status, self.passing, self.any_new) = (of.status, of.passing, of.any_new);
    }

    fn take_deviation(&mut self) -> Result<(), CoreError> {
        self.online.estimator().predicted_std_into(&mut self.std)
    }

    /// True if the model's friction follows a temperature.
    pub fn follows_temperature(&self) -> bool {
        self.follows_temperature
    }

    /// What there is to say now.
    pub fn answer(&self, time: Option<f64>) -> Answer<'_> {
        Answer {
            time,
            tau: self.online.tau(),
            terms: self.online.estimator().terms(),
            std: &self.std,
            external: self.online.observer().map(MomentumObserver::external),
            guide: self
                .online
                .observer()
                .filter(|_| self.guides)
                .map(MomentumObserver::guide),
            change: self.change(),
            added: self.online.adaptation().map(Adaptation::added),
            adapted: self.online.adapted(),
            status: self.status.and(self.passing),
        }
    }

    /// Of the model and what learns beside it, whose memory is of no use to another.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// Rows that watch and adaptation have finished.
    pub fn n_rows(&self) -> u64 {
        let watched = self.online.watch().map_or(0, |watch| watch.row().0);
        watched.max(self.online.adaptation().map_or(0, Adaptation::n_rows))
    }

    /// How many numbers watch and adaptation remember; none if there is neither.
    pub fn n_remembered(&self) -> Option<usize> {
        let watch = self.online.watch().map(Watch::n_remembered);
        let own = self.online.adaptation().map(Adaptation::n_remembered);
        (watch.is_some() || own.is_some()).then(|| watch.unwrap_or(0) + own.unwrap_or(0))
    }

    /// Writes what watch and adaptation know to `numbers`, the watch first, and says so; within a row that is being judged it
    /// does neither.
    ///
    /// # Errors
    /// [`CoreError`] if the length is not [`Self::n_remembered`].
    pub fn remember(&mut self, numbers: &mut [f64]) -> Result<bool, CoreError> {
        let of_watch = self.online.watch().map_or(0, Watch::n_remembered);
        let (first, rest) = numbers.split_at_mut_checked(of_watch).unwrap_or_default();
        let own = self.online.adaptation();
        let mut is_whole = own.is_none_or(Adaptation::is_between_rows);
        if let Some(watch) = self.online.watch_mut().filter(|_| is_whole) {
            is_whole = watch.remember(first)?;
        }
        match self.online.adaptation().filter(|_| is_whole) {
            Some(own) => own.remember(rest),
            None => Ok(is_whole),
        }
    }

    /// Goes on with what [`Self::remember`] wrote.
    ///
    /// # Errors
    /// [`CoreError`] if the numbers are none that watch and adaptation remember.
    pub fn recall(&mut self, numbers: &[f64]) -> Result<(), CoreError> {
        let of_watch = self.online.watch().map_or(0, Watch::n_remembered);
        let (first, rest) = numbers.split_at_checked(of_watch).unwrap_or_default();
        if let Some(watch) = self.online.watch_mut() {
            watch.recall(first)?;
        }
        let own = self.online.adaptation_mut();
        own.map_or(Ok(()), |own| own.recall(rest))
    }

    /// What the watch said of the last state.
    pub fn change(&self) -> Option<&Change> {
        self.online.change()
    }

    /// What watch and adaptation said of the last state.
    pub fn told(&self) -> impl Iterator<Item = Told> {
        let change = self.online.change().copied().map(Told::Change);
        let adapted = self.online.adapted().copied().map(Told::Adapted);
        change.into_iter().chain(adapted)
    }
}

fn check_joints(
    model: &TorqueModel,
    names: &[String],
    option: &str,
    mend: &str,
) -> Result<(), Stop> {
    let joints = model.robot().joints().iter();
    if joints.map(|joint| &joint.name).eq(names) {
        return Ok(());
    }
    Err(Stop::Because(format!(
        "{option}: the joints of the file are not those of the model; {mend}"
    )))
}
