"""Standard streams that a program was started without (`2>&-`): something takes their place, before any file can."""

from __future__ import annotations

import os
import sys
from typing import TextIO

_FLAGS = (os.O_RDONLY, os.O_RDONLY, os.O_WRONLY)
"""Of input, output and errors. Nothing can be written to the second: an answer that nobody takes is said to be lost,
as on a full disk. What is said to nobody on the third is not missed."""


def open_missing() -> None:
    """Put `/dev/null` in the place of closed standard streams.

    A file that is opened later would get the number of a closed one, and with it what libraries and processes that
    are started write there.
    """
    for number, flags in enumerate(_FLAGS):
        try:
            os.fstat(number)
        except OSError:
            _open_as(number, flags)
    for name, number in (("stdout", 1), ("stderr", 2)):
        if getattr(sys, name) is None:
            stream: TextIO = os.fdopen(number, "w", encoding="utf-8", closefd=False)
            setattr(sys, name, stream)
            setattr(sys, f"__{name}__", stream)


def _open_as(number: int, flags: int) -> None:
    opened = os.open(os.devnull, flags)
    os.dup2(opened, number)  # for processes that are started as well
    if opened == number:
        os.set_inheritable(number, True)
    else:
        os.close(opened)
