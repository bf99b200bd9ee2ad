//! Linux, through libc.

#![allow(unsafe_code)] // these calls have no safe face in std

use std::fs::File;
use std::io;
use std::mem;
use std::os::fd::AsRawFd;
use std::ptr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::PageFaults;

const NANO: u64 = 1_000_000_000;

static STOP: AtomicBool = AtomicBool::new(false);

extern "C" fn ask_to_stop(_signal: libc::c_int) {
    STOP.store(true, Ordering::Relaxed);
}

/// SIGINT and SIGTERM ask for an orderly end from now on ([`stop_asked`]) and interrupt what waits.
pub fn catch_signals() -> io::Result<()> {
    for signal in [libc::SIGINT, libc::SIGTERM] {
        // SAFETY: zeros are a valid sigaction; the handler only stores to an atomic, which is async-signal-safe.
        let done = unsafe {
            let mut action: libc::sigaction = mem::zeroed();
            action.sa_sigaction = ask_to_stop as extern "C" fn(libc::c_int) as libc::sighandler_t;
            libc::sigaction(signal, &action, ptr::null_mut())
        };
        checked(done)?;
    }
    Ok(())
}

/// True once somebody asked for an end.
pub fn stop_asked() -> bool {
    STOP.load(Ordering::Relaxed)
}

/// A clock that only goes forward \[ns\].
pub fn now() -> u64 {
    let mut time = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: `time` outlives the call; CLOCK_MONOTONIC exists on every Linux, so it cannot fail.
    unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut time) };
    time.tv_sec as u64 * NANO + time.tv_nsec as u64
}

/// Sleeps until [`now`] is `deadline` \[ns\]; earlier if a signal comes.
pub fn sleep_until(deadline: u64) {
    let time = libc::timespec {
        tv_sec: (deadline / NANO) as libc::time_t,
        tv_nsec: (deadline % NANO) as libc::c_long,
    };
    // SAFETY: `time` outlives the call; the remaining time, which a null pointer declines, is unused with TIMER_ABSTIME.
    unsafe {
        libc::clock_nanosleep(
            libc::CLOCK_MONOTONIC,
            libc::TIMER_ABSTIME,
            &time,
            ptr::null_mut(),
        );
    }
}

/// Lets this thread's sleeps end on time: the kernel may otherwise gather them over 50 us.
pub fn sleep_sharply() {
    // SAFETY: no pointer is passed; a refusal leaves the slack as it was.
    unsafe { libc::prctl(libc::PR_SET_TIMERSLACK, 1 as libc::c_ulong) };
}

/// Keeps every page of the program in memory, now and from now on.
pub fn lock_memory() -> io::Result<()> {
    // SAFETY: no pointer is passed.
    checked(unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) })
}

/// Schedules this thread before all that are not real-time.
pub fn schedule_fifo(priority: i32) -> io::Result<()> {
    let parameter = libc::sched_param {
        sched_priority: priority,
    };
    // SAFETY: `parameter` outlives the call; 0 names the calling thread.
    checked(unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &parameter) })
}

/// Keeps this thread on one core.
pub fn pin_to_core(core: usize) -> io::Result<()> {
    if core >= libc::CPU_SETSIZE as usize {
        return Err(io::ErrorKind::InvalidInput.into());
    }
    // SAFETY: zeros are an empty set, `core` is within it, and the set outlives the call; 0 names the calling thread.
    checked(unsafe {
        let mut set: libc::cpu_set_t = mem::zeroed();
        libc::CPU_SET(core, &mut set);
        libc::sched_setaffinity(0, mem::size_of_val(&set), &set)
    })
}

/// Page faults of this thread so far.
pub fn page_faults() -> PageFaults {
    // SAFETY: zeros are a valid rusage, which outlives the call; RUSAGE_THREAD names the calling thread.
    let usage = unsafe {
        let mut usage: libc::rusage = mem::zeroed();
        libc::getrusage(libc::RUSAGE_THREAD, &mut usage);
        usage
    };
    PageFaults {
        minor: usage.ru_minflt as u64,
        major: usage.ru_majflt as u64,
    }
}

/// The first `words` words of a file, shared with every process that maps it, until this one ends.
///
/// The file must keep at least this length: who cuts it ends this program with a bus error.
pub fn map_shared(file: &File, words: usize) -> io::Result<&'static [AtomicU64]> {
    let length = words * mem::size_of::<u64>();
    if length == 0 || file.metadata()?.len() < length as u64 {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    // SAFETY: a fresh shared mapping of an open file at an address that the kernel chooses; nothing of ours is replaced.
    let start = unsafe {
        libc::mmap(
            ptr::null_mut(),
            length,
            libc::PROT_READ | libc::PROT_WRITE,
            libc::MAP_SHARED | libc::MAP_POPULATE,
            file.as_raw_fd(),
            0,
        )
    };
    if start == libc::MAP_FAILED {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: the mapping is page-aligned, `length` long, readable and writable, and never unmapped. Every access, by other
    // processes too, is to whole aligned words, and ours are atomic.
    Ok(unsafe { std::slice::from_raw_parts(start.cast::<AtomicU64>(), words) })
}

fn checked(result: libc::c_int) -> io::Result<()> {
    if result == 0 {
        Ok(())
    } else {
        Err(io::Error::last_os_error())
    }
}
