//! Files written whole or not at all, in the place of files only.

use std::ffi::OsStr;
use std::fs::{self, File, FileType};
use std::hash::{BuildHasher, RandomState};
use std::io::{self, ErrorKind, Write};
use std::path::Path;

use tempfile::{Builder, NamedTempFile};

use crate::text::shorten_to;

/// Begins the name of what is being written, as in the Python package, which clears what killed processes left too.
const MARK: &str = ".dynid-";
/// Hexadecimal digits behind it.
const N_DIGITS: usize = 12;

/// Refuses a place that holds anything but a file: renaming over a device would put a file in its place for everybody.
///
/// # Errors
/// [`ErrorKind::IsADirectory`] or [`ErrorKind::AlreadyExists`], the text half a sentence: what is there, and the mend.
/// Other errors are the system's.
pub fn check_replaceable(path: &Path) -> io::Result<()> {
    let found = match fs::symlink_metadata(path) {
        Ok(found) => found.file_type(),
        // Whether its folder is one shows when the file is written.
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            return Ok(())
        }
        Err(error) => return Err(error),
    };
    if found.is_file() {
        return Ok(());
    }
    if found.is_dir() {
        return Err(io::Error::new(
            ErrorKind::IsADirectory,
            "this is a folder, where a file is to be written; name a file, or remove it",
        ));
    }
    let words = if found.is_symlink() {
        let aim = fs::read_link(path)?;
        format!(
            "this is a symbolic link to {}; name the file it points to, or remove the link",
            shorten_to(&aim.display().to_string(), 80)
        )
    } else {
        format!(
            "this is {}, and a file would take its place; name another one",
            kind(found)
        )
    };
    Err(io::Error::new(ErrorKind::AlreadyExists, words))
}

#[cfg(unix)]
fn kind(found: FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    if found.is_fifo() {
        "a pipe"
    } else if found.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

#[cfg(not(unix))]
fn kind(_found: FileType) -> &'static str {
    "no file"
}

/// Writes to a temporary file beside `path`, which is then renamed: who reads sees the old file or the whole new one.
///
/// # Errors
/// [`check_replaceable`]'s; [`ErrorKind::NotFound`], the text half a sentence, without the folder; or the system's.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    check_replaceable(path)?;
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    if !folder.exists() {
        // Of the temporary file, which nobody has asked for, the system would say so.
        let words = format!(
            "the folder {} does not exist; create it first",
            folder.display()
        );
        return Err(io::Error::new(ErrorKind::NotFound, words));
    }
    clear_leftovers(folder);
    let mut file = held_file(folder, path.extension())?;
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    file.persist(path)?;
    Ok(())
}

/// A new file that is locked as long as it is open.
fn held_file(folder: &Path, extension: Option<&OsStr>) -> io::Result<NamedTempFile> {
    let suffix = extension.map_or_else(Default::default, |extension| {
        let mut suffix = OsStr::new(".").to_owned();
        suffix.push(extension);
        suffix
    });
    loop {
        let random = RandomState::new().hash_one(MARK) & ((1 << (4 * N_DIGITS)) - 1);
        let name = format!("{MARK}{random:0N_DIGITS$x}");
        let mut builder = Builder::new();
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(fs::Permissions::from_mode(0o644));
        }
        builder.prefix(&name).suffix(&suffix).rand_bytes(0);
        let file = builder
            .tempfile_in(folder)
            .map_err(|error| of_the_system(&error))?;
        // Where there are no locks, nobody clears. Another process may have cleared before this lock was there.
        let _ = file.as_file().try_lock();
        if file.path().exists() {
            return Ok(file);
        }
    }
}

/// What the system said, without the name of a temporary file that nobody has asked for.
fn of_the_system(error: &io::Error) -> io::Error {
    error.kind().into()
}

/// Removes the files that dead processes left half written; a lock ends with its process, however that ends.
fn clear_leftovers(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        if !is_temporary(&entry.file_name()) || !entry.file_type().is_ok_and(|kind| kind.is_file())
        {
            continue;
        }
        // Writable: network file systems lock nothing else.
        let Ok(file) = File::options().read(true).write(true).open(entry.path()) else {
            continue;
        };
        if file.try_lock().is_ok() {
            let _ = fs::remove_file(entry.path());
        }
    }
}

fn is_temporary(name: &OsStr) -> bool {
    let digits = name.to_str().and_then(|name| name.strip_prefix(MARK));
    digits.is_some_and(|rest| {
        let (digits, suffix) = rest.split_at_checked(N_DIGITS).unwrap_or((rest, ""));
        digits.len() == N_DIGITS
            && digits
                .bytes()
                .all(|digit| matches!(digit, b'0'..=b'9' | b'a'..=b'f'))
            && (suffix.is_empty() || suffix.starts_with('.'))
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let name =
            |entry: io::Result<fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
        let mut names: Vec<String> = fs::read_dir(folder).unwrap().map(name).collect();
        names.sort();
        names
    }

    #[test]
    fn readers_keep_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let (path, other) = (folder.path().join("a.json"), folder.path().join("b"));
        write_whole(&path, b"the old one").unwrap();
        fs::hard_link(&path, &other).unwrap();
        write_whole(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read(&other).unwrap(), b"the old one");
        assert_eq!(names(folder.path()), ["a.json", "b"]);
    }

    #[test]
    fn what_fails_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("none").join("a");
        assert_eq!(
            write_whole(&path, b"x").unwrap_err().kind(),
            ErrorKind::NotFound
        );
        fs::create_dir(folder.path().join("none")).unwrap();
        assert!(write_whole(&folder.path().join("none"), b"x").is_err());
        assert_eq!(names(folder.path()), ["none"]);
    }

    #[cfg(unix)]
    #[test]
    fn only_files_are_replaced() {
        use std::os::unix::fs::symlink;
        use std::os::unix::net::UnixListener;

        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("precious"), "not yours").unwrap();
        symlink("precious", at("link")).unwrap();
        symlink("nowhere", at("dangling")).unwrap();
        fs::create_dir(at("folder")).unwrap();
        let _socket = UnixListener::bind(at("socket")).unwrap();
        let before = names(folder.path());
        for (name, words) in [
            ("link", "a symbolic link to precious; name the file"),
            ("dangling", "a symbolic link to nowhere; name the file"),
            ("folder", "this is a folder"),
            ("socket", "this is a socket"),
        ] {
            let error = write_whole(&at(name), b"x").unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        let error = check_replaceable(Path::new("/dev/null")).unwrap_err();
        assert!(error.to_string().contains("this is a device"), "{error}");
        assert_eq!(names(folder.path()), before);
        assert_eq!(fs::read(at("precious")).unwrap(), b"not yours");
        assert!(fs::symlink_metadata(at("link")).unwrap().is_symlink());
    }

    #[test]
    fn leftovers_go_and_what_is_being_written_stays() {
        let folder = tempfile::tempdir().unwrap();
        let kept = [
            ".dynid-0123456789",
            ".dynid-0123456789abc.json",
            ".dynid-notes",
            "a",
        ];
        for name in [
            &kept[..3],
            &[".dynid-0123456789ab", ".dynid-0123456789ab.json"],
        ]
        .concat()
        {
            fs::write(folder.path().join(name), "").unwrap();
        }
        let alive = held_file(folder.path(), Some(OsStr::new("json"))).unwrap();
        write_whole(&folder.path().join("a"), b"x").unwrap();
        assert!(is_temporary(alive.path().file_name().unwrap()));
        assert!(alive.path().exists());
        drop(alive);
        assert_eq!(names(folder.path()), kept);
    }
}
