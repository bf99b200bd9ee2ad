//! From the states of a run to one triangular factor per joint, without the rows in between.
//!
//! Columns are built for a few samples at a time, samples in lanes, and folded into the factors while they are in the
//! cache. Every lane keeps a factor of its own, so that no sum runs across lanes; the eight are merged at the end.

use dynid_core::chain;
use dynid_core::lanes::{self, Kernel, Lanes, MOST_LANES};
use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::{Effect, RobotModel};
use rayon::prelude::*;

use crate::error::OfflineError;
use crate::factor::{tree, triangular_factor};
use crate::joint_columns::{EffectColumns, JointPlan};
use crate::observation::{check, check_shapes, observe, RunStates, Sampling};
use crate::rows::{gather, StateRows};
use crate::triangle::Columns;
use reflect::{JointFold, DEPTH};

mod reflect;

/// Samples per task. Tasks, not threads, decide the order of sums.
const CHUNK: usize = 16_384;

/// Tasks whose factors are held at a time.
const WAVE: usize = 8;

/// Triangular factor of every joint's rows `[effects | base columns of the links it moves | torque]`, width × width,
/// row-major: [`observe`] and [`triangular_factor`] in one pass, in memory that does not depend on the number of samples
/// where the sampling has no filter. With a filter the rows are built first, because it runs along the whole run both
/// ways. Without a sampling every sample is a row.
///
/// # Errors
/// As [`observe`].
pub fn fold(
    robot: &RobotModel,
    effects: &[Effect],
    pivots: &[usize],
    run: &RunStates<'_>,
    sampling: Option<&Sampling>,
) -> Result<Vec<Vec<f64>>, OfflineError> {
    if let Some(sampling) = sampling.filter(|sampling| !sampling.filter.is_empty()) {
        let observation = observe(robot, effects, pivots, run, sampling)?;
        let joints = observation.joints.par_iter();
        return joints
            .map(|joint| triangular_factor(&joint.rows, joint.width))
            .collect();
    }
    let n = robot.n_joints();
    let n_samples = run.tau.len() / n;
    match sampling {
        Some(sampling) => check(robot, effects, pivots, run, sampling, n_samples)?,
        // Where every sample is read, numbers that are not finite are found on the way.
        None => check_shapes(robot, effects, pivots, run, n_samples)?,
    }
    let plan: Vec<JointPlan> = (0..n).map(|j| JointPlan::new(j, effects, pivots)).collect();
    let effects = EffectColumns::new(effects, n, &run.signals);
    let n_rows = sampling.map_or(n_samples, |sampling| sampling.kept.len());
    let folded = |chunk: usize| {
        let rows = chunk * CHUNK..n_rows.min((chunk + 1) * CHUNK);
        let all: Vec<usize>;
        let kept = if let Some(sampling) = sampling {
            &sampling.kept[rows]
        } else {
            all = rows.collect();
            &all
        };
        let not_finite = OfflineError::NonFinite { what: "run" };
        lanes::run(Chunk {
            robot,
            effects: &effects,
            plan: &plan,
            run,
            kept,
        })
        .ok_or(not_finite)
    };
    // A wave of tasks at a time, each merged with what came before: memory stays that of one wave.
    let mut factors: Option<Vec<Vec<f64>>> = None;
    for first in (0..n_rows.div_ceil(CHUNK)).step_by(WAVE) {
        let last = n_rows.div_ceil(CHUNK).min(first + WAVE);
        let new = (first..last).into_par_iter().map(folded);
        let new = new.collect::<Result<Vec<_>, _>>()?;
        let wave: Vec<_> = factors.take().into_iter().chain(new).collect();
        let of_joint = |j: usize| wave.iter().map(|chunk| chunk[j].clone()).collect();
        factors = Some((0..n).map(|j| tree(of_joint(j), plan[j].width())).collect());
    }
    let none = || plan.iter().map(|joint| vec![0.0; joint.width().pow(2)]);
    Ok(factors.unwrap_or_else(|| none().collect()))
}

/// Factors of some samples.
struct Chunk<'a> {
    robot: &'a RobotModel,
    effects: &'a EffectColumns<'a>,
    plan: &'a [JointPlan],
    run: &'a RunStates<'a>,
    kept: &'a [usize],
}

impl Kernel for Chunk<'_> {
    /// Nothing where a number is not finite.
    type Output = Option<Vec<Vec<f64>>>;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Self::Output {
        let widths = self.plan.iter().map(JointPlan::width);
        // Row i of all eight side by side: column k ends with row k.
        let empty = |width: usize| Columns::zeros(1..=width);
        let mut stacked: Vec<_> = widths.clone().map(empty).collect();
        // Eight factors on every processor, so that the sums are the same: narrower rows go over the samples again.
        for first in (0..MOST_LANES).step_by(L::LEN) {
            let mut joints: Vec<_> = widths.clone().map(JointFold::new::<L>).collect();
            if !self.fold_lanes::<L>(first, &mut joints) {
                return None;
            }
            for (joint, stacked) in joints.iter().zip(&mut stacked) {
                joint.put::<L>(first, stacked);
            }
        }
        let mut factors = Vec::with_capacity(stacked.len());
        for stacked in &mut stacked {
            factors.push(stacked.factor::<L>());
        }
        Some(factors)
    }
}

impl Chunk<'_> {
    /// Lanes `first..first + L::LEN` of all samples; whether all their numbers were finite.
    #[inline(always)]
    fn fold_lanes<L: Lanes>(&self, first: usize, joints: &mut [JointFold<L::Raw>]) -> bool {
        let n = self.robot.n_joints();
        let mut states = StateRows::<L>::new(n);
        let mut twists = vec![[[L::ZERO; 3]; 2]; n];
        let mut regressor = vec![L::ZERO; n * n * N_LINK_PARAMS];
        let state = &self.run.signals.state;
        let motion = [state.q, state.dq, state.ddq];
        // Zero times every number: zero as long as all are finite.
        let (zero, mut zeros) = (L::splat(0.0), L::splat(0.0));
        for group in self.kept.chunks(MOST_LANES * DEPTH) {
            for depth in 0..DEPTH {
                let from = (depth * MOST_LANES + first).min(group.len());
                let there = &group[from..group.len().min(from + L::LEN)];
                // Where samples end, rows of zeros change no factor; the numbers under them are any sample's.
                let mut samples = [group[0]; MOST_LANES];
                samples[..there.len()].copy_from_slice(there);
                let samples = &samples[..L::LEN];
                if !there.is_empty() {
                    states.take_samples(motion, samples);
                    chain::joint_torque_regressor::<L>(
                        self.robot,
                        states.rows(),
                        &mut twists,
                        &mut regressor,
                    );
                }
                let joint_rows = regressor.chunks_exact(n * N_LINK_PARAMS);
                let of_joint = self.plan.iter().zip(states.rows()).zip(joint_rows);
                for (j, (joint, ((plan, state), row))) in
                    joints.iter_mut().zip(of_joint).enumerate()
                {
                    let (effects, others) = joint.rows.split_at_mut(plan.n_effect_columns);
                    self.effects.put::<L, DEPTH>(j, samples, depth, effects);
                    for (column, &parameter) in others.iter_mut().zip(&plan.links) {
                        column[depth] = row[parameter];
                    }
                    let tau = gather::<L>(self.run.tau, samples, n, j);
                    others[plan.links.len()][depth] = tau.raw();
                    for number in [state.q, state.dq, state.ddq, tau.raw()] {
                        zeros = L::from_raw(number).mul_add(zero, zeros);
                    }
                    if there.len() < L::LEN {
                        let mut mask = [0.0; MOST_LANES];
                        mask[..there.len()].fill(1.0);
                        let mask = L::load(&mask);
                        for column in &mut joint.rows {
                            column[depth] = (L::from_raw(column[depth]) * mask).raw();
                        }
                    }
                }
            }
            for joint in joints.iter_mut() {
                joint.absorb::<L>();
            }
        }
        zeros.abs().all_less(L::splat(1.0))
    }
}
