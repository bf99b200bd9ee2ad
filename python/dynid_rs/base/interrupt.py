"""Ctrl-C: it ends the work at a place where that can be done, and nobody can swallow it.

An interrupt that falls into an import leaves half a module behind, and libraries that try one import after another take
the `KeyboardInterrupt` for a missing module: it is given again when the import is done. Where a callback or a library
has swallowed it all the same, the next safe point says so (`check`), at the latest the command's end.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130
"""Exit code."""
AGAIN = 0.02
"""Until an interrupt is given again that came during an import [s]."""
IMPORT = "<frozen importlib._bootstrap"
"""Beginning of the file names of the import system's frames."""


class _Interrupt:
    """Whether one came since `listen`, waits for an import, and whether the next signal is only the same one again."""

    came = False
    waits = False
    again = False


def listen() -> None:
    """Answer interrupts as this module does; where the program ignores them, as in the background, nothing changes."""
    _Interrupt.came = _Interrupt.waits = _Interrupt.again = False
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _first)


def take() -> bool:
    """Whether an interrupt came, raised or not: what fails afterwards may fail because of it. The caller answers it."""
    _Interrupt.waits = False
    return _Interrupt.came


def check() -> None:
    """Raise an interrupt that came and was not raised, or was swallowed; nothing while one is on its way.

    Raises
    ------
    KeyboardInterrupt
        In the main thread only.
    """
    if not _Interrupt.came or threading.current_thread() is not threading.main_thread():
        return
    error = sys.exception()
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return
        error = error.__context__
    _Interrupt.waits = False
    raise KeyboardInterrupt


def _first(number: int, frame: FrameType | None) -> None:
    """Let the work end in order; who presses again does not want to wait for that."""
    _Interrupt.came = True
    signal.signal(signal.SIGINT, _second)
    _give(frame)


def _second(number: int, frame: FrameType | None) -> None:
    """Results are whole or not there even so: the next command clears what is left of this one."""
    if not _Interrupt.again:
        os._exit(INTERRUPTED)
    _Interrupt.again = False
    if _Interrupt.waits:
        _give(frame)


def _give(frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename.startswith(IMPORT):
            _Interrupt.waits = True
            timer = threading.Timer(AGAIN, _signal_again)
            timer.daemon = True
            timer.start()
            return
        frame = frame.f_back
    _Interrupt.waits = False
    raise KeyboardInterrupt


def _signal_again() -> None:
    if not _Interrupt.waits:
        return
    _Interrupt.again = True
    if hasattr(signal, "pthread_kill"):  # wakes the main thread where it waits
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        _thread.interrupt_main()


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
