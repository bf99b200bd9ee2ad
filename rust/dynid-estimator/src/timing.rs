//! How long cycles take, and what is said about it at the end.

use std::fmt::Write;

use serde_json::{json, Value};

use crate::histogram::Histogram;
use crate::pace::Begin;
use crate::realtime::Sleep;
use crate::sys::{self, PageFaults};

/// A cycle that took this many times per state what cycles took lately did not compute for as long: the processor was taken
/// away, by the system or, where that cannot even see it, from below. A cycle whose code and numbers came from far memory
/// takes up to twenty times as long as one that follows another.
const INTERRUPTED: u64 = 100;

/// What made a cycle take more than half of a period, where computing did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Long {
    No,
    ByComputing,
    ByInterruption,
}

/// What is measured of a loop.
#[derive(Debug)]
pub struct Timing {
    compute: Histogram,
    wake_up: Histogram,
    awake: Histogram,
    end_to_end: Histogram,
    period: Option<u64>,
    missed: u64,
    missed_by_compute: u64,
    missed_by_interruption: u64,
    /// Cycles that were rehearsed.
    rehearsed: u64,
    /// Whether what made a cycle long is to be told; the clock of the processor is only asked then.
    told: bool,
    /// Processor time of this thread when the cycle was rehearsed last, or the one before was done \[ns\].
    used: u64,
    /// What made the cycle before long.
    last: Long,
    /// Cycles that computing for as long as that one did can make miss.
    most_missed: u64,
    /// What cycles take per state \[ns\]: it goes down at once and doubles at most, so that neither an interruption nor what
    /// follows it counts, and another model is known after a few cycles.
    usual: Option<u64>,
    faults: PageFaults,
    faults_at_start: PageFaults,
}

impl Timing {
    /// `period` \[ns\] where the loop is paced; `told`: somebody wants to know at the end why cycles were missed.
    pub fn new(period: Option<u64>, told: bool) -> Self {
        Self {
            compute: Histogram::new(),
            wake_up: Histogram::new(),
            awake: Histogram::new(),
            end_to_end: Histogram::new(),
            period,
            missed: 0,
            missed_by_compute: 0,
            missed_by_interruption: 0,
            rehearsed: 0,
            told,
            used: if told { sys::thread_time() } else { 0 },
            last: Long::No,
            most_missed: 0,
            usual: None,
            faults: PageFaults::default(),
            faults_at_start: sys::page_faults(),
        }
    }

    /// Page faults count from here.
    pub fn start(&mut self) {
        self.faults_at_start = sys::page_faults();
    }

    /// Page faults count up to here.
    pub fn stop(&mut self) {
        let now = sys::page_faults();
        self.faults = PageFaults {
            minor: now.minor - self.faults_at_start.minor,
            major: now.major - self.faults_at_start.major,
        };
    }

    /// A paced cycle began, `woke` \[ns\].
    pub fn begin(&mut self, begin: Begin, woke: u64) {
        self.wake_up.record(woke.saturating_sub(begin.due));
        self.awake.record(begin.awake);
        self.rehearsed += u64::from(begin.rehearsed);
        self.missed += begin.missed;
        match self.last {
            Long::No => {}
            Long::ByComputing => self.missed_by_compute += begin.missed.min(self.most_missed),
            Long::ByInterruption => {
                self.missed_by_interruption += begin.missed.min(self.most_missed);
            }
        }
    }

    /// A cycle is rehearsed: what this thread used the processor for before is not that cycle's. Asked for here and where a
    /// cycle ends, because between when a cycle is due and its answer it would come late by that.
    pub fn rehearse(&mut self) {
        if self.told {
            self.used = sys::thread_time();
        }
    }

    /// A cycle is done: `compute` \[ns\] from bytes to bytes, `end_to_end` from when it was due (paced) or its input had
    /// come (driven) until its answer had left. `states`: how many it used.
    pub fn end(&mut self, compute: u64, end_to_end: u64, states: u64) {
        self.compute.record(compute);
        self.end_to_end.record(end_to_end);
        let Some(period) = self.period.filter(|_| self.told) else {
            return;
        };
        let now = sys::thread_time();
        let used = now.saturating_sub(self.used);
        self.used = now;
        self.last = self.what_made_it_long(compute, states, used, period);
        self.most_missed = compute.div_ceil(period);
        if let Some(each) = compute.checked_div(states) {
            let most = self.usual.unwrap_or(u64::MAX).saturating_mul(2);
            self.usual = Some(each.max(1).min(most));
        }
    }

    fn what_made_it_long(&self, compute: u64, states: u64, used: u64, period: u64) -> Long {
        if compute <= period / 2 {
            return Long::No;
        }
        // The first one has nothing to be compared with.
        let most = self.usual.unwrap_or(u64::MAX).saturating_mul(INTERRUPTED);
        if used > period / 2 && compute / states.max(1) <= most {
            Long::ByComputing
        } else {
            Long::ByInterruption
        }
    }

    fn rows<'a>(&'a self, sleep: Option<&'a Sleep>) -> Vec<(&'static str, &'a Histogram)> {
        let mut rows = vec![("compute", &self.compute)];
        if self.period.is_some() {
            rows.extend([("wake-up", &self.wake_up), ("awake early", &self.awake)]);
        }
        rows.push(("end-to-end", &self.end_to_end));
        rows.extend(sleep.map(|sleep| ("sleep only", &sleep.late)));
        rows
    }

    /// For people. `sleep`: how late a thread woke beside this one that did nothing else.
    pub fn text(&self, sleep: Option<&Sleep>) -> String {
        let mut text = format!("{:<11}", "us");
        for (name, _) in QUANTILES {
            let _ = write!(text, "{name:>10}");
        }
        let _ = writeln!(text, "{:>10}{:>12}", "max", "cycles");
        for (name, histogram) in self.rows(sleep) {
            let _ = write!(text, "{name:<11}");
            let quantiles = QUANTILES.map(|(_, part)| histogram.quantile(part));
            for nanoseconds in quantiles.into_iter().chain([histogram.most()]) {
                let _ = write!(text, "{:>10.2}", nanoseconds as f64 / 1e3);
            }
            let _ = writeln!(text, "{:>12}", histogram.n());
        }
        let PageFaults { minor, major } = self.faults;
        if self.period.is_some() {
            let _ = write!(
                text,
                "missed cycles: {}, {} of them because computing took too long, {} because it was interrupted",
                self.missed, self.missed_by_compute, self.missed_by_interruption
            );
            if let Some(sleep) = sleep {
                let _ = write!(text, "; sleep only missed {}", sleep.missed);
            }
            let (rehearsed, n) = (self.rehearsed, self.wake_up.n());
            let _ = writeln!(text, "\nrehearsed: {rehearsed} of {n} cycles");
        }
        let _ = writeln!(text, "page faults: {minor} minor, {major} major");
        text
    }

    /// For machines \[s\].
    pub fn json(&self, sleep: Option<&Sleep>) -> String {
        let mut object = serde_json::Map::new();
        for (name, histogram) in self.rows(sleep) {
            let mut row = serde_json::Map::new();
            for (name, part) in QUANTILES {
                row.insert(name.to_owned(), seconds(histogram.quantile(part)));
            }
            row.insert("max".to_owned(), seconds(histogram.most()));
            row.insert("cycles".to_owned(), histogram.n().into());
            object.insert(name.replace(['-', ' '], "_"), row.into());
        }
        let counts = [
            ("missed", Some(self.missed)),
            ("missed_by_compute", Some(self.missed_by_compute)),
            ("missed_by_interruption", Some(self.missed_by_interruption)),
            ("missed_by_sleep_only", sleep.map(|sleep| sleep.missed)),
            ("rehearsed", Some(self.rehearsed)),
        ];
        for (name, count) in counts {
            object.extend(count.map(|count| (name.to_owned(), count.into())));
        }
        let PageFaults { minor, major } = self.faults;
        object.insert(
            "page_faults".to_owned(),
            json!({"minor": minor, "major": major}),
        );
        format!("{}\n", Value::from(object))
    }
}

const QUANTILES: [(&str, f64); 4] = [
    ("p50", 0.5),
    ("p99", 0.99),
    ("p99.9", 0.999),
    ("p99.99", 0.9999),
];

fn seconds(nanoseconds: u64) -> Value {
    (nanoseconds as f64 / 1e9).into()
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    const PERIOD: u64 = 1_000_000;

    /// Cycles of `before` (how long, how many states), then one that took `compute` for `states` and `used` so much of the
    /// processor; how many of the seven cycles that were missed after it count as computing's, and as an interruption's.
    fn missed_after(before: &[(u64, u64)], compute: u64, states: u64, used: u64) -> (u64, u64) {
        let mut timing = Timing::new(Some(PERIOD), true);
        let begin = |missed| Begin {
            missed,
            ..Begin::default()
        };
        for (compute, states) in before {
            timing.begin(begin(0), 0);
            timing.end(*compute, *compute, *states);
        }
        // What the loop does before it is rehearsed is not computing.
        spin(PERIOD);
        timing.rehearse();
        timing.begin(begin(0), 0);
        spin(used);
        timing.end(compute, compute, states);
        timing.begin(begin(7), 0);
        assert_eq!(timing.missed, 7);
        (timing.missed_by_compute, timing.missed_by_interruption)
    }

    fn spin(time: u64) {
        let start = sys::thread_time();
        while sys::thread_time() < start + time {}
    }

    #[test]
    fn what_interrupts_a_cycle_is_not_its_computing() {
        let after = |usual, compute, used| missed_after(&[(usual, 1)], compute, 1, used);
        assert_eq!(after(PERIOD, 7 * PERIOD, 7 * PERIOD), (7, 0));
        // Code and numbers from far memory are computing's affair.
        assert_eq!(after(PERIOD / 10, 7 * PERIOD, 7 * PERIOD), (7, 0));
        // Others take a tiny part of it.
        assert_eq!(after(PERIOD / 1000, 7 * PERIOD, 7 * PERIOD), (0, 7));
        // As long, but not on the processor.
        assert_eq!(after(PERIOD, 20 * PERIOD, 0), (0, 7));
        // What it cannot have caused came later.
        assert_eq!(after(PERIOD, 3 * PERIOD, 3 * PERIOD), (3, 0));
        // It woke late, or the transport took long.
        assert_eq!(after(PERIOD / 3, PERIOD / 3, 3 * PERIOD), (0, 0));
        // The first one.
        assert_eq!(missed_after(&[], 3 * PERIOD, 1, 3 * PERIOD), (3, 0));
    }

    #[test]
    fn cycles_of_many_states_are_compared_state_by_state() {
        let usual = PERIOD / 100;
        let long = 2 * PERIOD;
        // 200 times a cycle of one state, but only four times that for each of its fifty.
        assert_eq!(missed_after(&[(usual, 1)], long, 50, long), (2, 0));
        assert_eq!(missed_after(&[(usual, 1)], long, 1, long), (0, 2));
        // Forty times a cycle of fifty states, for one.
        let many = [(5 * usual, 50)];
        assert_eq!(missed_after(&many, long, 1, long), (0, 2));
        // A cycle without any state is no measure.
        assert_eq!(
            missed_after(&[(usual, 1), (1, 0)], PERIOD, 1, PERIOD),
            (1, 0)
        );
    }

    #[test]
    fn an_interruption_is_no_measure_and_another_model_is() {
        let usual = PERIOD / 1000;
        let long = 7 * PERIOD;
        let two = [(usual, 1), (long, 1)];
        assert_eq!(missed_after(&two, long, 1, long), (0, 7));
        let others = [&[(usual, 1)][..], &[(long, 1); 7]].concat();
        assert_eq!(missed_after(&others, long, 1, long), (7, 0));
    }

    #[test]
    fn nothing_is_told_apart_where_nobody_asks() {
        let mut timing = Timing::new(Some(PERIOD), false);
        timing.rehearse();
        timing.begin(Begin::default(), 0);
        timing.end(9 * PERIOD, 9 * PERIOD, 1);
        assert_eq!((timing.used, timing.last), (0, Long::No));
    }
}
