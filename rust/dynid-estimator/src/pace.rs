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

    /// A loop on a machine that wakes it late, evenly spread over 80 us, without a clock.
    struct Machine {
        pace: Pace,
        cycles: u64,
    }

    impl Machine {
        fn new(needs: u64) -> Self {
            let mut pace = Pace::new(1000.0, 250_000);
            (pace.needs, pace.last) = (needs, needs);
            let mut machine = Self { pace, cycles: 0 };
            machine.rehearse(20_000, needs);
            machine
        }

        /// How many of `n` cycles were rehearsed, and how many rehearsals of `time` were not done in time.
        fn rehearse(&mut self, n: u64, time: u64) -> (u64, u64) {
            let (mut rehearsed, mut past) = (0, 0);
            for _ in 0..n {
                self.cycles += 1;
                let left = self.pace.early.saturating_sub(self.cycles * 7919 % 80_000);
                let in_time = self.pace.has_time(left);
                self.pace.learn(in_time);
                if in_time {
                    self.pace.rehearsed_in(time);
                    rehearsed += 1;
                    past += u64::from(time > left);
                }
            }
            (rehearsed, past)
        }
    }

    #[test]
    fn one_interrupted_rehearsal_changes_nothing() {
        let mut machine = Machine::new(10_000);
        let (early, needs) = (machine.pace.early, machine.pace.needs);
        while machine.rehearse(1, 5_000_000).0 == 0 {}
        assert_eq!(machine.pace.needs, needs);
        let (rehearsed, _) = machine.rehearse(100, 10_000);
        assert!(rehearsed >= 98, "{rehearsed}");
        let after = machine.pace.early;
        assert!(
            after.abs_diff(early) <= early / RISE + early / 10,
            "{early} {after}"
        );
    }

    #[test]
    fn rehearsals_come_back_after_many_that_were_interrupted() {
        let mut machine = Machine::new(10_000);
        let early = machine.pace.early;
        machine.rehearse(10, 5_000_000);
        assert!(
            machine.pace.early <= early + early / RISE,
            "{:?}",
            machine.pace
        );
        machine.rehearse(3 * PATIENCE, 10_000);
        let (rehearsed, _) = machine.rehearse(1000, 10_000);
        assert!(rehearsed > 950, "{rehearsed}");
    }

    #[test]
    fn a_rehearsal_that_takes_longer_than_it_may_is_hardly_ever_begun() {
        let mut machine = Machine::new(10_000);
        machine.rehearse(10, 300_000);
        let (rehearsed, past) = machine.rehearse(100 * PATIENCE, 300_000);
        assert!(
            (1..=100).contains(&rehearsed) && past == rehearsed,
            "{rehearsed} {past}"
        );
        // Another model that takes longer, but not too long: the loop wakes earlier.
        let mut machine = Machine::new(10_000);
        machine.rehearse(200, 60_000);
        let (rehearsed, past) = machine.rehearse(10_000, 60_000);
        assert!(rehearsed > 9_900 && past == 0, "{rehearsed} {past}");
    }

    #[test]
    fn what_a_rehearsal_needs_is_known_before_the_first() {
        let mut pace = Pace::new(100.0, 1_000_000);
        let mut times = [3_000, 40, 200, 60, 50].into_iter();
        let mut begun = 0;
        pace.try_out(
            &mut || {
                begun += 1;
                let end = sys::now() + 1000 * times.next().unwrap();
                while sys::now() < end {}
            },
            u64::MAX,
        );
        assert_eq!(begun, TRIALS);
        assert!((50_000..=1_000_000).contains(&pace.needs), "{pace:?}");
        // It does not become less while nothing is rehearsed.
        let needs = pace.needs;
        (0..50).for_each(|_| pace.learn(false));
        assert_eq!(pace.needs, needs);
        // None is begun when there is no time.
        let mut begun = 0;
        pace.try_out(&mut || begun += 1, 0);
        assert_eq!(begun, 1);
    }

    #[test]
    fn no_cycle_begins_before_it_is_due() {
        let mut pace = Pace::new(2000.0, 100_000);
        let mut rehearsals = 0;
        while pace.needs == 0 {
            pace.wait(|| rehearsals += 1);
        }
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
