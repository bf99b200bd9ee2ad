"""Files and folders that are being written: a lock tells them from what a killed process left behind."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dynid_rs.base.interrupt import uninterrupted
from dynid_rs.base.together import is_journal

if sys.platform != "win32":
    import fcntl

_MARK = ".dynid-"
_NAME = re.compile(re.escape(_MARK) + r"[0-9a-f]{12}(\..*)?", re.DOTALL)
"""Names that `_made` gives, and no others: what somebody called .dynid-notes stays."""


@contextmanager
def held_file(folder: Path, suffix: str) -> Iterator[Path]:
    """Empty file of a new name in `folder`, removed after the body unless it was moved away.

    Parameters
    ----------
    folder : Path
        Where; what dead processes left there is cleared first.
    suffix : str
        End of the name, with its dot: some writers choose the format by it.

    Raises
    ------
    OSError
        The system's own error.
    """
    path, lock = None, None
    try:
        with uninterrupted():
            path, lock = _made(folder, suffix, _make_file)
        yield path
    finally:
        with uninterrupted():
            if path is not None:
                with suppress(OSError):
                    path.unlink()
            _release(lock)


@contextmanager
def held_folder(folder: Path) -> Iterator[Path]:
    """Empty folder of a new name in `folder`, removed after the body with all that is in it.

    Parameters
    ----------
    folder : Path
        Where; what dead processes left there is cleared first.

    Raises
    ------
    OSError
        The system's own error.
    """
    path, lock = None, None
    try:
        with uninterrupted():
            path, lock = _made(folder, "", lambda path: path.mkdir(0o700))
        yield path
    finally:
        with uninterrupted():
            if path is not None:
                shutil.rmtree(path, ignore_errors=True)
            _release(lock)


def clear_leftovers(folder: Path) -> None:
    """Remove what `held_file` and `held_folder` of dead processes left in `folder`; never fails.

    A lock ends with its process, however that ends, and is seen from other containers too, where a process number
    would say nothing. Where the file system has no locks, everything stays.
    """
    try:
        with os.scandir(folder) as entries:
            names = [entry.name for entry in entries if _NAME.fullmatch(entry.name) and not is_journal(entry)]
    except OSError:
        return
    for name in names:
        path = folder / name
        lock = _opened(path)
        if lock is None:
            continue
        with suppress(OSError):
            _lock(lock)
            if stat.S_ISDIR(os.fstat(lock).st_mode):
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink()
        _release(lock)


def _made(folder: Path, suffix: str, make: Callable[[Path], None]) -> tuple[Path, int | None]:
    """Something new in `folder`, and the descriptor of its lock, if locks are to be had."""
    clear_leftovers(folder)
    while True:
        path = folder / f"{_MARK}{secrets.token_hex(6)}{suffix}"
        make(path)
        lock = _opened(path)
        if _is_ours(path, lock):
            return path, lock
        _release(lock)


def _make_file(path: Path) -> None:
    os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666))


def _is_ours(path: Path, lock: int | None) -> bool:
    """Lock what was just made; False where another process took it for a leftover before the lock was there."""
    if lock is None:
        return path.exists()
    try:
        _lock(lock)
    except BlockingIOError:
        return False
    except OSError:
        pass  # no locks here, so nobody clears here either
    return path.exists()


def _opened(path: Path) -> int | None:
    """Descriptor that can carry a lock; None where none is to be had, or `path` is neither file nor folder."""
    if sys.platform == "win32":  # an open file cannot be renamed there
        return None
    try:
        mode = path.lstat().st_mode
        if stat.S_ISDIR(mode):
            return os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_DIRECTORY)
        # Writable: network file systems lock nothing else.
        return os.open(path, os.O_RDWR | os.O_NOFOLLOW) if stat.S_ISREG(mode) else None
    except OSError:
        return None


def _lock(descriptor: int) -> None:
    """Lock an open file or folder.

    Raises
    ------
    BlockingIOError
        Another process has it.
    OSError
        There are no locks here.
    """
    if sys.platform == "win32":
        raise OSError("no locks")
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _release(descriptor: int | None) -> None:
    if descriptor is not None:
        os.close(descriptor)
