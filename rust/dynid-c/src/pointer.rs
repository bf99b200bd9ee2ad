//! Pointers from C become references and slices here, checked as far as a pointer can be.
//!
//! What cannot be checked is the caller's word: that a pointer which is neither null nor misaligned leads to as many
//! initialised values as it says, that nobody writes there meanwhile, and that a handle was not freed.

use crate::failure::Failure;

/// Null and alignment.
fn checked<T>(what: &'static str, pointer: *const T) -> Result<(), Failure> {
    if pointer.is_null() {
        Err(Failure::Null(what))
    } else if !pointer.is_aligned() {
        Err(Failure::Unaligned(what))
    } else {
        Ok(())
    }
}

/// The value behind `pointer`.
///
/// # Safety
/// Not null and aligned, it leads to a value that stays and that nobody changes for `'a`.
pub(crate) unsafe fn shared<'a, T>(
    what: &'static str,
    pointer: *const T,
) -> Result<&'a T, Failure> {
    checked(what, pointer)?;
    // SAFETY: not null, aligned, and by the caller's word a value.
    Ok(unsafe { &*pointer })
}

/// The value behind `pointer`, to change.
///
/// # Safety
/// Not null and aligned, it leads to a value that stays and that nobody else uses for `'a`.
pub(crate) unsafe fn exclusive<'a, T>(
    what: &'static str,
    pointer: *mut T,
) -> Result<&'a mut T, Failure> {
    checked(what, pointer)?;
    // SAFETY: not null, aligned, and by the caller's word a value that is nobody else's.
    Ok(unsafe { &mut *pointer })
}

/// The `n` values behind `pointer`.
///
/// # Safety
/// Not null and aligned, it leads to `n` values that stay and that nobody changes for `'a`.
pub(crate) unsafe fn values<'a, T>(
    what: &'static str,
    pointer: *const T,
    n: usize,
) -> Result<&'a [T], Failure> {
    checked(what, pointer)?;
    if n > isize::MAX as usize / size_of::<T>().max(1) {
        return Err(Failure::Length {
            what,
            expected: isize::MAX as usize / size_of::<T>().max(1),
            actual: n,
        });
    }
    // SAFETY: not null, aligned, no longer than memory, and by the caller's word `n` values.
    Ok(unsafe { core::slice::from_raw_parts(pointer, n) })
}

/// Copies `from` to `to`, which may overlap what the caller passed in.
///
/// # Safety
/// Not null and aligned, `to` leads to room for as many values as `from` has.
pub(crate) unsafe fn copy_out<T: Copy>(
    what: &'static str,
    from: &[T],
    to: *mut T,
) -> Result<(), Failure> {
    checked(what, to)?;
    // SAFETY: not null, aligned, and by the caller's word long enough; `copy` allows overlap.
    unsafe { core::ptr::copy(from.as_ptr(), to, from.len()) };
    Ok(())
}

/// Puts `value` on the heap and its address where the caller wants the handle.
///
/// # Safety
/// Not null and aligned, `out` leads to room for a pointer.
pub(crate) unsafe fn hand_out<T>(
    what: &'static str,
    value: T,
    out: *mut *mut T,
) -> Result<(), Failure> {
    checked(what, out.cast_const())?;
    // SAFETY: not null, aligned, and by the caller's word room for a pointer.
    unsafe { out.write(Box::into_raw(Box::new(value))) };
    Ok(())
}

/// Frees what [`hand_out`] handed out; null is nothing to free.
///
/// # Safety
/// `handle` is null or came from [`hand_out`], is not freed yet and not used any more.
pub(crate) unsafe fn take_back<T>(handle: *mut T) {
    if !handle.is_null() {
        // SAFETY: it came from `Box::into_raw`, and this is the only time that it goes back.
        drop(unsafe { Box::from_raw(handle) });
    }
}
