//! What a smooth law's sign changes by with its shape, along a run, speeds in lanes.

use dynid_core::effects::sign_slope_row;
use dynid_core::lanes::{self, Kernel, Lanes};

use crate::filter::LANES;
use crate::rows::put;

/// Slopes of the sign and of its size: by the logarithm of the width, then by that of the sharpness.
pub const N_SLOPES: usize = 4;

/// At every speed the change of `s` and of `|s|` with the logarithm of the width, and the same with that of the sharpness;
/// zeros behind them, so that a filter takes all of a row at once.
#[must_use]
pub fn sign_slopes(dq: &[f64], transition_width: f64, sharpness: f64) -> Vec<[f64; LANES]> {
    let mut out = vec![[0.0; LANES]; dq.len()];
    lanes::run_narrow(Slopes {
        dq,
        shape: [transition_width, sharpness],
        out: out.as_flattened_mut(),
    });
    out
}

struct Slopes<'a> {
    dq: &'a [f64],
    shape: [f64; 2],
    out: &'a mut [f64],
}

impl Kernel for Slopes<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
        let [e, p] = self.shape.map(L::splat);
        let parts = self.out.chunks_mut(L::LEN * LANES);
        for (dq, out) in self.dq.chunks(L::LEN).zip(parts) {
            let v = L::load_some(dq);
            let [width, sharpness] = sign_slope_row(v, e, p);
            let mut columns = [L::ZERO; LANES];
            let slopes = [
                width,
                width.xor(v.sign()),
                sharpness,
                sharpness.xor(v.sign()),
            ];
            for (column, slope) in columns.iter_mut().zip(slopes) {
                *column = slope.raw();
            }
            put::<L>(&columns, out, LANES);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_beside_each_other_is_what_stands_alone() {
        let dq: Vec<f64> = (-45..46).map(|k| 0.003 * f64::from(k)).collect();
        let all = sign_slopes(&dq, 0.02, 1.5);
        for (speed, row) in dq.iter().zip(&all) {
            assert_eq!(sign_slopes(&[*speed], 0.02, 1.5)[0], *row);
            let turned = sign_slopes(&[-speed], 0.02, 1.5)[0];
            assert_eq!([-row[0], row[1], -row[2], row[3]], turned[..N_SLOPES]);
        }
    }
}
