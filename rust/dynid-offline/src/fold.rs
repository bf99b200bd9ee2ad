//! From the states of a run to one triangular factor per joint, without the rows in between.
//!
//! Columns are built for a few samples at a time, samples in lanes, and folded into the factors while they are in the
//! cache. Every lane keeps a factor of its own, so that no sum runs across lanes; the eight are merged at the end.

use dynid_core::chain;
use dynid_core::effects::MAX_COLUMNS;
use dynid_core::lanes::{self, Kernel, Lanes, MOST_LANES};
use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::{Effect, RobotModel};
use rayon::prelude::*;

use crate::error::OfflineError;
use crate::factor::{factor_once, tree, triangular_factor};
use crate::observation::{check, columns_of, history, observe, RunStates, Sampling, Wanted};
use crate::rows::{gather, StateRows};

/// Samples of one lane that are folded at a time: their column stays in registers while the others pass by.
const DEPTH: usize = 8;

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
    let every = Sampling::default();
    check(
        robot,
        effects,
        pivots,
        run,
        sampling.unwrap_or(&every),
        n_samples,
    )?;
    let plan: Vec<Vec<Wanted>> = (0..n).map(|j| columns_of(j, effects, pivots)).collect();
    let history = history(effects, n, &run.signals);
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
        lanes::run(Chunk {
            robot,
            effects,
            plan: &plan,
            history: &history,
            run,
            kept,
        })
    };
    // A wave of tasks at a time, each merged with what came before: memory stays that of one wave.
    let mut factors: Option<Vec<Vec<f64>>> = None;
    for first in (0..n_rows.div_ceil(CHUNK)).step_by(WAVE) {
        let last = n_rows.div_ceil(CHUNK).min(first + WAVE);
        let mut wave: Vec<Vec<Vec<f64>>> = factors.take().into_iter().collect();
        wave.par_extend((first..last).into_par_iter().map(folded));
        let of_joint = |j: usize| wave.iter().map(|chunk| chunk[j].clone()).collect();
        factors = Some((0..n).map(|j| tree(of_joint(j), plan[j].len())).collect());
    }
    let none = || plan.iter().map(|wanted| vec![0.0; wanted.len().pow(2)]);
    Ok(factors.unwrap_or_else(|| none().collect()))
}

/// Factors of some samples.
struct Chunk<'a> {
    robot: &'a RobotModel,
    effects: &'a [Effect],
    plan: &'a [Vec<Wanted>],
    history: &'a [Option<Vec<f64>>],
    run: &'a RunStates<'a>,
    kept: &'a [usize],
}

/// The rows of one joint and their factors, one per lane.
struct JointFold<R> {
    width: usize,
    /// Width × width, row-major.
    factor: Vec<R>,
    /// One column after the other.
    rows: Vec<[R; DEPTH]>,
}

impl Kernel for Chunk<'_> {
    type Output = Vec<Vec<f64>>;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Vec<Vec<f64>> {
        let widths = self.plan.iter().map(Vec::len);
        let mut stacked: Vec<Vec<f64>> = widths
            .clone()
            .map(|width| Vec::with_capacity(MOST_LANES * width * width))
            .collect();
        // Eight factors on every processor, so that the sums are the same: narrower rows go over the samples again.
        for first in (0..MOST_LANES).step_by(L::LEN) {
            let mut joints: Vec<JointFold<L::Raw>> = widths
                .clone()
                .map(|width| JointFold {
                    width,
                    factor: vec![L::ZERO; width * width],
                    rows: vec![[L::ZERO; DEPTH]; width],
                })
                .collect();
            self.fold_lanes::<L>(first, &mut joints);
            let mut numbers = [0.0; MOST_LANES];
            for (joint, stacked) in joints.iter().zip(&mut stacked) {
                for lane in 0..L::LEN {
                    for row in &joint.factor {
                        L::from_raw(*row).store(&mut numbers);
                        stacked.push(numbers[lane]);
                    }
                }
            }
        }
        widths
            .zip(stacked)
            .map(|(width, rows)| factor_once(&rows, width))
            .collect()
    }
}

impl Chunk<'_> {
    /// Lanes `first..first + L::LEN` of all samples.
    #[inline(always)]
    fn fold_lanes<L: Lanes>(&self, first: usize, joints: &mut [JointFold<L::Raw>]) {
        let n = self.robot.n_joints();
        let mut states = StateRows::<L>::new(n);
        let mut twists = vec![[[L::ZERO; 3]; 2]; n];
        let mut regressor = vec![L::ZERO; n * n * N_LINK_PARAMS];
        let mut columns = vec![[L::ZERO; MAX_COLUMNS]; self.effects.len()];
        let state = &self.run.signals.state;
        let motion = [state.q, state.dq, state.ddq];
        for group in self.kept.chunks(MOST_LANES * DEPTH) {
            for depth in 0..DEPTH {
                let from = (depth * MOST_LANES + first).min(group.len());
                let there = &group[from..group.len().min(from + L::LEN)];
                // Where samples end, rows of zeros change no factor; the numbers under them are any sample's.
                let mut samples = [group[0]; MOST_LANES];
                samples[..there.len()].copy_from_slice(there);
                let samples = &samples[..L::LEN];
                let mut mask = [0.0; MOST_LANES];
                mask[..there.len()].fill(1.0);
                let mask = L::load(&mask);
                if !there.is_empty() {
                    states.take_samples(motion, samples);
                    chain::joint_torque_regressor::<L>(
                        self.robot,
                        states.rows(),
                        &mut twists,
                        &mut regressor,
                    );
                }
                for (j, (joint, wanted)) in joints.iter_mut().zip(self.plan).enumerate() {
                    self.effect_columns::<L>(j, samples, &mut columns);
                    for (column, wanted) in joint.rows.iter_mut().zip(wanted) {
                        let row = match *wanted {
                            Wanted::Effect { term, column } => columns[term][column],
                            Wanted::Link { parameter } => {
                                regressor[j * n * N_LINK_PARAMS + parameter]
                            }
                            Wanted::Torque => gather::<L>(self.run.tau, samples, n, j).raw(),
                        };
                        column[depth] = if there.len() == L::LEN {
                            row
                        } else {
                            (L::from_raw(row) * mask).raw()
                        };
                    }
                }
            }
            for joint in joints.iter_mut() {
                absorb::<L>(joint);
            }
        }
    }

    /// Columns of every effect on joint `j`.
    #[inline(always)]
    fn effect_columns<L: Lanes>(
        &self,
        j: usize,
        samples: &[usize],
        columns: &mut [[L::Raw; MAX_COLUMNS]],
    ) {
        let n = self.robot.n_joints();
        let speeds = self.run.signals.state.dq_motor;
        for ((effect, history), columns) in self.effects.iter().zip(self.history).zip(columns) {
            if let Some(friction) = effect.friction_row::<L>(j, gather(speeds, samples, n, j)) {
                for (to, row) in columns.iter_mut().zip(friction) {
                    *to = row.raw();
                }
                continue;
            }
            let width = effect.n_columns();
            let mut numbers = [[0.0; MOST_LANES]; MAX_COLUMNS];
            for (lane, &k) in samples.iter().enumerate() {
                let mut own = [0.0; MAX_COLUMNS];
                match history {
                    Some(all) => {
                        let start = (k * n + j) * width;
                        own[..width].copy_from_slice(&all[start..start + width]);
                    }
                    None => {
                        let input = self.run.signals.input(k, n);
                        effect.columns_into(j, &input, &mut [], &mut own[..width]);
                    }
                }
                for (row, x) in numbers[..width].iter_mut().zip(own) {
                    row[lane] = x;
                }
            }
            for (to, row) in columns[..width].iter_mut().zip(&numbers) {
                *to = L::load(row).raw();
            }
        }
    }
}

/// Sums of squares up to here are nothing: where columns depend on each other, what is left of them falls with every
/// reflection and would end in numbers whose reciprocals are infinite.
const NOTHING: f64 = 1e-290;

/// Folds the rows of a joint into its factors: one Householder reflection per column, which mixes the factor's row with
/// [`DEPTH`] rows of the block. Diagonals stay non-negative.
#[inline(always)]
fn absorb<L: Lanes>(joint: &mut JointFold<L::Raw>) {
    let (zero, width) = (L::splat(0.0), joint.width);
    for k in 0..width {
        let (done, rest) = joint.rows.split_at_mut(k + 1);
        let factor = &mut joint.factor[k * width + k..(k + 1) * width];
        let mut x = [zero; DEPTH];
        let mut squares = zero;
        for (x, raw) in x.iter_mut().zip(&done[k]) {
            *x = L::from_raw(*raw);
            squares = x.mul_add(*x, squares);
        }
        let head = L::from_raw(factor[0]);
        let norm = head.mul_add(head, squares).sqrt();
        // head - norm, without cancellation; nothing is reflected where there is nothing to remove.
        let nothing = L::splat(NOTHING);
        let norm = nothing.if_less(squares, norm, head);
        let first = nothing.if_less(squares, -(squares / (head + norm)), zero);
        let scale = L::splat(2.0) / first.mul_add(first, squares);
        let scale = nothing.if_less(squares, scale, zero);
        factor[0] = norm.raw();
        for (to, column) in factor[1..].iter_mut().zip(rest) {
            let head = L::from_raw(*to);
            let (mut even, mut odd) = (first * head, zero);
            for i in 0..DEPTH / 2 {
                even = x[2 * i].mul_add(L::from_raw(column[2 * i]), even);
                odd = x[2 * i + 1].mul_add(L::from_raw(column[2 * i + 1]), odd);
            }
            let share = (even + odd) * scale;
            *to = share.mul_sub_from(first, head).raw();
            for (raw, x) in column.iter_mut().zip(&x) {
                *raw = x.mul_sub_from(share, L::from_raw(*raw)).raw();
            }
        }
    }
}
