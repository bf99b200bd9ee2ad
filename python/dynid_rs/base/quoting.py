"""What was read, quoted in sentences: short, and safe to print."""

from __future__ import annotations

from collections.abc import Sequence

LONGEST = 80
"""Most characters of one quotation: a line of a terminal. A damaged file may hold megabytes without a break."""
MAX_SHOWN = 12


def shown(text: str, limit: int = 40) -> str:
    """Text from a file, safe to print: short, and without control characters."""
    # Cut before anything else: of a megabyte no more is looked at than is shown.
    part = text[: limit + 1]
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
