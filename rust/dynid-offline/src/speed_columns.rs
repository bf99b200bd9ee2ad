//! Columns of one joint's speeds along a run, in lanes.

use core::marker::PhantomData;

use dynid_core::effects::SpeedRow;
use dynid_core::lanes::{self, Kernel, Lanes};

use crate::filter::LANES;
use crate::rows::put;

/// `Law`'s N columns at every speed; zeros behind them, so that a filter takes all of a row at once.
#[must_use]
pub fn speed_columns<Law: SpeedRow<N>, const N: usize>(
    dq: &[f64],
    first: f64,
    second: f64,
) -> Vec<[f64; LANES]> {
    let mut out = vec![[0.0; LANES]; dq.len()];
    lanes::run_narrow(Columns::<Law, N> {
        dq,
        shape: [first, second],
        out: out.as_flattened_mut(),
        law: PhantomData,
    });
    out
}

struct Columns<'a, Law, const N: usize> {
    dq: &'a [f64],
    shape: [f64; 2],
    out: &'a mut [f64],
    law: PhantomData<Law>,
}

impl<Law: SpeedRow<N>, const N: usize> Kernel for Columns<'_, Law, N> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
        const { assert!(N <= LANES) }
        let [first, second] = self.shape.map(L::splat);
        let parts = self.out.chunks_mut(L::LEN * LANES);
        for (dq, out) in self.dq.chunks(L::LEN).zip(parts) {
            let row = Law::row(L::load_some(dq), first, second);
            let mut columns = [L::ZERO; LANES];
            for (column, x) in columns.iter_mut().zip(row) {
                *column = x.raw();
            }
            put::<L>(&columns, out, LANES);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_core::effects::{friction_columns, PaperFriction, SignSlopes, N_SLOPES};

    fn speeds() -> Vec<f64> {
        (-45..46).map(|k| 0.003 * f64::from(k)).collect()
    }

    #[test]
    fn speeds_beside_each_other_are_those_alone() {
        let dq = speeds();
        let friction = speed_columns::<PaperFriction, _>(&dq, 0.05, 0.01);
        for (speed, row) in dq.iter().zip(friction) {
            assert_eq!(row, friction_columns(*speed, 0.05, 0.01));
        }
        let slopes = speed_columns::<SignSlopes, _>(&dq, 0.02, 1.5);
        for (speed, row) in dq.iter().zip(slopes) {
            let alone = |v| speed_columns::<SignSlopes, _>(&[v], 0.02, 1.5)[0];
            assert_eq!(alone(*speed), row);
            let turned = [-row[0], row[1], -row[2], row[3]];
            assert_eq!(turned, alone(-speed)[..N_SLOPES]);
            assert_eq!(row[N_SLOPES..], [0.0; LANES - N_SLOPES]);
        }
    }
}
