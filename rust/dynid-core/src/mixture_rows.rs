//! The mixture's formula (Eqs. 31-39) in rows: many queries of one mixture, or one query of many joints' mixtures.

use crate::lanes::{Few, Lanes, MOST_LANES};
use crate::mixture::Component;
use crate::powers::power_falling;
use crate::slices::{at, part, tail};

/// Components that are looked at together before their sums are merged.
const BLOCK: usize = 16;

/// Most inputs of a mixture: a query stands on the stack.
pub(crate) const MOST_INPUTS: usize = 32;

/// Squared distance where the true one overflows: finite, and the density nothing beside any other.
const FAR_AWAY: f64 = f64::MAX / 2.0;

/// Squared Mahalanobis distance of one binary digit of density, `d^2 / 2 = ln 2`: the unit of those below, so that densities
/// are powers of two.
const UNIT: f64 = 2.0 * core::f64::consts::LN_2;

/// The numbers of a mixture, component by component; of several mixtures side by side, one per lane.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MixtureRows {
    n_inputs: usize,
    n_components: usize,
    /// 1, or [`MOST_LANES`].
    n_lanes: usize,
    /// Per component: binary logarithm of the weight, output mean, variance, input means, then row by row of the whitener its
    /// entries up to the diagonal and the gain, in roots of [`UNIT`]. Each is `n_lanes` wide.
    numbers: Vec<f64>,
}

/// Answer to a row of queries: conditional mean, variance, squared distance to the nearest component.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PredictionRow<L> {
    pub mean: L,
    pub variance: L,
    pub distance_squared: L,
}

/// How a number of a component becomes a row.
pub(crate) trait Numbers: Copy {
    /// Mixtures side by side.
    const LANES: usize;

    /// Number `k`.
    fn get<L: Lanes>(self, component: &[f64], k: usize) -> L;
}

/// One mixture: the same number in every lane.
#[derive(Clone, Copy)]
pub(crate) struct Shared;

impl Numbers for Shared {
    const LANES: usize = 1;

    #[inline(always)]
    fn get<L: Lanes>(self, component: &[f64], k: usize) -> L {
        L::splat(at(component, k))
    }
}

/// Mixtures side by side, from this lane on.
#[derive(Clone, Copy)]
pub(crate) struct Own(pub usize);

impl Numbers for Own {
    const LANES: usize = MOST_LANES;

    #[inline(always)]
    fn get<L: Lanes>(self, component: &[f64], k: usize) -> L {
        L::load(tail(component, k * MOST_LANES + self.0))
    }
}

/// Root of [`UNIT`].
pub(crate) fn root_unit() -> f64 {
    UNIT.sqrt()
}

/// Numbers of a component with `d` inputs.
fn n_numbers(d: usize) -> usize {
    3 + d + d * (d + 1) / 2 + d
}

impl MixtureRows {
    /// One mixture.
    pub(crate) fn new(n_inputs: usize, components: &[Component]) -> Self {
        let mut rows = Self {
            n_inputs,
            n_components: components.len(),
            n_lanes: 1,
            numbers: Vec::new(),
        };
        for component in components {
            rows.numbers.extend(component.numbers(n_inputs, n_inputs));
        }
        rows
    }

    /// Mixtures of at most [`MOST_LANES`] joints side by side. Where a joint has fewer components or inputs than another
    /// there are components without weight and inputs without effect: they add exact zeros.
    pub(crate) fn side_by_side(joints: &[Option<(usize, &[Component])>]) -> Self {
        let known = joints.iter().flatten();
        // Joints without any mixture are asked on a pair like the others.
        let n_inputs = known.clone().map(|(d, _)| *d).max().unwrap_or(2);
        let n_components = known.map(|(_, c)| c.len()).max().unwrap_or(1);
        let width = n_numbers(n_inputs);
        let mut numbers = vec![0.0; n_components * width * MOST_LANES];
        for c in 0..n_components {
            for lane in 0..MOST_LANES {
                let joint = joints.get(lane).copied().flatten();
                let own = joint.and_then(|(d, components)| Some((d, components.get(c)?)));
                let mut absent = vec![0.0; width];
                // A lane without a mixture has one component of weight one, so that its sums are numbers.
                if joint.is_some() || c > 0 {
                    absent[0] = f64::NEG_INFINITY;
                }
                let column = own.map_or(absent, |(d, component)| component.numbers(d, n_inputs));
                for (k, x) in column.into_iter().enumerate() {
                    numbers[(c * width + k) * MOST_LANES + lane] = x;
                }
            }
        }
        Self {
            n_inputs,
            n_components,
            n_lanes: MOST_LANES,
            numbers,
        }
    }

    pub(crate) fn n_inputs(&self) -> usize {
        self.n_inputs
    }

    /// The numbers of component `c`.
    #[inline(always)]
    fn component(&self, c: usize) -> &[f64] {
        let width = n_numbers(self.n_inputs) * self.n_lanes;
        part(&self.numbers, c * width, (c + 1) * width)
    }

    /// Of a component: the binary logarithm of its density at `u` up to the common factor (which Eq. 32 prints for two
    /// dimensions), the squared Mahalanobis distance in [`UNIT`]s and the mean, Eq. 34, of its conditional density, Eq. 33.
    #[inline(always)]
    pub(crate) fn condition<L: Lanes, N: Numbers>(&self, c: usize, u: &[L], numbers: N) -> [L; 3] {
        let d = u.len();
        let width = n_numbers(d) * N::LANES;
        // With a length that the compiler knows nothing is checked below.
        let Some(component) = self.numbers.get(c * width..(c + 1) * width) else {
            return [L::splat(f64::NAN); 3];
        };
        let mut mean = numbers.get::<L>(component, 1);
        let mut distance_squared = L::splat(0.0);
        let mut k = 3 + d;
        for r in 0..d {
            let mut z = L::splat(0.0);
            for (i, u) in u.iter().take(r + 1).enumerate() {
                let away = *u - numbers.get(component, 3 + i);
                z = numbers.get::<L>(component, k).mul_add(away, z);
                k += 1;
            }
            distance_squared = z.mul_add(z, distance_squared);
            mean = numbers.get::<L>(component, k).mul_add(z, mean);
            k += 1;
        }
        // Written so that what is not a number counts as far away.
        let fall = L::splat(FAR_AWAY).at_most(distance_squared);
        [
            numbers.get::<L>(component, 0) - fall,
            distance_squared,
            mean,
        ]
    }

    /// Conditional mean (Eq. 38) and variance at `u` (one row per input): the moments of the density of Eq. 36.
    ///
    /// Responsibilities h_k (Eq. 37) are ratios of `2^(log density - maximum)`, so they sum to one at any distance from
    /// the data. Variances are summed about the mean, so that a large mean does not cancel them.
    #[inline(always)]
    pub(crate) fn predict<L: Lanes, N: Numbers>(&self, u: &[L], numbers: N) -> PredictionRow<L> {
        // The pairs of Section 5: with the number known, everything stays in registers.
        match <&[L; 2]>::try_from(u) {
            Ok(pair) => self.moments(pair, numbers),
            Err(_) => self.moments(u, numbers),
        }
    }

    #[inline(always)]
    fn moments<L: Lanes, N: Numbers>(&self, u: &[L], numbers: N) -> PredictionRow<L> {
        let zero = L::splat(0.0);
        let mut best = L::splat(f64::NEG_INFINITY);
        let mut nearest = L::splat(f64::INFINITY);
        let (mut total, mut mean, mut spread, mut variance) = (zero, zero, zero, zero);
        let mut from = 0;
        while from < self.n_components {
            let size = BLOCK.min(self.n_components - from);
            let mut block = Few::<[L; 2], BLOCK>::new();
            let mut top = best;
            for c in from..from + size {
                let [log_density, distance_squared, own] = self.condition(c, u, numbers);
                nearest = nearest.at_most(distance_squared);
                top = top.at_least(log_density);
                block.push([log_density, own]);
            }
            let (mut block_total, mut block_mean) = (zero, zero);
            for [log_density, own] in block.all() {
                let h = power_falling(*log_density - top);
                block_total = block_total + h;
                block_mean = h.mul_add(*own, block_mean);
                *log_density = h;
            }
            // A later block may be nothing beside an earlier one.
            let one_over = L::splat(1.0) / block_total.at_least(L::splat(f64::MIN_POSITIVE));
            block_mean = block_mean * one_over;
            let mut block_spread = zero;
            for (c, [h, own]) in block.all().iter().enumerate() {
                let variance = numbers.get::<L>(self.component(from + c), 2);
                let step = *own - block_mean;
                block_spread = h.mul_add(step.mul_add(step, variance), block_spread);
            }
            if from == 0 {
                (total, mean, spread) = (block_total, block_mean, block_spread);
                variance = spread * one_over;
            } else {
                let shrink = power_falling(best - top);
                let (before, step) = (total * shrink, block_mean - mean);
                total = before + block_total;
                let share = block_total / total;
                mean = step.mul_add(share, mean);
                spread = spread * shrink + block_spread + step * step * before * share;
                variance = spread / total;
            }
            best = top;
            from += size;
        }
        PredictionRow {
            mean,
            variance,
            distance_squared: nearest * L::splat(UNIT),
        }
    }
}
