//! How early a loop wakes, and when it rehearses.

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
