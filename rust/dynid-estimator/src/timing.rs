//! When cycles begin, how long they take, and what is said about it at the end.

use std::fmt::Write;

use serde_json::{json, Value};

use crate::histogram::Histogram;
use crate::sys::{self, PageFaults};

/// Begins cycles at multiples of a period after the start, whatever the ones before took.
#[derive(Debug)]
pub struct Pace {
    period: u64,
    next: u64,
}

/// A cycle that begins.
#[derive(Clone, Copy, Debug)]
pub struct Begin {
    /// When it should have begun \[ns\].
    pub due: u64,
    /// Beginnings that passed before it, because the cycle before was not done.
    pub missed: u64,
}

impl Pace {
    /// The first cycle begins a period from now.
    pub fn new(hertz: f64) -> Self {
        let period = (1e9 / hertz).round().max(1.0) as u64;
        Self {
            period,
            next: sys::now() + period,
        }
    }

    /// Sleeps until the next cycle begins. Where that has passed already, the cycle is missed and the one after it comes.
    pub fn wait(&mut self) -> Begin {
        let now = sys::now();
        let missed = if now > self.next {
            (now - self.next).div_ceil(self.period)
        } else {
            0
        };
        let due = self.next + missed * self.period;
        self.next = due + self.period;
        sys::sleep_until(due);
        Begin { due, missed }
    }

    /// Time from one beginning to the next \[ns\].
    pub fn period(&self) -> u64 {
        self.period
    }
}

/// What is measured of a loop.
#[derive(Debug)]
pub struct Timing {
    compute: Histogram,
    wake_up: Histogram,
    end_to_end: Histogram,
    period: Option<u64>,
    missed: u64,
    missed_by_compute: u64,
    /// Processor time of this thread when the cycle before was done, and what that cycle had used of it \[ns\].
    used: u64,
    last_used: u64,
    faults: PageFaults,
    faults_at_start: PageFaults,
}

impl Timing {
    /// `period` \[ns\] where the loop is paced.
    pub fn new(period: Option<u64>) -> Self {
        Self {
            compute: Histogram::new(),
            wake_up: Histogram::new(),
            end_to_end: Histogram::new(),
            period,
            missed: 0,
            missed_by_compute: 0,
            used: sys::thread_time(),
            last_used: 0,
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
        self.missed += begin.missed;
        // By the processor's time: a cycle that was interrupted for as long is the machine's affair.
        if self.period.is_some_and(|period| self.last_used > period) {
            self.missed_by_compute += begin.missed;
        }
    }

    /// A cycle is done: `compute` \[ns\] from bytes to bytes, `end_to_end` from when it was due (paced) or its input had
    /// come (driven) until its answer had left.
    pub fn end(&mut self, compute: u64, end_to_end: u64) {
        self.compute.record(compute);
        self.end_to_end.record(end_to_end);
        if self.period.is_some() {
            let used = sys::thread_time();
            self.last_used = used.saturating_sub(self.used);
            self.used = used;
        }
    }

    fn rows<'a>(&'a self, jitter: Option<&'a Histogram>) -> Vec<(&'static str, &'a Histogram)> {
        let paced = self.period.map(|_| ("wake-up", &self.wake_up));
        let mut rows = vec![("compute", &self.compute)];
        rows.extend(paced);
        rows.push(("end-to-end", &self.end_to_end));
        rows.extend(jitter.map(|jitter| ("sleep only", jitter)));
        rows
    }

    /// For people. `jitter`: how late a thread woke beside this one that did nothing but sleep.
    pub fn text(&self, jitter: Option<&Histogram>) -> String {
        let mut text = format!("{:<11}", "us");
        for (name, _) in QUANTILES {
            let _ = write!(text, "{name:>10}");
        }
        let _ = writeln!(text, "{:>10}{:>12}", "max", "cycles");
        for (name, histogram) in self.rows(jitter) {
            let _ = write!(text, "{name:<11}");
            let quantiles = QUANTILES.map(|(_, part)| histogram.quantile(part));
            for nanoseconds in quantiles.into_iter().chain([histogram.most()]) {
                let _ = write!(text, "{:>10.2}", nanoseconds as f64 / 1e3);
            }
            let _ = writeln!(text, "{:>12}", histogram.n());
        }
        let PageFaults { minor, major } = self.faults;
        if self.period.is_some() {
            let (missed, by_compute) = (self.missed, self.missed_by_compute);
            let _ = writeln!(text, "missed cycles: {missed}, {by_compute} of them because computing used more processor time than a period");
        }
        let _ = writeln!(text, "page faults: {minor} minor, {major} major");
        text
    }

    /// For machines \[s\].
    pub fn json(&self, jitter: Option<&Histogram>) -> String {
        let mut object = serde_json::Map::new();
        for (name, histogram) in self.rows(jitter) {
            let mut row = serde_json::Map::new();
            for (name, part) in QUANTILES {
                row.insert(name.to_owned(), seconds(histogram.quantile(part)));
            }
            row.insert("max".to_owned(), seconds(histogram.most()));
            row.insert("cycles".to_owned(), histogram.n().into());
            object.insert(name.replace(['-', ' '], "_"), row.into());
        }
        object.insert("missed".to_owned(), self.missed.into());
        object.insert(
            "missed_by_compute".to_owned(),
            self.missed_by_compute.into(),
        );
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

    #[test]
    fn what_interrupts_a_cycle_is_not_its_computing() {
        let mut timing = Timing::new(Some(PERIOD));
        let missed = |missed| Begin { due: 0, missed };
        let start = sys::thread_time();
        while sys::thread_time() < start + 3 * PERIOD {}
        timing.end(3 * PERIOD, 3 * PERIOD);
        timing.begin(missed(2), 0);
        assert_eq!((timing.missed, timing.missed_by_compute), (2, 2));
        // As long, but not on the processor.
        sys::sleep_until(sys::now() + 20 * PERIOD);
        timing.end(20 * PERIOD, 20 * PERIOD);
        timing.begin(missed(19), 0);
        assert_eq!((timing.missed, timing.missed_by_compute), (21, 2));
    }
}
