//! Shared memory that anything may be written into, word by word, while it is read.
//!
//! Every 256 bytes are what the slot holds at the next cycle.

use crate::arm::arm;
use crate::limits::within_limits;
use dynid_estimator::fuzzing::Door;
use std::cell::RefCell;

thread_local! {
    static DOOR: RefCell<Door> = RefCell::new(Door::new(arm()).expect("an observer fits"));
}

/// One input.
pub fn run(bytes: &[u8]) {
    DOOR.with_borrow_mut(|door| {
        within_limits(|| {
            door.reset();
            for cycle in bytes.chunks(256) {
                let (words, _) = cycle.as_chunks::<8>();
                door.memory(words.iter().map(|word| u64::from_le_bytes(*word)));
            }
        });
    });
}
