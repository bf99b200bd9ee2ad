//! How well a motion excites a robot (Eqs. 13, 14), with the exact gradient.
//!
//! With the eigenpairs `(s_m², v_m)` of the Gram matrix `W'W` of the base columns, `d(s_m²) = 2 v_m' W' dW v_m`. A criterion
//! `f(s_1², ..., s_n²)` therefore has the gradient `C = 2 W V diag(df) V'` with respect to W, and the reverse sweep of
//! [`crate::adjoint`] takes it to q, dq and ddq.

mod spectrum;

use std::sync::Mutex;

use dynid_core::lanes::{self, Kernel, Lanes};
use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::RobotModel;
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};

use crate::adjoint::{Sweep, SPLIT, SUMMED};
use crate::base::{probing_states, rank};
use crate::error::OfflineError;
use crate::factor::triangular_factor;
use crate::rows::{gather, lane_samples, put, StateRows};
use spectrum::Spectrum;

/// What makes a motion good; every one is smaller for a better motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Criterion {
    /// Eq. 14: `(wa + wb + wg) cond(W) + wa cond(Wa) + wb cond(Wb) + wg cond(Wg)`, weights in that order.
    Block([f64; 3]),
    /// `cond(W)`, the blocks left alone.
    Condition,
    /// `-log det(W'W)`: the volume of the parameters' confidence ellipsoid.
    D,
    /// `trace((W'W)^-1)`: the sum of the parameters' variances.
    A,
}

/// Probing states that show the structural ranks, as many as the base parameters take.
const PROBES: usize = 60;

/// Criteria of one robot. Holds its scratch; shared freely between threads.
#[derive(Debug)]
pub struct Excitation {
    robot: RobotModel,
    n_base: usize,
    /// Per link: (base column, parameter of the link).
    columns: Vec<Vec<(usize, usize)>>,
    /// n × n, row-major; multiplies the rows of every sample.
    whitening: Option<Vec<f64>>,
    ranks: [usize; 4],
    summed: Mutex<Vec<Scratch<SUMMED>>>,
    split: Mutex<Vec<Scratch<SPLIT>>>,
}

impl Excitation {
    /// `pivots`: base columns, ascending. `whitening`: n × n matrix `Omega^(-1/2)` of Eq. 13, row-major.
    ///
    /// The structural rank of each block on these columns is found here, from the regressor at random probing states
    /// drawn from `seed`, relative to `rtol`.
    ///
    /// # Errors
    /// [`OfflineError`] if there is no column, an index is out of range or not ascending, or the whitening has the
    /// wrong size or a number that is not finite.
    pub fn new(
        robot: &RobotModel,
        pivots: &[usize],
        whitening: Option<&[f64]>,
        seed: u64,
        rtol: f64,
    ) -> Result<Self, OfflineError> {
        let n = robot.n_joints();
        let ascending = pivots.windows(2).all(|pair| pair[0] < pair[1]);
        let inside = pivots.last().is_some_and(|&k| k < N_LINK_PARAMS * n);
        if !(ascending && inside) {
            return Err(OfflineError::Shape { what: "pivots" });
        }
        if let Some(whitening) = whitening {
            if whitening.len() != n * n {
                return Err(OfflineError::Shape { what: "whitening" });
            }
            if !whitening.iter().all(|x| x.is_finite()) {
                return Err(OfflineError::NonFinite { what: "whitening" });
            }
        }
        let mut columns = vec![Vec::new(); n];
        for (column, &pivot) in pivots.iter().enumerate() {
            columns[pivot / N_LINK_PARAMS].push((column, pivot % N_LINK_PARAMS));
        }
        let mut excitation = Self {
            robot: robot.clone(),
            n_base: pivots.len(),
            columns,
            whitening: whitening.map(<[f64]>::to_vec),
            ranks: [0; 4],
            summed: Mutex::default(),
            split: Mutex::default(),
        };
        let (q, dq, ddq) = probing_states(robot, PROBES, seed);
        let mut scratch = excitation.take(&excitation.split);
        excitation.fill(&mut scratch, [&q, &dq, &ddq]);
        for (found, rows) in excitation.ranks.iter_mut().zip(&scratch.rows) {
            *found = rank(&triangular_factor(rows, pivots.len())?, pivots.len(), rtol);
        }
        Ok(excitation)
    }

    /// Structural ranks of W, Wa, Wb, Wg on the base columns.
    #[must_use]
    pub fn ranks(&self) -> [usize; 4] {
        self.ranks
    }

    /// Whitened base columns of the blocks, each (n_samples · n) × n_base, row-major, sample by sample: acceleration
    /// `Y(q, 0, ddq) - Y(q, 0, 0)`, velocity `Y(q, dq, 0) - Y(q, 0, 0)`, gravity `Y(q, 0, 0)`. They add up to W.
    ///
    /// # Errors
    /// [`OfflineError::Shape`] if lengths disagree.
    pub fn blocks(&self, motion: [&[f64]; 3]) -> Result<[Vec<f64>; 3], OfflineError> {
        self.check(motion)?;
        let mut scratch = self.take(&self.split);
        self.fill(&mut scratch, motion);
        let [_, acceleration, velocity, gravity] = std::mem::take(&mut scratch.rows);
        Ok([acceleration, velocity, gravity])
    }

    /// Condition numbers `s_1 / s_r` of W, Wa, Wb, Wg over their structural ranks r; NaN for a block of rank zero.
    ///
    /// # Errors
    /// [`OfflineError`] if lengths disagree or a number is not finite.
    pub fn conditions(&self, motion: [&[f64]; 3]) -> Result<[f64; 4], OfflineError> {
        self.check(motion)?;
        let mut scratch = self.take(&self.split);
        self.fill(&mut scratch, motion);
        let mut conditions = [f64::NAN; 4];
        for (m, condition) in conditions.iter_mut().enumerate() {
            if self.ranks[m] > 0 {
                let spectrum = Spectrum::new(&scratch.rows[m], self.n_base)?;
                *condition = spectrum.condition(self.ranks[m]).0;
            }
        }
        self.put_back(&self.split, scratch);
        Ok(conditions)
    }

    /// Value of a criterion for a motion (q, dq, ddq; row-major, n_samples × n), and its gradient if memory for it is
    /// given.
    ///
    /// # Errors
    /// [`OfflineError`] if lengths disagree or a number is not finite.
    pub fn evaluate(
        &self,
        criterion: Criterion,
        motion: [&[f64]; 3],
        gradient: Option<[&mut [f64]; 3]>,
    ) -> Result<f64, OfflineError> {
        self.check(motion)?;
        if let Some(gradient) = &gradient {
            if gradient.iter().any(|part| part.len() != motion[0].len()) {
                return Err(OfflineError::Shape { what: "gradient" });
            }
        }
        match criterion {
            Criterion::Block(_) => self.evaluate_with(&self.split, criterion, motion, gradient),
            _ => self.evaluate_with(&self.summed, criterion, motion, gradient),
        }
    }

    fn evaluate_with<const P: usize>(
        &self,
        pool: &Mutex<Vec<Scratch<P>>>,
        criterion: Criterion,
        motion: [&[f64]; 3],
        gradient: Option<[&mut [f64]; 3]>,
    ) -> Result<f64, OfflineError> {
        let mut scratch = self.take(pool);
        self.fill(&mut scratch, motion);
        let mut value = 0.0;
        scratch.weights[0].clear();
        for m in 0..scratch.n_matrices() {
            let share = match criterion {
                Criterion::Block(w) if m == 0 => w.iter().sum(),
                Criterion::Block(w) => w[m - 1],
                _ => 1.0,
            };
            // A block that this robot does not have (gravity in weightlessness) says nothing.
            if self.ranks[m] == 0 || share == 0.0 {
                continue;
            }
            let spectrum = Spectrum::new(&scratch.rows[m], self.n_base)?;
            let (part, slopes) = match criterion {
                Criterion::Block(_) | Criterion::Condition => spectrum.condition(self.ranks[m]),
                Criterion::D => spectrum.log_volume(),
                Criterion::A => spectrum.total_variance(),
            };
            value += share * part;
            if gradient.is_some() {
                scratch.push_back(m, share, &spectrum, &slopes, self.n_base);
            }
        }
        if let Some(gradient) = gradient {
            self.sweep_back(&mut scratch, motion, gradient);
        }
        self.put_back(pool, scratch);
        Ok(value)
    }

    /// Rows of W and, if split, of its blocks.
    fn fill<const P: usize>(&self, scratch: &mut Scratch<P>, motion: [&[f64]; 3]) {
        for rows in &mut scratch.rows {
            rows.clear();
            rows.resize(motion[0].len() * self.n_base, 0.0);
        }
        lanes::run(Fill {
            excitation: self,
            scratch,
            motion,
        });
    }

    /// From the gradient with respect to the rows to that with respect to the motion.
    fn sweep_back<const P: usize>(
        &self,
        scratch: &mut Scratch<P>,
        motion: [&[f64]; 3],
        gradient: [&mut [f64]; 3],
    ) {
        if scratch.weights[0].is_empty() {
            for out in gradient {
                out.fill(0.0);
            }
            return;
        }
        if let Some(whitening) = &self.whitening {
            let n = self.robot.n_joints();
            for weights in &mut scratch.weights {
                for rows in weights.chunks_exact_mut(n * self.n_base) {
                    transform(whitening, true, n, rows, &mut scratch.row);
                }
            }
        }
        lanes::run(SweepBack {
            excitation: self,
            weights: &scratch.weights,
            motion,
            gradient,
        });
    }

    fn check(&self, motion: [&[f64]; 3]) -> Result<(), OfflineError> {
        let length = motion[0].len();
        let whole = length > 0 && length.is_multiple_of(self.robot.n_joints());
        if !whole || motion.iter().any(|signal| signal.len() != length) {
            return Err(OfflineError::Shape { what: "motion" });
        }
        Ok(())
    }

    fn take<const P: usize>(&self, pool: &Mutex<Vec<Scratch<P>>>) -> Scratch<P> {
        let idle = pool.lock().ok().and_then(|mut pool| pool.pop());
        idle.unwrap_or_else(Scratch::new)
    }

    fn put_back<const P: usize>(&self, pool: &Mutex<Vec<Scratch<P>>>, scratch: Scratch<P>) {
        if let Ok(mut pool) = pool.lock() {
            pool.push(scratch);
        }
    }
}

/// [`Excitation::fill`], samples in lanes.
struct Fill<'a, const P: usize> {
    excitation: &'a Excitation,
    scratch: &'a mut Scratch<P>,
    motion: [&'a [f64]; 3],
}

impl<const P: usize> Kernel for Fill<'_, P> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
        let (robot, width) = (&self.excitation.robot, self.excitation.n_base);
        let n = robot.n_joints();
        let first = self.scratch.n_matrices() - P; // the first part; W itself if there is only one
        let mut sweep = Sweep::<L, P>::new(robot);
        let mut states = StateRows::<L>::new(n);
        let mut rows = vec![L::ZERO; n * width];
        let group = L::LEN * n * width;
        for k in 0..(self.motion[0].len() / n).div_ceil(L::LEN) {
            states.take(self.motion, k);
            sweep.forward(robot, states.rows());
            let start = k * group;
            let end = self.scratch.rows[0].len().min(start + group);
            for part in 0..P {
                for (i, columns) in self.excitation.columns.iter().enumerate() {
                    for j in 0..=i {
                        let row = sweep.row(part, j, i);
                        for &(column, parameter) in columns {
                            rows[j * width + column] = row[parameter].raw();
                        }
                    }
                }
                let out = &mut self.scratch.rows[first + part][start..end];
                put::<L>(&rows, out, n * width);
                if let Some(whitening) = &self.excitation.whitening {
                    for sample in out.chunks_exact_mut(n * width) {
                        transform(whitening, false, n, sample, &mut self.scratch.row);
                    }
                }
            }
            if P > 1 {
                let [total, parts @ ..] = &mut self.scratch.rows;
                for index in start..end {
                    total[index] = parts[0][index] + parts[1][index] + parts[2][index];
                }
            }
        }
    }
}

/// [`Excitation::sweep_back`], samples in lanes.
struct SweepBack<'a, const P: usize> {
    excitation: &'a Excitation,
    weights: &'a [Vec<f64>; P],
    motion: [&'a [f64]; 3],
    gradient: [&'a mut [f64]; 3],
}

impl<const P: usize> Kernel for SweepBack<'_, P> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
        let (robot, width) = (&self.excitation.robot, self.excitation.n_base);
        let n = robot.n_joints();
        let full = N_LINK_PARAMS * n;
        let n_samples = self.motion[0].len() / n;
        let mut sweep = Sweep::<L, P>::new(robot);
        let mut states = StateRows::<L>::new(n);
        let mut spread = vec![L::ZERO; P * n * full];
        let mut rows = [vec![L::ZERO; n], vec![L::ZERO; n], vec![L::ZERO; n]];
        let [out_q, out_dq, out_ddq] = self.gradient;
        for k in 0..n_samples.div_ceil(L::LEN) {
            let samples = lane_samples::<L>(k, n_samples);
            let samples = &samples[..L::LEN];
            states.take_samples(self.motion, samples);
            for (part, weights) in self.weights.iter().enumerate() {
                for (i, columns) in self.excitation.columns.iter().enumerate() {
                    for j in 0..=i {
                        for &(column, parameter) in columns {
                            let to = (part * n + j) * full + i * N_LINK_PARAMS + parameter;
                            let from = j * width + column;
                            spread[to] = gather::<L>(weights, samples, n * width, from).raw();
                        }
                    }
                }
            }
            sweep.forward(robot, states.rows());
            let [q, dq, ddq] = &mut rows;
            sweep.reverse(robot, &spread, [q, dq, ddq]);
            let start = k * L::LEN * n;
            put::<L>(&rows[0], &mut out_q[start..], n);
            put::<L>(&rows[1], &mut out_dq[start..], n);
            put::<L>(&rows[2], &mut out_ddq[start..], n);
        }
    }
}

/// Memory of one evaluation, kept for the next.
#[derive(Debug)]
struct Scratch<const P: usize> {
    /// Rows of W, Wa, Wb, Wg; of W alone if the parts are summed.
    rows: [Vec<f64>; 4],
    /// Gradient with respect to the rows of each part.
    weights: [Vec<f64>; P],
    projected: Vec<f64>,
    row: Vec<f64>,
}

impl<const P: usize> Scratch<P> {
    fn new() -> Self {
        Self {
            rows: Default::default(),
            weights: std::array::from_fn(|_| Vec::new()),
            projected: Vec::new(),
            row: Vec::new(),
        }
    }

    /// W alone, or W and its parts.
    fn n_matrices(&self) -> usize {
        if P == SUMMED {
            1
        } else {
            1 + P
        }
    }

    /// Adds `share * 2 W V diag(slopes) V'` of matrix `m` to the gradients of the parts it consists of.
    fn push_back(
        &mut self,
        m: usize,
        share: f64,
        spectrum: &Spectrum,
        slopes: &[(usize, f64)],
        width: usize,
    ) {
        let n_rows = self.rows[m].len() / width;
        let vectors = Mat::from_fn(width, slopes.len(), |i, k| {
            spectrum.vectors[(i, slopes[k].0)]
        });
        let back = Mat::from_fn(slopes.len(), width, |k, j| {
            2.0 * share * slopes[k].1 * vectors[(j, k)]
        });
        self.projected.resize(n_rows * slopes.len(), 0.0);
        let rows = MatRef::from_row_major_slice(&self.rows[m], n_rows, width);
        let mut projected =
            MatMut::from_row_major_slice_mut(&mut self.projected, n_rows, slopes.len());
        matmul(
            &mut projected,
            Accum::Replace,
            rows,
            &vectors,
            1.0,
            Par::Seq,
        );
        let started = !self.weights[0].is_empty();
        let parts = if m == 0 { 0..P } else { m - 1..m };
        for part in 0..P {
            let weights = &mut self.weights[part];
            if !started {
                weights.clear();
                weights.resize(n_rows * width, 0.0);
            }
            if parts.contains(&part) {
                let weights = MatMut::from_row_major_slice_mut(weights, n_rows, width);
                matmul(weights, Accum::Add, &projected, &back, 1.0, Par::Seq);
            }
        }
    }
}

/// `rows <- T rows` or `T' rows` for one sample (n × width, row-major).
fn transform(t: &[f64], transposed: bool, n: usize, rows: &mut [f64], copy: &mut Vec<f64>) {
    let width = rows.len() / n;
    copy.clear();
    copy.extend_from_slice(rows);
    rows.fill(0.0);
    for (i, row) in rows.chunks_exact_mut(width).enumerate() {
        for (j, old) in copy.chunks_exact(width).enumerate() {
            let factor = if transposed {
                t[j * n + i]
            } else {
                t[i * n + j]
            };
            for (x, old) in row.iter_mut().zip(old) {
                *x += factor * old;
            }
        }
    }
}
