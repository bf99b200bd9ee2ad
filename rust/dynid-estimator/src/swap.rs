//! Another model between two cycles: a second thread watches the file, reads it, and lays a finished estimator ready; the
//! loop exchanges two pointers.

use std::fs;
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, TryLockError};
use std::thread;
use std::time::{Duration, SystemTime};

use dynid_core::TorqueModel;

use crate::cycle::{Cycle, Settings};
use crate::run::tell;
use crate::sys;

/// How often the file is looked at. A change is read once the file has stayed the same from one look to the next; a file
/// that SIGHUP asks for, at the next look.
const LOOK: Duration = Duration::from_millis(100);

/// Where the two threads meet. The loop only tries the lock, and the other one only holds it to move pointers, so the loop
/// neither waits nor calls the system.
#[derive(Debug, Default)]
struct Table {
    offered: AtomicBool,
    slot: Mutex<Slot>,
}

#[derive(Debug, Default)]
struct Slot {
    /// For the loop: an estimator and the twin that it is rehearsed on.
    ready: Option<Box<[Cycle; 2]>>,
    /// From the loop, to be freed elsewhere.
    done: Option<Box<[Cycle; 2]>>,
}

/// The loop's side.
#[derive(Debug)]
pub struct Inbox(Arc<Table>);

impl Inbox {
    /// Goes on with the new model, if one lies ready.
    pub fn take(&self, cycle: &mut Cycle, twin: &mut Cycle) {
        if !self.0.offered.load(Ordering::Acquire) {
            return;
        }
        let Ok(mut slot) = self.0.slot.try_lock() else {
            return; // in the next cycle then
        };
        if let Some(mut new) = slot.ready.take() {
            let [of_cycle, of_twin] = &mut *new;
            cycle.swap(of_cycle);
            twin.swap(of_twin);
            slot.done = Some(new);
        }
        self.0.offered.store(false, Ordering::Release);
    }
}

#[cfg(test)]
impl Inbox {
    /// An inbox that only a test fills.
    pub fn empty() -> Self {
        Self(Arc::default())
    }

    /// Lays another model ready.
    pub fn offer(&self, cycle: Cycle) {
        lock(&self.0).ready = Some(Box::new([cycle.clone(), cycle]));
        self.0.offered.store(true, Ordering::Release);
    }
}

/// What a file was like: when it was written, how long it is.
type Stamp = (Option<SystemTime>, u64);

fn stamp(path: &Path) -> Option<Stamp> {
    let data = fs::metadata(path).ok()?;
    Some((data.modified().ok(), data.len()))
}

/// Watches `path`, the file of `model`, from now on. A file that is no model, or one of another robot, is refused with a
/// sentence, and the old model stays. `same_terms`: answers stand in columns that cannot change.
pub fn watch(
    path: PathBuf,
    model: Arc<TorqueModel>,
    settings: Settings,
    same_terms: bool,
) -> Inbox {
    let table = Arc::new(Table::default());
    let inbox = Inbox(Arc::clone(&table));
    let mut read = stamp(&path);
    // Ends with the program; a thread that cannot be started leaves the model as it is.
    let started = thread::Builder::new().name("watch".into()).spawn(move || {
        let mut before = read;
        loop {
            thread::sleep(LOOK);
            free_what_is_done(&table);
            let asked = sys::reload_asked();
            let now = stamp(&path);
            let settled = now.is_some() && now == before;
            before = now;
            if !asked && (!settled || now == read) {
                continue;
            }
            read = now;
            // A first step is taken there: a model that could panic does so here, and is refused.
            let found = catch_unwind(|| load(&path, &model, &settings, same_terms));
            let found =
                found.unwrap_or_else(|_| Err(format!("{}: its first step failed", path.display())));
            match found {
                Ok(new) => {
                    lock(&table).ready = Some(new);
                    table.offered.store(true, Ordering::Release);
                    tell(
                        "note",
                        &format!("{}: the new model is used from now on", path.display()),
                    );
                }
                Err(sentence) => tell("error", &format!("{sentence}; the old model stays")),
            }
        }
    });
    if let Err(error) = started {
        tell(
            "error",
            &format!("--watch: {error}; the model stays as it is"),
        );
    }
    inbox
}

fn free_what_is_done(table: &Table) {
    drop(lock(table).done.take());
}

/// Never makes the loop wake anybody: it is tried for, not waited for.
fn lock(table: &Table) -> MutexGuard<'_, Slot> {
    loop {
        match table.slot.try_lock() {
            Ok(slot) => return slot,
            Err(TryLockError::Poisoned(slot)) => return slot.into_inner(),
            Err(TryLockError::WouldBlock) => thread::sleep(Duration::from_micros(50)),
        }
    }
}

fn load(
    path: &Path,
    old: &TorqueModel,
    settings: &Settings,
    same_terms: bool,
) -> Result<Box<[Cycle; 2]>, String> {
    let new = dynid_io::load(path).map_err(|error| error.to_string())?;
    let names = |model: &TorqueModel| -> Vec<String> {
        model
            .robot()
            .joints()
            .iter()
            .map(|joint| joint.name.clone())
            .collect()
    };
    let differs = if names(&new) != names(old) {
        "joints"
    } else if new.torque_unit() != old.torque_unit() {
        "torque unit"
    } else if same_terms && new.term_names() != old.term_names() {
        "terms"
    } else if new.n_terms() > MOST_TERMS.max(old.n_terms()) {
        "number of terms"
    } else {
        let cycle = Cycle::new(Arc::new(new), settings);
        return cycle
            .map(|cycle| {
                let cycle = cycle.warm();
                // A copy's pages are written to, so the twin's are in place too.
                Box::new([cycle.clone(), cycle])
            })
            .map_err(|stop| stop.to_string());
    };
    Err(format!(
        "{}: the {differs} are not those of the model that runs",
        path.display()
    ))
}

/// Answers have room for so many terms, so that a new model may have more than the old one.
pub const MOST_TERMS: usize = 40;
