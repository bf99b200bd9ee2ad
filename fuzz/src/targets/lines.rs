//! Standard input, CSV or JSON lines: answers of numbers up to the line that is none, and a sentence for that.

use crate::arm::arm;
use crate::limits::within_limits;
use dynid_estimator::fuzzing::{Door, LineFormat};
use std::cell::RefCell;

thread_local! {
    static DOOR: RefCell<Door> = RefCell::new(Door::new(arm()).expect("an observer fits"));
}

/// One input.
pub fn run(bytes: &[u8]) {
    DOOR.with_borrow_mut(|door| {
        within_limits(|| {
            let format = if bytes.len() % 2 == 0 {
                LineFormat::Csv
            } else {
                LineFormat::Jsonl
            };
            door.lines(bytes, format);
        });
    });
}
