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

/// What a rehearsal needs is forgotten by this part with every cycle, so that one that was interrupted does not count for
/// long.
const FORGET: u64 = 8;

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
    /// What a rehearsal takes \[ns\].
    needs: u64,
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
        let wake = due.saturating_sub(self.early);
        sys::sleep_until(wake);
        if self.most_early == 0 || sys::stop_asked() {
            return begin;
        }
        let woke = sys::now();
        let rehearsed = woke + self.needs < due;
        self.needs -= self.needs / FORGET;
        // Nothing is learnt from a sleep that there was no time for.
        if done < wake {
            self.learn(rehearsed);
        }
        let mut now = woke;
        if rehearsed {
            rehearse();
            now = sys::now();
            self.needs = self.needs.max(now - woke);
        }
        let again = rehearsed;
        while now < due {
            let left = due - now;
            if again && (self.needs..LAST * self.needs).contains(&left) {
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

    fn learn(&mut self, in_time: bool) {
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
mod tests {
    use super::*;

    #[test]
    fn it_wakes_as_early_as_one_wake_in_five_hundred_needs() {
        // How late the machine wakes it: evenly spread over 80 us, and far too late once in a thousand.
        let mut pace = Pace::new(1000.0, 250_000);
        let (mut too_late, n) = (0, 200_000_u64);
        for k in 0..n {
            let late = if k % 1000 == 0 {
                5_000_000
            } else {
                k * 7919 % 80_000
            };
            let in_time = late <= pace.early;
            too_late += u64::from(!in_time && k >= n / 2);
            pace.learn(in_time);
        }
        assert!((40_000..120_000).contains(&pace.early), "{}", pace.early);
        assert!(
            (n / 2 / 1000..n / 2 / 250).contains(&too_late),
            "{too_late}"
        );
    }

    #[test]
    fn it_never_wakes_earlier_than_asked_for() {
        let mut pace = Pace::new(1000.0, 20_000);
        (0..100).for_each(|_| pace.learn(false));
        assert_eq!(pace.early, 20_000);
        (0..100_000).for_each(|_| pace.learn(true));
        assert_eq!(pace.early, LEAST_EARLY);
    }

    #[test]
    fn no_cycle_begins_before_it_is_due() {
        let mut pace = Pace::new(2000.0, 100_000);
        let mut rehearsals = 0;
        for _ in 0..200 {
            let before = rehearsals;
            let begin = pace.wait(|| rehearsals += 1);
            assert_eq!(begin.rehearsed, rehearsals > before);
            assert!(
                sys::now() >= begin.due && begin.awake <= 100_000,
                "{begin:?}"
            );
        }
        // Without, nothing is.
        let mut pace = Pace::new(2000.0, 0);
        let begin = pace.wait(|| unreachable!());
        assert!(!begin.rehearsed && begin.awake == 0);
    }
}
