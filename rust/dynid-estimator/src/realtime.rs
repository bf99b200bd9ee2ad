//! What is asked of the machine before the loop begins, each refused with one sentence where it is not permitted.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use crate::histogram::Histogram;
use crate::pace::Pace;
use crate::stop::Stop;
use crate::sys;
use crate::timing::Timing;

/// Most that a loop with a real-time priority wakes before a cycle \[s\], but not more than a quarter of its period: what a
/// sleep in a virtual machine is late at its worst one percent. The loop finds out how much less this machine needs.
const USUAL_EARLY: f64 = 0.00025;

/// What was asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RealTime {
    /// Cycles per second; none: driven by input.
    pub rate: Option<f64>,
    /// Most that the loop wakes before a cycle \[s\]; none: [`USUAL_EARLY`], or not at all where others need the core.
    pub early: Option<f64>,
    /// End after so long \[s\].
    pub duration: Option<f64>,
    /// Say how long things took.
    pub histogram: bool,
    /// Say it as JSON.
    pub json: bool,
    /// Measure how late a thread wakes that does nothing but sleep.
    pub jitter: bool,
    /// Keep all pages in memory.
    pub mlock: bool,
    /// Priority of SCHED_FIFO.
    pub fifo: Option<i32>,
    /// Core to stay on.
    pub core: Option<usize>,
}

impl RealTime {
    /// Keeps memory in place, before any thread takes some of its own: what a thread takes counts to the limit, so that
    /// the answer would depend on how far it has come. `watched`: a new model may come, which needs memory then.
    ///
    /// # Errors
    /// [`Stop`] if it is not permitted, or might not be for the next model.
    pub fn lock_memory(&self, watched: bool) -> Result<(), Stop> {
        const MEND: &str = "raise the limit (ulimit -l unlimited), or leave";
        if !self.mlock {
            return Ok(());
        }
        let sentence = |error| Stop::Because(format!("--mlock: {error}; {MEND} it out"));
        sys::lock_memory().map_err(sentence)?;
        match sys::most_locked() {
            // A new model that does not fit would not be refused: its reader could not even say so.
            Some(bytes) if watched => Err(Stop::Because(format!(
                "--mlock with --watch: a new model needs memory, and {:.1} MB may be locked; {MEND} one of them out",
                bytes as f64 / 1e6
            ))),
            _ => Ok(()),
        }
    }

    /// Asks for the rest, for the calling thread, and begins the pace, if there is one. The sleeper is started before: it asks
    /// for the same priority itself.
    ///
    /// # Errors
    /// [`Stop`] with what is not permitted.
    pub fn begin(&self) -> Result<(Option<Sleeper>, Option<Pace>), Stop> {
        // Of this program, so before this thread stays on one of them. Unknown is like many.
        let alone = thread::available_parallelism().is_ok_and(|cores| cores.get() == 1);
        let refused = |what: String, error: io::Error, mend: &str| {
            Err(Stop::Because(format!(
                "{what}: {error}; {mend}, or leave it out"
            )))
        };
        if self.rate.is_some() {
            sys::sleep_sharply();
        }
        let sleeper = match self.rate {
            Some(rate) if self.jitter => Some(
                Sleeper::start(rate, self.fifo)
                    .map_err(|error| Stop::Because(format!("--jitter: {error}")))?,
            ),
            _ => None,
        };
        if let Some(core) = self.core {
            if let Err(error) = sys::pin_to_core(core) {
                return refused(
                    format!("--core {core}"),
                    error,
                    "name a core that this program may run on",
                );
            }
        }
        if let Some(priority) = self.fifo {
            if let Err(error) = sys::schedule_fifo(priority) {
                let mend = "give this program the right to real-time priorities (CAP_SYS_NICE, or rtprio in limits.conf)";
                return refused(format!("--fifo {priority}"), error, mend);
            }
        }
        let pace = self
            .rate
            .map(|rate| Pace::new(rate, self.most_early(rate, alone)));
        Ok((sleeper, pace))
    }

    /// Most that the loop wakes before a cycle \[ns\]. Who waits awake takes time from others, so without a real-time
    /// priority, where the core is shared with whoever else is there, nobody does unless it is asked for. `alone`: there is
    /// only one core, so with such a priority even the sender would have to wait.
    fn most_early(&self, rate: f64, alone: bool) -> u64 {
        let usual = match self.fifo {
            Some(_) if !alone => USUAL_EARLY.min(0.25 / rate),
            _ => 0.0,
        };
        (self.early.unwrap_or(usual) * 1e9) as u64
    }

    /// When it ends \[ns\].
    pub fn end(&self) -> u64 {
        let duration = self.duration.unwrap_or(f64::INFINITY);
        // A cast saturates.
        sys::now().saturating_add((duration * 1e9) as u64)
    }

    /// What is said at the end, if anything is.
    pub fn report(&self, timing: &Timing, sleeper: Option<Sleeper>) -> Option<String> {
        let sleep = sleeper.and_then(Sleeper::stop);
        self.histogram.then(|| {
            if self.json {
                timing.json(sleep.as_ref())
            } else {
                timing.text(sleep.as_ref())
            }
        })
    }
}

/// How late a thread woke that does nothing but sleep \[ns\], and how often by more than a period.
#[derive(Debug)]
pub struct Sleep {
    pub late: Histogram,
    pub missed: u64,
}

/// A thread that wakes at the same rate and does nothing: what the machine itself adds.
#[derive(Debug)]
pub struct Sleeper {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Sleep>,
}

impl Sleeper {
    fn start(rate: f64, fifo: Option<i32>) -> io::Result<Self> {
        let mut sleep = Sleep {
            late: Histogram::new(),
            missed: 0,
        };
        let stop = Arc::new(AtomicBool::new(false));
        let asked = Arc::clone(&stop);
        let work = move || {
            sys::sleep_sharply();
            if let Some(priority) = fifo {
                // Where it is refused, so is the loop's own, which says so.
                let _ = sys::schedule_fifo(priority);
            }
            let mut pace = Pace::new(rate, 0);
            while !asked.load(Ordering::Relaxed) {
                let begin = pace.wait(|| {});
                sleep.late.record(sys::now().saturating_sub(begin.due));
                sleep.missed += begin.missed;
            }
            sleep
        };
        let thread = thread::Builder::new().name("jitter".into()).spawn(work)?;
        Ok(Self { stop, thread })
    }

    fn stop(self) -> Option<Sleep> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_wakes_early_by_itself_only_where_nobody_else_needs_the_core() {
        let most = |fifo, early, alone| {
            let asked = RealTime {
                fifo,
                early,
                ..RealTime::default()
            };
            asked.most_early(1000.0, alone)
        };
        assert_eq!(most(Some(80), None, false), 250_000);
        assert_eq!(most(Some(80), None, true), 0);
        assert_eq!(most(None, None, false), 0);
        // Who asks for it has it.
        assert_eq!(most(Some(80), Some(0.0001), true), 100_000);
        assert_eq!(most(None, Some(0.0001), true), 100_000);
    }
}
