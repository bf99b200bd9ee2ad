//! How well a motion excites a robot (Eqs. 13, 14), with the exact gradient.
//!
//! With the eigenpairs `(s_m², v_m)` of the Gram matrix `W'W` of the base columns, `d(s_m²) = 2 v_m' W' dW v_m`. A criterion
//! `f(s_1², ..., s_n²)` therefore has the gradient `C = 2 W V diag(df) V'` with respect to W, and the reverse sweep of
//! [`crate::adjoint`] takes it to q, dq and ddq.

mod gram;
mod spectrum;
mod tridiagonal;

use std::sync::Mutex;

use dynid_core::lanes::{self, Kernel, Lanes, MOST_LANES};
use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::RobotModel;

use crate::adjoint::{Sweep, SPLIT, SUMMED};
use crate::base::{probing_states, rank};
use crate::error::OfflineError;
use crate::factor::triangular_factor;
use crate::rows::{lane_samples, put, StateRows};
use crate::triangle::subtract;
use gram::LaneRows;
use spectrum::{Slope, Sum};

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
    /// Joints, from the first on, in whose rows a base column may stand.
    reach: Vec<usize>,
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
            reach: pivots
                .iter()
                .map(|pivot| match whitening {
                    Some(_) => n,
                    None => pivot / N_LINK_PARAMS + 1,
                })
                .collect(),
            whitening: whitening.map(<[f64]>::to_vec),
            ranks: [0; 4],
            summed: Mutex::default(),
            split: Mutex::default(),
        };
        let (q, dq, ddq) = probing_states(robot, PROBES, seed);
        let mut scratch = excitation.take(&excitation.split);
        excitation.fill(&mut scratch, [&q, &dq, &ddq]);
        for (found, rows) in excitation.ranks.iter_mut().zip(&scratch.rows) {
            let rows = rows.row_major(PROBES, n);
            *found = rank(&triangular_factor(&rows, pivots.len())?, pivots.len(), rtol);
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
        let n = self.robot.n_joints();
        let [_, parts @ ..] = &scratch.rows;
        let blocks = parts
            .each_ref()
            .map(|rows| rows.row_major(motion[0].len() / n, n));
        self.put_back(&self.split, scratch);
        Ok(blocks)
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
                let gram = scratch.rows[m].gram(&self.reach);
                *condition = spectrum::condition(&gram, self.n_base, self.ranks[m], false)?.0;
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
        let mut moving = Vec::new();
        for m in 0..n_matrices::<P>() {
            let share = match criterion {
                Criterion::Block(w) if m == 0 => w.iter().sum(),
                Criterion::Block(w) => w[m - 1],
                _ => 1.0,
            };
            // A block that this robot does not have (gravity in weightlessness) says nothing.
            if self.ranks[m] == 0 || share == 0.0 {
                continue;
            }
            let gram = scratch.rows[m].gram(&self.reach);
            let (part, slopes) = match criterion {
                Criterion::Block(_) | Criterion::Condition => {
                    spectrum::condition(&gram, self.n_base, self.ranks[m], gradient.is_some())?
                }
                Criterion::D => spectrum::sum(&gram, self.n_base, Sum::LogVolume)?,
                Criterion::A => spectrum::sum(&gram, self.n_base, Sum::TotalVariance)?,
            };
            value += share * part;
            moving.extend(slopes.into_iter().map(|slope| (m, share, slope)));
        }
        if let Some(gradient) = gradient {
            lanes::run(SweepBack {
                excitation: self,
                scratch: &scratch,
                moving: &moving,
                motion,
                gradient,
            });
        }
        self.put_back(pool, scratch);
        Ok(value)
    }

    /// Rows of W and, if split, of its blocks.
    fn fill<const P: usize>(&self, scratch: &mut Scratch<P>, motion: [&[f64]; 3]) {
        let n = self.robot.n_joints();
        for rows in &mut scratch.rows[..n_matrices::<P>()] {
            rows.reserve(n, self.n_base, motion[0].len() / n);
        }
        lanes::run(Fill {
            excitation: self,
            scratch,
            motion,
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
        idle.unwrap_or_default()
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
        let n_samples = self.motion[0].len() / n;
        let first = n_matrices::<P>() - P; // the first part; W itself if there is only one
        let mut sweep = Sweep::<L, P>::new(robot);
        let mut states = StateRows::<L>::new(n);
        let mut white = vec![L::ZERO; n * width];
        for k in 0..n_samples.div_ceil(L::LEN) {
            states.take(self.motion, k);
            sweep.forward(robot, states.rows());
            let there = n_samples - k * L::LEN;
            let (group, lane) = (k * L::LEN / MOST_LANES, k * L::LEN % MOST_LANES);
            for part in 0..P {
                let out = &mut self.scratch.rows[first + part];
                for (i, columns) in self.excitation.columns.iter().enumerate() {
                    for j in 0..=i {
                        let mut row = sweep.row(part, j, i);
                        if there < L::LEN {
                            let mut mask = [0.0; MOST_LANES];
                            mask[..there].fill(1.0);
                            for x in &mut row {
                                *x = *x * L::load(&mask);
                            }
                        }
                        // A link's columns are neighbours.
                        let Some(&(first, _)) = columns.first() else {
                            continue;
                        };
                        if self.excitation.whitening.is_some() {
                            let white = &mut white[j * width + first..];
                            for (to, &(_, parameter)) in white.iter_mut().zip(columns) {
                                *to = row[parameter].raw();
                            }
                        } else {
                            let of_link = out.columns_from(j, first).zip(columns);
                            for (to, &(_, parameter)) in of_link {
                                row[parameter].store(&mut to[group][lane..]);
                            }
                        }
                    }
                }
                if let Some(whitening) = &self.excitation.whitening {
                    for column in 0..width {
                        for (j, factors) in whitening.chunks_exact(n).enumerate() {
                            let mut sum = L::splat(0.0);
                            for (i, factor) in factors.iter().enumerate() {
                                let x = L::from_raw(white[i * width + column]);
                                sum = x.mul_add(L::splat(*factor), sum);
                            }
                            sum.store(&mut out.at(j, column, group)[lane..]);
                        }
                    }
                }
            }
            if P > 1 {
                let [total, parts @ ..] = &mut self.scratch.rows;
                for (column, reach) in self.excitation.reach.iter().enumerate() {
                    for j in 0..*reach {
                        let mut sum = L::splat(0.0);
                        for rows in &mut *parts {
                            sum = sum + L::load(&rows.at(j, column, group)[lane..]);
                        }
                        sum.store(&mut total.at(j, column, group)[lane..]);
                    }
                }
            }
        }
    }
}

/// From the slopes of the criterion in its eigenvalues to the gradient with respect to the motion, samples in lanes.
struct SweepBack<'a, const P: usize> {
    excitation: &'a Excitation,
    scratch: &'a Scratch<P>,
    /// Matrix, share in the criterion, slope of it.
    moving: &'a [(usize, f64, Slope)],
    motion: [&'a [f64]; 3],
    gradient: [&'a mut [f64]; 3],
}

impl<const P: usize> Kernel for SweepBack<'_, P> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
        let (excitation, robot) = (self.excitation, &self.excitation.robot);
        let n = robot.n_joints();
        let full = N_LINK_PARAMS * n;
        let n_samples = self.motion[0].len() / n;
        let mut sweep = Sweep::<L, P>::new(robot);
        let mut states = StateRows::<L>::new(n);
        let mut spread = vec![L::ZERO; P * n * full];
        let mut rows = [vec![L::ZERO; n], vec![L::ZERO; n], vec![L::ZERO; n]];
        let mut along = vec![L::ZERO; n];
        let n_groups = n_samples.div_ceil(MOST_LANES);
        // The gradient with respect to the rows is the sum of `2 share slope (W v) v'`: all `W v` first, so that rows are
        // read as they lie.
        let mut products = vec![[0.0; MOST_LANES]; self.moving.len() * n * n_groups];
        let of_slope = products.chunks_exact_mut(n * n_groups);
        for ((m, share, (slope, vector)), products) in self.moving.iter().zip(of_slope) {
            let own = &self.scratch.rows[*m];
            for (j, products) in products.chunks_exact_mut(n_groups).enumerate() {
                for (c, (x, reach)) in vector.iter().zip(&excitation.reach).enumerate() {
                    if j < *reach {
                        subtract::<L>(products, -2.0 * share * slope * x, own.column(j, c));
                    }
                }
            }
        }
        let [out_q, out_dq, out_ddq] = self.gradient;
        for k in 0..n_samples.div_ceil(L::LEN) {
            let samples = lane_samples::<L>(k, n_samples);
            states.take_samples(self.motion, &samples[..L::LEN]);
            let (group, lane) = (k * L::LEN / MOST_LANES, k * L::LEN % MOST_LANES);
            spread.fill(L::ZERO);
            let of_slope = products.chunks_exact(n * n_groups);
            for ((m, _, (_, vector)), products) in self.moving.iter().zip(of_slope) {
                let product = products.chunks_exact(n_groups);
                for (along, product) in along.iter_mut().zip(product.clone()) {
                    *along = L::load(&product[group][lane..]).raw();
                }
                if let Some(whitening) = &excitation.whitening {
                    for (j, along) in along.iter_mut().enumerate() {
                        let mut sum = L::splat(0.0);
                        for (i, product) in product.clone().enumerate() {
                            let factor = L::splat(whitening[i * n + j]);
                            sum = L::load(&product[group][lane..]).mul_add(factor, sum);
                        }
                        *along = sum.raw();
                    }
                }
                let (from, to) = if *m == 0 { (0, P) } else { (m - 1, *m) };
                for part in from..to {
                    for (i, columns) in excitation.columns.iter().enumerate() {
                        for (j, along) in along.iter().enumerate().take(i + 1) {
                            let start = (part * n + j) * full + i * N_LINK_PARAMS;
                            for &(column, parameter) in columns {
                                let to = &mut spread[start + parameter];
                                let factor = L::splat(vector[column]);
                                let sum = L::from_raw(*along).mul_add(factor, L::from_raw(*to));
                                *to = sum.raw();
                            }
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
#[derive(Debug, Default)]
struct Scratch<const P: usize> {
    /// W, Wa, Wb, Wg; W alone if the parts are summed.
    rows: [LaneRows; 4],
}

/// W alone, or W and its parts.
const fn n_matrices<const P: usize>() -> usize {
    if P == SUMMED {
        1
    } else {
        1 + P
    }
}
