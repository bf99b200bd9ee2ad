//! Slices whose lengths were checked before, without the panic that the compiler cannot know to be impossible: what is not
//! there would be a NaN, which no torque survives.

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

/// Whether every number is finite: what is not, times zero, is no number. Without a way out on the way, eight at a time.
#[must_use]
pub fn all_finite(x: &[f64]) -> bool {
    let (eights, rest) = x.as_chunks::<8>();
    let mut nothing = [0.0; 8];
    for eight in eights {
        for (sum, x) in nothing.iter_mut().zip(eight) {
            *sum += x * 0.0;
        }
    }
    nothing.iter().all(|sum| *sum == 0.0) && rest.iter().all(|x| x.is_finite())
}

/// Writes value `k`.
#[inline(always)]
pub fn set(x: &mut [f64], k: usize, value: f64) {
    if let Some(place) = x.get_mut(k) {
        *place = value;
    }
}

/// Copies as many values as both have.
pub fn copy<T: Copy>(from: &[T], to: &mut [T]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
}

/// [`copy`] of an array: where there is room for all of it, its few numbers are moved without a call.
#[inline(always)]
pub fn put<T: Copy, const N: usize>(from: &[T; N], to: &mut [T]) {
    match to.first_chunk_mut() {
        Some(to) => *to = *from,
        None => copy(from, to),
    }
}

/// What can become like another of its shape without taking memory, which `clone_from` does not promise.
pub(crate) trait Mirror {
    /// Becomes like `of`.
    fn mirror(&mut self, of: &Self);
}

impl<T: Copy> Mirror for Vec<T> {
    fn mirror(&mut self, of: &Self) {
        copy(of, self);
    }
}

impl<T: Mirror, const N: usize> Mirror for [T; N] {
    fn mirror(&mut self, of: &Self) {
        for (own, of) in self.iter_mut().zip(of) {
            own.mirror(of);
        }
    }
}

/// Every field that is named becomes like the other's; a field that is not named is an error, so none is forgotten.
macro_rules! mirror_fields {
    ($own:ident, $of:ident; $($mirrored:ident),*; copied $($copied:ident),*; kept $($kept:ident),*) => {
        let Self { $($mirrored,)* $($copied,)* $($kept: _,)* } = $of;
        $(crate::slices::Mirror::mirror(&mut $own.$mirrored, $mirrored);)*
        $($own.$copied = *$copied;)*
    };
}
pub(crate) use mirror_fields;

/// Rows of `n` values, as many as there are whole ones; `n` is never 0.
#[inline(always)]
pub fn rows(x: &[f64], n: usize) -> Rows<'_> {
    Rows {
        rest: x,
        n: n.max(1),
    }
}

/// Rows of `n` values, to be written; `n` is never 0.
#[inline(always)]
pub fn rows_mut(x: &mut [f64], n: usize) -> RowsMut<'_> {
    RowsMut {
        rest: x,
        n: n.max(1),
    }
}

/// [`rows`]: the library's chunks divide by their length, which may panic where the compiler has lost sight of it.
#[derive(Debug)]
pub struct Rows<'a> {
    rest: &'a [f64],
    n: usize,
}

impl<'a> Iterator for Rows<'a> {
    type Item = &'a [f64];

    #[inline(always)]
    fn next(&mut self) -> Option<Self::Item> {
        let (row, rest) = self.rest.split_at_checked(self.n)?;
        self.rest = rest;
        Some(row)
    }
}

/// [`rows_mut`].
#[derive(Debug)]
pub struct RowsMut<'a> {
    rest: &'a mut [f64],
    n: usize,
}

impl<'a> Iterator for RowsMut<'a> {
    type Item = &'a mut [f64];

    #[inline(always)]
    fn next(&mut self) -> Option<Self::Item> {
        let (row, rest) = core::mem::take(&mut self.rest).split_at_mut_checked(self.n)?;
        self.rest = rest;
        Some(row)
    }
}

#[cfg(test)]
mod tests {
    use super::all_finite;

    #[test]
    fn one_number_that_is_none_is_seen_wherever_it_stands() {
        for n in 0..40 {
            let mut x: Vec<f64> = (0..n).map(|k| 1e300 * (f64::from(k) - 7.0)).collect();
            assert!(all_finite(&x), "{n}");
            for k in 0..x.len() {
                for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                    let was = std::mem::replace(&mut x[k], wrong);
                    assert!(!all_finite(&x), "{n} {k}");
                    x[k] = was;
                }
            }
        }
    }
}
