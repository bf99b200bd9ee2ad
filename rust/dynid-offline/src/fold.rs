//! From the states of a run to one triangular factor per joint, without the rows in between.
//!
//! Columns are built for a few samples at a time, samples in lanes, and folded into the factors while they are in the
//! cache. Every lane keeps sums of its own, so that no sum runs across lanes; the eight are merged at the end. What is
//! summed are products of columns; where these would lose digits, reflections take their place.

use std::marker::PhantomData;

use dynid_core::chain;
use dynid_core::lanes::{self, Kernel, Lanes, MOST_LANES};
use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::{Effect, RobotModel};
use rayon::prelude::*;

use crate::error::OfflineError;
use crate::factor::{tree, triangular_factor};
use crate::joint_columns::{EffectColumns, JointPlan};
use crate::observation::{check, check_shapes, observe, RunStates, Sampling};
use crate::rows::{take_numbers, StateRows};
use crate::triangle::Columns;
use products::Products;
use reflect::Reflections;
use structure::structures;

mod products;
mod reflect;
mod structure;

/// Samples per task. Tasks, not threads, decide the order of sums.
const CHUNK: usize = 16_384;

/// Samples of a task for each column, all along it, that are looked at before the others.
const GLANCE: usize = 3;

/// Tasks of up to this many times as many samples are not looked at before.
const SHORT: usize = 16;

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
    let structures = structures(robot, &plan)?;
    let joints = structures.iter().zip(&plan);
    let plan: Vec<JointPlan> = joints
        .map(|(of_joint, joint)| of_joint.plan(joint))
        .collect();
    let effects = EffectColumns::new(effects, n, &run.signals);
    let n_rows = sampling.map_or(n_samples, |sampling| sampling.kept.len());
    let widest = plan.iter().map(JointPlan::width).max().unwrap_or(0);
    let glance = (GLANCE * widest).next_multiple_of(MOST_LANES * products::DEPTH);
    let folded = |chunk: usize, reflected: bool, first: bool| {
        let rows = chunk * CHUNK..n_rows.min((chunk + 1) * CHUNK);
        let all: Vec<usize>;
        let kept = if let Some(sampling) = sampling {
            &sampling.kept[rows]
        } else {
            all = rows.collect();
            &all
        };
        let chunk = Chunk {
            robot,
            effects: &effects,
            plan: &plan,
            run,
            kept,
        };
        // Before the first wave is over a few of the samples tell whether it is worth while to try.
        let poor = || -> Result<bool, OfflineError> {
            if !first || kept.len() < SHORT * glance {
                return Ok(false);
            }
            let step = kept.len() / glance + 1;
            let few: Vec<usize> = kept.iter().copied().step_by(step).collect();
            let of_few = Chunk {
                kept: &few,
                ..chunk
            };
            Ok(of_few.factors::<Products, { products::DEPTH }>()?.is_none())
        };
        let factors = if reflected || poor()? {
            None
        } else {
            chunk.factors::<Products, { products::DEPTH }>()?
        };
        match factors {
            Some(factors) => Ok((factors, false)),
            None => chunk
                .factors::<Reflections, { reflect::DEPTH }>()
                .map(|factors| (factors.unwrap_or_default(), true)),
        }
    };
    // A wave of tasks at a time, each merged with what came before: memory stays that of one wave. Where reflections were
    // needed once, nothing else is tried in the waves that follow.
    let (mut factors, mut reflected) = (None::<Vec<Vec<f64>>>, false);
    for first in (0..n_rows.div_ceil(CHUNK)).step_by(WAVE) {
        let last = n_rows.div_ceil(CHUNK).min(first + WAVE);
        let new = (first..last)
            .into_par_iter()
            .map(|chunk| folded(chunk, reflected, first == 0));
        let new = new.collect::<Result<Vec<_>, _>>()?;
        reflected |= new.iter().any(|(_, reflected)| *reflected);
        let new = new.into_iter().map(|(factors, _)| factors);
        let wave: Vec<_> = factors.take().into_iter().chain(new).collect();
        let of_joint = |j: usize| wave.iter().map(|chunk| chunk[j].clone()).collect();
        factors = Some((0..n).map(|j| tree(of_joint(j), plan[j].width())).collect());
    }
    let none = || plan.iter().map(|joint| vec![0.0; joint.width().pow(2)]);
    let factors = factors.unwrap_or_else(|| none().collect());
    let joints = structures.iter().zip(&factors).zip(&plan);
    Ok(joints
        .map(|((of_joint, factor), joint)| of_joint.expand(factor, joint.n_effect_columns))
        .collect())
}

/// A way from the rows of a joint to their factor.
trait Folding<const DEPTH: usize> {
    /// Takes the rows that have come into the triangles.
    fn absorb<L: Lanes>(joint: &mut JointRows<L::Raw, DEPTH>);

    /// Factor of the triangles of eight lanes, row i of all side by side; nothing where it would not be good enough.
    fn factor<L: Lanes>(triangles: &mut Columns) -> Option<Vec<f64>>;
}

/// Rows of one joint, and what is left of those before them, samples in lanes.
struct JointRows<R, const DEPTH: usize> {
    width: usize,
    /// Upper triangles, row by row without what is below the diagonal.
    triangle: Vec<R>,
    /// Rows that come next, one column after the other.
    rows: Vec<[R; DEPTH]>,
}

impl<R: Copy, const DEPTH: usize> JointRows<R, DEPTH> {
    fn new<L: Lanes<Raw = R>>(width: usize) -> Self {
        Self {
            width,
            triangle: vec![L::ZERO; width * (width + 1) / 2],
            rows: vec![[L::ZERO; DEPTH]; width],
        }
    }

    /// Rows of the triangles that stand in these lanes, from lane `first` of eight on.
    #[inline(always)]
    fn put<L: Lanes<Raw = R>>(&self, first: usize, triangles: &mut Columns) {
        let mut entries = self.triangle.iter();
        for i in 0..self.width {
            for (c, entry) in (i..self.width).zip(entries.by_ref()) {
                L::from_raw(*entry).store(&mut triangles.column(c)[i][first..]);
            }
        }
    }
}

/// Some samples.
#[derive(Clone, Copy)]
struct Chunk<'a> {
    robot: &'a RobotModel,
    effects: &'a EffectColumns<'a>,
    plan: &'a [JointPlan],
    run: &'a RunStates<'a>,
    kept: &'a [usize],
}

/// Factors of them.
struct Factors<'a, F, const DEPTH: usize>(Chunk<'a>, PhantomData<F>);

impl<F: Folding<DEPTH>, const DEPTH: usize> Kernel for Factors<'_, F, DEPTH> {
    type Output = Result<Option<Vec<Vec<f64>>>, OfflineError>;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Self::Output {
        let widths = self.0.plan.iter().map(JointPlan::width);
        // Row i of all eight side by side: column k ends with row k.
        let empty = |width: usize| Columns::zeros(1..=width);
        let mut triangles: Vec<_> = widths.clone().map(empty).collect();
        // Eight triangles on every processor, so that the sums are the same: narrower rows go over the samples again.
        for first in (0..MOST_LANES).step_by(L::LEN) {
            let mut joints: Vec<_> = widths.clone().map(JointRows::new::<L>).collect();
            if !self.0.fold_lanes::<L, F, DEPTH>(first, &mut joints) {
                return Err(OfflineError::NonFinite { what: "run" });
            }
            for (joint, triangles) in joints.iter().zip(&mut triangles) {
                joint.put::<L>(first, triangles);
            }
        }
        let mut factors = Vec::with_capacity(triangles.len());
        for triangles in &mut triangles {
            match F::factor::<L>(triangles) {
                Some(factor) => factors.push(factor),
                None => return Ok(None),
            }
        }
        Ok(Some(factors))
    }
}

impl Chunk<'_> {
    /// Nothing where this way is not good enough.
    fn factors<F: Folding<DEPTH>, const DEPTH: usize>(
        self,
    ) -> Result<Option<Vec<Vec<f64>>>, OfflineError> {
        lanes::run(Factors::<F, DEPTH>(self, PhantomData))
    }

    /// Lanes `first..first + L::LEN` of all samples; whether all their numbers were finite.
    #[inline(always)]
    fn fold_lanes<L: Lanes, F: Folding<DEPTH>, const DEPTH: usize>(
        &self,
        first: usize,
        joints: &mut [JointRows<L::Raw, DEPTH>],
    ) -> bool {
        let n = self.robot.n_joints();
        let mut states = StateRows::<L>::new(n);
        let mut twists = vec![[[L::ZERO; 3]; 2]; n];
        let mut regressor = vec![L::ZERO; n * n * N_LINK_PARAMS];
        let state = &self.run.signals.state;
        let motion = [state.q, state.dq, state.ddq];
        let mut torques = vec![L::ZERO; n];
        // Zero times every torque: zero as long as all are finite.
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
                    take_numbers::<L>(self.run.tau, samples, n, &mut torques);
                }
                let joint_rows = regressor.chunks_exact(n * N_LINK_PARAMS);
                let of_joint = self.plan.iter().zip(&torques).zip(joint_rows);
                for (j, (joint, ((plan, torque), row))) in
                    joints.iter_mut().zip(of_joint).enumerate()
                {
                    let (effects, others) = joint.rows.split_at_mut(plan.n_effect_columns);
                    self.effects.put::<L, DEPTH>(j, samples, depth, effects);
                    for (column, &parameter) in others.iter_mut().zip(&plan.links) {
                        column[depth] = row[parameter];
                    }
                    others[plan.links.len()][depth] = *torque;
                    zeros = L::from_raw(*torque).mul_add(zero, zeros);
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
                F::absorb::<L>(joint);
            }
        }
        states.are_finite() && zeros.abs().all_less(L::splat(1.0))
    }
}
