//! What a step of the estimator does before and after its terms, joints in lanes.

use crate::lanes::{Kernel, Lanes, MOST_LANES};
use crate::model::TorqueModel;
use crate::slices::{mirror_fields, part, part_mut, rows, tail, Mirror};
use crate::state::{align_row, State};

/// Numbers of the model that every step asks for, each padded to whole rows.
#[derive(Clone, Debug)]
pub(crate) struct StepRows {
    delay: Vec<f64>,
    /// Least and greatest position, greatest speed and acceleration; lanes without a joint are inside.
    domain: [Vec<f64>; 4],
}

impl StepRows {
    pub(crate) fn new(model: &TorqueModel) -> Self {
        let padded = |values: &mut dyn Iterator<Item = f64>| {
            let mut row: Vec<f64> = values.collect();
            row.resize(row.len().next_multiple_of(MOST_LANES), 0.0);
            row
        };
        let domain = model.domain();
        Self {
            delay: padded(&mut model.encoder_delay().iter().copied()),
            domain: [
                padded(&mut domain.q.iter().map(|[low, _]| *low)),
                padded(&mut domain.q.iter().map(|[_, high]| *high)),
                padded(&mut domain.dq.iter().copied()),
                padded(&mut domain.ddq.iter().copied()),
            ],
        }
    }
}

/// Checks what the channels show and brings it to the motor channel's clock.
pub(crate) struct Take<'a> {
    pub rows: &'a StepRows,
    pub shown: &'a State<'a>,
    pub link: &'a mut [Vec<f64>; 3],
    pub motor: &'a mut [Vec<f64>; 3],
}

/// What [`Take`] found.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Taken {
    pub finite: bool,
    pub inside_domain: bool,
}

impl Kernel for Take<'_> {
    type Output = Taken;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Taken {
        let n = self.shown.q.len();
        let (mut finite, mut outside) = (true, false);
        let [low, high, speed, acceleration] = &self.rows.domain;
        let mut start = 0;
        while start < n {
            let end = n.min(start + L::LEN);
            let joints = |signal| L::load_some(part(signal, start, end));
            let q = joints(self.shown.q);
            let dq = joints(self.shown.dq);
            let ddq = joints(self.shown.ddq);
            let motor = [
                joints(self.shown.q_motor),
                joints(self.shown.dq_motor),
                joints(self.shown.ddq_motor),
            ];
            // A number times zero is zero, unless it is not finite; sums of zeros are.
            let zero = L::splat(0.0);
            let link_sum = q * zero + dq * zero + ddq * zero;
            let motor_sum = motor[0] * zero + motor[1] * zero + motor[2] * zero;
            finite &= (link_sum + motor_sum).all_less(L::splat(1.0));
            outside |=
                q.any_less(L::load(tail(low, start))) | L::load(tail(high, start)).any_less(q);
            outside |= L::load(tail(speed, start)).any_less(dq.abs());
            outside |= L::load(tail(acceleration, start)).any_less(ddq.abs());

            let [q, dq] = align_row(q, dq, ddq, L::load(tail(&self.rows.delay, start)));
            for (to, row) in self.link.iter_mut().zip([q, dq, ddq]) {
                row.store_some(part_mut(to, start, end));
            }
            for (to, row) in self.motor.iter_mut().zip(motor) {
                row.store_some(part_mut(to, start, end));
            }
            start += L::LEN;
        }
        Taken {
            finite,
            inside_domain: !outside,
        }
    }
}

/// A term beyond this is an overflow, not a torque; sums of terms below it stay finite. A NaN compares false.
const OVERFLOW: f64 = 1e300;

/// Adds the terms up; false, and nothing is written, if one overflowed.
pub(crate) struct Sum<'a> {
    /// Rows of `total.len()` joints.
    pub terms: &'a [f64],
    pub total: &'a mut [f64],
}

impl Kernel for Sum<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> bool {
        let n = self.total.len();
        let mut sound = true;
        let mut start = 0;
        while start < self.terms.len() {
            let end = self.terms.len().min(start + L::LEN);
            let row = L::load_some(part(self.terms, start, end));
            sound &= row.abs().all_less(L::splat(OVERFLOW));
            start += L::LEN;
        }
        if !sound {
            return false;
        }
        for (k, total) in self.total.chunks_mut(L::LEN).enumerate() {
            let first = k * L::LEN;
            let mut sum = L::splat(0.0);
            for row in rows(self.terms, n) {
                sum = sum + L::load_some(part(row, first, first + total.len()));
            }
            sum.store_some(total);
        }
        true
    }
}

impl Mirror for StepRows {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(self, of; delay, domain; copied; kept);
    }
}
