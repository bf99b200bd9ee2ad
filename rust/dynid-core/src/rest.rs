//! What friction may hold of a joint that stands, and below which speed it may.

use crate::effects::{smooth_friction, EffectInput, EffectTerm};
use crate::model::TorqueModel;
use crate::slices::{at, set};
use crate::state::State;

/// Speeds are slow where friction has not reached this part of its step.
const STEP_PART: f64 = 0.9;

/// Per joint, half of the step of friction at standstill without load \[torque unit\], less what follows the angle, and the
/// speed below which it is not a function of the state: a joint that stands holds any torque in between, and no model says
/// which.
pub(crate) fn at_rest(model: &TorqueModel) -> Vec<[f64; 2]> {
    let n = model.robot().n_joints();
    let mut found = vec![[0.0; 2]; n];
    for effect in model.effects().iter().filter(|effect| steps(effect, n)) {
        let of_sign = sign_of(effect, n);
        let (effect, by_its_sign) = (of_sign.as_ref().unwrap_or(effect), of_sign.is_some());
        let own = step_of(effect, &vec![0.0; n], by_its_sign);
        for ([torque, speed], [step, at]) in found.iter_mut().zip(own) {
            *torque += if needs(effect, "q") { 0.0 } else { step };
            *speed = speed.max(at);
        }
    }
    found
}

/// Friction that grows with the load or follows the angle, by its place among the effects, and per joint the speed at which
/// its step is passed.
pub(crate) fn of_state(model: &TorqueModel) -> Vec<(usize, Vec<f64>)> {
    let n = model.robot().n_joints();
    let effects = model.effects().iter().enumerate();
    let followed =
        effects.filter(|(_, term)| steps(term, n) && (needs(term, "tau_link") || needs(term, "q")));
    let speeds = |term| step_of(term, &vec![1.0; n], false).into_iter();
    followed
        .map(|(place, term)| (place, speeds(term).map(|[_, speed]| speed).collect()))
        .collect()
}

/// True if it may have a step at standstill.
fn steps(term: &EffectTerm, n: usize) -> bool {
    needs(term, "dq_motor") && term.effect().memory_len(n) == 0
}

fn needs(term: &EffectTerm, signal: &str) -> bool {
    term.effect().entry().needs(signal)
}

/// Per joint, half of the step between the speeds to either side, doubled until it grows by less than the rest of its part,
/// and that speed; zeros where there is none.
fn step_of(effect: &EffectTerm, tau_link: &[f64], by_its_sign: bool) -> Vec<[f64; 2]> {
    let n = tau_link.len();
    let zeros = vec![0.0; n];
    // Friction along the angle is zero here for no number of cycles by itself, as a sine is at zero.
    let q = vec![1.0; n];
    let mut found = vec![[0.0; 2]; n];
    let mut all = vec![0.0; n];
    let mut low = vec![0.0; n];
    let mut high = vec![0.0; n];
    let mut half_step = |speed: f64| -> Vec<f64> {
        for (sign, out) in [(-1.0, &mut low), (1.0, &mut high)] {
            for (j, out) in out.iter_mut().enumerate() {
                // The joint alone: a stage that the difference of two speeds turns would stand where both are alike.
                let mut dq = zeros.clone();
                set(&mut dq, j, sign * speed);
                let state = State {
                    dq_motor: &dq,
                    ..State::single(&q, &dq, &zeros)
                };
                let input = EffectInput {
                    state,
                    tau_link,
                    tau_motor: &zeros,
                    step: 0.0,
                    sign: None,
                };
                effect.torque_into(&input, &mut [], &mut all);
                *out = at(&all, j);
            }
        }
        high.iter()
            .zip(&low)
            .map(|(high, low)| 0.5 * (high - low))
            .collect()
    };
    let mut speed = SLOWEST;
    while speed < FASTEST {
        let (here, there) = (half_step(speed), half_step(2.0 * speed));
        for (j, found) in found.iter_mut().enumerate() {
            let step = here[j].abs();
            let is_last = by_its_sign && 2.0 * speed >= FASTEST;
            if found[1] == 0.0 && step > 0.0 && (is_last || step >= STEP_PART * there[j].abs()) {
                *found = [step, speed];
            }
        }
        speed *= 2.0;
    }
    found
}

/// Per joint, the speed below which its friction is not a function of the state \[rad/s, m/s\].
pub(crate) fn rest_speeds(model: &TorqueModel) -> Vec<f64> {
    at_rest(model).into_iter().map(|[_, speed]| speed).collect()
}

/// Of friction with a shape of its own, the part of its sign alone: a wide one still rises where viscous friction has taken
/// over, and would be no step beside it.
fn sign_of(term: &EffectTerm, n: usize) -> Option<EffectTerm> {
    if term.effect().kind() != smooth_friction::KIND {
        return None;
    }
    let mut coefficients = term.coefficients().to_vec();
    for own in coefficients.chunks_mut(term.effect().n_columns()) {
        own[smooth_friction::N_SIGN..].fill(0.0);
    }
    EffectTerm::new(term.effect().clone(), coefficients, n).ok()
}

/// Speeds at which a step at standstill is looked for \[rad/s, m/s\].
const SLOWEST: f64 = 1e-4;
const FASTEST: f64 = 0.5;
