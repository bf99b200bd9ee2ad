//! Columns of one joint's rows, some samples at a time, samples in lanes.

use dynid_core::effects::{JointRow, MAX_COLUMNS};
use dynid_core::lanes::{Lanes, MOST_LANES};
use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::Effect;
use rayon::prelude::*;

use crate::columns::{columns, RunSignals};
use crate::rows::gather;

/// Columns of one joint's rows: those of the effects (they are eliminated first), then these of the links, then the
/// torque.
pub(crate) struct JointPlan {
    pub(crate) n_effect_columns: usize,
    /// Indices into phi: the base columns of links j and beyond.
    pub(crate) links: Vec<usize>,
}

impl JointPlan {
    pub(crate) fn new(j: usize, effects: &[Effect], pivots: &[usize]) -> Self {
        let moved = |parameter: &usize| *parameter >= j * N_LINK_PARAMS;
        Self {
            n_effect_columns: effects.iter().map(Effect::n_columns).sum(),
            links: pivots.iter().copied().filter(moved).collect(),
        }
    }

    pub(crate) fn width(&self) -> usize {
        self.n_effect_columns + self.links.len() + 1
    }
}

/// Effects along one run.
pub(crate) struct EffectColumns<'a> {
    effects: &'a [Effect],
    signals: &'a RunSignals<'a>,
    n_joints: usize,
    /// Columns of the effects that remember, which run once along the whole run; everything else is evaluated where it is
    /// needed.
    history: Vec<Option<Vec<f64>>>,
    /// Columns of the effects that are the same in every sample, joint by joint.
    constant: Vec<Option<Vec<f64>>>,
}

impl<'a> EffectColumns<'a> {
    pub(crate) fn new(effects: &'a [Effect], n_joints: usize, signals: &'a RunSignals<'a>) -> Self {
        let all: Vec<usize> = (0..n_joints).collect();
        let history = |effect: &Effect| {
            let remembers = effect.entry().memory > 0;
            remembers.then(|| columns(effect, n_joints, signals, &all))
        };
        Self {
            effects,
            signals,
            n_joints,
            history: effects.par_iter().map(history).collect(),
            constant: effects
                .iter()
                .map(|effect| constant(effect, n_joints, signals))
                .collect(),
        }
    }

    /// Columns of every effect on joint `j` at `samples`, to place `depth` of its rows.
    #[inline(always)]
    pub(crate) fn put<L: Lanes, const DEPTH: usize>(
        &self,
        j: usize,
        samples: &[usize],
        depth: usize,
        rows: &mut [[L::Raw; DEPTH]],
    ) {
        let n = self.n_joints;
        let state = &self.signals.state;
        let speeds = state.dq_motor;
        let mut input = JointRow {
            q: gather(state.q, samples, n, j),
            q_motor: gather(state.q_motor, samples, n, j),
            dq_motor: gather(speeds, samples, n, j),
            dq_partner: L::splat(0.0),
        };
        let known = self.history.iter().zip(&self.constant);
        let mut start = 0;
        for (effect, (history, constant)) in self.effects.iter().zip(known) {
            let width = effect.n_columns();
            let rows = &mut rows[start..start + width];
            start += width;
            if let Some(all) = constant {
                for (row, x) in rows.iter_mut().zip(&all[j * width..(j + 1) * width]) {
                    row[depth] = L::splat(*x).raw();
                }
                continue;
            }
            if let Some(partner) = effect.speed_partner(j) {
                input.dq_partner = gather(speeds, samples, n, partner);
            }
            if let Some(columns) = effect.row::<L>(j, &input) {
                for (row, column) in rows.iter_mut().zip(columns) {
                    row[depth] = column.raw();
                }
                continue;
            }
            let mut signs = [0.0; MOST_LANES];
            let mut sign = None;
            if history.is_none() {
                sign = effect.sign_row::<L>(j, input.dq_motor);
            }
            if let Some(sign) = sign {
                sign.store(&mut signs);
            }
            let mut numbers = [[0.0; MOST_LANES]; MAX_COLUMNS];
            for (lane, &k) in samples.iter().enumerate() {
                let mut own = [0.0; MAX_COLUMNS];
                match history {
                    Some(all) => {
                        let start = (k * n + j) * width;
                        own[..width].copy_from_slice(&all[start..start + width]);
                    }
                    None => {
                        let mut sample = self.signals.input(k, n);
                        if sign.is_some() {
                            sample.sign = Some(signs[lane]);
                        }
                        effect.columns_into(j, &sample, &mut [], &mut own[..width]);
                    }
                }
                for (row, x) in numbers[..width].iter_mut().zip(own) {
                    row[lane] = x;
                }
            }
            for (row, column) in rows.iter_mut().zip(&numbers) {
                row[depth] = L::load(column).raw();
            }
        }
    }
}

/// Columns of an effect that no signal moves, for every joint.
fn constant(effect: &Effect, n_joints: usize, signals: &RunSignals<'_>) -> Option<Vec<f64>> {
    if effect.kind() != "torque_offset" || signals.state.q.is_empty() {
        return None;
    }
    let mut columns = vec![0.0; n_joints * effect.n_columns()];
    for (j, own) in columns.chunks_exact_mut(effect.n_columns()).enumerate() {
        effect.columns_into(j, &signals.input(0, n_joints), &mut [], own);
    }
    Some(columns)
}
