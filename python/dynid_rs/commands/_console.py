"""Terminals: answers on standard output, progress on standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.live import Live
from rich.spinner import Spinner
from rich.text import Text

from dynid_rs.base import interrupt
from dynid_rs.commands._steps import Step, Steps

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
def progress(*plan: Step) -> Iterator[Callable[[str], None]]:
    """Show what is being done while it is being done; silent where standard error is no terminal.

    Yields a function that takes a few words; they are drawn at once, however short the step, with the step of `plan`
    that they belong to and the time that is left. Each is a place where an interrupt that was only noted ends the work.
    Variables such as FORCE_COLOR make Rich believe in a terminal that is not there; only the stream itself is asked
    here.
    """
    interrupt.check()
    if not sys.stderr.isatty():
        yield lambda words: interrupt.check()
        return
    steps = Steps(plan)
    shown = _Line(steps)

    def say(words: str) -> None:
        interrupt.check()
        steps.say(words)
        live.refresh()

    with Live(shown, console=Console(stderr=True), refresh_per_second=12.5, transient=True) as live:
        yield say


class _Line:
    """A wheel that turns, and the line of the steps as it is at this instant."""

    def __init__(self, steps: Steps) -> None:
        self._steps, self._spinner = steps, Spinner("dots")

    def __rich__(self) -> Spinner:
        self._spinner.update(text=Text(self._steps.line()))
        return self._spinner
