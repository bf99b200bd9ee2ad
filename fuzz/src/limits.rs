//! Limits of memory and time, and what a sentence has to be.

use std::alloc::System;
use std::fmt::Display;
use std::time::Duration;

use cap::Cap;
use cpu_time::ThreadTime;

/// Most memory that an input may take \[bytes\]: beyond it an allocation fails, which ends the program.
const MOST_MEMORY: usize = 512 << 20;
/// Longest that an input may take, in time of the processor.
const LONGEST: Duration = Duration::from_secs(1);

#[global_allocator]
static ALLOCATOR: Cap<System> = Cap::new(System, MOST_MEMORY);

/// Runs `work` on one input.
///
/// # Panics
/// If it takes too long.
pub fn within_limits(work: impl FnOnce()) {
    let start = ThreadTime::now();
    work();
    let taken = start.elapsed();
    assert!(taken < LONGEST, "{taken:?} of processor time for one input");
}

/// A refusal is one line that a terminal shows whole.
///
/// # Panics
/// If it is not.
pub fn check_sentence(error: &impl Display) {
    let sentence = error.to_string();
    assert!(
        !sentence.is_empty() && sentence.len() < 4096,
        "{} bytes: {sentence}",
        sentence.len()
    );
    let odd = sentence.chars().find(|c| c.is_control());
    assert!(odd.is_none(), "{odd:?} in {sentence:?}");
}
