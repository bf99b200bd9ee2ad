//! The torque that the model predicts at the motors: what a drive's current has to make.

use super::EffectTerm;
use crate::slices::copy;

/// Name in [`Entry::signals`](super::Entry::signals).
pub const SIGNAL: &str = "tau_motor";

/// Rigid-body torque as the channel shows it, `scaled`, and all declared ones of `terms` on top of it, each with its torque
/// \[torque unit\], in their order; effects beyond the declared model are not among them. Written to `tau_motor`.
///
/// All slices are equally long: the joints of a sample, or those of all samples of a run.
#[inline(always)]
pub fn motor_torque_into<'a>(
    scaled: &[f64],
    terms: impl Iterator<Item = (&'a EffectTerm, &'a [f64])>,
    tau_motor: &mut [f64],
) {
    copy(scaled, tau_motor);
    for (_, torque) in terms.filter(|(term, _)| term.effect().is_declared()) {
        for (sum, torque) in tau_motor.iter_mut().zip(torque) {
            *sum += torque;
        }
    }
}
