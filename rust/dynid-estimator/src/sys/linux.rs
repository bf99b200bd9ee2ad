//! Linux, through libc.

#![allow(unsafe_code)] // these calls have no safe face in std

use std::fs::{File, OpenOptions};
use std::io::{self, Read};
use std::mem;
use std::os::fd::{AsFd, AsRawFd};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;
use std::ptr;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

use super::PageFaults;
use crate::stop::EndAsked;

const NANO: u64 = 1_000_000_000;

/// A look at what was asked for is taken so often while nothing comes \[ns\].
const LOOK: u64 = NANO / 10;

static STOP: AtomicBool = AtomicBool::new(false);
static RELOAD: AtomicBool = AtomicBool::new(false);

type Handler = extern "C" fn(libc::c_int);

extern "C" fn ask_to_stop(_signal: libc::c_int) {
    STOP.store(true, Ordering::Relaxed);
}

extern "C" fn ask_to_reload(_signal: libc::c_int) {
    RELOAD.store(true, Ordering::Relaxed);
}

/// SIGINT, SIGTERM and SIGHUP ask for an orderly end from now on ([`stop_asked`]) and interrupt what waits; who asks twice
/// ends the program at once. With `reloads`, SIGHUP asks for the model's file to be read instead ([`reload_asked`]).
pub fn catch_signals(reloads: bool) -> io::Result<()> {
    for signal in [libc::SIGINT, libc::SIGTERM] {
        catch(signal, ask_to_stop, libc::SA_RESETHAND)?;
    }
    if reloads {
        return catch(libc::SIGHUP, ask_to_reload, 0);
    }
    // SAFETY: zeros are a valid sigaction, which outlives the call; a null pointer asks for what there is.
    let there = unsafe {
        let mut there: libc::sigaction = mem::zeroed();
        libc::sigaction(libc::SIGHUP, ptr::null(), &mut there);
        there
    };
    // Whoever started it so that a closed terminal does not end it (nohup) meant it.
    if there.sa_sigaction == libc::SIG_IGN {
        return Ok(());
    }
    catch(libc::SIGHUP, ask_to_stop, libc::SA_RESETHAND)
}

fn catch(signal: libc::c_int, handler: Handler, flags: libc::c_int) -> io::Result<()> {
    // SAFETY: zeros are a valid sigaction; the handlers only store to an atomic, which is async-signal-safe.
    checked(unsafe {
        let mut action: libc::sigaction = mem::zeroed();
        action.sa_sigaction = handler as libc::sighandler_t;
        action.sa_flags = flags;
        libc::sigaction(signal, &action, ptr::null_mut())
    })
}

/// True once for every time that somebody asked for the model's file to be read.
pub fn reload_asked() -> bool {
    RELOAD.swap(false, Ordering::Relaxed)
}

/// True once somebody asked for an end.
pub fn stop_asked() -> bool {
    STOP.load(Ordering::Relaxed)
}

static NO_STDOUT: AtomicBool = AtomicBool::new(false);

/// Called by the loader: before `main`, Rust's runtime opens `/dev/null` in the place of a stream that is closed, and what
/// is written there is lost without a word.
#[used]
#[link_section = ".init_array"]
static LOOK_AT_STDOUT: extern "C" fn() = look_at_stdout;

extern "C" fn look_at_stdout() {
    // SAFETY: no pointer is passed; a closed descriptor is an answer.
    let closed = unsafe { libc::fcntl(libc::STDOUT_FILENO, libc::F_GETFD) } == -1;
    NO_STDOUT.store(closed, Ordering::Relaxed);
}

/// Whether the program was started without standard output (`>&-`).
pub fn stdout_is_closed() -> bool {
    NO_STDOUT.load(Ordering::Relaxed)
}

/// Where memory is shared: its first address and the one behind its last.
static SHARED: [AtomicUsize; 2] = [AtomicUsize::new(0), AtomicUsize::new(0)];

const CUT: &[u8] = b"error: the shared memory is gone: its file was cut, or there is no room for it; start again\n";

/// A page of the shared memory that has no file behind it any more was touched. Whoever may write the file may cut it at
/// any instant, also between a look at its length and the access, so that the access itself has to be answered.
extern "C" fn end_without_memory(
    signal: libc::c_int,
    info: *mut libc::siginfo_t,
    _context: *mut libc::c_void,
) {
    let [start, end] = [&SHARED[0], &SHARED[1]].map(|at| at.load(Ordering::Relaxed));
    // SAFETY: the kernel gives an address with this signal; `write`, `_exit` and `signal` are async-signal-safe.
    unsafe {
        if (start..end).contains(&((*info).si_addr() as usize)) {
            libc::write(libc::STDERR_FILENO, CUT.as_ptr().cast(), CUT.len());
            libc::_exit(2);
        }
        // Another fault: it happens again, and ends the program as it does by default.
        libc::signal(signal, libc::SIG_DFL);
    }
}

/// Ends the program with a sentence where shared memory from `start` on, `length` bytes, is touched and is not there.
fn catch_cut(start: usize, length: usize) -> io::Result<()> {
    SHARED[0].store(start, Ordering::Relaxed);
    SHARED[1].store(start + length, Ordering::Relaxed);
    // SAFETY: zeros are a valid sigaction; the handler takes the three arguments that SA_SIGINFO gives.
    checked(unsafe {
        let mut action: libc::sigaction = mem::zeroed();
        let handler: extern "C" fn(libc::c_int, *mut libc::siginfo_t, *mut libc::c_void) =
            end_without_memory;
        action.sa_sigaction = handler as libc::sighandler_t;
        action.sa_flags = libc::SA_SIGINFO;
        libc::sigaction(libc::SIGBUS, &action, ptr::null_mut())
    })
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

/// Processor time that this thread has used \[ns\].
pub fn thread_time() -> u64 {
    let mut time = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: `time` outlives the call; every thread has this clock, so it cannot fail.
    unsafe { libc::clock_gettime(libc::CLOCK_THREAD_CPUTIME_ID, &mut time) };
    time.tv_sec as u64 * NANO + time.tv_nsec as u64
}

/// Sleeps until [`now`] is `deadline` \[ns\]; less if somebody asks for an end, but not for any other signal.
pub fn sleep_until(deadline: u64) {
    let time = libc::timespec {
        tv_sec: (deadline / NANO) as libc::time_t,
        tv_nsec: (deadline % NANO) as libc::c_long,
    };
    loop {
        // SAFETY: `time` outlives the call; the remaining time, which a null pointer declines, is unused with TIMER_ABSTIME.
        let done = unsafe {
            libc::clock_nanosleep(
                libc::CLOCK_MONOTONIC,
                libc::TIMER_ABSTIME,
                &time,
                ptr::null_mut(),
            )
        };
        if done != libc::EINTR || stop_asked() {
            return;
        }
    }
}

/// Standard input whose reads end with [`EndAsked`] when somebody asks for an end, or at `end` \[ns\].
#[derive(Debug)]
pub struct Stdin {
    file: File,
    end: u64,
}

/// Standard input.
pub fn stdin(end: u64) -> io::Result<Stdin> {
    let file = File::from(io::stdin().as_fd().try_clone_to_owned()?);
    Ok(Stdin { file, end })
}

impl Read for Stdin {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        loop {
            let now = now();
            if stop_asked() || now >= self.end {
                return Err(io::Error::other(EndAsked));
            }
            let left = (self.end - now).min(LOOK).div_ceil(1_000_000);
            let mut wanted = libc::pollfd {
                fd: self.file.as_raw_fd(),
                events: libc::POLLIN,
                revents: 0,
            };
            // SAFETY: one entry, which outlives the call. A failure is left to the read, which says it.
            if unsafe { libc::poll(&mut wanted, 1, left as libc::c_int) } > 0 {
                return self.file.read(out);
            }
        }
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

/// Most bytes that [`lock_memory`] lets the program grow to, if there is a limit for it.
pub fn most_locked() -> Option<u64> {
    let mut limit = libc::rlimit {
        rlim_cur: 0,
        rlim_max: 0,
    };
    // SAFETY: `limit` outlives the call. The mapping is a fresh one that nobody may touch, and is given back at once: what
    // it tells is whether the limit holds for this program, which the kernel knows best.
    unsafe {
        libc::getrlimit(libc::RLIMIT_MEMLOCK, &mut limit);
        if limit.rlim_cur == libc::RLIM_INFINITY {
            return None;
        }
        let length = (limit.rlim_cur as usize).max(1);
        let kind = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_NORESERVE;
        let start = libc::mmap(ptr::null_mut(), length, libc::PROT_NONE, kind, -1, 0);
        if start == libc::MAP_FAILED {
            return Some(limit.rlim_cur);
        }
        libc::munmap(start, length);
    }
    None
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

/// Opens a file for reading and writing, or creates it for this user alone; a link at its end is not followed.
pub fn open_own(path: &Path) -> io::Result<File> {
    OpenOptions::new()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .mode(0o600)
        // A pipe that took the file's place would be waited for.
        .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK)
        .open(path)
}

/// The owner of an open file, if that is another user than this program runs as.
pub fn other_owner(file: &File) -> io::Result<Option<u32>> {
    let owner = file.metadata()?.uid();
    // SAFETY: takes nothing and cannot fail.
    let ours = unsafe { libc::geteuid() };
    Ok((owner != ours).then_some(owner))
}

/// Whether two descriptors show the same file.
pub fn is_same_file(a: &File, b: &File) -> io::Result<bool> {
    let (a, b) = (a.metadata()?, b.metadata()?);
    Ok((a.dev(), a.ino()) == (b.dev(), b.ino()))
}

/// The first `words` words of a file, shared with every process that maps it, until this one ends.
///
/// The file must keep at least this length: who cuts it ends this program, with a sentence ([`end_without_memory`]).
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
    catch_cut(start as usize, length)?;
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
