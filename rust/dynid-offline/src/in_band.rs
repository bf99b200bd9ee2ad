//! All columns of a run through the band's filter: built for a few samples at a time, and on their way forwards while they
//! are in the cache.
//!
//! No sum runs over samples but the filter's own, which goes on where it stopped: the same bits however a run is cut.

use std::ops::Range;

use dynid_core::chain;
use dynid_core::lanes::{self, Kernel, Lanes, MOST_LANES};
use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::RobotModel;
use rayon::prelude::*;

use crate::filter::{Direction, Memory, ZeroPhase};
use crate::joint_columns::{EffectColumns, JointPlan};
use crate::observation::{RunStates, Sampling};
use crate::rows::{gather, put, StateRows};

/// Columns that are filtered side by side.
pub(crate) const GROUP: usize = 32;
/// One sample of them.
pub(crate) type Sample = [f64; GROUP];

/// Samples that are built at a time, unless the filter's padding takes more.
const TILE: usize = 64;

/// Columns `[effects | links | torque]` of every joint, side by side, of one run.
pub(crate) struct Columns<'a> {
    pub(crate) robot: &'a RobotModel,
    pub(crate) effects: &'a EffectColumns<'a>,
    pub(crate) plan: &'a [JointPlan],
    pub(crate) run: &'a RunStates<'a>,
}

impl Columns<'_> {
    /// Their low-passed values at the samples that are kept, [`GROUP`] columns in each part.
    pub(crate) fn kept_in_band(&self, sampling: &Sampling) -> Vec<Vec<Sample>> {
        let width: usize = self.plan.iter().map(JointPlan::width).sum();
        let mut groups: Vec<Group> = Vec::new();
        groups.resize_with(width.div_ceil(GROUP), Group::default);
        let width = groups.len() * GROUP;
        let n_samples = self.run.tau.len() / self.plan.len();
        // A tile at either end has to hold what the filter mirrors there.
        let n_tiles = (n_samples / TILE.max(sampling.filter.min_samples())).max(1);
        let edge = |tile: usize| tile * n_samples / n_tiles;
        let at_a_time = rayon::current_num_threads();
        let mut raw = Vec::new();
        for first in (0..n_tiles).step_by(at_a_time) {
            let tiles = first..n_tiles.min(first + at_a_time);
            let (start, stop) = (edge(tiles.start), edge(tiles.end));
            raw.resize((stop - start) * width, 0.0);
            let mut left = raw.as_mut_slice();
            let mut parts = Vec::with_capacity(tiles.len());
            for tile in tiles {
                let samples = edge(tile)..edge(tile + 1);
                let (own, rest) = left.split_at_mut(samples.len() * width);
                parts.push((samples, own));
                left = rest;
            }
            parts.into_par_iter().for_each(|(samples, out)| {
                lanes::run(Fill {
                    columns: self,
                    samples,
                    width,
                    out,
                });
            });
            let ends = (start == 0, stop == n_samples);
            groups.par_iter_mut().enumerate().for_each(|(k, group)| {
                group.take(&sampling.filter, &raw, width, k * GROUP, ends, n_samples);
            });
        }
        groups
            .into_par_iter()
            .map(|group| group.kept(sampling))
            .collect()
    }
}

/// Some columns on their way through the filter.
#[derive(Default)]
struct Group {
    /// The filter's padding included.
    passed: Vec<Sample>,
    memory: Option<Memory<GROUP>>,
}

impl Group {
    /// The next samples of columns `from..from + GROUP` of `raw`; `ends`: whether they are the first, and the last, of
    /// `n_samples`.
    fn take(
        &mut self,
        filter: &ZeroPhase,
        raw: &[f64],
        width: usize,
        from: usize,
        ends: (bool, bool),
        n_samples: usize,
    ) {
        let new = self.passed.len();
        if ends.0 {
            let pad = filter.min_samples() - 1;
            self.passed.reserve_exact(n_samples + 2 * pad);
            self.passed.resize(pad, [0.0; GROUP]);
        }
        for row in raw.chunks_exact(width) {
            if let Ok(sample) = row[from..from + GROUP].try_into() {
                self.passed.push(sample);
            }
        }
        if ends.0 {
            filter.put_before(&mut self.passed);
        }
        if ends.1 {
            filter.put_behind(&mut self.passed);
        }
        let new = &mut self.passed[new..];
        let memory = self.memory.get_or_insert_with(|| filter.steady(&new[0]));
        filter.run(memory, new, Direction::Forwards);
    }

    /// All the way back.
    fn kept(mut self, sampling: &Sampling) -> Vec<Sample> {
        let filter = &sampling.filter;
        if let Some(last) = self.passed.last() {
            let mut memory = filter.steady(last);
            filter.run(&mut memory, &mut self.passed, Direction::Backwards);
        }
        let pad = filter.min_samples() - 1;
        sampling.kept.iter().map(|k| self.passed[pad + k]).collect()
    }
}

/// Some samples of all columns, row-major.
struct Fill<'a> {
    columns: &'a Columns<'a>,
    samples: Range<usize>,
    width: usize,
    out: &'a mut [f64],
}

impl Kernel for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
        let Columns {
            robot,
            effects,
            plan,
            run,
        } = self.columns;
        let n = robot.n_joints();
        let mut states = StateRows::<L>::new(n);
        let mut twists = vec![[[L::ZERO; 3]; 2]; n];
        let mut regressor = vec![L::ZERO; n * n * N_LINK_PARAMS];
        let mut columns = vec![[L::ZERO]; self.width];
        let state = &run.signals.state;
        let any_links = plan.iter().any(|joint| !joint.links.is_empty());
        for (k, out) in self.out.chunks_mut(L::LEN * self.width).enumerate() {
            // Where samples end, the last one fills up.
            let mut samples = [0; MOST_LANES];
            for (lane, sample) in samples.iter_mut().enumerate() {
                *sample = (self.samples.start + k * L::LEN + lane).min(self.samples.end - 1);
            }
            let samples = &samples[..L::LEN];
            if any_links {
                states.take_samples([state.q, state.dq, state.ddq], samples);
                chain::joint_torque_regressor::<L>(
                    robot,
                    states.rows(),
                    &mut twists,
                    &mut regressor,
                );
            }
            let mut start = 0;
            let joints = plan.iter().zip(regressor.chunks_exact(n * N_LINK_PARAMS));
            for (j, (joint, row)) in joints.enumerate() {
                let own = &mut columns[start..start + joint.width()];
                start += joint.width();
                let (own, others) = own.split_at_mut(joint.n_effect_columns);
                effects.put::<L, 1>(j, samples, 0, own);
                for (column, &parameter) in others.iter_mut().zip(&joint.links) {
                    column[0] = row[parameter];
                }
                others[joint.links.len()][0] = gather::<L>(run.tau, samples, n, j).raw();
            }
            put::<L>(columns.as_flattened(), out, self.width);
        }
    }
}
