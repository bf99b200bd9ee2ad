"""Terminals: answers on standard output, progress on standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.live import Live
from rich.spinner import Spinner

_WIDTH = 120


class _Console(Console):
    """Rich ends the process when the reader of a pipe leaves; here `run_command` decides."""

    def on_broken_pipe(self) -> None:
        """Pass the error on."""
        raise


def console() -> Console:
    """Terminal output: coloured and as wide as the terminal; plain and of fixed width elsewhere."""
    plain = _Console(highlight=False, color_system=None, width=_WIDTH)
    terminal = _Console(highlight=False)
    return terminal if terminal.file.isatty() else plain


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Show what is being done while it is being done; silent where standard error is no terminal.

    Yields a function that takes a few words; they are drawn at once, however short the step. Variables such as
    FORCE_COLOR make Rich believe in a terminal that is not there; only the stream itself is asked here.
    """
    if not sys.stderr.isatty():
        yield lambda words: None
        return
    spinner = Spinner("dots")

    def say(words: str) -> None:
        spinner.update(text=words)
        live.refresh()

    with Live(spinner, console=Console(stderr=True), refresh_per_second=12.5, transient=True) as live:
        yield say
