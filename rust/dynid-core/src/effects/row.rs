//! Effects at a row of samples of one joint, samples in lanes: what runs over whole recordings.

use super::{
    counterbalance, friction, position_dependent_friction, smooth_friction, stribeck, torque_ripple,
};
use super::{Effect, PaperFriction, SpeedRow, MAX_COLUMNS};
use crate::effects::entry::partner_of;
use crate::lanes::{self, Kernel, Lanes};
use crate::slices::{at, first};
use position_dependent_friction::PositionDependentFriction;
use smooth_friction::SmoothFriction;

/// What an effect of a joint's own motion sees, one sample in each lane.
#[derive(Clone, Copy, Debug)]
pub struct JointRow<L> {
    /// Angle of the link \[rad, m\].
    pub q: L,
    /// Angle of the motor, on the link's side of the gear \[rad, m\].
    pub q_motor: L,
    /// Speed of the motor.
    pub dq_motor: L,
    /// Speed of the motor of [`Effect::speed_partner`]; anything where there is none.
    pub dq_partner: L,
}

impl<L: Lanes> JointRow<L> {
    /// A joint at rest.
    #[inline(always)]
    pub fn at_rest() -> Self {
        let zero = L::splat(0.0);
        Self {
            q: zero,
            q_motor: zero,
            dq_motor: zero,
            dq_partner: zero,
        }
    }
}

/// A formula of `N` signals with `M` columns, written once for a row of samples and for a single one.
///
/// A type, not a function, as [`SpeedRow`].
pub(super) trait Formula<const N: usize, const M: usize> {
    /// The columns of a row of signals.
    fn row<L: Lanes>(signals: [L; N], shape: &[f64]) -> [L; M];
}

/// A [`Formula`] at a single sample, to the bits that it has in a row.
pub(super) fn single<F: Formula<N, M>, const N: usize, const M: usize>(
    signals: [f64; N],
    shape: &[f64],
) -> [f64; M] {
    struct One<'a, F, const N: usize, const M: usize> {
        signals: [f64; N],
        shape: &'a [f64],
        formula: core::marker::PhantomData<F>,
    }

    impl<F: Formula<N, M>, const N: usize, const M: usize> Kernel for One<'_, F, N, M> {
        type Output = [f64; M];

        #[inline(always)]
        fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> [f64; M] {
            let mut signals = [S::splat(0.0); N];
            for (to, x) in signals.iter_mut().zip(self.signals) {
                *to = S::splat(x);
            }
            let mut columns = [0.0; M];
            for (to, column) in columns.iter_mut().zip(F::row(signals, self.shape)) {
                [*to] = column.raw();
            }
            columns
        }
    }

    lanes::run_narrow(One::<F, N, M> {
        signals,
        shape,
        formula: core::marker::PhantomData,
    })
}

impl Effect {
    /// The joint beside `j` whose speed its sign is of too: that of a gear stage which both turn.
    #[must_use]
    pub fn speed_partner(&self, j: usize) -> Option<usize> {
        if self.kind() != super::coupled_friction::KIND {
            return None;
        }
        let [partner] = first(self.own_shape(j));
        partner_of(partner)
    }

    /// [`Self::columns_into`] at a row of samples of joint `j`, to the same bits, and zeros after the columns. `None` of an
    /// effect that remembers, hears of anything but its joint's motion, or has a tanh for a sign beside another law.
    #[inline(always)]
    pub fn row<L: Lanes>(&self, j: usize, input: &JointRow<L>) -> Option<[L; MAX_COLUMNS]> {
        let shape = self.own_shape(j);
        let JointRow {
            mut q,
            mut q_motor,
            dq_motor: v,
            ..
        } = *input;
        if let Some([from, to]) = self.held.get(j) {
            let (from, to) = (L::splat(*from), L::splat(*to));
            q = q.at_least(from).at_most(to);
            q_motor = q_motor.at_least(from).at_most(to);
        }
        match self.kind() {
            friction::KIND => {
                let [threshold, width] = first(shape);
                Some(PaperFriction::row(v, L::splat(threshold), L::splat(width)))
            }
            smooth_friction::KIND => {
                let [width, sharpness] = first(shape);
                let columns = SmoothFriction::row(v, L::splat(width), L::splat(sharpness));
                Some(filled_up(columns))
            }
            stribeck::KIND => {
                let sign = self.sign_row(j, v)?;
                Some(filled_up(stribeck::Stribeck::row([v, sign], shape)))
            }
            position_dependent_friction::KIND => {
                let sign = self.sign_row(j, v)?;
                Some(filled_up(PositionDependentFriction::row([q, sign], shape)))
            }
            counterbalance::KIND => Some(filled_up(counterbalance::Cylinder::row([q], shape))),
            torque_ripple::KIND => Some(filled_up(torque_ripple::Ripple::row([q_motor], shape))),
            super::coupled_friction::KIND => {
                let [partner, ratio, width, sharpness] = first(shape);
                let mut columns = [L::splat(0.0); MAX_COLUMNS];
                if partner_of(partner).is_some() {
                    if sharpness <= 0.0 {
                        return None;
                    }
                    let u = v + L::splat(ratio) * input.dq_partner;
                    let sign = smooth_friction::sign_row(u, L::splat(width), L::splat(sharpness));
                    columns[0] = sign;
                    columns[1] = u;
                }
                Some(columns)
            }
            _ => None,
        }
    }

    /// [`super::EffectInput::sign`] of a row of speeds of joint `j`'s motor, to the same bits as one by one; `None` of an effect
    /// without one, with a tanh in its place (sharpness 0), or with one of two joints' speed.
    #[inline(always)]
    pub fn sign_row<L: Lanes>(&self, j: usize, dq_motor: L) -> Option<L> {
        let [width, sharpness] = self.entry().sign()?;
        let own = self.own_shape(j);
        let (e, p) = (at(own, width), at(own, sharpness));
        // What stands in a closure is not compiled for these registers.
        if p > 0.0 {
            return Some(smooth_friction::sign_row(
                dq_motor,
                L::splat(e),
                L::splat(p),
            ));
        }
        None
    }
}

#[inline(always)]
fn filled_up<L: Lanes, const M: usize>(columns: [L; M]) -> [L; MAX_COLUMNS] {
    let mut row = [L::splat(0.0); MAX_COLUMNS];
    for (to, column) in row.iter_mut().zip(columns) {
        *to = column;
    }
    row
}
