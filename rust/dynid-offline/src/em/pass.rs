//! One pass over the data: log-likelihood, and the moments of every component's responsibilities.
#![allow(clippy::needless_range_loop)] // indices of a triangle, as in the formulas

use dynid_core::lanes::{run, Kernel, Lanes, MOST_LANES};
use dynid_core::powers::power_falling;
use rayon::prelude::*;

/// Samples whose responsibilities are in the cache together.
const BLOCK: usize = 128;
/// Blocks that one thread takes; their moments are one term of the sum over all.
const BLOCKS_PER_TASK: usize = 64;

/// A weighted Gaussian, ready for evaluation.
#[derive(Clone, Copy, Debug)]
pub struct Density<const D: usize> {
    /// log2(weight / |L| / (2 pi)^(D/2)), covariance = L Lᵀ.
    pub log_weight: f64,
    /// Mean.
    pub mean: [f64; D],
    /// Inverse of L, lower triangular, over the root of 2 ln 2: the density is `2^(log_weight - |whitener δ|²)`.
    pub whitener: [[f64; D]; D],
}

/// Sums over the samples, weighted by a component's responsibility h, with δ the sample minus the component's mean: no
/// large mean cancels a small variance.
#[derive(Clone, Copy, Debug)]
pub struct Moments<const D: usize> {
    /// Σ h.
    pub count: f64,
    /// Σ h δ.
    pub first: [f64; D],
    /// Σ h δ δᵀ, lower triangle.
    pub second: [[f64; D]; D],
}

impl<const D: usize> Moments<D> {
    const ZERO: Self = Self {
        count: 0.0,
        first: [0.0; D],
        second: [[0.0; D]; D],
    };

    fn add(&mut self, other: &Self) {
        self.count += other.count;
        for r in 0..D {
            self.first[r] += other.first[r];
            for c in 0..=r {
                self.second[r][c] += other.second[r][c];
            }
        }
    }
}

/// Log-likelihood of all samples `x` (n × D, row-major), and the moments of every component.
pub fn over<const D: usize>(x: &[f64], densities: &[Density<D>]) -> (f64, Vec<Moments<D>>) {
    over_with(x, densities, densities.len())
}

/// Log-likelihood of all samples `x` (n × D, row-major) alone.
pub fn log_likelihood<const D: usize>(x: &[f64], densities: &[Density<D>]) -> f64 {
    over_with(x, densities, 0).0
}

/// With the moments of the first `n_moments` components.
fn over_with<const D: usize>(
    x: &[f64],
    densities: &[Density<D>],
    n_moments: usize,
) -> (f64, Vec<Moments<D>>) {
    let zero = || (0.0, vec![Moments::ZERO; n_moments]);
    let tasks: Vec<_> = x
        .par_chunks(D * BLOCK * BLOCKS_PER_TASK)
        .map(|x| {
            let (mut log_likelihood, mut moments) = zero();
            run(Task {
                x,
                densities,
                log_likelihood: &mut log_likelihood,
                moments: &mut moments,
            });
            (log_likelihood, moments)
        })
        .collect();
    // In the order of the samples, whoever summed them.
    tasks
        .iter()
        .fold(zero(), |(sum, mut all), (log_likelihood, moments)| {
            for (all, own) in all.iter_mut().zip(moments) {
                all.add(own);
            }
            (sum + log_likelihood, all)
        })
}

/// One thread's part.
struct Task<'a, const D: usize> {
    x: &'a [f64],
    densities: &'a [Density<D>],
    log_likelihood: &'a mut f64,
    moments: &'a mut [Moments<D>],
}

impl<const D: usize> Kernel for Task<'_, D> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) {
        let mut share = vec![Row([0.0; BLOCK]); self.densities.len()];
        let mut sums = vec![Sums::<L, D>::zero(); self.moments.len()];
        let mut block = Block::<D>::EMPTY;
        for x in self.x.chunks(D * BLOCK) {
            block.fill(x);
            *self.log_likelihood += block.weigh::<L>(self.densities, &mut share);
            for (k, sums) in sums.iter_mut().enumerate() {
                block.sum_up(&self.densities[k].mean, &share[k], sums);
            }
        }
        for (sums, moments) in sums.iter().zip(self.moments) {
            *moments = sums.moments();
        }
    }
}

/// Moments of one component, of every lane by itself.
#[derive(Clone, Copy)]
struct Sums<L, const D: usize> {
    count: L,
    first: [L; D],
    second: [[L; D]; D],
}

impl<L: Lanes, const D: usize> Sums<L, D> {
    #[inline(always)]
    fn zero() -> Self {
        let zero = L::splat(0.0);
        Self {
            count: zero,
            first: [zero; D],
            second: [[zero; D]; D],
        }
    }

    #[inline(always)]
    fn moments(&self) -> Moments<D> {
        let mut moments = Moments::ZERO;
        moments.count = sum_of(self.count);
        for r in 0..D {
            moments.first[r] = sum_of(self.first[r]);
            for c in 0..=r {
                moments.second[r][c] = sum_of(self.second[r][c]);
            }
        }
        moments
    }
}

/// One number of every sample of a block, where registers like to load from.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Row([f64; BLOCK]);

/// Samples side by side.
struct Block<const D: usize> {
    x: [Row; D],
    /// 1 for a sample, 0 for what fills up the last block.
    counts: Row,
    /// The same over the total of all components: times a share it is a responsibility.
    per_total: Row,
}

impl<const D: usize> Block<D> {
    const EMPTY: Self = Self {
        x: [Row([0.0; BLOCK]); D],
        counts: Row([0.0; BLOCK]),
        per_total: Row([0.0; BLOCK]),
    };

    /// At most [`BLOCK`] samples, row by row, one at least; the last one fills up.
    #[inline(always)]
    fn fill(&mut self, samples: &[f64]) {
        let n = samples.len() / D;
        for (k, sample) in samples.chunks_exact(D).enumerate() {
            for d in 0..D {
                self.x[d].0[k] = sample[d];
            }
        }
        for row in &mut self.x {
            let last = row.0[n - 1];
            row.0[n..].fill(last);
        }
        self.counts.0[..n].fill(1.0);
        self.counts.0[n..].fill(0.0);
    }

    /// The samples at `at` less a mean.
    #[inline(always)]
    fn delta<L: Lanes>(&self, at: usize, mean: &[f64; D]) -> [L; D] {
        let mut delta = [L::splat(0.0); D];
        for d in 0..D {
            delta[d] = L::load(&self.x[d].0[at..]) - L::splat(mean[d]);
        }
        delta
    }

    /// Densities of every component, over the greatest, into `share`; the log-likelihood of the block.
    #[inline(always)]
    fn weigh<L: Lanes>(&mut self, densities: &[Density<D>], share: &mut [Row]) -> f64 {
        let mut greatest = Row([f64::MIN; BLOCK]);
        for (density, share) in densities.iter().zip(&mut *share) {
            for at in (0..BLOCK).step_by(L::LEN) {
                let delta = self.delta::<L>(at, &density.mean);
                let mut log_density = L::splat(density.log_weight);
                for r in 0..D {
                    let mut z = L::splat(0.0);
                    for c in 0..=r {
                        z = delta[c].mul_add(L::splat(density.whitener[r][c]), z);
                    }
                    log_density = z.mul_sub_from(z, log_density);
                }
                log_density.store(&mut share.0[at..]);
                let so_far = L::load(&greatest.0[at..]);
                log_density.at_least(so_far).store(&mut greatest.0[at..]);
            }
        }
        // One logarithm for the product of a lane's totals: each is between 1 and K, and there are few.
        let (one, mut product, mut sum) = (L::splat(1.0), L::splat(1.0), L::splat(0.0));
        for at in (0..BLOCK).step_by(L::LEN) {
            let (counts, greatest) = (L::load(&self.counts.0[at..]), L::load(&greatest.0[at..]));
            let mut total = L::splat(0.0);
            for share in &mut *share {
                let part = power_falling(L::load(&share.0[at..]) - greatest);
                part.store(&mut share.0[at..]);
                total = total + part;
            }
            product = product * (total - one).mul_add(counts, one);
            sum = greatest.mul_add(counts, sum);
            (counts / total).store(&mut self.per_total.0[at..]);
        }
        let mut totals = [1.0; MOST_LANES];
        product.store(&mut totals);
        totals.iter().map(|total| total.ln()).sum::<f64>() + std::f64::consts::LN_2 * sum_of(sum)
    }

    /// Adds to the sums of one component what [`Self::weigh`] has weighed.
    #[inline(always)]
    fn sum_up<L: Lanes>(&self, mean: &[f64; D], share: &Row, sums: &mut Sums<L, D>) {
        // A copy stays in registers.
        let mut own = *sums;
        for at in (0..BLOCK).step_by(L::LEN) {
            let share = L::load(&share.0[at..]) * L::load(&self.per_total.0[at..]);
            let delta = self.delta::<L>(at, mean);
            own.count = own.count + share;
            for r in 0..D {
                let weighted = share * delta[r];
                own.first[r] = own.first[r] + weighted;
                for c in 0..=r {
                    own.second[r][c] = weighted.mul_add(delta[c], own.second[r][c]);
                }
            }
        }
        *sums = own;
    }
}

#[inline(always)]
fn sum_of<L: Lanes>(row: L) -> f64 {
    let mut lanes = [0.0; MOST_LANES];
    row.store(&mut lanes);
    let [a, b, c, d, e, f, g, h] = lanes;
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}
