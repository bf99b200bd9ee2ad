//! Other systems: a clock, a sleep, and refusals.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::sync::atomic::AtomicU64;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use super::PageFaults;

fn only_on_linux() -> io::Error {
    io::Error::new(io::ErrorKind::Unsupported, "only on Linux")
}

pub fn catch_signals(_reloads: bool) -> io::Result<()> {
    Ok(())
}

pub fn reload_asked() -> bool {
    false
}

/// The end of a duration is seen when the next bytes come.
pub fn stdin(_end: u64) -> io::Result<impl Read> {
    Ok(io::stdin())
}

pub fn stdout_is_closed() -> bool {
    false
}

pub fn stop_asked() -> bool {
    false
}

pub fn now() -> u64 {
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_nanos() as u64
}

/// The clock: what interrupts counts too.
pub fn thread_time() -> u64 {
    now()
}

pub fn sleep_until(deadline: u64) {
    std::thread::sleep(Duration::from_nanos(deadline.saturating_sub(now())));
}

pub fn sleep_sharply() {}

pub fn lock_memory() -> io::Result<()> {
    Err(only_on_linux())
}

pub fn most_locked() -> Option<u64> {
    None
}

pub fn schedule_fifo(_priority: i32) -> io::Result<()> {
    Err(only_on_linux())
}

pub fn pin_to_core(_core: usize) -> io::Result<()> {
    Err(only_on_linux())
}

pub fn page_faults() -> PageFaults {
    PageFaults::default()
}

pub fn open_own(_path: &Path) -> io::Result<File> {
    Err(only_on_linux())
}

pub fn other_owner(_file: &File) -> io::Result<Option<u32>> {
    Err(only_on_linux())
}

pub fn is_same_file(_a: &File, _b: &File) -> io::Result<bool> {
    Err(only_on_linux())
}

pub fn map_shared(_file: &File, _words: usize) -> io::Result<&'static [AtomicU64]> {
    Err(only_on_linux())
}
