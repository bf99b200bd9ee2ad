//! Datagrams one after the other: whatever they are, every answer is of numbers.
//!
//! Two bytes say how long the next one is; none of them is a cycle without any.

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
            let mut rest = bytes;
            while let Some((length, behind)) = rest.split_at_checked(2) {
                let length = usize::from(u16::from_le_bytes([length[0], length[1]]));
                let (datagram, behind) = behind.split_at(length.min(behind.len()));
                door.datagram((length > 0).then_some(datagram));
                rest = behind;
            }
        });
    });
}
