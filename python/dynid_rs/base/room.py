"""Memory: how it is held, and that it has run out, which libraries say in ways of their own."""

from __future__ import annotations

import errno
import os
from contextlib import suppress

RAN_OUT = (
    "memory ran out; hold less at a time (a smaller --memory and fewer --jobs, where the command has them), or allow "
    "the program more (ulimit -v, the limit of a container)"
)
_SAID = (os.strerror(errno.ENOMEM), "failed to map segment from shared object", MemoryError.__name__)
"""What the system, its loader and the text of another process's error say."""

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8
"""Numbers of `malloc.h`."""
LARGE = 4 << 20
"""Bytes from which on an array has pages of its own, which go back as soon as it is let go."""


def one_heap() -> None:
    """Hold small arrays of all threads in one heap, and give large ones pages of their own, where malloc is glibc's.

    A heap for every thread has holes that the others do not fill: a sixth of the memory of a diagnosis was those. What
    the environment says of malloc stays.
    """
    if any(name.startswith("MALLOC_") for name in os.environ):
        return
    import ctypes

    with suppress(AttributeError, OSError, TypeError):  # another system's malloc has no such thing
        mallopt = ctypes.CDLL(None).mallopt
        for parameter, value in ((M_ARENA_MAX, 1), (M_MMAP_THRESHOLD, LARGE), (M_TRIM_THRESHOLD, LARGE)):
            mallopt(parameter, value)


def ran_out(error: BaseException | None) -> bool:
    """Whether memory ran out behind an error, here or in another process, whose errors come as text."""
    while error is not None:
        if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
            return True
        # What a file holds is quoted in errors of these two.
        if not isinstance(error, ValueError | OSError) and any(words in str(error) for words in _SAID):
            return True
        error = error.__cause__ or (None if error.__suppress_context__ else error.__context__)
    return False
