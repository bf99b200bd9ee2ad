//! Shared memory: two slots of one file, each written by one process and read by the other without locks.
//!
//! ```text
//!  0  "DYNM", u16 version 1, u16 n_joints
//!  8  u32 place of the state slot, u32 its most bytes
//! 16  u32 place of the answer slot, u32 its most bytes
//! slot:  u64 counter, u64 bytes, then the bytes as on the wire, in whole words
//! ```
//!
//! A slot is a seqlock: its counter is odd while it is written and goes up by two with every message. Who reads takes the
//! counter, the bytes, the counter again, and believes the bytes if it was even and the same.

use std::fs::{File, TryLockError};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{fence, AtomicU64, Ordering};

use crate::stop::Stop;
use crate::sys;
use crate::wire;

const MAGIC: [u8; 4] = *b"DYNM";
const VERSION: u16 = 1;

/// Bytes of a cache line: slots do not share one.
const LINE: usize = 64;

/// Reads are tried so often within a cycle.
const TRIES: usize = 8;

/// One slot: counter, length, words.
#[derive(Clone, Copy, Debug)]
struct Slot {
    words: &'static [AtomicU64],
}

impl Slot {
    fn parts(&self) -> Option<(&AtomicU64, &AtomicU64, &[AtomicU64])> {
        match self.words {
            [counter, length, words @ ..] => Some((counter, length, words)),
            _ => None,
        }
    }

    /// Copies a message that is newer than counter `seen`; `None` if there is none, or it is being written.
    fn read(&self, seen: &mut u64, out: &mut [u8]) -> Option<usize> {
        let (counter, length, words) = self.parts()?;
        for _ in 0..TRIES {
            let before = counter.load(Ordering::Acquire);
            if before == *seen {
                return None;
            }
            if before % 2 == 1 {
                std::hint::spin_loop();
                continue;
            }
            let length = length.load(Ordering::Relaxed) as usize;
            let places = out.as_chunks_mut::<8>().0.iter_mut();
            for (place, word) in places.zip(words).take(length.div_ceil(8)) {
                *place = word.load(Ordering::Relaxed).to_le_bytes();
            }
            fence(Ordering::Acquire);
            if counter.load(Ordering::Relaxed) == before {
                *seen = before;
                return (length <= out.len()).then_some(length);
            }
        }
        None
    }

    /// Writes a message of whole words.
    fn write(&self, bytes: &[u8]) {
        let Some((counter, length, words)) = self.parts() else {
            return;
        };
        // Odd, also where a writer before us died within a message.
        let writing = counter.load(Ordering::Relaxed) | 1;
        counter.store(writing, Ordering::Relaxed);
        fence(Ordering::Release);
        length.store(bytes.len() as u64, Ordering::Relaxed);
        for (word, bytes) in words.iter().zip(bytes.as_chunks::<8>().0) {
            word.store(u64::from_le_bytes(*bytes), Ordering::Relaxed);
        }
        counter.store(writing.wrapping_add(1), Ordering::Release);
    }
}

/// The estimator's end of the file.
#[derive(Debug)]
pub struct SharedMemory {
    state: Slot,
    answer: Slot,
    seen: u64,
    /// Holds the lock: one estimator per file.
    _file: File,
}

/// A name without a folder stands for a file in memory.
pub fn path_of(name: &Path) -> PathBuf {
    match name.parent() {
        Some(folder) if folder.as_os_str().is_empty() => Path::new("/dev/shm").join(name),
        _ => name.to_owned(),
    }
}

/// Why a file is not to be written into, if it is not ours; an empty one holds nothing that could be lost.
fn foreign(mut file: &File) -> io::Result<Option<String>> {
    if let Some(owner) = sys::other_owner(file)? {
        return Ok(Some(format!(
            "belongs to another user (number {owner}); give another name"
        )));
    }
    let (found, mut begin) = (file.metadata()?, [0; MAGIC.len()]);
    if !found.is_file() {
        return Ok(Some("this is no file; give another name".to_owned()));
    }
    if found.len() == 0 {
        return Ok(None);
    }
    let ours = match file.read_exact(&mut begin) {
        Ok(()) => begin == MAGIC,
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => false,
        Err(error) => return Err(error),
    };
    Ok((!ours).then(|| {
        "no estimator made this file, and it would be overwritten; give another name, or remove it".to_owned()
    }))
}

impl SharedMemory {
    /// Creates the file or takes over one that an earlier estimator left, so that whoever has it mapped goes on.
    ///
    /// # Errors
    /// [`Stop`] if the file cannot be made, is another program's or another user's, or another estimator has it.
    pub fn create(name: &Path, n_joints: usize, most_terms: usize) -> Result<Self, Stop> {
        let path = path_of(name);
        let refusal = |words: &str| Stop::Because(format!("{}: {words}", path.display()));
        let sentence = |error: &io::Error| refusal(&error.to_string());
        dynid_io::check_replaceable(&path).map_err(|error| sentence(&error))?;
        // Opened twice: a mapping would keep the lock of its own file for as long as the program runs.
        let open = || sys::open_own(&path).map_err(|error| sentence(&error));
        let (file, mapped) = (open()?, open()?);
        if !sys::is_same_file(&file, &mapped).map_err(|error| sentence(&error))? {
            return Err(refusal("another file took its place; try again"));
        }
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(refusal("another estimator answers here; give another name"))
            }
            Err(TryLockError::Error(error)) => return Err(sentence(&error)),
        }
        // Under the lock: an estimator that has just made it has written nothing yet.
        if let Some(words) = foreign(&file).map_err(|error| sentence(&error))? {
            return Err(refusal(&words));
        }
        let lines = |bytes: usize| bytes.div_ceil(LINE) * LINE;
        let state_bytes = wire::most_state_bytes(n_joints);
        let answer_bytes = wire::answer_bytes(n_joints, most_terms);
        let state_at = LINE;
        let answer_at = state_at + lines(16 + state_bytes);
        let total = answer_at + lines(16 + answer_bytes);
        // Never shorter: somebody may have the old length mapped.
        let longest = file
            .metadata()
            .map_err(|error| sentence(&error))?
            .len()
            .max(total as u64);
        file.set_len(longest).map_err(|error| sentence(&error))?;
        let words = sys::map_shared(&mapped, total / 8).map_err(|error| sentence(&error))?;
        let slot = |at: usize, bytes: usize| Slot {
            words: &words[at / 8..(at + 16 + bytes) / 8],
        };
        let memory = Self {
            state: slot(state_at, state_bytes),
            answer: slot(answer_at, answer_bytes),
            seen: 0,
            _file: file,
        };
        let pair = |a: usize, b: usize| (a as u64) | (b as u64) << 32;
        words[1].store(pair(state_at, state_bytes), Ordering::Relaxed);
        words[2].store(pair(answer_at, answer_bytes), Ordering::Relaxed);
        let [a, b, c, d] = MAGIC;
        let ([e, f], [g, h]) = (VERSION.to_le_bytes(), (n_joints as u16).to_le_bytes());
        // Last: who finds the magic finds the places.
        words[0].store(
            u64::from_le_bytes([a, b, c, d, e, f, g, h]),
            Ordering::Release,
        );
        Ok(memory.without_what_was_left())
    }

    /// A message from before this start is not new.
    fn without_what_was_left(mut self) -> Self {
        if let Some((counter, ..)) = self.state.parts() {
            self.seen = counter.load(Ordering::Acquire) & !1;
        }
        self
    }

    /// The newest state, if it is newer than the last one; how many bytes it has.
    pub fn receive(&mut self, out: &mut [u8]) -> Option<usize> {
        self.state.read(&mut self.seen, out)
    }

    /// The newest state, whether it was received or not; it stays as new as it was. `None` if nobody ever wrote one.
    pub fn look(&self, out: &mut [u8]) -> Option<usize> {
        let mut nothing = 0; // a slot's counter before its first message
        let length = self.state.read(&mut nothing, out);
        length.filter(|length| *length > 0)
    }

    /// Leaves an answer.
    pub fn send(&self, bytes: &[u8]) {
        self.answer.write(bytes);
    }
}

/// A state slot in plain memory, for [`crate::fuzzing`]: the reader's half of [`SharedMemory`].
#[derive(Debug)]
pub struct Scratch {
    state: Slot,
    seen: u64,
}

impl Scratch {
    /// A slot as [`SharedMemory::create`] cuts it, never given back.
    pub fn new(n_joints: usize) -> Self {
        let words = (16 + wire::most_state_bytes(n_joints)).div_ceil(8);
        let words: Vec<AtomicU64> = (0..words).map(|_| AtomicU64::new(0)).collect();
        Self {
            state: Slot {
                words: words.leak(),
            },
            seen: 0,
        }
    }

    /// Counter, length, and the message's words.
    pub fn words(&self) -> &[AtomicU64] {
        self.state.words
    }

    /// As [`SharedMemory::receive`].
    pub fn receive(&mut self, out: &mut [u8]) -> Option<usize> {
        self.state.read(&mut self.seen, out)
    }
}

#[cfg(test)]
impl SharedMemory {
    /// What the other end does.
    pub fn write_state(&self, bytes: &[u8]) {
        self.state.write(bytes);
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::fs;
    use std::os::unix::fs::{chown, symlink, MetadataExt, PermissionsExt};
    use std::os::unix::net::UnixListener;

    use super::*;

    fn slot(words: usize) -> Slot {
        let file = tempfile::tempfile().unwrap();
        file.set_len(8 * words as u64).unwrap();
        Slot {
            words: sys::map_shared(&file, words).unwrap(),
        }
    }

    #[test]
    fn a_message_comes_once_and_whole() {
        let (slot, mut seen, mut out) = (slot(6), 0, [0; 32]);
        assert_eq!(slot.read(&mut seen, &mut out), None);
        slot.write(&[7; 24]);
        assert_eq!(slot.read(&mut seen, &mut out), Some(24));
        assert_eq!(out[..25], [[7; 24].as_slice(), &[0]].concat());
        assert_eq!(slot.read(&mut seen, &mut out), None);
        // A writer that died in the middle, and the next one.
        slot.words[0].fetch_add(1, Ordering::Relaxed);
        assert_eq!(slot.read(&mut seen, &mut out), None);
        slot.write(&[8; 16]);
        assert_eq!(slot.read(&mut seen, &mut out), Some(16));
        // A length that is none.
        slot.words[1].store(u64::MAX, Ordering::Relaxed);
        slot.words[0].fetch_add(2, Ordering::Relaxed);
        assert_eq!(slot.read(&mut seen, &mut out), None);
    }

    #[test]
    fn a_look_takes_nothing_away_and_finds_nothing_in_a_fresh_slot() {
        let folder = tempfile::tempdir().unwrap();
        let mut memory = SharedMemory::create(&folder.path().join("slot"), 6, 20).unwrap();
        let mut out = [0; 64];
        assert_eq!(memory.look(&mut out), None);
        memory.write_state(&[7; 24]);
        assert_eq!(memory.look(&mut out), Some(24));
        assert_eq!(memory.look(&mut out), Some(24));
        assert_eq!(memory.receive(&mut out), Some(24));
        assert_eq!(
            (memory.receive(&mut out), memory.look(&mut out)),
            (None, Some(24))
        );
        memory.write_state(&[]);
        assert_eq!(memory.look(&mut out), None);
    }

    #[test]
    fn no_message_is_torn() {
        let slot = slot(2 + 64);
        let writer = std::thread::spawn(move || {
            for k in 0..200_000_u64 {
                slot.write(&[k as u8; 512]);
            }
        });
        let (mut seen, mut out, mut messages) = (0, [0; 512], 0);
        while !writer.is_finished() || messages == 0 {
            if let Some(length) = slot.read(&mut seen, &mut out) {
                messages += 1;
                assert_eq!(length, 512);
                assert!(out.iter().all(|byte| *byte == out[0]));
            }
        }
        writer.join().unwrap();
        // A reader that had to wait may have missed any number, but not the last one.
        slot.read(&mut seen, &mut out);
        assert_eq!(seen, 400_000);
    }

    fn refusal(path: &Path) -> String {
        let before = fs::symlink_metadata(path).unwrap();
        let Err(Stop::Because(sentence)) = SharedMemory::create(path, 6, 20) else {
            panic!("{} is not ours", path.display());
        };
        let after = fs::symlink_metadata(path).unwrap();
        assert_eq!(
            (after.ino(), after.mode(), after.len()),
            (before.ino(), before.mode(), before.len())
        );
        assert!(sentence.starts_with(path.to_str().unwrap()), "{sentence}");
        sentence
    }

    #[test]
    fn what_is_not_ours_is_not_touched() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for content in [
            "D",
            "DYN",
            "somebody's own",
            &"x".repeat(10_000),
            "\0\0\0\0",
        ] {
            fs::write(at("precious"), content).unwrap();
            let sentence = refusal(&at("precious"));
            assert!(
                sentence.contains("no estimator made this file"),
                "{sentence}"
            );
            assert_eq!(fs::read_to_string(at("precious")).unwrap(), content);
        }
        symlink(at("precious"), at("link")).unwrap();
        symlink(at("nowhere"), at("dangling")).unwrap();
        fs::create_dir(at("folder")).unwrap();
        let _socket = UnixListener::bind(at("socket")).unwrap();
        for (name, words) in [
            ("link", "this is a symbolic link to "),
            ("dangling", "this is a symbolic link to "),
            ("folder", "this is a folder"),
            ("socket", "this is a socket"),
        ] {
            let sentence = refusal(&at(name));
            assert!(sentence.contains(words), "{sentence}");
        }
        assert!(!at("nowhere").exists());
        // What is found is believed less than the descriptor: a link that comes in between is not followed.
        assert!(sys::open_own(&at("link")).is_err());
        // A link to memory of ours is a link all the same.
        drop(SharedMemory::create(&at("ours"), 6, 20).unwrap());
        symlink(at("ours"), at("link to ours")).unwrap();
        assert!(refusal(&at("link to ours")).contains("this is a symbolic link to "));
    }

    #[test]
    fn a_file_of_another_user_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("slot");
        drop(SharedMemory::create(&path, 6, 20).unwrap());
        if let Err(error) = chown(&path, Some(12_345), None) {
            eprintln!("skipped: files cannot be given away here ({error})");
            return;
        }
        let sentence = refusal(&path);
        assert!(
            sentence.contains("belongs to another user (number 12345)"),
            "{sentence}"
        );
    }

    #[test]
    fn the_file_is_for_its_user_alone_and_taken_over_with_its_rights() {
        let folder = tempfile::tempdir().unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().mode() & 0o777;
        let path = folder.path().join("slot");
        drop(SharedMemory::create(&path, 6, 20).unwrap());
        assert_eq!(mode(&path), 0o600);
        // Whoever lets others in has meant it.
        fs::set_permissions(&path, fs::Permissions::from_mode(0o660)).unwrap();
        drop(SharedMemory::create(&path, 6, 20).unwrap());
        assert_eq!(mode(&path), 0o660);
        let empty = folder.path().join("empty");
        fs::write(&empty, "").unwrap();
        assert!(SharedMemory::create(&empty, 6, 20).is_ok());
    }

    #[test]
    fn one_estimator_per_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("slot");
        let first = SharedMemory::create(&path, 6, 20).unwrap();
        let Err(Stop::Because(sentence)) = SharedMemory::create(&path, 6, 20) else {
            panic!("two estimators on one file");
        };
        assert!(
            sentence.contains("another estimator answers here"),
            "{sentence}"
        );
        drop(first);
        assert!(SharedMemory::create(&path, 7, 20).is_ok());
        assert_eq!(path_of(Path::new("arm")), Path::new("/dev/shm/arm"));
        assert_eq!(path_of(Path::new("/tmp/arm")), Path::new("/tmp/arm"));
    }
}
