//! What watch and adaptation know, kept over a restart: the loop lays it down after each of their rows, a second thread writes it.
//!
//! As in `changes.rs` the loop only tries a lock; nothing is allocated, nobody is woken.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::thread;
use std::time::Duration;

use dynid_io::remembered::{digits_of, Identity};
use dynid_io::{check_replaceable, load_remembered, ModelFileError, Remembered};

use crate::cycle::{Cycle, Settings};
use crate::run::tell;
use crate::stop::Stop;

/// How often the file is written: what a program that is killed forgets.
const PAUSE: Duration = Duration::from_secs(10);

/// What was laid down last.
#[derive(Debug)]
struct Page {
    of: Identity,
    numbers: Vec<f64>,
    /// Not written yet.
    waits: bool,
}

#[derive(Debug)]
struct Desk {
    path: PathBuf,
    page: Mutex<Page>,
    /// Of those who write; the loop never takes this one. Whether the last of them could not.
    refused: Mutex<bool>,
}

/// The loop's side. What was not written yet is when it is dropped.
#[derive(Debug)]
pub struct Notebook {
    desk: Arc<Desk>,
    /// Rows that were finished.
    rows: u64,
}

impl Notebook {
    /// Lets watch and adaptation go on with what the file holds, if it is of the same model and settings, and starts the thread that
    /// writes it, which ends with the program. None if nothing is to be remembered.
    ///
    /// # Errors
    /// [`Stop`] if something else than what is remembered is in the file's place.
    pub fn open(cycle: &mut Cycle, settings: &Settings) -> Result<Option<Self>, Stop> {
        let identity = *cycle.identity();
        let (Some(path), Some(length)) = (&settings.remember, cycle.n_remembered()) else {
            return Ok(None);
        };
        let because =
            |words: &str| Stop::Because(format!("--remember: {}: {words}", path.display()));
        check_replaceable(path).map_err(|error| because(&error.to_string()))?;
        if path.exists() {
            let found = load_remembered(path)?;
            if found.of != digits_of(&identity) {
                let what = names_of(settings);
                tell(
                    "note",
                    &format!(
                        "{}: of another model, or of other settings: the {what} begins anew",
                        path.display()
                    ),
                );
            } else if cycle.recall(&found.numbers).is_err() {
                return Err(because(&format!(
                    "numbers that no {} remembers; name another file, or remove this one to begin anew",
                    names_of(settings)
                )));
            }
        }
        let desk = Arc::new(Desk {
            path: path.clone(),
            page: Mutex::new(Page {
                of: identity,
                // Written to, so that its pages are there.
                numbers: vec![f64::NAN; length],
                waits: false,
            }),
            refused: Mutex::new(false),
        });
        let theirs = Arc::clone(&desk);
        let started = thread::Builder::new()
            .name("remember".into())
            .spawn(move || loop {
                thread::sleep(PAUSE);
                let _ = theirs.write(false);
            });
        if let Err(error) = started {
            tell(
                "error",
                &format!("--remember: {error}; the file is written at the end"),
            );
        }
        let rows = cycle.n_rows();
        Ok(Some(Self { desk, rows }))
    }

    /// Lays down what is known, once another row was judged.
    pub fn note(&mut self, cycle: &mut Cycle) {
        let identity = *cycle.identity();
        let rows = cycle.n_rows();
        if rows == self.rows {
            return;
        }
        if let Ok(mut page) = self.desk.page.try_lock() {
            // A model that came in between has the same joints, so as many numbers are remembered.
            if cycle.remember(&mut page.numbers) == Ok(true) {
                self.rows = rows;
                page.of = identity;
                page.waits = true;
            }
        }
    }

    /// Writes what was not written yet.
    ///
    /// # Errors
    /// [`Stop`] if it cannot be: what was learned since the file was written last is lost.
    pub fn end(self) -> Result<(), Stop> {
        self.desk.write(true).map_err(|error| {
            self.desk.page().waits = false; // said, and not tried once more
            Stop::Because(format!("--remember: {error}"))
        })
    }
}

/// What learns.
fn names_of(settings: &Settings) -> &'static str {
    match (&settings.watch, &settings.adapt) {
        (Some(_), Some(_)) => "watch and adaptation",
        (None, Some(_)) => "adaptation",
        _ => "watch",
    }
}

impl Drop for Notebook {
    fn drop(&mut self) {
        if let Err(error) = self.desk.write(true) {
            tell("error", &format!("--remember: {error}"));
        }
    }
}

impl Desk {
    /// Writes what was laid down since it was written last. That it cannot be is said once; the last time by the caller.
    fn write(&self, is_last: bool) -> Result<(), ModelFileError> {
        // Held until the file is there: the program does not end in between.
        let mut refused = self.refused.lock().unwrap_or_else(PoisonError::into_inner);
        let page = {
            let mut page = self.page();
            if !std::mem::take(&mut page.waits) {
                return Ok(());
            }
            Remembered {
                of: digits_of(&page.of),
                numbers: page.numbers.clone(),
            }
        };
        let done = page.save(&self.path);
        if let Err(error) = &done {
            self.page().waits = true;
            if !is_last && !*refused {
                tell("error", &format!("--remember: {error}"));
            }
        }
        *refused = done.is_err();
        done
    }

    /// Never makes the loop wake anybody: it is tried for, not waited for.
    fn page(&self) -> MutexGuard<'_, Page> {
        loop {
            match self.page.try_lock() {
                Ok(page) => return page,
                Err(TryLockError::Poisoned(page)) => return page.into_inner(),
                Err(TryLockError::WouldBlock) => thread::sleep(Duration::from_micros(50)),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::tests::model;
    use dynid_core::watch::{Healthy, WatchSettings};
    use dynid_core::Sample;
    use dynid_io::WatchFile;

    fn settings(path: PathBuf) -> Settings {
        let watch = WatchFile {
            joints: vec!["joint".to_owned()],
            settings: WatchSettings::default(),
            healthy: Healthy::untold(1),
        };
        Settings {
            watch: Some(Arc::new(watch)),
            remember: Some(path),
            ..Settings::default()
        }
    }

    fn go_on(cycle: &mut Cycle, notebook: &mut Notebook, from: u32) {
        for k in from..from + 1000 {
            let speed = 0.9 + 0.1 * (0.01 * f64::from(k)).sin();
            let sample = Sample {
                sequence: None,
                time: 0.001 * f64::from(k),
                motion: [Some(&[0.5]), Some(&[speed]), Some(&[0.1]), None, None, None],
                temperature: None,
                tau: Some(&[1.0]),
            };
            cycle.step(&sample).unwrap();
            notebook.note(cycle);
        }
    }

    #[test]
    fn a_page_is_written_at_the_end_and_read_at_the_beginning() {
        let folder = tempfile::tempdir().unwrap();
        let settings = settings(folder.path().join("known.json"));
        let path = settings.remember.clone().unwrap();
        let mut cycle = Cycle::new(model(1.0), &settings).unwrap();
        let mut notebook = Notebook::open(&mut cycle, &settings).unwrap().unwrap();
        drop(Notebook::open(&mut cycle, &settings));
        assert!(!path.exists(), "nothing was learnt yet");
        go_on(&mut cycle, &mut notebook, 0);
        drop(notebook);
        let first = load_remembered(&path).unwrap();
        assert_eq!(first.of, digits_of(cycle.identity()));
        let mut again = Cycle::new(model(1.0), &settings).unwrap();
        let notebook = Notebook::open(&mut again, &settings).unwrap();
        let mut numbers = vec![0.0; first.numbers.len()];
        again.remember(&mut numbers).unwrap();
        assert_eq!(numbers, first.numbers);
        drop(notebook);
        assert_eq!(load_remembered(&path).unwrap(), first);
        // Another model begins anew, and what it learns is its own.
        let mut other = Cycle::new(model(1.1), &settings).unwrap();
        let mut notebook = Notebook::open(&mut other, &settings).unwrap().unwrap();
        go_on(&mut other, &mut notebook, 0);
        // The first one comes back in between.
        other.swap(&mut again);
        go_on(&mut other, &mut notebook, 1000);
        drop(notebook);
        let last = load_remembered(&path).unwrap();
        assert_eq!(last.of, first.of);
        assert_ne!(last.numbers, first.numbers);
    }

    #[test]
    fn what_could_not_be_written_is_written_later() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("inner");
        std::fs::create_dir(&inner).unwrap();
        let settings = settings(inner.join("known.json"));
        let path = settings.remember.clone().unwrap();
        let mut cycle = Cycle::new(model(1.0), &settings).unwrap();
        let mut notebook = Notebook::open(&mut cycle, &settings).unwrap().unwrap();
        go_on(&mut cycle, &mut notebook, 0);
        std::fs::remove_dir(&inner).unwrap();
        assert!(notebook.desk.write(false).is_err());
        assert!(!path.exists() && *notebook.desk.refused.lock().unwrap());
        std::fs::create_dir(&inner).unwrap();
        assert!(notebook.end().is_ok() && path.exists());
    }

    #[test]
    fn what_finds_the_lock_taken_is_laid_down_later() {
        let folder = tempfile::tempdir().unwrap();
        let settings = settings(folder.path().join("known.json"));
        let mut cycle = Cycle::new(model(1.0), &settings).unwrap();
        let mut notebook = Notebook::open(&mut cycle, &settings).unwrap().unwrap();
        let desk = Arc::clone(&notebook.desk);
        let taken = desk.page.lock().unwrap();
        go_on(&mut cycle, &mut notebook, 0);
        assert!(!taken.waits);
        drop(taken);
        go_on(&mut cycle, &mut notebook, 1000);
        assert!(desk.page.lock().unwrap().waits);
    }
}
