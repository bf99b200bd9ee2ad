//! Base parameters by column-pivoted QR: which of the ten-per-link parameters the torque can tell apart (the minimal set
//! of Eq. 2).

use dynid_core::{JointKind, RobotModel};
use faer::linalg::solvers::SolveLstsqCore;
use faer::{Mat, MatRef};

use crate::error::OfflineError;
use crate::factor::triangular_factor;

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
/// [`OfflineError`] from the regressor or the factor; none for a valid robot.
pub fn base_parameters(
    robot: &RobotModel,
    seed: u64,
    rtol: f64,
) -> Result<BaseParameters, OfflineError> {
    let n = robot.n_joints();
    let width = 10 * n;
    let (q, dq, ddq) = probing_states(robot, PROBES, seed);
    let mut rows = vec![0.0; PROBES * n * width];
    crate::batch::joint_torque_regressor(robot, &q, &dq, &ddq, &mut rows)?;
    let r = triangular_factor(&rows, width)?;
    Ok(select_columns(&r, width, rtol))
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
    let a = Mat::from_fn(width, width, |i, j| r[i * width + j]);
    let (order, diagonal) = pivoted(&a);
    let rank = diagonal
        .iter()
        .take_while(|d| **d > rtol * diagonal[0])
        .count();
    let mut pivots = order[..rank].to_vec();
    pivots.sort_unstable();
    // Columns of zeros never move the torque; they belong to no group.
    let mut dependent: Vec<usize> = order[rank..]
        .iter()
        .copied()
        .filter(|&j| norm(&a, j) > rtol * diagonal[0])
        .collect();
    dependent.sort_unstable();
    let beta = regroup(&a, &pivots, &dependent);
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
    let (_, diagonal) = pivoted(&Mat::from_fn(width, width, |i, j| r[i * width + j]));
    let first = diagonal.first().copied().unwrap_or(0.0);
    diagonal.iter().take_while(|d| **d > rtol * first).count()
}

/// Column-pivoted QR by Gram and Schmidt: order of the columns and the diagonal of R, which falls.
///
/// The usual pivoted QR updates column norms instead of computing them; near the cut, where the rank is decided, they are
/// rounding then. Here every norm is computed; the matrix is small.
fn pivoted(a: &Mat<f64>) -> (Vec<usize>, Vec<f64>) {
    let (m, n) = (a.nrows(), a.ncols());
    let mut columns: Vec<Vec<f64>> = (0..n)
        .map(|j| (0..m).map(|i| a[(i, j)]).collect())
        .collect();
    let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    let mut order: Vec<usize> = (0..n).collect();
    let mut diagonal = Vec::with_capacity(n);
    for k in 0..n {
        let norms: Vec<f64> = order[k..]
            .iter()
            .map(|&j| dot(&columns[j], &columns[j]).sqrt())
            .collect();
        // Symmetric robots have columns of the same length; which is taken must not hang on how sums are rounded.
        let most = norms.iter().copied().fold(0.0, f64::max);
        let best = (0..norms.len())
            .filter(|&i| norms[i] >= (1.0 - TIE) * most)
            .min_by_key(|&i| order[k + i])
            .unwrap_or(0);
        order.swap(k, k + best);
        diagonal.push(norms[best]);
        if norms[best] == 0.0 {
            continue;
        }
        let unit: Vec<f64> = columns[order[k]].iter().map(|x| x / norms[best]).collect();
        for &j in &order[k + 1..] {
            let part = dot(&unit, &columns[j]);
            for (x, u) in columns[j].iter_mut().zip(&unit) {
                *x -= part * u;
            }
        }
    }
    (order, diagonal)
}

fn norm(a: &Mat<f64>, j: usize) -> f64 {
    (0..a.nrows())
        .map(|i| a[(i, j)] * a[(i, j)])
        .sum::<f64>()
        .sqrt()
}

/// `beta` with `A[:, dependent] = A[:, pivots] beta`.
fn regroup(a: &Mat<f64>, pivots: &[usize], dependent: &[usize]) -> Vec<f64> {
    if pivots.is_empty() || dependent.is_empty() {
        return Vec::new();
    }
    let independent = Mat::from_fn(a.nrows(), pivots.len(), |i, j| a[(i, pivots[j])]);
    let mut solution = Mat::from_fn(a.nrows(), dependent.len(), |i, j| a[(i, dependent[j])]);
    independent
        .as_ref()
        .qr()
        .solve_lstsq_in_place_with_conj(faer::Conj::No, solution.as_mut());
    let solution: MatRef<'_, f64> = solution.as_ref();
    (0..pivots.len())
        .flat_map(|i| (0..dependent.len()).map(move |j| (i, j)))
        .map(|at| solution[at])
        .collect()
}
