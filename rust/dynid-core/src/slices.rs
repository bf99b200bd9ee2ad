//! Slices whose lengths were checked before, without the panic that the compiler cannot know to be impossible.

use core::slice::{ChunksExact, ChunksExactMut};

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
