"""What every command does with errors: one sentence and an exit code, never a traceback."""

from __future__ import annotations

import codecs
import errno
import functools
import io
import os
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import ParamSpec, TextIO

import typer

from dynid_rs.base import interrupt, room
from dynid_rs.base.codes import mend_of
from dynid_rs.base.errors import DamageWarning
from dynid_rs.base.files import with_sentence
from dynid_rs.base.quoting import NO_UTF_8, as_json, as_text, is_of_a_name, shown_ends

EXIT_NO = 1
EXIT_UNUSABLE = 2
EXIT_INTERRUPTED = interrupt.INTERRUPTED
EXIT_BROKEN_PIPE = 141

_LONGEST = 1000
"""Characters of one sentence: enough for two long paths and a list of names, whatever a damaged file holds."""

_WRITERS = (f"{__package__}.", "typer.", "click.", "rich.")
"""Modules that write to standard output."""

_ESCAPED = "dynid-escaped"
"""How standard streams take what they have no character for: no answer is lost for the name of a file."""

P = ParamSpec("P")


class UsageError(ValueError):
    """Options or arguments that no command takes, in the words of the library that parses them."""


def error_object(error: BaseException) -> dict[str, object]:
    """Return the fields of an error that programs read: class, message and, where known, the place."""
    fields: dict[str, object] = {"class": type(error).__name__, "message": sentence(error)}
    for name in ("code", "file", "column", "row"):
        value = getattr(error, name, None)
        if isinstance(value, str | int):
            fields[name] = value
    mend = mend_of(str(fields.get("code", "")))
    return fields if mend is None else fields | {"mend": mend}


def sentence(error: BaseException) -> str:
    """Return the text of an error on one line; a bare error of the system becomes a sentence."""
    if isinstance(error, OSError) and error.errno is not None and error.filename is not None:
        error = with_sentence(error, error.filename, "open")
    if isinstance(error, UnicodeEncodeError) and is_of_a_name(error):
        return f"{shown_ends(error.object, _LONGEST)}: {NO_UTF_8}"
    return shown_ends(str(error), _LONGEST) or type(error).__name__


def print_json(obj: object) -> None:
    """Write one JSON value to standard output.

    Raises
    ------
    OSError
        Standard output is closed, or cannot be written.
    """
    sys.stdout.write(as_json(obj))


def run_command(command: Callable[P, int | None]) -> Callable[P, None]:
    """Wrap a command function: its return value becomes the exit code, its errors one sentence each.

    `ValueError` and `OSError` end in exit code 2 with a sentence on standard error, and with ``--json``
    (an argument called `json_output`) in ``{"error": {...}}`` on standard output as well. So does an answer that
    standard output does not take, and memory that ran out; where only the output's reader has left, the code is 141,
    without a word. An interrupt ends in 130, with what `goes_on` says, whatever a library made of it. Anything else is
    our own bug and keeps its traceback.
    """

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            interrupt.begin()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DamageWarning)  # every command says its findings itself
                code = command(*args, **kwargs)
            sys.stdout.flush()
            interrupt.check()
        except (KeyboardInterrupt, typer.Abort) as stop:  # the latter where a question was on the terminal
            raise typer.Exit(_interrupted(str(stop))) from None
        except Exception as error:
            if interrupt.came():  # a library that was struck fails in ways of its own
                raise typer.Exit(_interrupted()) from None
            if room.ran_out(error):
                error = MemoryError(room.RAN_OUT)
            if not isinstance(error, ValueError | OSError | MemoryError):
                raise
            raise typer.Exit(failed(error, as_json=bool(kwargs.get("json_output")))) from None
        if code:
            raise typer.Exit(code)

    return wrapped


@contextmanager
def goes_on(how: Callable[[], str]) -> Iterator[None]:
    """Say after an interrupt of the body what is left of it, and how to go on.

    Parameters
    ----------
    how : callable
        Gives one sentence, without a full stop; called after the interrupt.
    """
    try:
        interrupt.check()
        yield
        interrupt.check()
    except KeyboardInterrupt:
        raise KeyboardInterrupt(how()) from None
    except Exception:
        if interrupt.came():
            raise KeyboardInterrupt(how()) from None
        raise


@contextmanager
def of_option(option: str) -> Iterator[None]:
    """Say which option gave the runs that an error of the body begins with.

    Raises
    ------
    ValueError
        The body does.
    """
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{option} {error}") from None


def run_app(app: Callable[[], object]) -> None:
    """Run the whole program; help, version and wrong use, which belong to no command, fail as answers of commands do.

    Of wrong use click has said what it is on standard error; with ``--json`` it stands on standard output too.
    """
    codecs.register_error(_ESCAPED, _escape)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_ESCAPED)
    try:
        app()
    except OSError as error:
        if not _is_of_a_stream(error):
            raise
        raise SystemExit(_unanswered(error)) from None
    except SystemExit as end:
        # Click ends with 1, which is our "no", when the reader of a help leaves.
        if isinstance(end.__context__, BrokenPipeError):
            raise SystemExit(_unanswered(end.__context__)) from None
        # It ends with 1 after an interrupt too, where no command has begun.
        if isinstance(end.__context__, typer.Abort):
            raise SystemExit(EXIT_INTERRUPTED) from None
        words = getattr(end.__context__, "format_message", None)  # click's errors, wherever typer has click from
        if words is not None and "--json" in sys.argv[1:]:
            _say_as_json(UsageError(words().removesuffix(".")))
        raise


def _escape(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return as_text(error.object[error.start : error.end]).encode("ascii", "backslashreplace").decode(), error.end


def _interrupted(how: str = "") -> int:
    """Say that it was, and how to go on; returns the exit code."""
    interrupt.answered()
    _complain(f"interrupted: {how}" if how else "interrupted")
    return EXIT_INTERRUPTED


def said_of(errors: Sequence[Exception]) -> dict[str, object]:
    """Fields of an answer that is there in spite of them: the first as every command has it, and all."""
    objects = [error_object(error) for error in errors]
    return {"error": objects[0], "errors": objects} if objects else {}


def refused(errors: Sequence[Exception]) -> int:
    """Say what was refused beside what was answered, one sentence each; returns the exit code."""
    for error in errors:
        _complain(f"error: {sentence(error)}")
    return EXIT_UNUSABLE


def failed(error: ValueError | OSError | MemoryError, *, as_json: bool) -> int:
    """Say what is wrong and return the exit code."""
    if isinstance(error, OSError) and _is_of_a_stream(error):
        return _unanswered(error)
    _complain(f"error: {sentence(error)}")
    if as_json:
        _say_as_json(error)
    return EXIT_UNUSABLE


def _say_as_json(error: Exception) -> None:
    try:
        print_json({"error": error_object(error)})
        sys.stdout.flush()
    except OSError:
        _give_up(sys.stdout)  # what is wrong stands on standard error


def _is_of_a_stream(error: OSError) -> bool:
    """Whether standard output failed: a file would have given its name to the error, and what writes there is known."""
    if error.errno is None or error.filename is not None or getattr(error, "is_sentence", False):
        return False
    *_, (writer, _) = traceback.walk_tb(error.__traceback__)
    return str(writer.f_globals.get("__name__")).startswith(_WRITERS)


def _unanswered(error: OSError) -> int:
    """Standard output took no answer, or a part of it; returns the exit code."""
    _give_up(sys.stdout)
    if error.errno == errno.EPIPE:
        return EXIT_BROKEN_PIPE
    reason = (error.strerror or type(error).__name__).lower()
    _complain(f"error: standard output cannot be written ({reason}), the answer is lost; send it to another place")
    return EXIT_UNUSABLE


def _complain(text: str) -> None:
    try:
        print(text, file=sys.stderr, flush=True)
    except OSError:
        _give_up(sys.stderr)  # nobody is left who could hear it; the exit code tells


def _give_up(stream: TextIO) -> None:
    """Let nothing more come of a stream that failed: Python would try again at exit, complain and change the code."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
