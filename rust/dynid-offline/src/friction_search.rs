//! Residual power of one joint's torque as a function of friction's shape: what the search of Eq. 12 asks for.
//!
//! The coefficients are linear inside (variable projection). Everything that does not depend on the shape is done once:
//! the links' columns are made orthonormal and taken out of the torque. The quadratic and cubic columns do not depend on
//! the width, so they are kept for as long as the threshold stays.

use dynid_core::effects::{PaperFriction, N_FRICTION};
use faer::Mat;

use crate::error::OfflineError;
use crate::filter::ZeroPhase;
use crate::speed_columns::speed_columns;

/// Columns that are filtered side by side: Coulomb and first viscous order, then second and third.
const HALF: usize = N_FRICTION / 2;

/// Columns shorter than this, over the longest, are rounding.
const NEGLIGIBLE: f64 = 1e-9;
/// A column of which less than this is left is a sum of earlier ones.
const DEPENDENT: f64 = 1e-13;

/// Speeds of one run, its filter, and the samples that become rows.
#[derive(Clone, Debug)]
pub struct SearchRun {
    /// Motor-side speed of the joint at every sample \[rad/s\].
    pub speeds: Vec<f64>,
    /// Low-pass of the run's rows.
    pub filter: ZeroPhase,
    /// Samples that become rows.
    pub kept: Vec<usize>,
    /// Half the difference of the rows at `kept` and at these samples becomes a row, where given: a pair of Eq. 8.
    pub mirrored: Option<Vec<usize>>,
}

/// Second and third viscous order at one threshold, filtered, links taken out.
#[derive(Clone, Debug)]
struct HighOrders {
    threshold: f64,
    all_links: bool,
    columns: Vec<Vec<f64>>,
}

/// What one call of [`FrictionSearch::power`] leaves for the next: buffers, and columns of the same threshold.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    high: Option<HighOrders>,
    half: Buffers<HALF>,
    whole: Buffers<N_FRICTION>,
}

/// Samples of N columns, and the filter's own copy of them.
#[derive(Clone, Debug)]
struct Buffers<const N: usize> {
    samples: Vec<[f64; N]>,
    work: Vec<[f64; N]>,
}

impl<const N: usize> Default for Buffers<N> {
    fn default() -> Self {
        Self {
            samples: Vec::new(),
            work: Vec::new(),
        }
    }
}

/// See the module.
#[derive(Clone, Debug)]
pub struct FrictionSearch {
    runs: Vec<SearchRun>,
    fixed: Vec<[f64; N_FRICTION]>,
    n_rows: usize,
    /// Orthonormal columns that span the links', row-major, strongest first; `strong` of them are taken out.
    links: Vec<f64>,
    n_links: usize,
    strong: usize,
    /// Torque without the links' strong directions, and without any.
    tau_left: [Vec<f64>; 2],
    n_orders: usize,
}

impl FrictionSearch {
    /// `links`: the links' columns, row-major, rows of all runs one after the other; `tau` the torque in the same rows.
    /// Directions weaker than `weak` times the strongest are taken out on request only. `n_orders` of the
    /// viscous torque are fitted, 0 to 3. `fixed` are rows of friction's columns that no shape in question changes (a
    /// factor of fast samples); their torque stands at the end of `tau`.
    ///
    /// # Errors
    /// [`OfflineError`] if lengths disagree, a sample is out of range, a run is shorter than its filter's padding, or the
    /// decomposition of the links' columns fails.
    pub fn new(
        runs: Vec<SearchRun>,
        links: &[f64],
        tau: Vec<f64>,
        weak: f64,
        n_orders: usize,
        fixed: Vec<[f64; N_FRICTION]>,
    ) -> Result<Self, OfflineError> {
        let n_rows = runs.iter().map(|run| run.kept.len()).sum::<usize>() + fixed.len();
        if tau.len() != n_rows {
            return Err(OfflineError::Shape { what: "tau" });
        }
        if n_orders > 3 {
            return Err(OfflineError::Shape {
                what: "viscous torque",
            });
        }
        for run in &runs {
            check(run)?;
        }
        let width = links.len().checked_div(n_rows).unwrap_or(0);
        if width * n_rows != links.len() {
            return Err(OfflineError::Shape { what: "links" });
        }
        if !links
            .iter()
            .chain(&tau)
            .chain(fixed.as_flattened())
            .all(|x| x.is_finite())
        {
            return Err(OfflineError::NonFinite { what: "rows" });
        }
        let (links, strengths) = orthonormal(links, n_rows, width)?;
        let strongest = strengths.first().copied().unwrap_or(0.0);
        let strong = strengths.iter().filter(|s| **s > weak * strongest).count();
        let mut search = Self {
            runs,
            fixed,
            n_rows,
            n_links: strengths.len(),
            links,
            strong,
            tau_left: [tau.clone(), tau],
            n_orders,
        };
        for (tau, all) in std::mem::take(&mut search.tau_left)
            .iter_mut()
            .zip([false, true])
        {
            let mut rows: Vec<[f64; 1]> = tau.iter().map(|&x| [x]).collect();
            search.take_out_links(&mut rows, all);
            search.tau_left[usize::from(all)] = rows.concat();
        }
        Ok(search)
    }

    /// Sum of squares of the torque that neither links nor friction of shape (lambda, eps) \[rad/s\] explain; with
    /// `all_links` their weak directions count too. `scratch` is of any earlier call of the same search, or new.
    pub fn power(&self, threshold: f64, width: f64, all_links: bool, scratch: &mut Scratch) -> f64 {
        let usable = |high: &HighOrders| high.threshold == threshold && high.all_links == all_links;
        let low: [Vec<f64>; HALF];
        if self.n_orders < 2 || scratch.high.as_ref().is_some_and(usable) {
            low = self.columns(all_links, &mut scratch.half, threshold, width);
        } else {
            let mut both = self
                .columns(all_links, &mut scratch.whole, threshold, width)
                .into_iter();
            low = std::array::from_fn(|_| both.next().unwrap_or_default());
            scratch.high = Some(HighOrders {
                threshold,
                all_links,
                columns: both.collect(),
            });
        }
        let high = match &scratch.high {
            Some(high) if self.n_orders > 1 => high.columns.as_slice(),
            _ => &[],
        };
        let used = 2 + 2 * self.n_orders;
        let mut columns: Vec<Vec<f64>> = low
            .into_iter()
            .chain(high.iter().cloned())
            .take(used)
            .collect();
        power_left(&mut columns, self.tau_left[usize::from(all_links)].clone())
    }

    /// Filtered rows of friction's first N columns of this shape, links taken out, one vector per column.
    fn columns<const N: usize>(
        &self,
        all_links: bool,
        buffers: &mut Buffers<N>,
        threshold: f64,
        width: f64,
    ) -> [Vec<f64>; N] {
        let mut rows = Vec::with_capacity(self.n_rows);
        let Buffers { samples, work } = buffers;
        for run in &self.runs {
            samples.clear();
            let basis = speed_columns::<PaperFriction, _>(&run.speeds, threshold, width);
            samples.extend(basis.iter().map(|row| std::array::from_fn(|k| row[k])));
            run.filter.apply(samples, work);
            match &run.mirrored {
                None => rows.extend(run.kept.iter().map(|&k| samples[k])),
                Some(mirrored) => rows.extend(run.kept.iter().zip(mirrored).map(|(&k, &m)| {
                    std::array::from_fn(|lane| (samples[k][lane] - samples[m][lane]) / 2.0)
                })),
            }
        }
        rows.extend(self.fixed.iter().map(|fixed| {
            let row: [f64; N] = std::array::from_fn(|lane| fixed[lane]);
            row
        }));
        self.take_out_links(&mut rows, all_links);
        std::array::from_fn(|lane| rows.iter().map(|row| row[lane]).collect())
    }

    /// Subtracts from every column (one per lane) its part along the links' directions, the strong ones or all.
    fn take_out_links<const N: usize>(&self, rows: &mut [[f64; N]], all: bool) {
        let n_out = if all { self.n_links } else { self.strong };
        if n_out == 0 {
            return;
        }
        let mut along = vec![[0.0; N]; n_out];
        for (links, row) in self.links.chunks_exact(self.n_links).zip(&*rows) {
            for (along, link) in along.iter_mut().zip(links) {
                for lane in 0..N {
                    along[lane] += link * row[lane];
                }
            }
        }
        for (links, row) in self.links.chunks_exact(self.n_links).zip(rows) {
            let mut part = [0.0; N];
            for (along, link) in along.iter().zip(links) {
                for lane in 0..N {
                    part[lane] += link * along[lane];
                }
            }
            for lane in 0..N {
                row[lane] -= part[lane];
            }
        }
    }
}

fn check(run: &SearchRun) -> Result<(), OfflineError> {
    let n = run.speeds.len();
    let needed = run.filter.min_samples();
    if n < needed {
        return Err(OfflineError::TooFewSamples { actual: n, needed });
    }
    let mirrored = run.mirrored.as_deref().unwrap_or(&run.kept);
    if mirrored.len() != run.kept.len() || run.kept.iter().chain(mirrored).any(|&k| k >= n) {
        return Err(OfflineError::Shape {
            what: "kept samples",
        });
    }
    Ok(())
}

/// Left singular vectors of the unit-norm columns (row-major, n_rows × rank) and the singular values, strongest first.
fn orthonormal(
    links: &[f64],
    n_rows: usize,
    width: usize,
) -> Result<(Vec<f64>, Vec<f64>), OfflineError> {
    let norms: Vec<f64> = (0..width)
        .map(|c| {
            (0..n_rows)
                .map(|i| links[i * width + c].powi(2))
                .sum::<f64>()
        })
        .map(f64::sqrt)
        .collect();
    let longest = norms.iter().copied().fold(0.0, f64::max);
    let used: Vec<usize> = (0..width)
        .filter(|&c| norms[c] > NEGLIGIBLE * longest)
        .collect();
    if used.is_empty() {
        return Ok((Vec::new(), Vec::new()));
    }
    let scaled = Mat::from_fn(n_rows, used.len(), |i, c| {
        links[i * width + used[c]] / norms[used[c]]
    });
    let svd = scaled
        .thin_svd()
        .map_err(|_| OfflineError::NonFinite { what: "links" })?;
    let (u, s) = (svd.U(), svd.S().column_vector());
    let rank = u.ncols();
    let vectors = (0..n_rows * rank)
        .map(|k| u[(k / rank, k % rank)])
        .collect();
    Ok((vectors, (0..rank).map(|k| s[k]).collect()))
}

/// Sum of squares of `tau` that the columns do not explain, by modified Gram-Schmidt.
fn power_left(columns: &mut [Vec<f64>], mut tau: Vec<f64>) -> f64 {
    let norms: Vec<f64> = columns.iter().map(|x| dot(x, x).sqrt()).collect();
    let longest = norms.iter().copied().fold(0.0, f64::max);
    for first in 0..columns.len() {
        let (done, rest) = columns.split_at_mut(first + 1);
        let column = &mut done[first];
        let norm = dot(column, column).sqrt();
        if norms[first] <= NEGLIGIBLE * longest || norm <= DEPENDENT * norms[first] {
            continue;
        }
        column.iter_mut().for_each(|x| *x /= norm);
        for other in rest.iter_mut().chain([&mut tau]) {
            let along = dot(column, other);
            for (x, y) in other.iter_mut().zip(&*column) {
                *x -= along * y;
            }
        }
    }
    dot(&tau, &tau)
}

/// Sum of products over eight chains, so that the processor need not wait for each addition.
fn dot(x: &[f64], y: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (x8, x_rest) = x.as_chunks::<8>();
    let (y8, y_rest) = y.as_chunks::<8>();
    for (x, y) in x8.iter().zip(y8) {
        for lane in 0..8 {
            sums[lane] += x[lane] * y[lane];
        }
    }
    let rest: f64 = x_rest.iter().zip(y_rest).map(|(x, y)| x * y).sum();
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::factor::triangular_factor;
    use dynid_core::effects::friction_columns;

    fn wave(n: usize, pace: f64) -> Vec<f64> {
        (0..n).map(|k| (k as f64 * pace).sin()).collect()
    }

    /// The same by the triangular factor of `[links | friction | torque]`, whose last diagonal entry is what is left.
    fn reference(run: &SearchRun, links: &[f64], tau: &[f64], shape: (f64, f64)) -> f64 {
        let width = links.len() / tau.len();
        let columns: Vec<_> = run
            .speeds
            .iter()
            .map(|&speed| friction_columns(speed, shape.0, shape.1))
            .collect();
        let mut rows = Vec::new();
        for (i, &k) in run.kept.iter().enumerate() {
            rows.extend_from_slice(&links[i * width..(i + 1) * width]);
            match &run.mirrored {
                None => rows.extend_from_slice(&columns[k]),
                // Both sides' columns are halves of one: one of each pair is enough.
                Some(m) => {
                    rows.extend((0..4).map(|c| (columns[k][2 * c] - columns[m[i]][2 * c]) / 2.0))
                }
            }
            rows.push(tau[i]);
        }
        let width = rows.len() / tau.len();
        let r = triangular_factor(&rows, width).unwrap();
        r[width * width - 1].powi(2)
    }

    #[test]
    fn power_is_that_of_the_triangular_factor() {
        let n = 400;
        let run = SearchRun {
            speeds: wave(n, 0.07),
            filter: ZeroPhase::default(),
            kept: (0..n).collect(),
            mirrored: None,
        };
        let links: Vec<f64> = wave(3 * n, 1.3).iter().map(|x| x * x * x).collect();
        let tau: Vec<f64> = wave(n, 0.11).iter().map(|x| x + x.signum()).collect();
        let search =
            FrictionSearch::new(vec![run.clone()], &links, tau.clone(), 0.0, 3, Vec::new())
                .unwrap();
        let mut scratch = Scratch::default();
        for shape in [(0.0, 0.01), (0.0, 0.1), (0.2, 0.1), (0.1, 0.3)] {
            let expected = reference(&run, &links, &tau, shape);
            let power = search.power(shape.0, shape.1, false, &mut scratch);
            assert!(
                (power - expected).abs() < 1e-10 * expected,
                "{power} {expected}"
            );
        }
    }

    #[test]
    fn a_pair_of_opposite_speeds_sees_friction_twice() {
        let n = 300;
        let mut speeds = wave(n, 0.05);
        speeds.extend(wave(n, 0.05).iter().map(|x| -x));
        let run = SearchRun {
            speeds,
            filter: ZeroPhase::default(),
            kept: (0..n).collect(),
            mirrored: Some((n..2 * n).collect()),
        };
        let tau = wave(n, 0.2);
        let search =
            FrictionSearch::new(vec![run.clone()], &[], tau.clone(), 0.0, 3, Vec::new()).unwrap();
        let expected = reference(&run, &[], &tau, (0.1, 0.05));
        let power = search.power(0.1, 0.05, false, &mut Scratch::default());
        assert!(
            (power - expected).abs() < 1e-9 * expected,
            "{power} {expected}"
        );
    }

    #[test]
    fn a_factor_of_fast_rows_stands_for_them() {
        let n = 300;
        let mut speeds = wave(n, 0.05);
        speeds.extend(wave(n, 0.05).iter().map(|x| 30.0 + x));
        let run = SearchRun {
            speeds,
            filter: ZeroPhase::default(),
            kept: (0..2 * n).collect(),
            mirrored: None,
        };
        let tau = wave(2 * n, 0.2);
        let all = FrictionSearch::new(vec![run.clone()], &[], tau.clone(), 0.0, 3, Vec::new());
        let expected = all
            .unwrap()
            .power(0.1, 0.05, false, &mut Scratch::default());
        let rows: Vec<f64> = (n..2 * n)
            .flat_map(|k| {
                let columns = friction_columns(run.speeds[k], 0.3, 0.2);
                columns.into_iter().chain([tau[k]])
            })
            .collect();
        let factor = triangular_factor(&rows, N_FRICTION + 1).unwrap();
        let (fixed, end): (Vec<[f64; N_FRICTION]>, Vec<f64>) = factor
            .chunks_exact(N_FRICTION + 1)
            .map(|row| (std::array::from_fn(|c| row[c]), row[N_FRICTION]))
            .unzip();
        let run = SearchRun {
            kept: (0..n).collect(),
            ..run
        };
        let tau = [&tau[..n], &end].concat();
        let search = FrictionSearch::new(vec![run], &[], tau, 0.0, 3, fixed).unwrap();
        let power = search.power(0.1, 0.05, false, &mut Scratch::default());
        assert!(
            (power - expected).abs() < 1e-9 * expected,
            "{power} {expected}"
        );
    }

    #[test]
    fn spoiled_input_is_an_error() {
        let run = SearchRun {
            speeds: wave(30, 0.1),
            filter: ZeroPhase::default(),
            kept: vec![3, 40],
            mirrored: None,
        };
        assert!(
            FrictionSearch::new(vec![run.clone()], &[], vec![0.0; 2], 0.0, 3, Vec::new()).is_err()
        );
        let run = SearchRun {
            kept: vec![3, 4],
            ..run
        };
        assert!(
            FrictionSearch::new(vec![run.clone()], &[], vec![0.0; 3], 0.0, 3, Vec::new()).is_err()
        );
        assert!(
            FrictionSearch::new(vec![run.clone()], &[], vec![0.0; 2], 0.0, 4, Vec::new()).is_err()
        );
        assert!(
            FrictionSearch::new(vec![run], &[0.0; 3], vec![0.0; 2], 0.0, 3, Vec::new()).is_err()
        );
    }
}
