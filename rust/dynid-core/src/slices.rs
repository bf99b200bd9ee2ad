//! Slices whose lengths were checked before, without the panic that the compiler cannot know to be impossible: what is not
//! there would be a NaN, which no torque survives.

use core::slice::{ChunksExact, ChunksExactMut};

/// Value `k`.
#[inline(always)]
pub fn at(x: &[f64], k: usize) -> f64 {
    x.get(k).copied().unwrap_or(f64::NAN)
}

/// The first `N` values.
#[inline(always)]
pub fn first<const N: usize>(x: &[f64]) -> [f64; N] {
    x.first_chunk().copied().unwrap_or([f64::NAN; N])
}

/// What is there of values `start` to `end`.
#[inline(always)]
pub fn part(x: &[f64], start: usize, end: usize) -> &[f64] {
    x.get(start..end).unwrap_or_default()
}

/// [`part`], to be written.
#[inline(always)]
pub fn part_mut(x: &mut [f64], start: usize, end: usize) -> &mut [f64] {
    x.get_mut(start..end).unwrap_or_default()
}

/// Values from `start` on.
#[inline(always)]
pub fn tail(x: &[f64], start: usize) -> &[f64] {
    x.get(start..).unwrap_or_default()
}

/// Copies as many values as both have.
pub fn copy(from: &[f64], to: &mut [f64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
}

/// Rows of `n` values; `n` is never 0.
pub fn rows(x: &[f64], n: usize) -> ChunksExact<'_, f64> {
    x.chunks_exact(n.max(1))
}

/// Rows of `n` values, to be written; `n` is never 0.
pub fn rows_mut(x: &mut [f64], n: usize) -> ChunksExactMut<'_, f64> {
    x.chunks_exact_mut(n.max(1))
}
