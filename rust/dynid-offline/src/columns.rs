//! Columns and torque of one effect along a run, memory and all: what the estimator sums online, to the same bits.

use dynid_core::effects::{motor_torque_into, JointRow, TAU_MOTOR};
use dynid_core::lanes::{self, Kernel, Lanes, Portable, MOST_LANES};
use dynid_core::{all_finite, CoreError, Effect, EffectInput, EffectTerm, State};
use rayon::prelude::*;

use crate::error::OfflineError;
use crate::observation::slice_state;
use crate::rows::gather;
use crate::signs::signs;

/// Samples per task.
const CHUNK: usize = 256;

/// What effects see of a run on a uniform time grid; every slice is row-major, n_samples × n_joints.
#[derive(Clone, Copy, Debug)]
pub struct RunSignals<'a> {
    /// Link-side and motor-side signals, on one clock; temperatures are needed by effects that follow them.
    pub state: State<'a>,
    /// Rigid-body torque that the model predicts \[N·m\]; needed by effects of the load.
    pub tau_link: Option<&'a [f64]>,
    /// Torque that the model predicts at the motors \[torque unit\], [`motor_torque`]; needed by effects of it.
    pub tau_motor: Option<&'a [f64]>,
    /// Time between samples \[s\]; needed by effects that remember in time.
    pub step: Option<f64>,
}

impl<'a> RunSignals<'a> {
    /// # Errors
    /// [`OfflineError`] if a length is wrong, a number is not finite or an effect needs what is not there.
    pub fn check(
        &self,
        effects: &[Effect],
        n_joints: usize,
        n_samples: usize,
    ) -> Result<(), OfflineError> {
        self.check_shapes(effects, n_joints, n_samples)?;
        self.check_read(effects)
    }

    /// # Errors
    /// [`OfflineError::NonFinite`] if a number is not finite.
    pub(crate) fn check_finite(&self) -> Result<(), OfflineError> {
        let State { q, dq, ddq, .. } = self.state;
        if ![q, dq, ddq].into_iter().all(all_finite) {
            return Err(OfflineError::NonFinite { what: "run" });
        }
        self.check_others()
    }

    /// [`Self::check_finite`] of the signals that some of `effects` read.
    fn check_read(&self, effects: &[Effect]) -> Result<(), OfflineError> {
        let state = &self.state;
        let optional = [
            ("tau_link", self.tau_link),
            (TAU_MOTOR, self.tau_motor),
            ("temperature", state.temperature),
        ];
        let optional = optional
            .into_iter()
            .filter_map(|(name, signal)| Some((name, signal?)));
        let read = |name| effects.iter().any(|effect| effect.entry().needs(name));
        let mut signals = state.signals().into_iter().chain(optional);
        if signals.all(|(name, signal)| !read(name) || all_finite(signal)) {
            Ok(())
        } else {
            Err(OfflineError::NonFinite { what: "run" })
        }
    }

    /// [`Self::check_finite`] of all but q, dq and ddq of the links; the motors' where they are other arrays.
    pub(crate) fn check_others(&self) -> Result<(), OfflineError> {
        let state = &self.state;
        let motor = [
            (state.q_motor, state.q),
            (state.dq_motor, state.dq),
            (state.ddq_motor, state.ddq),
        ];
        let own = motor
            .into_iter()
            .filter(|(motor, link)| !std::ptr::eq(*motor, *link))
            .map(|(motor, _)| motor);
        let optional = [self.tau_link, self.tau_motor, state.temperature]
            .into_iter()
            .flatten();
        if own.chain(optional).all(all_finite) {
            Ok(())
        } else {
            Err(OfflineError::NonFinite { what: "run" })
        }
    }

    /// [`Self::check`] without looking whether numbers are finite.
    pub(crate) fn check_shapes(
        &self,
        effects: &[Effect],
        n_joints: usize,
        n_samples: usize,
    ) -> Result<(), OfflineError> {
        self.state.check(n_samples * n_joints)?;
        for (what, tau) in [("tau_link", self.tau_link), (TAU_MOTOR, self.tau_motor)] {
            if tau.is_some_and(|tau| tau.len() != n_samples * n_joints) {
                return Err(OfflineError::Shape { what });
            }
        }
        if let Some(step) = self.step {
            dynid_core::model::check_step(step)?;
        }
        for effect in effects {
            effect.check(n_joints)?;
            for (what, there) in [
                ("tau_link", self.tau_link.is_some()),
                (TAU_MOTOR, self.tau_motor.is_some()),
                ("step", self.step.is_some()),
                ("temperature", self.state.temperature.is_some()),
            ] {
                if !there && effect.entry().needs(what) {
                    return Err(OfflineError::Missing {
                        kind: effect.kind(),
                        what,
                    });
                }
            }
        }
        Ok(())
    }

    /// Sample `k`. What is not there is not needed, after [`Self::check`].
    pub(crate) fn input(&self, k: usize, n_joints: usize) -> EffectInput<'a> {
        let at = k * n_joints..(k + 1) * n_joints;
        EffectInput {
            state: slice_state(&self.state, at.clone()),
            tau_link: self.tau_link.map_or(&[], |tau| &tau[at.clone()]),
            tau_motor: self.tau_motor.map_or(&[], |tau| &tau[at]),
            step: self.step.unwrap_or(0.0),
            sign: None,
        }
    }
}

/// Columns of `effect` on some joints at every sample, n_samples × joints × n_columns, from a fresh memory.
///
/// # Errors
/// As [`RunSignals::check`]; [`OfflineError::Shape`] if there is no such joint.
pub fn effect_columns(
    effect: &Effect,
    n_joints: usize,
    run: &RunSignals<'_>,
    joints: &[usize],
) -> Result<Vec<f64>, OfflineError> {
    let n_samples = run.state.q.len() / n_joints;
    run.check(std::slice::from_ref(effect), n_joints, n_samples)?;
    if joints.iter().any(|j| *j >= n_joints) {
        return Err(OfflineError::Shape { what: "joints" });
    }
    Ok(columns(effect, n_joints, run, joints))
}

/// [`effect_columns`] of what has been checked.
pub(crate) fn columns(
    effect: &Effect,
    n_joints: usize,
    run: &RunSignals<'_>,
    joints: &[usize],
) -> Vec<f64> {
    let width = effect.n_columns();
    let n_samples = run.state.q.len() / n_joints;
    let mut out = vec![0.0; n_samples * joints.len() * width];
    let in_rows = joints.iter().all(|j| is_in_rows(effect, *j));
    let signs: Vec<Vec<f64>> = joints
        .iter()
        .filter(|_| !in_rows)
        .map(|j| signs(effect, *j, n_joints, run.state.dq_motor))
        .collect();
    let fill = |first: usize, out: &mut [f64]| {
        if in_rows {
            lanes::run(Rows {
                effect,
                state: &run.state,
                n_joints,
                joints,
                first,
                out,
            });
            return;
        }
        let mut memory = vec![0.0; effect.memory_len(n_joints)];
        for (k, sample) in out.chunks_exact_mut(joints.len() * width).enumerate() {
            let mut input = run.input(first + k, n_joints);
            let own = joints.iter().zip(&signs);
            for ((j, signs), columns) in own.zip(sample.chunks_exact_mut(width)) {
                input.sign = signs.get(first + k).copied();
                effect.columns_into(*j, &input, &mut memory, columns);
            }
        }
    };
    if out.is_empty() {
        return out;
    }
    // Of one joint they are done before the pool has woken.
    if effect.entry().memory > 0 || joints.len() == 1 {
        fill(0, &mut out);
    } else {
        out.par_chunks_mut(CHUNK * joints.len() * width)
            .enumerate()
            .for_each(|(chunk, out)| fill(chunk * CHUNK, out));
    }
    out
}

/// Columns of an effect on some joints at samples from `first` on, samples in lanes.
struct Rows<'a> {
    effect: &'a Effect,
    state: &'a State<'a>,
    n_joints: usize,
    joints: &'a [usize],
    first: usize,
    /// Samples × joints × columns.
    out: &'a mut [f64],
}

impl Kernel for Rows<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
        let (n, width) = (self.n_joints, self.effect.n_columns());
        let State {
            q,
            q_motor,
            dq_motor,
            ..
        } = *self.state;
        let stride = self.joints.len() * width;
        for (group, out) in self.out.chunks_mut(L::LEN * stride).enumerate() {
            let n_own = out.len() / stride;
            // Where samples end, the last one fills up.
            let mut samples = [0; MOST_LANES];
            for (lane, sample) in samples.iter_mut().enumerate() {
                *sample = self.first + group * L::LEN + lane.min(n_own - 1);
            }
            let samples = &samples[..L::LEN];
            for (place, &j) in self.joints.iter().enumerate() {
                let partner = self.effect.speed_partner(j).unwrap_or(j);
                let input = JointRow {
                    q: gather::<L>(q, samples, n, j),
                    q_motor: gather::<L>(q_motor, samples, n, j),
                    dq_motor: gather::<L>(dq_motor, samples, n, j),
                    dq_partner: gather::<L>(dq_motor, samples, n, partner),
                };
                let Some(columns) = self.effect.row(j, &input) else {
                    return;
                };
                for (c, column) in columns.into_iter().take(width).enumerate() {
                    let mut numbers = [0.0; MOST_LANES];
                    column.store(&mut numbers);
                    let to = out[place * width + c..].iter_mut().step_by(stride);
                    for (to, x) in to.zip(numbers) {
                        *to = x;
                    }
                }
            }
        }
    }
}

/// Whether samples of joint `j` go side by side.
fn is_in_rows(effect: &Effect, j: usize) -> bool {
    let input = JointRow::<Portable<1, false>>::at_rest();
    effect.row(j, &input).is_some()
}

/// Torque of `term` at every sample into `tau` (n_samples × n_joints), from a fresh memory.
///
/// # Errors
/// As [`RunSignals::check`].
pub fn effect_torque(
    term: &EffectTerm,
    n_joints: usize,
    run: &RunSignals<'_>,
    tau: &mut [f64],
) -> Result<(), OfflineError> {
    let n_samples = run.state.q.len() / n_joints;
    run.check(std::slice::from_ref(term.effect()), n_joints, n_samples)?;
    check_length("tau", tau.len(), run.state.q.len())?;
    torque(term, n_joints, run, tau);
    Ok(())
}

/// [`effect_torque`] of what has been checked.
fn torque(term: &EffectTerm, n_joints: usize, run: &RunSignals<'_>, tau: &mut [f64]) {
    let fill = |first: usize, tau: &mut [f64]| {
        let mut memory = vec![0.0; term.effect().memory_len(n_joints)];
        for (k, tau) in tau.chunks_exact_mut(n_joints).enumerate() {
            term.torque_into(&run.input(first + k, n_joints), &mut memory, tau);
        }
    };
    if term.effect().entry().memory > 0 {
        fill(0, tau);
    } else {
        tau.par_chunks_mut(CHUNK * n_joints)
            .enumerate()
            .for_each(|(chunk, tau)| fill(chunk * CHUNK, tau));
    }
}

fn check_length(what: &'static str, actual: usize, expected: usize) -> Result<(), CoreError> {
    if actual == expected {
        Ok(())
    } else {
        Err(CoreError::Length {
            what,
            expected,
            actual,
        })
    }
}

/// Torque that a model predicts at the motors at every sample into `tau_motor` (n_samples × n_joints): its rigid-body torque
/// `run.tau_link` as the channel shows it, times `torque_scale`, and what is declared of `terms`, from a fresh memory.
///
/// # Errors
/// As [`RunSignals::check`]; [`OfflineError::Missing`] without `tau_link`.
pub fn motor_torque(
    terms: &[EffectTerm],
    torque_scale: &[f64],
    run: &RunSignals<'_>,
    tau_motor: &mut [f64],
) -> Result<(), OfflineError> {
    let n_joints = torque_scale.len();
    let tau_link = run.tau_link.ok_or(OfflineError::Missing {
        kind: TAU_MOTOR,
        what: "tau_link",
    })?;
    let terms: Vec<_> = terms
        .iter()
        .filter(|term| term.effect().is_declared())
        .collect();
    let effects: Vec<_> = terms.iter().map(|term| term.effect().clone()).collect();
    run.check(&effects, n_joints, run.state.q.len() / n_joints)?;
    check_length("torque", tau_motor.len(), tau_link.len())?;
    if !all_finite(tau_link) {
        return Err(OfflineError::NonFinite { what: "tau_link" });
    }
    let scales = torque_scale.iter().cycle();
    let scaled: Vec<f64> = tau_link
        .iter()
        .zip(scales)
        .map(|(tau, scale)| tau * scale)
        .collect();
    let torques: Vec<Vec<f64>> = terms
        .par_iter()
        .map(|term| {
            let mut own = vec![0.0; scaled.len()];
            torque(term, n_joints, run, &mut own);
            own
        })
        .collect();
    let declared = terms.into_iter().zip(torques.iter().map(Vec::as_slice));
    motor_torque_into(&scaled, declared, tau_motor);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn torque_has_a_number_per_sample_and_joint() {
        let motion = vec![0.5; 6];
        let run = RunSignals {
            state: State::single(&motion, &motion, &motion),
            tau_link: None,
            tau_motor: None,
            step: None,
        };
        let term = EffectTerm::new(Effect::rotor_inertia(), vec![1.0, 2.0], 2);
        let term = term.expect("a term");
        let mut tau = vec![0.0; 6];
        assert!(effect_torque(&term, 2, &run, &mut tau).is_ok());
        assert_eq!(tau, [0.5, 1.0, 0.5, 1.0, 0.5, 1.0]);
        for wrong in [4, 8] {
            let said = effect_torque(&term, 2, &run, &mut vec![0.0; wrong]);
            let said = said.expect_err("another length").to_string();
            assert_eq!(said, format!("tau has {wrong} values, expected 6"));
        }
    }
}
