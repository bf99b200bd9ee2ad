//! Samples become rows: means of what the model leaves and of what changes would add to it.

use std::sync::Arc;

use super::{Change, Kind, Said};
use crate::dynamics::{check_length, inverse_dynamics_into, Workspace};
use crate::error::CoreError;
use crate::estimator::TorqueEstimator;
use crate::link_params::N_LINK_PARAMS;
use crate::model::TorqueModel;
use crate::observer::rest_speeds;
use crate::slices::{at, mirror_fields, rows as rows_of, set, Mirror};

/// Mass and first moments of a load.
pub(crate) const N_LOAD: usize = 4;

/// The torque of a load is evaluated so often per row: it follows the motion.
const LOADS_A_ROW: f64 = 10.0;

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
    /// Torque per kg, and per kg m along each axis of the last link, in the channel's unit.
    pub load: [Vec<f64>; N_LOAD],
    /// Joints that moved all the time, in a row of states that the model was trained on.
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
            load: std::array::from_fn(|_| vec![0.0; n]),
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

/// Rows in the making.
#[derive(Clone, Debug)]
pub(crate) struct Rows {
    model: Arc<TorqueModel>,
    is_friction: Vec<bool>,
    rest: Vec<f64>,
    units: [Vec<f64>; N_LOAD],
    workspace: Workspace,
    scratch: Vec<f64>,
    length: f64,
    sums: Row,
    n_loads: u32,
    elapsed: f64,
    last: f64,
    since_load: f64,
    /// Whether the torque of a load is evaluated.
    with_load: bool,
    good: bool,
}

impl Rows {
    pub fn new(model: Arc<TorqueModel>, length: f64) -> Self {
        let n = model.robot().n_joints();
        let first = N_LINK_PARAMS * (n - 1);
        let units = std::array::from_fn(|k| {
            let mut phi = vec![0.0; N_LINK_PARAMS * n];
            set(&mut phi, first + k, 1.0);
            phi
        });
        Self {
            is_friction: friction_terms(&model).collect(),
            rest: rest_speeds(&model),
            units,
            workspace: Workspace::new(model.robot()),
            scratch: vec![0.0; n],
            length,
            sums: Row {
                moves: vec![true; n],
                ..Row::new(n)
            },
            n_loads: 0,
            elapsed: 0.0,
            last: 0.0,
            since_load: f64::INFINITY,
            with_load: true,
            good: true,
            model,
        }
    }

    /// The same for those who do not ask for a load, whose columns stay zero.
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
        ];
        sums.into_iter().for_each(|sums| sums.fill(0.0));
        own.load.iter_mut().for_each(|sums| sums.fill(0.0));
        own.moves.fill(true);
        own.n = 0;
        (self.n_loads, self.good, self.elapsed) = (0, true, 0.0);
        (self.last, self.since_load) = (0.0, f64::INFINITY);
    }

    /// True once the next sample would be nearer to the next row.
    pub fn is_full(&self) -> bool {
        self.elapsed + 0.5 * self.last >= self.length
    }

    /// Adds a sample.
    pub fn take(
        &mut self,
        estimator: &TorqueEstimator,
        tau: &[f64],
        elapsed: f64,
        good: bool,
    ) -> Result<(), CoreError> {
        let n = self.scratch.len();
        check_length("tau", tau, n)?;
        check_length("terms", estimator.terms(), n * self.model.n_terms())?;
        self.elapsed += elapsed;
        self.last = elapsed;
        self.since_load += elapsed;
        if !good || !tau.iter().all(|x| x.is_finite()) {
            self.good = false;
            return Ok(());
        }
        let sums = &mut self.sums;
        sums.n = sums.n.saturating_add(1);
        estimator.predicted_std_into(&mut self.scratch)?;
        for (sum, std) in sums.variance.iter_mut().zip(&self.scratch) {
            *sum += std * std;
        }
        for (sum, measured) in sums.left.iter_mut().zip(tau) {
            *sum += measured;
        }
        // The rigid body comes first, then effects, then a third loop.
        let of_friction = std::iter::once(false).chain(self.is_friction.iter().copied());
        let terms = rows_of(estimator.terms(), n);
        for (term, is_friction) in terms.zip(of_friction.chain(std::iter::repeat(false))) {
            let joints = sums.left.iter_mut().zip(&mut sums.torque);
            for (((left, torque), friction), own) in joints.zip(&mut sums.friction).zip(term) {
                *left -= own;
                *torque += own;
                *friction += if is_friction { *own } else { 0.0 };
            }
        }
        let state = estimator.true_state();
        let speeds = state.dq_motor.iter().zip(&self.rest);
        for (moves, (dq, rest)) in sums.moves.iter_mut().zip(speeds) {
            *moves &= dq.abs() > *rest;
        }
        if self.with_load && self.since_load * LOADS_A_ROW >= self.length {
            self.since_load = 0.0;
            self.n_loads = self.n_loads.saturating_add(1);
            for (unit, sum) in self.units.iter().zip(&mut sums.load) {
                let (robot, torque) = (self.model.robot(), &mut self.scratch);
                let (q, dq, ddq) = (state.q, state.dq, state.ddq);
                inverse_dynamics_into(robot, &mut self.workspace, q, dq, ddq, unit, torque)?;
                let scaled = torque.iter().zip(self.model.torque_scale());
                for (sum, (torque, scale)) in sum.iter_mut().zip(scaled) {
                    *sum += scale * torque;
                }
            }
        }
        Ok(())
    }

    /// Ends a row: its means are written to `row`.
    pub fn finish(&mut self, row: &mut Row) {
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
        for (moves, moved) in sums.moves.iter_mut().zip(&mut row.moves) {
            *moved = *moves && usable;
            *moves = true;
        }
        row.n = n;
        (self.sums.n, self.n_loads, self.good) = (0, 0, true);
        self.elapsed = 0.0;
    }
}

impl Mirror for Row {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(self, of; left, friction, torque, variance, load, moves; copied n; kept);
    }
}

impl Mirror for Rows {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(
            self, of;
            workspace, scratch, sums;
            copied length, n_loads, elapsed, last, since_load, with_load, good;
            kept model, is_friction, rest, units
        );
    }
}

impl Mirror for Known {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(self, of; friction, gain, offset, unknown, variance; copied load; kept);
    }
}

fn end(sums: &mut [f64], means: &mut [f64], share: f64) {
    for (sum, mean) in sums.iter_mut().zip(means) {
        *mean = *sum * share;
        *sum = 0.0;
    }
}

/// What was named already; sums, and their variances.
#[derive(Clone, Debug)]
pub(super) struct Known {
    pub friction: Vec<f64>,
    pub gain: Vec<f64>,
    pub offset: Vec<f64>,
    /// Growth of an error without a name, which nothing is taken off for.
    pub unknown: Vec<f64>,
    pub load: [f64; N_LOAD],
    /// Four per joint, in the order above, and the mass's.
    pub variance: Vec<f64>,
}

impl Known {
    pub fn new(n: usize) -> Self {
        Self {
            friction: vec![0.0; n],
            gain: vec![0.0; n],
            offset: vec![0.0; n],
            unknown: vec![0.0; n],
            load: [0.0; N_LOAD],
            variance: vec![0.0; 4 * n + 1],
        }
    }

    pub fn add(&mut self, change: &Change) {
        let (j, mut factor) = (change.joint, 1.0);
        let mut variance = change.std * change.std;
        let place = self.place(change.kind, j);
        let sizes: &mut [f64] = match change.kind {
            Kind::Friction => &mut self.friction,
            Kind::Gain => &mut self.gain,
            Kind::Offset => &mut self.offset,
            Kind::Unknown => &mut self.unknown,
            Kind::Load => {
                let [x, y, z] = change.moments;
                for (sum, more) in self.load.iter_mut().zip([change.size, x, y, z]) {
                    *sum += more;
                }
                &mut []
            }
        };
        let before = at(sizes, j);
        let mut now = before + change.size;
        if change.kind == Kind::Unknown {
            // Errors multiply.
            now += before * change.size;
            factor = (1.0 + change.size) * (1.0 + change.size);
            variance *= (1.0 + before) * (1.0 + before);
        }
        set(sizes, j, now);
        let sum = factor * at(&self.variance, place) + variance;
        set(&mut self.variance, place, sum);
    }

    /// Where the variance of a kind on a joint is.
    fn place(&self, kind: Kind, joint: usize) -> usize {
        let n = self.friction.len();
        let row = match kind {
            Kind::Friction => 0,
            Kind::Gain => 1,
            Kind::Offset => 2,
            Kind::Unknown => 3,
            Kind::Load => return 4 * n,
        };
        row * n + joint
    }

    /// What was named, put together: one change per kind and joint.
    pub fn all(&self) -> impl Iterator<Item = Change> + '_ {
        let n = self.friction.len();
        let own = [
            (Kind::Friction, &self.friction),
            (Kind::Gain, &self.gain),
            (Kind::Offset, &self.offset),
            (Kind::Unknown, &self.unknown),
        ];
        let [mass, x, y, z] = self.load;
        let own = own.into_iter().flat_map(move |(kind, sizes)| {
            let sizes = sizes.iter().enumerate();
            sizes.map(move |(joint, size)| (kind, joint, *size, [0.0; 3]))
        });
        let load = (Kind::Load, n.saturating_sub(1), mass, [x, y, z]);
        let named = own.chain([load]).filter(|(_, _, size, moments)| {
            *size != 0.0 || moments.iter().any(|moment| *moment != 0.0)
        });
        named.map(|(kind, joint, size, moments)| Change {
            kind,
            joint,
            size,
            std: at(&self.variance, self.place(kind, joint)).sqrt(),
            moments,
            said: Said::Settled,
            or: None,
        })
    }

    /// Takes it off what a row leaves.
    pub fn take_off(&self, row: &mut Row) {
        let own = self.friction.iter().zip(&self.gain).zip(&self.offset);
        let columns = row.friction.iter().zip(&row.torque);
        for ((left, ((friction, gain), offset)), (f, tau)) in
            row.left.iter_mut().zip(own).zip(columns)
        {
            *left -= friction * f + gain * tau + offset;
        }
        for (column, size) in row.load.iter().zip(self.load) {
            for (left, per_unit) in row.left.iter_mut().zip(column) {
                *left -= size * per_unit;
            }
        }
    }
}
