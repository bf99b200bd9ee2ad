"""Ctrl-C: it ends the work where that can be done, and nobody can swallow it.

An interrupt that falls into an import would leave half a module behind, and libraries that try one import after another
take the `KeyboardInterrupt` for a missing module. There it is only noted, and the next safe point raises it: a step of
the progress, the beginning and the end of what `goes_on` holds, the command's end. So is one that a callback or a
library has swallowed. No timer and no second signal: they would fall into the start of worker processes.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130
"""Exit code."""
_IMPORT = "<frozen importlib._bootstrap"
"""Beginning of the file names of the import system's frames."""


class _State:
    """Whether an interrupt came that nobody has answered, and whether a command is there that would answer it."""

    came = False
    begun = False


def listen() -> None:
    """Answer interrupts as this module does; where the program ignores them, as in the background, nothing changes."""
    _State.came = _State.begun = False
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _first)


def begin() -> None:
    """From here on an interrupt is raised where it falls, but for imports: a command has begun, which answers it.

    Raises
    ------
    KeyboardInterrupt
        One has come already.
    """
    _State.begun = True
    check()


def check() -> None:
    """Raise an interrupt that was noted during an import, or swallowed: this is a safe point.

    Raises
    ------
    KeyboardInterrupt
        In the main thread only.
    """
    if _State.came and threading.current_thread() is threading.main_thread():
        raise KeyboardInterrupt


def came() -> bool:
    """Whether an interrupt came, raised or not: what fails afterwards may fail because of it."""
    return _State.came


def answered() -> None:
    """The interrupt that came has been answered: no safe point raises it again."""
    _State.came = False


def _first(number: int, frame: FrameType | None) -> None:
    """Let the work end in order; who presses again does not want to wait for that."""
    _State.came = True
    signal.signal(signal.SIGINT, _second)
    if _State.begun and not _in_import(frame):
        raise KeyboardInterrupt


def _second(number: int, frame: FrameType | None) -> None:
    """Results are whole or not there even so: the next command clears what is left of this one."""
    os._exit(INTERRUPTED)


def _in_import(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith(_IMPORT):
            return True
        frame = frame.f_back
    return False


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold an interrupt back until the body is done; for moments, not for work.

    In threads other than the main one Python delivers none, and where the program answers interrupts in a way of its
    own that is no function, as where it ignores them, nothing changes.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    held: list[int] = []
    signal.signal(signal.SIGINT, lambda number, frame: held.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if held:
            before(held[0], sys._getframe())  # the frame that it came in has ended


@contextmanager
def deaf_children() -> Iterator[None]:
    """Hold an interrupt back, from processes that start in the body too: they hear it from `hear` on.

    A terminal interrupts all processes at once, and Python that is starting answers with a traceback.
    """
    with uninterrupted():
        if sys.platform == "win32":
            yield
            return
        from multiprocessing.resource_tracker import ensure_running

        ensure_running()  # before: as it starts it unblocks what was blocked
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def hear() -> None:
    """In a process that was started deaf: what came since is raised now."""
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
