"""Files that belong together: a reader, a kill or a refusal finds all of the new ones or all of the old ones.

```text
.dynid-x/        filled; a killed run leaves nothing else, and it is thrown away
   | renamed
.dynid-x.whole/  from here on the new files count: whoever finds this folder goes on moving them
   | each renamed into its place; where the system refuses one, the old files are put back
folder/
```
"""

from __future__ import annotations

import os
import re
import shutil
import stat
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

if sys.platform != "win32":
    import fcntl

COMMITTED = ".whole"
"""End of the name of a folder whose files are all there and are being moved."""

_JOURNAL = re.compile(r"\.dynid-[0-9a-f]{12}" + re.escape(COMMITTED))
_OLD = ".old"
"""Folder in it for what the new files replace."""


def place(stage: Path, folder: Path) -> None:
    """Move all files of `stage` to `folder`, its parent, or none of them.

    What a process that was killed here had begun to move is moved first; `alone_in` keeps others away.

    Raises
    ------
    OSError
        The system refuses; `folder` is as it was.
    """
    finish(folder)
    names = sorted(file.name for file in stage.iterdir())
    _keep_old(stage, folder, names)
    sync_folder(stage)
    journal = stage.with_name(stage.name + COMMITTED)
    os.rename(stage, journal)
    moved: list[str] = []
    try:
        sync_folder(folder)
        for name in names:
            os.replace(journal / name, folder / name)
            moved.append(name)
        sync_folder(folder)
    except BaseException:
        _put_back(journal, folder, moved)
        os.rename(journal, stage)
        raise
    # Nothing is left to move, so that it may be thrown away as any stage.
    with suppress(OSError):
        os.rename(journal, stage)


def finish(folder: Path) -> None:
    """Move into `folder` what a killed process had begun to move there.

    Raises
    ------
    OSError
        It cannot be moved; the text says what to do.
    """
    for journal in _journals(folder):
        try:
            since = journal.lstat().st_mtime_ns
            for file in sorted(journal.iterdir()):
                if file.name != _OLD and _may_be_replaced(folder / file.name, since):
                    with suppress(FileNotFoundError):  # another process finishes too, where there are no locks
                        os.replace(file, folder / file.name)
            sync_folder(folder)
        except FileNotFoundError:
            continue
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise OSError(
                error.errno,
                f"{folder}: an earlier run was killed while it put its results here, and they cannot be put in place "
                f"now ({reason}); remove {journal} and run again",
            ) from None
        shutil.rmtree(journal, ignore_errors=True)


def finish_killed(folder: Path) -> None:
    """`finish`, where a process was killed, or is at work, between the first file and the last.

    Raises
    ------
    OSError
        As `finish`.
    """
    if _journals(folder):
        with alone_in(folder):
            finish(folder)


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Wait until no other process moves files into `folder`, and keep others waiting.

    Where the file system has no locks, two processes that end at the same instant may mix their files.
    """
    if sys.platform == "win32":
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def sync_folder(folder: Path) -> None:
    """Names on the disk, in the order of the calls; a power cut then leaves what a kill would.

    Raises
    ------
    OSError
        The disk refuses.
    """
    if sys.platform == "win32":  # folders cannot be opened there
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(folder)) from None
    finally:
        os.close(descriptor)


def _keep_old(stage: Path, folder: Path, names: Sequence[str]) -> None:
    (stage / _OLD).mkdir()
    for name in names:
        with suppress(FileNotFoundError):
            try:
                os.link(folder / name, stage / _OLD / name)
            except FileNotFoundError:
                raise
            except OSError:  # links are not to be had everywhere
                shutil.copy2(folder / name, stage / _OLD / name)


def _put_back(journal: Path, folder: Path, moved: Sequence[str]) -> None:
    """Undo, in steps after each of which `finish` would still find all of the new files."""
    for name in reversed(moved):
        os.replace(folder / name, journal / name)
        with suppress(FileNotFoundError):
            os.replace(journal / _OLD / name, folder / name)


def _journals(folder: Path) -> list[Path]:
    """Folders of ours that are being moved, the oldest first; in a shared folder others' names are not believed."""
    try:
        with os.scandir(folder) as entries:
            found = [Path(entry.path) for entry in entries if is_journal(entry)]
    except OSError:
        return []
    return sorted(found, key=lambda path: (path.lstat().st_mtime_ns, path.name))


def is_journal(entry: os.DirEntry[str]) -> bool:
    """Whether this is a folder whose files are being moved, made by this user."""
    if not _JOURNAL.fullmatch(entry.name):
        return False
    info = entry.stat(follow_symlinks=False)
    mine = sys.platform == "win32" or (info.st_uid == os.geteuid() and not info.st_mode & 0o022)
    return stat.S_ISDIR(info.st_mode) and mine


def _may_be_replaced(path: Path, since: int) -> bool:
    """Whether nobody wrote there after the kill; only a file is replaced by a file."""
    try:
        info = path.lstat()
    except FileNotFoundError:
        return True
    if not stat.S_ISREG(info.st_mode):
        raise FileExistsError(None, f"{path.name} is no file there")
    return info.st_mtime_ns <= since
