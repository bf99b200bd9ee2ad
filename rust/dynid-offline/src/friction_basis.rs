//! The paper's friction columns along a run, speeds in lanes.

use dynid_core::effects::{friction_row, N_FRICTION};
use dynid_core::lanes::{self, Kernel, Lanes};

use crate::rows::put;

/// Basis of Eqs. 9-11 at every speed: `dynid_core::effects::friction_columns`, to the same bits.
#[must_use]
pub fn friction_basis(
    dq: &[f64],
    velocity_threshold: f64,
    transition_width: f64,
) -> Vec<[f64; N_FRICTION]> {
    let mut out = vec![[0.0; N_FRICTION]; dq.len()];
    lanes::run_narrow(Basis {
        dq,
        shape: [velocity_threshold, transition_width],
        out: out.as_flattened_mut(),
    });
    out
}

struct Basis<'a> {
    dq: &'a [f64],
    shape: [f64; 2],
    out: &'a mut [f64],
}

impl Kernel for Basis<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
        let [lambda, eps] = self.shape.map(L::splat);
        let parts = self.out.chunks_mut(L::LEN * N_FRICTION);
        for (dq, out) in self.dq.chunks(L::LEN).zip(parts) {
            let row = friction_row(L::load_some(dq), lambda, eps);
            let mut columns = [L::ZERO; N_FRICTION];
            for (column, x) in columns.iter_mut().zip(row) {
                *column = x.raw();
            }
            put::<L>(&columns, out, N_FRICTION);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_core::effects::friction_columns;

    #[test]
    fn speeds_beside_each_other_are_those_alone() {
        let dq: Vec<f64> = (-45..46).map(|k| 0.003 * f64::from(k)).collect();
        for (speed, row) in dq.iter().zip(friction_basis(&dq, 0.05, 0.01)) {
            assert_eq!(row, friction_columns(*speed, 0.05, 0.01));
        }
    }
}
