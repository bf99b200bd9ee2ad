//! Samples become rows: means of what the model leaves and of what changes would add to it.

use std::sync::Arc;

use crate::dynamics::{
    begin_inverse_dynamics, begin_last_link, check_length, end_inverse_dynamics_into,
    end_last_link_into, Workspace,
};
use crate::error::CoreError;
use crate::estimator::TorqueEstimator;
use crate::link_params::N_LINK_PARAMS;
use crate::model::TorqueModel;
use crate::observer::rest_speeds;
use crate::slices::{at, copy, mirror_fields, rows as rows_of, rows_mut, set, Mirror};

/// Parameters of a load, those of a link.
pub(crate) const N_LOAD: usize = N_LINK_PARAMS;

/// The torque of a load is evaluated so often per row, in the middle of as many parts (at their ends the mean would be that of
/// another time, by half a part): enough to see that there is one, and enough to take a heavy one off a wrist of little noise.
const LOADS_A_ROW: f64 = 10.0;
const LOADS_A_FINE_ROW: f64 = 40.0;

/// What a channel that is late by d shows at a time is the torque of d before; over a row that is what was predicted in the last d
/// before the row less that in its last d. Of delays that are told the middle of that is about here \[s\].
const LATE: f64 = 0.008;

/// So often per row and joint the torque of a slip is; joints take turns, forwards and back, so that every mean is of the row's
/// middle.
const SLIPS_A_ROW: f64 = 4.0;
/// Step of the difference that it is \[rad, m\].
const SLIP_STEP: f64 = 1e-5;

/// Means over a row, per joint.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    /// Measured less predicted torque.
    pub left: Vec<f64>,
    /// Predicted torque of friction and of all terms.
    pub friction: Vec<f64>,
    pub torque: Vec<f64>,
    /// Of what the model leaves, as it expects it.
    pub variance: Vec<f64>,
    /// Torque per parameter of a load at the last link, in the channel's unit; one array per joint.
    pub load: Vec<[f64; N_LOAD]>,
    /// What a channel shows more per second that it is late: the predicted torque falls.
    pub late: Vec<f64>,
    /// What is left more per rad or m that the position of a joint is shown too far; n values per joint that slips.
    pub slip: Vec<f64>,
    /// Mean speed.
    pub speed: Vec<f64>,
    /// Joints that moved all the time, as fast as in healthy runs at least, in a row of states that the model was trained on.
    pub moves: Vec<bool>,
    pub n: u32,
}

impl Row {
    pub fn new(n: usize) -> Self {
        Self {
            left: vec![0.0; n],
            friction: vec![0.0; n],
            torque: vec![0.0; n],
            variance: vec![0.0; n],
            load: vec![[0.0; N_LOAD]; n],
            late: vec![0.0; n],
            slip: vec![0.0; n * n],
            speed: vec![0.0; n],
            moves: vec![false; n],
            n: 0,
        }
    }
}

/// Which of a model's effects are friction: what follows the motor's speed, or remembers its way.
pub(crate) fn friction_terms(model: &TorqueModel) -> impl Iterator<Item = bool> + '_ {
    let entries = model.effects().iter().map(|term| term.effect().entry());
    entries.map(|entry| entry.needs("dq_motor") || entry.memory > 0)
}

/// A torque that is half evaluated: the whole takes as long as all else.
#[derive(Clone, Copy, Debug, Default)]
enum Half {
    #[default]
    None,
    Load,
    /// Of this joint.
    Slip(usize),
}

/// Rows in the making.
#[derive(Clone, Debug)]
pub(crate) struct Rows {
    pub model: Arc<TorqueModel>,
    is_friction: Vec<bool>,
    rest: Vec<f64>,
    least_speed: Vec<f64>,
    workspace: Workspace,
    columns: Vec<[f64; N_LOAD]>,
    length: f64,
    sums: Row,
    n_loads: u32,
    /// What was begun at the sample before, for the workspace.
    half: Half,
    /// Positions of which one has slipped, the torque at them, and the one at the state.
    slipped: Vec<f64>,
    torque: Vec<f64>,
    here: Vec<f64>,
    /// How often the torque of every joint's slip was evaluated, and whose turn it is.
    n_slips: Vec<u32>,
    turn: usize,
    since_slip: f64,
    /// Predicted torque a little before the end of the row before, and of this one; NaN where there is none.
    before: Vec<f64>,
    now: Vec<f64>,
    /// Samples so far, of which the first two are counted.
    n_seen: u8,
    elapsed: f64,
    last: f64,
    /// Time of a part, and since the middle of the last one.
    part: f64,
    since_load: f64,
    /// Whether the torque of loads and slips is evaluated.
    with_load: bool,
    good: bool,
}

impl Rows {
    pub fn new(model: Arc<TorqueModel>, length: f64, least_speed: Vec<f64>) -> Self {
        let n = model.robot().n_joints();
        Self {
            is_friction: friction_terms(&model).collect(),
            rest: rest_speeds(&model),
            least_speed,
            workspace: Workspace::new(model.robot()),
            columns: vec![[0.0; N_LOAD]; n],
            length,
            sums: Row {
                moves: vec![true; n],
                ..Row::new(n)
            },
            n_loads: 0,
            half: Half::None,
            slipped: vec![0.0; n],
            torque: vec![0.0; n],
            here: vec![0.0; n],
            n_slips: vec![0; n],
            turn: 0,
            since_slip: 0.5 * slip_part(length, n),
            before: vec![f64::NAN; n],
            now: vec![f64::NAN; n],
            n_seen: 0,
            elapsed: 0.0,
            last: 0.0,
            part: length / LOADS_A_ROW,
            since_load: 0.5 * length / LOADS_A_ROW,
            with_load: true,
            good: true,
            model,
        }
    }

    /// Whether a joint turns or slides at the state that was just answered.
    pub fn any_moves(&self, estimator: &TorqueEstimator) -> bool {
        let speeds = estimator.true_state().dq_motor.iter();
        let mut joints = speeds.zip(&self.rest);
        joints.any(|(dq, rest)| dq.abs() > *rest)
    }

    /// The row in the making.
    pub fn sums_mut(&mut self) -> &mut Row {
        &mut self.sums
    }

    /// The same for those who do not ask for loads and slips, whose columns stay zero.
    pub fn without_load(mut self) -> Self {
        self.with_load = false;
        self
    }

    /// Forgets the row in the making.
    pub fn clear(&mut self) {
        let own = &mut self.sums;
        let sums = [
            &mut own.left,
            &mut own.friction,
            &mut own.torque,
            &mut own.variance,
            &mut own.speed,
        ];
        sums.into_iter().for_each(|sums| sums.fill(0.0));
        own.load.fill([0.0; N_LOAD]);
        own.slip.fill(0.0);
        own.moves.fill(true);
        own.n = 0;
        self.before.fill(f64::NAN);
        self.now.fill(f64::NAN);
        self.begin_slips();
        self.half = Half::None;
        (self.n_loads, self.good, self.elapsed) = (0, true, 0.0);
        (self.last, self.part) = (0.0, self.length / LOADS_A_ROW);
        self.since_load = 0.5 * self.part;
    }

    /// True once the next sample would be nearer to the next row.
    pub fn is_full(&self) -> bool {
        self.elapsed + 0.5 * self.last >= self.length
    }

    /// True in the first half of a row.
    pub fn is_young(&self) -> bool {
        self.elapsed < 0.5 * self.length
    }

    /// Adds a sample; true if half of the torque of a load or a slip was evaluated at it.
    pub fn take(
        &mut self,
        estimator: &TorqueEstimator,
        tau: &[f64],
        elapsed: f64,
        good: bool,
    ) -> Result<bool, CoreError> {
        let n = self.rest.len();
        check_length("tau", tau, n)?;
        check_length("terms", estimator.terms(), n * self.model.n_terms())?;
        // Before the second sample nobody knows how long the first one stands for: it is given the second one's time, so that
        // rows begin alike whatever step a program has been told.
        let time = match self.n_seen {
            0 => 0.0,
            1 => 2.0 * elapsed,
            _ => elapsed,
        };
        self.n_seen = self.n_seen.saturating_add(1).min(2);
        self.elapsed += time;
        self.last = elapsed;
        self.since_load += time;
        self.since_slip += time;
        if !good || !tau.iter().all(|x| x.is_finite()) {
            self.good = false;
            return Ok(false);
        }
        let sums = &mut self.sums;
        sums.n = sums.n.saturating_add(1);
        let means = sums.left.iter_mut().zip(&mut sums.torque);
        let means = means.zip(&mut sums.variance);
        let joints = tau.iter().zip(estimator.total());
        let joints = joints.zip(estimator.predicted_variance());
        for (((left, torque), sum), ((measured, total), variance)) in means.zip(joints) {
            *left += measured - total;
            *torque += total;
            *sum += variance;
        }
        // The rigid body comes first, then effects, then a third loop.
        let effects = rows_of(estimator.terms(), n).skip(1).zip(&self.is_friction);
        for (term, _) in effects.filter(|(_, is_friction)| **is_friction) {
            for (friction, own) in sums.friction.iter_mut().zip(term) {
                *friction += own;
            }
        }
        let state = estimator.true_state();
        let speeds = state.dq_motor.iter().zip(&self.rest);
        let joints = sums.moves.iter_mut().zip(&mut sums.speed);
        for ((moves, speed), (dq, rest)) in joints.zip(speeds) {
            *moves &= dq.abs() > *rest;
            *speed += dq.abs();
        }
        if !self.with_load {
            return Ok(false);
        }
        if self.elapsed >= self.length - LATE && at(&self.now, 0).is_nan() {
            copy(estimator.total(), &mut self.now);
        }
        if self.end_half()? {
            return Ok(true);
        }
        let (part, of_slips) = (self.part, slip_part(self.length, n));
        let with_load = self.since_load >= part;
        // One of the two a sample, and half of it, unless samples are too rare for that.
        let halves = 2.0 * (self.length / part + self.length / of_slips);
        let at_once = halves * elapsed > self.length;
        let with_slip = self.since_slip >= if with_load { 2.0 * of_slips } else { of_slips };
        if with_slip {
            self.since_slip = (self.since_slip - of_slips).min(of_slips);
            self.begin_slip(estimator)?;
            if at_once || with_load {
                self.end_half()?;
            }
        }
        if with_load {
            self.since_load = (self.since_load - part).min(part);
            let state = estimator.true_state();
            let motion = [state.q, state.dq, state.ddq];
            begin_last_link(self.model.robot(), &mut self.workspace, motion)?;
            self.half = Half::Load;
            if at_once {
                self.end_half()?;
            }
        }
        Ok(with_load || with_slip)
    }

    /// Begins what the next joint's slip would leave: the torque of the links at the state less that a little further.
    fn begin_slip(&mut self, estimator: &TorqueEstimator) -> Result<(), CoreError> {
        let state = estimator.true_state();
        let n = self.slipped.len();
        let joint = self.turn.min((2 * n).saturating_sub(self.turn + 1));
        self.turn = if self.turn + 1 < 2 * n {
            self.turn + 1
        } else {
            0
        };
        copy(state.q, &mut self.slipped);
        let further = at(&self.slipped, joint) + SLIP_STEP;
        set(&mut self.slipped, joint, further);
        let motion = [&self.slipped[..], state.dq, state.ddq];
        let (robot, phi) = (self.model.robot(), self.model.phi());
        begin_inverse_dynamics(robot, &mut self.workspace, motion, phi)?;
        copy(estimator.terms(), &mut self.here);
        self.half = Half::Slip(joint);
        Ok(())
    }

    /// Ends what was begun at the sample before, and adds it; false if there is nothing.
    fn end_half(&mut self) -> Result<bool, CoreError> {
        let robot = self.model.robot();
        match core::mem::take(&mut self.half) {
            Half::None => return Ok(false),
            Half::Load => {
                end_last_link_into(robot, &self.workspace, &mut self.columns)?;
                self.n_loads = self.n_loads.saturating_add(1);
                let joints = self.columns.iter().zip(self.model.torque_scale());
                for (sum, (columns, scale)) in self.sums.load.iter_mut().zip(joints) {
                    for (sum, torque) in sum.iter_mut().zip(columns) {
                        *sum += scale * torque;
                    }
                }
            }
            Half::Slip(joint) => {
                end_inverse_dynamics_into(robot, &self.workspace, &mut self.torque)?;
                let own = rows_mut(&mut self.sums.slip, self.slipped.len()).nth(joint);
                let torques = self.torque.iter().zip(self.model.torque_scale());
                let shown = self.here.iter().zip(torques);
                for (sum, (here, (torque, scale))) in own.into_iter().flatten().zip(shown) {
                    *sum += (here - scale * torque) / SLIP_STEP;
                }
                if let Some(count) = self.n_slips.get_mut(joint) {
                    *count = count.saturating_add(1);
                }
            }
        }
        Ok(true)
    }

    fn begin_slips(&mut self) {
        self.n_slips.fill(0);
        self.turn = 0;
        self.since_slip = 0.5 * slip_part(self.length, self.n_slips.len());
    }

    /// Ends a row: its means are written to `row`. A load's torque is evaluated more often in a `fine` one that follows.
    ///
    /// # Errors
    /// [`CoreError`] if a length is wrong.
    pub fn finish(&mut self, row: &mut Row, fine: bool) -> Result<(), CoreError> {
        self.end_half()?;
        let (n, n_loads) = (self.sums.n.max(1), self.n_loads.max(1));
        let usable = self.good && self.sums.n > 0;
        let share = f64::from(n).recip();
        let sums = &mut self.sums;
        end(&mut sums.left, &mut row.left, share);
        end(&mut sums.friction, &mut row.friction, share);
        end(&mut sums.torque, &mut row.torque, share);
        end(&mut sums.variance, &mut row.variance, share);
        for (sum, mean) in sums.load.iter_mut().zip(&mut row.load) {
            end(sum, mean, f64::from(n_loads).recip());
        }
        end(&mut sums.speed, &mut row.speed, share);
        let joints = rows_mut(&mut sums.slip, self.slipped.len());
        let joints = joints.zip(rows_mut(&mut row.slip, self.slipped.len()));
        for ((sums, means), count) in joints.zip(&self.n_slips) {
            end(sums, means, f64::from((*count).max(1)).recip());
        }
        let falls = row.late.iter_mut().zip(&mut self.before);
        for ((late, before), now) in falls.zip(&mut self.now) {
            let rate = (*before - *now) / self.elapsed;
            *late = if rate.is_finite() { rate } else { 0.0 };
            (*before, *now) = (*now, f64::NAN);
        }
        let joints = sums.moves.iter_mut().zip(&mut row.moves);
        for ((moves, moved), (speed, least)) in joints.zip(row.speed.iter().zip(&self.least_speed))
        {
            *moved = *moves && usable && speed >= least;
            *moves = true;
        }
        row.n = n;
        (self.sums.n, self.n_loads, self.good) = (0, 0, true);
        self.elapsed = 0.0;
        let parts = if fine { LOADS_A_FINE_ROW } else { LOADS_A_ROW };
        self.part = self.length / parts;
        self.since_load = 0.5 * self.part;
        self.begin_slips();
        Ok(())
    }
}

/// Time from one slip to the next.
fn slip_part(length: f64, n: usize) -> f64 {
    length / (SLIPS_A_ROW * n.max(1) as f64)
}

impl Mirror for Row {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(self, of; left, friction, torque, variance, load, late, slip, speed, moves; copied n; kept);
    }
}

impl Mirror for Rows {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(
            self, of;
            workspace, columns, sums, slipped, torque, here, n_slips, before, now;
            copied length, n_loads, half, turn, since_slip, n_seen, elapsed, last, part, since_load, with_load, good;
            kept model, is_friction, rest, least_speed
        );
    }
}

fn end(sums: &mut [f64], means: &mut [f64], share: f64) {
    for (sum, mean) in sums.iter_mut().zip(means) {
        *mean = *sum * share;
        *sum = 0.0;
    }
}

/// Torque of a load.
pub(super) fn product(columns: &[f64; N_LOAD], load: &[f64; N_LOAD]) -> f64 {
    columns.iter().zip(load).map(|(c, x)| c * x).sum()
}
