//! What the watch says, on its way to a person: the loop lays it down, a second thread says it on stderr.
//!
//! The loop only tries a lock that the other thread holds to copy a few numbers; nothing is allocated, nobody is woken.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, TryLockError};
use std::thread;
use std::time::Duration;

use dynid_core::watch::{Change, Kind, Said};
use dynid_core::TorqueModel;

use crate::run::tell;

/// How often the thread looks.
const LOOK: Duration = Duration::from_millis(100);

/// Changes that may wait; between two looks there is hardly one.
const MOST: usize = 8;

/// Half of an interval of 95 % over its standard deviation.
const INTERVAL: f64 = 1.96;

/// A change and the time of the state at which it was said, which may be NaN \[s\].
type News = (f64, Change);

#[derive(Debug, Default)]
struct Table {
    waits: AtomicBool,
    news: Mutex<[Option<News>; MOST]>,
}

/// The loop's side.
#[derive(Debug)]
pub struct Outbox {
    table: Arc<Table>,
    /// What found the lock taken.
    kept: [Option<News>; MOST],
    names: Arc<Names>,
}

/// What sentences are made of.
#[derive(Debug)]
struct Names {
    joints: Vec<String>,
    torque_unit: String,
}

impl Outbox {
    /// Starts the thread, which ends with the program.
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
                &format!("--changes: {error}; only the status says them"),
            );
        }
        Self {
            table,
            kept: [None; MOST],
            names,
        }
    }

    /// Lays a change down, and what could not be laid down before; the oldest are lost where there are too many.
    pub fn put(&mut self, time: f64, change: Option<&Change>) {
        if let Some(change) = change {
            push(&mut self.kept, (time, *change));
        }
        if self.kept[0].is_none() {
            return;
        }
        if let Ok(mut news) = self.table.news.try_lock() {
            for one in self.kept.iter_mut().map_while(Option::take) {
                push(&mut news, one);
            }
            self.table.waits.store(true, Ordering::Release);
        }
    }

    /// Says what is left, at the end.
    pub fn close(mut self) {
        say(&self.table, &self.names);
        for (time, change) in self.kept.iter_mut().filter_map(Option::take) {
            tell("change", &self.names.sentence(time, &change));
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
    for (time, change) in found.into_iter().flatten() {
        tell("change", &names.sentence(time, &change));
    }
}

impl Names {
    fn of(model: &TorqueModel) -> Self {
        let joints = model.robot().joints().iter();
        Self {
            joints: joints.map(|joint| joint.name.clone()).collect(),
            torque_unit: model.torque_unit().to_owned(),
        }
    }

    fn joint(&self, joint: usize) -> &str {
        self.joints.get(joint).map_or("?", String::as_str)
    }

    /// As `dynid watch` says it.
    fn sentence(&self, time: f64, change: &Change) -> String {
        let joint = self.joint(change.joint);
        let (low, high) = (
            change.size - INTERVAL * change.std,
            change.size + INTERVAL * change.std,
        );
        let percent = |x: f64| format!("{:+.1} %", 100.0 * x);
        let what = match change.kind {
            Kind::Friction | Kind::Gain => format!(
                "{joint}: {} {} ({} to {})",
                change.kind.word(),
                percent(change.size),
                percent(low),
                percent(high)
            ),
            Kind::Offset => format!(
                "{joint}: constant torque {:.3e} ({low:.3e} to {high:.3e}) {}",
                change.size, self.torque_unit
            ),
            Kind::Load => format!(
                "load {:.3} ({low:.3} to {high:.3}) kg{}",
                change.size,
                if self.torque_unit == "N*m" {
                    ""
                } else {
                    " times what the channel shows per N m"
                }
            ),
            Kind::Unknown => format!(
                "{joint}: the error has grown by {}, no name says why: look again",
                percent(change.size)
            ),
        };
        let or = change.or.map_or(String::new(), |(kind, j)| match kind {
            Kind::Load => ", or a load".to_owned(),
            Kind::Offset => format!(", or constant torque of {}", self.joint(j)),
            kind => format!(", or {} of {}", kind.word(), self.joint(j)),
        });
        let when = if time.is_finite() {
            format!("{time:.1} s: ")
        } else {
            String::new()
        };
        let said = match change.said {
            Said::Named => String::new(),
            said => format!(" ({})", said.word()),
        };
        format!("{when}{what}{or}{said}")
    }
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
        assert!(names
            .sentence(1.0, &change(Kind::Offset, 1.0))
            .contains("constant torque 1.000e0"));
    }

    #[test]
    fn news_waits_for_its_reader_and_the_oldest_goes() {
        let mut news = [None; MOST];
        for k in 0..MOST + 3 {
            push(&mut news, (k as f64, change(Kind::Gain, 0.1)));
        }
        let times: Vec<f64> = news.iter().flatten().map(|(time, _)| *time).collect();
        assert_eq!(times, [3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0]);
    }

    #[test]
    fn what_finds_the_lock_taken_is_laid_down_later() {
        let (table, names) = (Arc::new(Table::default()), Arc::new(Names::of(&model(1.0))));
        let mut outbox = Outbox {
            table: Arc::clone(&table),
            kept: [None; MOST],
            names,
        };
        let taken = table.news.lock().unwrap();
        outbox.put(1.0, Some(&change(Kind::Gain, 0.1)));
        assert!(outbox.kept[0].is_some());
        drop(taken);
        outbox.put(2.0, None);
        assert!(outbox.kept[0].is_none() && table.waits.load(Ordering::Acquire));
        assert!(table.news.lock().unwrap()[0].is_some_and(|(time, _)| time == 1.0));
        say(&table, &outbox.names);
        assert!(table.news.lock().unwrap()[0].is_none());
    }
}
