"""Memory that has run out: libraries say it in ways of their own."""

from __future__ import annotations

import errno
import os

RAN_OUT = (
    "memory ran out; hold less at a time (a smaller --memory and fewer --jobs, where the command has them), or allow "
    "the program more (ulimit -v, the limit of a container)"
)
_SAID = (os.strerror(errno.ENOMEM), "failed to map segment from shared object", MemoryError.__name__)
"""What the system, its loader and the text of another process's error say."""


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
