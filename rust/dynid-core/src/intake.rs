//! What becomes of a state before it is evaluated: where the torque channel is late an earlier one takes its place, and one
//! beyond the model's limits is brought to them.

use crate::delay_line::{n_delay_rows, shared_and_own, DelayLine};
use crate::estimator::Status;
use crate::limits::{is_state, Limits};
use crate::model::TorqueModel;
use crate::slices::{mirror_fields, part, Mirror};
use crate::state::State;

/// Signals of motion in a state.
const SIGNALS: usize = 6;

/// Between what comes and what is evaluated. All memory is taken in `new`.
#[derive(Clone, Debug)]
pub(crate) struct Intake {
    n: usize,
    /// States that the torque channels show later, all by `delay` \[s\]; the state of then comes to lie in `past`.
    line: Option<DelayLine>,
    delay: f64,
    past: Vec<f64>,
    limits: Limits,
    /// Whether what lies beyond the limits is evaluated as it came.
    unlimited: bool,
    row: Vec<f64>,
}

impl Intake {
    pub fn new(model: &TorqueModel, step: f64) -> Self {
        let n = model.robot().n_joints();
        Self {
            n,
            line: line(model, step).unwrap_or_default(),
            delay: shared_delay(model),
            past: vec![0.0; SIGNALS * n],
            limits: Limits::of(model),
            unlimited: false,
            row: vec![0.0; SIGNALS * n],
        }
    }

    /// The same for states `step` seconds apart; `None` if the model's delay asks for too many of them.
    pub fn with_step(self, model: &TorqueModel, step: f64) -> Option<Self> {
        let line = line(model, step)?;
        Some(Self { line, ..self })
    }

    pub fn set_unlimited(&mut self, unlimited: bool) {
        self.unlimited = unlimited;
    }

    pub fn reset(&mut self) {
        if let Some(line) = &mut self.line {
            line.reset();
        }
    }

    /// `elapsed` seconds went by, and brought no state.
    pub fn pass(&mut self, elapsed: f64) {
        if let Some(line) = &mut self.line {
            line.pass(elapsed);
        }
    }

    /// The state to evaluate, and what is unusual about it; all NaN where there is none.
    pub fn take<'a>(&'a mut self, shown: &State<'a>, elapsed: f64) -> (State<'a>, Status) {
        let mut status = Status::OK;
        if !is_state(shown) {
            self.pass(elapsed);
            self.row.fill(f64::NAN);
            return (state_of(&self.row, self.n, shown.temperature), status);
        }
        let mut state = *shown;
        if let Some(line) = &mut self.line {
            line.push(shown.signals().map(|(_, signal)| signal), elapsed);
            let past = line.look_back(self.delay);
            status.set(Status::SETTLING, !past.reached);
            line.row_into(past, &mut self.past);
            // With the temperature of now: it changes over minutes.
            state = state_of(&self.past, self.n, shown.temperature);
        }
        if self.limits.hold(&state, &mut self.row, self.n) {
            status = status
                .and(Status::BEYOND_LIMITS)
                .and(Status::OUTSIDE_DOMAIN);
            if !self.unlimited {
                state = state_of(&self.row, self.n, shown.temperature);
            }
        }
        (state, status)
    }

    /// Goes on with the states that `before` kept.
    pub fn continue_from(&mut self, before: &Self) {
        if let (Some(own), Some(before)) = (&mut self.line, &before.line) {
            own.continue_from(before);
        }
    }
}

/// Six signals in a row as a state.
pub(crate) fn state_of<'a>(row: &'a [f64], n: usize, temperature: Option<&'a [f64]>) -> State<'a> {
    let signal = |k: usize| part(row, k * n, (k + 1) * n);
    State {
        q: signal(0),
        dq: signal(1),
        ddq: signal(2),
        q_motor: signal(3),
        dq_motor: signal(4),
        ddq_motor: signal(5),
        temperature,
    }
}

/// How late all torque channels are \[s\]. What comes before its time cannot be known before it comes.
fn shared_delay(model: &TorqueModel) -> f64 {
    shared_and_own(model.torque_delay(), 0.0).0
}

/// Keeps the states that `model`'s torque channels show later; `None` if they are too many.
fn line(model: &TorqueModel, step: f64) -> Option<Option<DelayLine>> {
    let delay = shared_delay(model);
    if delay > 0.0 {
        let n_rows = n_delay_rows(delay, step)?;
        let n = model.robot().n_joints();
        Some(Some(DelayLine::new(SIGNALS * n, n_rows)))
    } else {
        Some(None)
    }
}

impl Mirror for Intake {
    fn mirror(&mut self, of: &Self) {
        if let (Some(own), Some(of)) = (&mut self.line, &of.line) {
            own.mirror(of);
        }
        mirror_fields!(self, of; row, past; copied n, delay, unlimited; kept line, limits);
    }
}
