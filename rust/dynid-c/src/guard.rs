//! Where a call ends: as a code, never as a panic that unwinds into C.

use std::panic::{catch_unwind, AssertUnwindSafe};

use crate::failure::{remember, DynidCode, Failure};

/// Runs `work`. Its failure, or its panic, becomes a code and a sentence.
///
/// After a panic the estimator may hold half a step in its scratch; it holds that only until the next step writes all of
/// it, and what effects remember is taken over after a step is whole.
pub(crate) fn guarded(work: impl FnOnce() -> Result<(), Failure>) -> DynidCode {
    let failure = match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => return DynidCode::Ok,
        Ok(Err(failure)) => failure,
        Err(payload) => {
            // Dropping a payload may panic once more.
            core::mem::forget(payload);
            Failure::Panic
        }
    };
    remember(&failure);
    failure.code()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[expect(clippy::panic, reason = "what is tested")]
    fn a_panic_ends_as_a_code() {
        struct Bomb;
        impl Drop for Bomb {
            fn drop(&mut self) {
                std::panic::panic_any("again");
            }
        }
        assert_eq!(guarded(|| panic!("in a step")), DynidCode::Internal);
        let twice = guarded(|| std::panic::panic_any(Bomb));
        assert_eq!(twice, DynidCode::Internal);
        assert_eq!(guarded(|| Ok(())), DynidCode::Ok);
    }
}
