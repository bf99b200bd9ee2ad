//! A list on the stack that is not filled before it is used: filling sixteen rows of eight with zeros takes as long as a
//! fifth of what is then done with them.
#![expect(
    unsafe_code,
    reason = "the compiler cannot know that the first places of an array are written and the others never read"
)]

use core::mem::MaybeUninit;

/// At most `N` things.
pub(crate) struct Few<T: Copy, const N: usize> {
    places: [MaybeUninit<T>; N],
    len: usize,
}

impl<T: Copy, const N: usize> Few<T, N> {
    /// None yet.
    #[inline(always)]
    pub(crate) fn new() -> Self {
        Self {
            places: [const { MaybeUninit::uninit() }; N],
            len: 0,
        }
    }

    /// One more; nothing happens where there is no room.
    #[inline(always)]
    pub(crate) fn push(&mut self, thing: T) {
        if let Some(place) = self.places.get_mut(self.len) {
            place.write(thing);
            self.len += 1;
        }
    }

    /// Those that there are.
    #[inline(always)]
    pub(crate) fn all(&mut self) -> &mut [T] {
        // SAFETY: `push` has written the first `len` places, which are at most `N`; a written place is a `T`.
        unsafe { core::slice::from_raw_parts_mut(self.places.as_mut_ptr().cast(), self.len) }
    }
}

#[cfg(test)]
mod tests {
    use super::Few;

    #[test]
    fn what_has_no_room_is_left_out() {
        let mut few = Few::<f64, 2>::new();
        assert!(few.all().is_empty());
        for x in [1.0, 2.0, 3.0] {
            few.push(x);
        }
        assert_eq!(few.all(), [1.0, 2.0]);
    }
}
