//! Signs of one joint's speeds along a run, in lanes.

use dynid_core::lanes::{self, Kernel, Lanes};
use dynid_core::Effect;

/// `EffectInput::sign` of joint `j` at every sample of the motors' speeds (row-major); none of an effect without it.
pub(crate) fn signs(effect: &Effect, j: usize, n_joints: usize, dq_motor: &[f64]) -> Vec<f64> {
    struct Signs<'a> {
        effect: &'a Effect,
        j: usize,
        signs: &'a mut [f64],
    }

    impl Kernel for Signs<'_> {
        type Output = bool;

        #[inline(always)]
        fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> bool {
            for signs in self.signs.chunks_mut(L::LEN) {
                let Some(sign) = self.effect.sign_row(self.j, L::load_some(signs)) else {
                    return false;
                };
                sign.store_some(signs);
            }
            true
        }
    }

    let mut signs: Vec<f64> = dq_motor.iter().skip(j).step_by(n_joints).copied().collect();
    let there = lanes::run_narrow(Signs {
        effect,
        j,
        signs: &mut signs,
    });
    if there {
        signs
    } else {
        Vec::new()
    }
}
