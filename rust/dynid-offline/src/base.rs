//! Base parameters by column-pivoted QR: which of the ten-per-link parameters the torque can tell apart (the minimal set
//! of Eq. 2).

use dynid_core::lanes::{self, Kernel, Lanes, MOST_LANES};
use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::{JointKind, RobotModel};

use crate::error::OfflineError;
use crate::probes::{Place, Probes};
use crate::triangle::{product, subtract, Columns};

/// `Y phi = Y[:, pivots] phi_base` with `phi_base = phi[pivots] + beta phi[dependent]`.
#[derive(Clone, Debug, PartialEq)]
pub struct BaseParameters {
    /// Indices into phi of the independent columns, ascending.
    pub pivots: Vec<usize>,
    /// Indices into phi of the other columns that move the torque, ascending.
    pub dependent: Vec<usize>,
    /// Regrouping, `pivots.len()` × `dependent.len()`, row-major.
    pub beta: Vec<f64>,
    /// `|r_kk| / |r_k+1,k+1|` across the cut: how clear the rank is. Infinite where nothing is left.
    pub gap: f64,
    /// `|r_00| / |r_kk|`: how well the weakest independent column is seen at the probing states.
    pub spread: f64,
}

/// Probing states per joint: enough for the rank of any chain to show.
const PROBES: usize = 60;

/// Columns whose lengths differ by less than this part are of the same length: the first of them is taken.
const TIE: f64 = 1e-9;

/// Finds the base parameters from the regressor at random probing states drawn from `seed`.
///
/// A column counts as dependent where its diagonal entry of R falls below `rtol` times the first one (relative, so units
/// and scale do not decide).
///
/// # Errors
/// [`OfflineError::NonFinite`] if the regressor overflows; not for a valid robot.
pub fn base_parameters(
    robot: &RobotModel,
    seed: u64,
    rtol: f64,
) -> Result<BaseParameters, OfflineError> {
    let width = N_LINK_PARAMS * robot.n_joints();
    let (q, dq, ddq) = probing_states(robot, PROBES, seed);
    let r = lanes::run_narrow(ProbesFactor {
        robot,
        motion: [&q, &dq, &ddq],
    });
    if !r.iter().all(|x| x.is_finite()) {
        return Err(OfflineError::NonFinite { what: "rows" });
    }
    Ok(select_columns(&r, width, rtol))
}

/// Triangular factor of the regressor at some states.
struct ProbesFactor<'a> {
    robot: &'a RobotModel,
    motion: [&'a [f64]; 3],
}

impl Kernel for ProbesFactor<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Vec<f64> {
        let n = self.robot.n_joints();
        let (width, eights) = (N_LINK_PARAMS * n, PROBES.div_ceil(MOST_LANES));
        // Joint after joint: the rows of those behind it know nothing of a link, so its columns end before them.
        let length = |link: usize| eights * (link / N_LINK_PARAMS + 1);
        let mut columns = [Columns::zeros((0..width).map(length))];
        let place = |j: usize| Place {
            matrix: 0,
            first: j * eights,
            links: (j * N_LINK_PARAMS..width).collect(),
            first_column: j * N_LINK_PARAMS,
        };
        let places: Vec<Place> = (0..n).map(place).collect();
        let probes = Probes {
            robot: self.robot,
            motion: self.motion,
            places: &places,
        };
        probes.fill::<L>(&mut columns);
        let [columns] = &mut columns;
        columns.factor::<L>()
    }
}

/// Random states, row-major: positions within pi (1 m for prismatic joints), speeds and accelerations of order one.
/// Which columns are independent is a property of the geometry, so position limits are not asked.
#[must_use]
pub fn probing_states(
    robot: &RobotModel,
    n_samples: usize,
    seed: u64,
) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let mut state = seed;
    let mut uniform = move || {
        // SplitMix64 (Steele, Lea and Flood 2014): a counter and a finaliser, the same on every machine.
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    let reach: Vec<f64> = robot
        .joints()
        .iter()
        .map(|joint| match joint.kind {
            JointKind::Revolute => std::f64::consts::PI,
            JointKind::Prismatic => 1.0,
        })
        .collect();
    let mut draw = |scale: &dyn Fn(usize) -> f64| -> Vec<f64> {
        (0..n_samples * reach.len())
            .map(|k| scale(k % reach.len()) * uniform())
            .collect()
    };
    (draw(&|j| reach[j]), draw(&|_| 2.0), draw(&|_| 5.0))
}

fn select_columns(r: &[f64], width: usize, rtol: f64) -> BaseParameters {
    let pivoted = pivoted(r, width, rtol);
    let diagonal = &pivoted.diagonal;
    let rank = pivoted.rank(rtol);
    let (first, others) = pivoted.order.split_at(rank);
    let mut pivots = first.to_vec();
    pivots.sort_unstable();
    // Columns of zeros never move the torque; they belong to no group.
    let norm = |j: usize| {
        (0..=j)
            .map(|i| r[i * width + j].powi(2))
            .sum::<f64>()
            .sqrt()
    };
    let mut dependent: Vec<usize> = others
        .iter()
        .copied()
        .filter(|&j| norm(j) > rtol * diagonal[0])
        .collect();
    dependent.sort_unstable();
    let beta = pivoted.regroup(&pivots, &dependent);
    let next = diagonal.get(rank).copied().unwrap_or(0.0);
    let last = rank.checked_sub(1).map_or(0.0, |k| diagonal[k]);
    BaseParameters {
        beta,
        gap: if next > 0.0 {
            last / next
        } else {
            f64::INFINITY
        },
        spread: if last > 0.0 {
            diagonal[0] / last
        } else {
            f64::INFINITY
        },
        pivots,
        dependent,
    }
}

/// Rank of a triangular factor (width × width, row-major): diagonal entries above `rtol` times the first.
pub(crate) fn rank(r: &[f64], width: usize, rtol: f64) -> usize {
    pivoted(r, width, rtol).rank(rtol)
}

/// Column-pivoted QR of a small matrix, up to the first column that counts as dependent.
struct Pivoted {
    /// Columns as they were taken, then the others.
    order: Vec<usize>,
    /// Diagonal of R, which falls; the last entry is that behind the cut, if columns are left there.
    diagonal: Vec<f64>,
    /// Row k of R, n entries in the order of the matrix's own columns.
    r: Vec<f64>,
}

/// By Gram and Schmidt.
///
/// The usual pivoted QR updates column norms instead of computing them; near the cut, where the rank is decided, they are
/// rounding then. Here every norm is computed; the matrix is small.
fn pivoted(r: &[f64], width: usize, rtol: f64) -> Pivoted {
    struct Pivoting(Columns, f64);
    impl Kernel for Pivoting {
        type Output = Pivoted;

        #[inline(always)]
        fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(mut self) -> Pivoted {
            pivot::<L>(&mut self.0, self.1)
        }
    }
    let mut columns = Columns::zeros((0..width).map(|_| width.div_ceil(MOST_LANES)));
    for (i, row) in r.chunks_exact(width.max(1)).enumerate() {
        for (j, x) in row.iter().enumerate().skip(i) {
            columns.column(j)[i / MOST_LANES][i % MOST_LANES] = *x;
        }
    }
    lanes::run_narrow(Pivoting(columns, rtol))
}

#[inline(always)]
fn pivot<L: Lanes>(columns: &mut Columns, rtol: f64) -> Pivoted {
    let n = columns.width();
    let mut order: Vec<usize> = (0..n).collect();
    let mut diagonal = Vec::with_capacity(n);
    let mut r = vec![0.0; n * n];
    let mut norms = vec![0.0; n];
    for (j, norm) in norms.iter_mut().enumerate() {
        let column = columns.column(j);
        *norm = product::<L>(column, column).sqrt();
    }
    let mut own = vec![[0.0; MOST_LANES]; n.div_ceil(MOST_LANES)];
    for k in 0..n {
        // Symmetric robots have columns of the same length; which is taken must not hang on how sums are rounded.
        let most = order[k..].iter().fold(0.0, |most, &j| norms[j].max(most));
        let mut best = k;
        for i in k + 1..n {
            let long = norms[order[i]] >= (1.0 - TIE) * most;
            let longer = norms[order[best]] < (1.0 - TIE) * most;
            if long && (longer || order[i] < order[best]) {
                best = i;
            }
        }
        order.swap(k, best);
        let taken = order[k];
        let norm = norms[taken];
        diagonal.push(norm);
        r[k * n + taken] = norm;
        // Nothing hangs on what is left of the others.
        if norm <= rtol * diagonal[0] {
            break;
        }
        own.copy_from_slice(columns.column(taken));
        for own in &mut own {
            for x in own.iter_mut() {
                *x /= norm;
            }
        }
        for &j in &order[k + 1..] {
            let column = columns.column(j);
            let part = product::<L>(&own, column);
            subtract::<L>(column, part, &own);
            r[k * n + j] = part;
            norms[j] = product::<L>(column, column).sqrt();
        }
    }
    Pivoted { order, diagonal, r }
}

impl Pivoted {
    fn rank(&self, rtol: f64) -> usize {
        let first = self.diagonal.first().copied().unwrap_or(0.0);
        let large = self.diagonal.iter().take_while(|d| **d > rtol * first);
        large.count()
    }

    /// `beta` (as many rows as `pivots`, row-major) with `A[:, dependent] = A[:, pivots] beta`; `pivots` are the columns
    /// that were taken first, in any order.
    fn regroup(&self, pivots: &[usize], dependent: &[usize]) -> Vec<f64> {
        let (n, rank, width) = (self.order.len(), pivots.len(), dependent.len());
        let mut beta = vec![0.0; rank * width];
        let place = |taken: usize| pivots.binary_search(&taken).unwrap_or(0);
        // Back substitution, from the column that was taken last.
        for k in (0..rank).rev() {
            let mut row: Vec<f64> = dependent.iter().map(|j| self.r[k * n + j]).collect();
            for &later in &self.order[k + 1..rank] {
                let (factor, start) = (self.r[k * n + later], place(later) * width);
                for (x, other) in row.iter_mut().zip(&beta[start..start + width]) {
                    *x -= factor * other;
                }
            }
            let start = place(self.order[k]) * width;
            for (to, x) in beta[start..start + width].iter_mut().zip(row) {
                *to = x / self.diagonal[k];
            }
        }
        beta
    }
}
