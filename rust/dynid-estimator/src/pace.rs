//! When cycles begin: at fixed times, awake a little before them where that is asked for.
//!
//! ```text
//! sleep | rehearse | wait without sleeping | the cycle ... sleep
//!       ^ early                            ^ due
//! ```
//!
//! A processor that has slept has forgotten: code and numbers come from far memory, and one cycle takes as long as ten that
//! follow each other. So the loop wakes early, does once what the cycle will do ([`crate::rehearsal`]), and stays awake.

use crate::sys;

/// Shortest time that is woken early, where it is at all \[ns\].
const LEAST_EARLY: u64 = 5_000;

/// The loop wakes earlier by this part after a wake that came too late to rehearse, later by that part after one that did
/// not: one in five hundred comes too late then, however late this machine wakes who sleeps.
const RISE: u64 = 4;
const FALL: u64 = 2_000;

/// What a rehearsal needs is forgotten by this part with every one that was faster.
const FORGET: u64 = 8;

/// After so many cycles in a row that seemed to leave no time for a rehearsal, half of what it needs is forgotten: with
/// another model or on another day it may be wrong, and only a rehearsal can say so.
const PATIENCE: u64 = 500;

/// Rehearsals that are timed before the first cycle; the fastest but one counts.
const TRIALS: usize = 5;

/// The rehearsal is repeated in the last so many times of what it needs: branches are learnt by then, and what other
/// threads did meanwhile is undone.
const LAST: u64 = 4;

/// Begins cycles at multiples of a period after the start, whatever the ones before took.
#[derive(Debug)]
pub struct Pace {
    period: u64,
    next: u64,
    /// Most that it wakes early, and how much it does now \[ns\].
    most_early: u64,
    early: u64,
    /// What a rehearsal takes \[ns\], 0 before the first: the faster one of the last two, or what is not forgotten yet of
    /// slower ones. One that was interrupted does not count.
    needs: u64,
    /// What the last one took \[ns\].
    last: u64,
    /// Cycles since.
    without: u64,
}

/// A cycle that begins.
#[derive(Clone, Copy, Debug, Default)]
pub struct Begin {
    /// When it should have begun \[ns\].
    pub due: u64,
    /// Beginnings that passed before it, because the cycle before was not done.
    pub missed: u64,
    /// How long the loop was awake before \[ns\].
    pub awake: u64,
    /// Whether it was rehearsed.
    pub rehearsed: bool,
}

impl Pace {
    /// The first cycle begins a period from now; the loop wakes up to `most_early` \[ns\] before each.
    pub fn new(hertz: f64, most_early: u64) -> Self {
        let period = (1e9 / hertz).round().max(1.0) as u64;
        Self {
            period,
            next: sys::now() + period,
            most_early,
            early: most_early,
            needs: 0,
            last: 0,
            without: 0,
        }
    }

    /// Sleeps until the next cycle begins, or a little less, rehearses it then, and waits awake. Where that time has passed
    /// already, the cycle is missed and the one after it comes.
    pub fn wait(&mut self, mut rehearse: impl FnMut()) -> Begin {
        let done = sys::now();
        let missed = if done > self.next {
            (done - self.next).div_ceil(self.period)
        } else {
            0
        };
        let due = self.next + missed * self.period;
        self.next = due + self.period;
        let begin = Begin {
            due,
            missed,
            ..Begin::default()
        };
        // Where there is time enough before the first cycle, so that no rehearsal of unknown length begins before one.
        if self.needs == 0 && self.most_early > 0 && due.saturating_sub(done) > self.most_early {
            self.try_out(&mut rehearse, done + (due - done) / 4);
        }
        let wake = due.saturating_sub(self.early);
        sys::sleep_until(wake);
        if self.most_early == 0 || sys::stop_asked() {
            return begin;
        }
        let woke = sys::now();
        let rehearsed = self.has_time(due.saturating_sub(woke));
        // Nothing is learnt from a sleep that there was no time for.
        if done < wake {
            self.learn(rehearsed);
        }
        let mut now = woke;
        if rehearsed {
            rehearse();
            now = sys::now();
            self.rehearsed_in(now - woke);
        }
        while now < due && !sys::stop_asked() {
            let left = due - now;
            if rehearsed && (self.needs..LAST * self.needs).contains(&left) {
                rehearse();
            } else {
                std::hint::spin_loop();
            }
            now = sys::now();
        }
        Begin {
            awake: due.saturating_sub(woke),
            rehearsed,
            ..begin
        }
    }

    /// Times some rehearsals, but begins none after `until`.
    fn try_out(&mut self, rehearse: &mut impl FnMut(), until: u64) {
        let mut times = [u64::MAX; TRIALS];
        let mut begin = sys::now();
        for (k, time) in times.iter_mut().enumerate() {
            if k > 0 && begin > until {
                break;
            }
            rehearse();
            let end = sys::now();
            *time = end - begin;
            begin = end;
        }
        times.sort_unstable();
        let [fastest, next, ..] = times;
        let needs = if next < u64::MAX { next } else { fastest };
        self.needs = needs.clamp(1, self.most_early);
        self.last = self.needs;
    }

    /// True if a rehearsal that begins `left` \[ns\] before a cycle will be done before it.
    fn has_time(&self, left: u64) -> bool {
        self.needs > 0 && self.needs < left
    }

    /// A rehearsal took so long \[ns\].
    fn rehearsed_in(&mut self, time: u64) {
        let seen = time.min(self.last);
        self.last = time;
        self.needs = if seen > self.needs {
            seen.min(self.most_early)
        } else {
            (self.needs - (self.needs - seen) / FORGET).max(1)
        };
    }

    /// A wake left time for a rehearsal, or did not.
    fn learn(&mut self, in_time: bool) {
        if in_time {
            self.without = 0;
        } else {
            self.without += 1;
            if self.without >= PATIENCE {
                self.without = 0;
                self.needs = self.needs.div_ceil(2);
            }
        }
        // No wake is early enough for a rehearsal that takes as long as the loop may be awake.
        if self.needs >= self.most_early {
            return;
        }
        let early = if in_time {
            self.early - self.early / FALL
        } else {
            self.early + self.early / RISE
        };
        self.early = early.max(LEAST_EARLY).min(self.most_early);
    }

    /// Time from one beginning to the next \[ns\].
    pub fn period(&self) -> u64 {
        self.period
    }
}

#[cfg(test)]
mod tests;
