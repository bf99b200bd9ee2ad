"""What was read, quoted in sentences: short, and safe to print."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path

LONGEST = 80
"""Most characters of one quotation: a line of a terminal. A damaged file may hold megabytes without a break."""
MAX_SHOWN = 12
NO_UTF_8 = "its name, or that of a folder above it, is no UTF-8, and a library that it is for takes no other; rename it"
_LONE = re.compile(r"(\\\\|\\ud[89ab]..\\ud[c-f]..)|\\udc([89a-f].)")
"""In JSON: what only looks like a lone surrogate, or one that stands for a byte of a name."""


def as_text(name: str) -> str:
    r"""A name as every file and terminal takes it: its bytes that are no UTF-8 (an old disk's) are written ``\xe4``."""
    try:
        return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    except UnicodeEncodeError:  # no bytes, but half of a character of UTF-16
        return name.encode("utf-8", "backslashreplace").decode()


def is_of_a_name(error: BaseException) -> bool:
    """Whether a library could not take a name whose bytes are no UTF-8."""
    return isinstance(error, UnicodeEncodeError) and "\udc80" <= error.object[error.start] <= "\udcff"


def file_name(path: str | os.PathLike[str]) -> str:
    """Last part of a path, as text."""
    return as_text(Path(path).name)


def as_json(obj: object, default: Callable[[object], object] | None = None) -> str:
    """`obj` as JSON of several lines, in ASCII, with the names of files as text.

    Raises
    ------
    ValueError
        NaN or infinity somewhere in `obj`: JSON has no word for it.
    TypeError
        Something in `obj` is not JSON.
    """
    text = json.dumps(obj, indent=2, allow_nan=False, default=default)
    return _LONE.sub(lambda found: found[1] or f"\\\\x{found[2]}", text) + "\n"


def shown(text: str, limit: int = 40) -> str:
    """Text from a file, safe to print: short, and without control characters."""
    # Cut before anything else: of a megabyte no more is looked at than is shown.
    part = as_text(text[: limit + 1])
    safe = part if part.isprintable() else ascii(part)[1:-1]
    return safe if len(safe) <= limit else safe[: limit - 3] + "..."


def shown_value(value: object, limit: int = LONGEST) -> str:
    """Any value from a file as Python writes it, as `shown` shows text."""
    return shown(repr(value), limit)


def shown_ends(text: str, limit: int = 2 * LONGEST) -> str:
    """Words of a library about what it read, on one line: where they are long, their beginning and their end.

    The place in the file stands at the end, behind what is quoted of it.
    """
    line = " ".join(text.split())
    if len(line) <= limit:
        return shown(line, limit)
    head = (limit - 5) // 2
    return f"{shown(line[:head], head)} ... {shown(line[head - limit + 5 :], limit)}"


def shown_names(names: Sequence[str]) -> str:
    """Return the columns of a file as a short list."""
    listed = ", ".join(shown(name) for name in names[:MAX_SHOWN])
    rest = len(names) - MAX_SHOWN
    return listed + (f", ... ({len(names)} columns)" if rest > 0 else "") if names else "no column"
