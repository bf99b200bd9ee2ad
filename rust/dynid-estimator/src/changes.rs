//! What is seen in the stream, on its way to a person: the loop lays it down, a second thread says it on stderr.
//!
//! The loop only tries a lock that the other thread holds to copy a few numbers; nothing is allocated, nobody is woken. A
//! loop that nothing paces may read a day in a second, and says everything by itself.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, TryLockError};
use std::thread;
use std::time::Duration;

use dynid_core::adapt::{Adapted, Part, Reason};
use dynid_core::watch::{Change, Kind, Said};
use dynid_core::{JointKind, TorqueModel};

use crate::run::tell;

/// How often the thread looks.
const LOOK: Duration = Duration::from_millis(100);

/// What may wait; a change takes seconds of motion, and so does what one joint's adaptation says, so between two looks at a
/// loop with a rate there are a few, of an arm all of whose joints move on.
const MOST: usize = 32;

/// Something to say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Told {
    /// What of the model no longer holds.
    Change(Change),
    /// What is added to the model.
    Adapted(Adapted),
    /// States come at another rate \[Hz\] than thresholds of contacts were learned at.
    Rate {
        /// Of the stream.
        comes: f64,
        /// Of the healthy runs.
        learned: f64,
    },
}

/// It and the time of the state at which it was said, which may be NaN \[s\].
type News = (f64, Told);

#[derive(Debug, Default)]
struct Table {
    waits: AtomicBool,
    news: Mutex<[Option<News>; MOST]>,
    /// Of those who say it; the loop never takes this one.
    speaks: Mutex<()>,
}

/// The loop's side. What is left is said when it is dropped.
#[derive(Debug)]
pub struct Outbox {
    /// None where the loop says everything by itself.
    table: Option<Arc<Table>>,
    /// What found the lock taken.
    kept: [Option<News>; MOST],
    names: Arc<Names>,
}

/// What sentences are made of.
#[derive(Debug)]
struct Names {
    joints: Vec<String>,
    slides: Vec<bool>,
    torque_unit: String,
}

impl Outbox {
    /// For a loop that may wait for stderr.
    pub fn patient(model: &TorqueModel) -> Self {
        Self {
            table: None,
            kept: [None; MOST],
            names: Arc::new(Names::of(model)),
        }
    }

    /// For a loop that may not: starts the thread, which ends with the program.
    pub fn open(model: &TorqueModel) -> Self {
        let (table, names) = (Arc::new(Table::default()), Arc::new(Names::of(model)));
        let (theirs, words) = (Arc::clone(&table), Arc::clone(&names));
        let started = thread::Builder::new()
            .name("changes".into())
            .spawn(move || loop {
                thread::sleep(LOOK);
                say(&theirs, &words);
            });
        if let Err(error) = started {
            tell(
                "error",
                &format!("no thread for sentences ({error}); they come at the end"),
            );
        }
        Self {
            table: Some(table),
            kept: [None; MOST],
            names,
        }
    }

    /// Lays news down, and what could not be laid down before; the oldest are lost where there are too many.
    pub fn put(&mut self, time: f64, news: impl Iterator<Item = Told>) {
        let Some(table) = &self.table else {
            news.for_each(|told| self.names.tell(time, &told));
            return;
        };
        news.for_each(|told| push(&mut self.kept, (time, told)));
        if self.kept[0].is_none() {
            return;
        }
        if let Ok(mut news) = table.news.try_lock() {
            for one in self.kept.iter_mut().map_while(Option::take) {
                push(&mut news, one);
            }
            table.waits.store(true, Ordering::Release);
        }
    }
}

impl Drop for Outbox {
    fn drop(&mut self) {
        if let Some(table) = &self.table {
            say(table, &self.names);
        }
        for (time, told) in self.kept.iter_mut().filter_map(Option::take) {
            self.names.tell(time, &told);
        }
    }
}

/// Puts one behind the others; where there is no room the first goes.
fn push(news: &mut [Option<News>; MOST], one: News) {
    match news.iter_mut().find(|place| place.is_none()) {
        Some(place) => *place = Some(one),
        None => {
            news.rotate_left(1);
            news[MOST - 1] = Some(one);
        }
    }
}

fn say(table: &Table, names: &Names) {
    // Held until all is said: the program does not end in between.
    let _speaks = table.speaks.lock().unwrap_or_else(PoisonError::into_inner);
    if !table.waits.swap(false, Ordering::Acquire) {
        return;
    }
    let found = loop {
        match table.news.try_lock() {
            Ok(mut news) => break std::mem::take(&mut *news),
            Err(TryLockError::Poisoned(news)) => break std::mem::take(&mut *news.into_inner()),
            Err(TryLockError::WouldBlock) => thread::sleep(Duration::from_micros(50)),
        }
    };
    for (time, told) in found.into_iter().flatten() {
        names.tell(time, &told);
    }
}

impl Names {
    fn of(model: &TorqueModel) -> Self {
        let joints = model.robot().joints().iter();
        let slides = joints
            .clone()
            .map(|joint| joint.kind == JointKind::Prismatic);
        Self {
            slides: slides.collect(),
            joints: joints.map(|joint| joint.name.clone()).collect(),
            torque_unit: model.torque_unit().to_owned(),
        }
    }

    fn joint(&self, joint: usize) -> &str {
        self.joints.get(joint).map_or("?", String::as_str)
    }

    fn slides(&self, joint: usize) -> bool {
        self.slides.get(joint) == Some(&true)
    }

    fn tell(&self, time: f64, told: &Told) {
        match told {
            Told::Change(change) => tell("change", &self.sentence(time, change)),
            Told::Adapted(adapted) => tell("adapted", &self.sentence_of(time, adapted)),
            Told::Rate { comes, learned } => tell("note", &sentence_of_rates(*comes, *learned)),
        }
    }

    /// Of one joint's channel: a force where it slides.
    fn torque_unit(&self, joint: usize) -> &str {
        match self.torque_unit.as_str() {
            "N*m" if self.slides(joint) => "N",
            unit => unit,
        }
    }

    /// Mass, by the unit of the torque.
    fn mass_unit(&self) -> &'static str {
        match self.torque_unit.as_str() {
            "N*m" => "kg",
            _ => "kg times what the channel shows per N m",
        }
    }

    /// From where to where, and where the data say it is, with 95 %.
    fn sentence_of(&self, time: f64, adapted: &Adapted) -> String {
        let [low, high] = adapted.interval();
        let [from, to, low, high] = [adapted.from, adapted.to, low, high].map(short);
        let data = format!("{from} -> {to} (data: {low} to {high})");
        let what = match adapted.part {
            Part::Friction => format!("{}: friction times {data}", self.joint(adapted.joint)),
            Part::Payload => format!("payload {data} {}", self.mass_unit()),
        };
        let why = match adapted.reason {
            Reason::Followed => "",
            Reason::Limit => ", stopped at its limit",
            Reason::Within => ", within its limits again",
            Reason::Reset => ", put back",
        };
        format!("{}{what}{why}", when(time))
    }

    /// One sentence, with an interval of 95 %.
    fn sentence(&self, time: f64, change: &Change) -> String {
        let (joint, [low, high]) = (self.joint(change.joint), change.interval());
        let ends = [change.size, low, high];
        let [size, low, high] = ends.map(short);
        let what = match change.kind {
            Kind::Friction | Kind::Gain => {
                let [size, low, high] = ends.map(percent);
                format!("{joint}: {} {size} ({low} to {high})", change.kind.word())
            }
            Kind::Offset => {
                let unit = self.torque_unit(change.joint);
                format!("{joint}: constant torque {size} ({low} to {high}) {unit}")
            }
            Kind::Delay => {
                let [size, low, high] = ends.map(|x| short(1e3 * x));
                format!("{joint}: delay {size} ({low} to {high}) ms")
            }
            Kind::Slip => {
                let unit = if self.slides(change.joint) {
                    "m"
                } else {
                    "rad"
                };
                format!("{joint}: encoder slip {size} ({low} to {high}) {unit}")
            }
            Kind::Load => {
                format!("load {size} ({low} to {high}) {}", self.mass_unit())
            }
            Kind::Frozen => {
                let unit = self.torque_unit(change.joint);
                let does = match change.said {
                    Said::Withdrawn => "the torque channel changes again",
                    _ => "the torque channel does not change any more",
                };
                format!("{joint}: {does}, {size} {unit}")
            }
            Kind::Unknown => {
                let grown = short(100.0 * change.size);
                format!("{joint}: the error has grown by {grown} %, no name says why: look again")
            }
        };
        let or = change.or.map_or(String::new(), |(kind, j)| match kind {
            Kind::Load => ", or a load".to_owned(),
            Kind::Offset => format!(", or constant torque of {}", self.joint(j)),
            Kind::Slip => format!(", or encoder slip of {}", self.joint(j)),
            kind => format!(", or {} of {}", kind.word(), self.joint(j)),
        });
        let when = when(time);
        let said = match change.said {
            Said::Named => String::new(),
            said => format!(" ({})", said.word()),
        };
        format!("{when}{what}{or}{said}")
    }
}

fn sentence_of_rates(comes: f64, learned: f64) -> String {
    let [comes, learned] = [comes, learned].map(short);
    format!(
        "states come at {comes} Hz, the --contacts file was learned at {learned} Hz, and the observer counts its steps: external \
         torques and contacts are wrong; learn it from runs at this rate with `dynid contact MODEL.json --healthy RUN --save`"
    )
}

fn when(time: f64) -> String {
    if time.is_finite() {
        format!("{time:.1} s: ")
    } else {
        String::new()
    }
}

fn percent(x: f64) -> String {
    let sign = if x < 0.0 { "" } else { "+" };
    format!("{sign}{} %", short(100.0 * x))
}

/// Three digits.
fn short(x: f64) -> String {
    if x == 0.0 {
        return "0".to_owned();
    }
    if !(1e-4..1e6).contains(&x.abs()) {
        return format!("{x:.2e}");
    }
    let digits = 2.0 - x.abs().max(1e-4).log10().floor();
    format!("{x:.*}", digits.max(0.0) as usize)
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use crate::live::tests::model;

    pub fn change(kind: Kind, size: f64) -> Change {
        Change {
            kind,
            joint: 0,
            size,
            std: 0.01,
            moments: [0.0; 3],
            said: Said::Named,
            or: None,
        }
    }

    #[test]
    fn sentences_are_those_of_the_command() {
        let names = Names::of(&model(1.0));
        let settled = Change {
            said: Said::Settled,
            or: Some((Kind::Gain, 0)),
            ..change(Kind::Friction, 0.2)
        };
        assert_eq!(
            names.sentence(5.25, &settled),
            "5.2 s: joint: friction +20.0 % (+18.0 % to +22.0 %), or gain of joint (settled)"
        );
        assert_eq!(
            names.sentence(f64::NAN, &change(Kind::Load, 0.5)),
            "load 0.500 (0.480 to 0.520) kg"
        );
        assert!(names
            .sentence(1.0, &change(Kind::Unknown, 1.0))
            .contains("look again"));
        let offset = names.sentence(1.0, &change(Kind::Offset, 20.24));
        assert!(offset.contains("constant torque 20.2 ("), "{offset}");
        assert!(offset.ends_with(") N*m"), "{offset}");
        let sliding = Names {
            slides: vec![true],
            ..Names::of(&model(1.0))
        };
        let offset = sliding.sentence(1.0, &change(Kind::Offset, 20.24));
        assert!(offset.ends_with(") N"), "{offset}");
        let unknown = names.sentence(1.0, &change(Kind::Unknown, 1.32));
        assert!(unknown.contains("grown by 132 %"), "{unknown}");
        let frozen = names.sentence(1.0, &change(Kind::Frozen, 0.0));
        assert_eq!(
            frozen,
            "1.0 s: joint: the torque channel does not change any more, 0 N*m"
        );
        let over = Change {
            said: Said::Withdrawn,
            ..change(Kind::Frozen, 2.5)
        };
        assert!(names
            .sentence(1.0, &over)
            .ends_with("changes again, 2.50 N*m (withdrawn)"));
        let numbers = [-0.012_345, 99.94, 12_345.0, 1e157, -3e-9, f64::INFINITY];
        let shorts = ["-0.0123", "99.9", "12345", "1.00e157", "-3.00e-9", "inf"];
        assert_eq!(numbers.map(short), shorts);
    }

    pub fn adapted(part: Part, reason: Reason) -> Adapted {
        Adapted {
            part,
            joint: 0,
            from: 1.0,
            to: 1.05,
            estimate: 1.06,
            std: 0.01,
            moments: [0.0; 3],
            reason,
        }
    }

    #[test]
    fn what_follows_is_said_from_where_to_where() {
        let names = Names::of(&model(1.0));
        assert_eq!(
            names.sentence_of(5.25, &adapted(Part::Friction, Reason::Limit)),
            "5.2 s: joint: friction times 1.00 -> 1.05 (data: 1.04 to 1.08), stopped at its limit"
        );
        assert_eq!(
            names.sentence_of(f64::NAN, &adapted(Part::Payload, Reason::Followed)),
            "payload 1.00 -> 1.05 (data: 1.04 to 1.08) kg"
        );
    }

    #[test]
    fn news_waits_for_its_reader_and_the_oldest_goes() {
        let mut news = [None; MOST];
        for k in 0..MOST + 3 {
            push(&mut news, (k as f64, Told::Change(change(Kind::Gain, 0.1))));
        }
        let times: Vec<f64> = news.iter().flatten().map(|(time, _)| *time).collect();
        assert_eq!((times.len(), times[0], times[MOST - 1]), (MOST, 3.0, 34.0));
    }

    #[test]
    fn what_finds_the_lock_taken_is_laid_down_later() {
        let (table, names) = (Arc::new(Table::default()), Arc::new(Names::of(&model(1.0))));
        let mut outbox = Outbox {
            table: Some(Arc::clone(&table)),
            kept: [None; MOST],
            names,
        };
        let taken = table.news.lock().unwrap();
        outbox.put(1.0, [Told::Change(change(Kind::Gain, 0.1))].into_iter());
        assert!(outbox.kept[0].is_some());
        drop(taken);
        outbox.put(2.0, std::iter::empty());
        assert!(outbox.kept[0].is_none() && table.waits.load(Ordering::Acquire));
        assert!(table.news.lock().unwrap()[0].is_some_and(|(time, _)| time == 1.0));
        say(&table, &outbox.names);
        assert!(table.news.lock().unwrap()[0].is_none());
    }
}
