"""What every command does with errors: one sentence and an exit code, never a traceback."""

from __future__ import annotations

import functools
import json
import os
import sys
from collections.abc import Callable
from typing import ParamSpec

import typer

from dynid_rs.base.files import with_sentence

EXIT_NO = 1
EXIT_UNUSABLE = 2
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141

P = ParamSpec("P")


def error_object(error: BaseException) -> dict[str, object]:
    """Return the fields of an error that programs read: class, message and, where known, the place."""
    fields: dict[str, object] = {"class": type(error).__name__, "message": sentence(error)}
    for name in ("code", "file", "column", "row"):
        value = getattr(error, name, None)
        if isinstance(value, str | int):
            fields[name] = value
    return fields


def sentence(error: BaseException) -> str:
    """Return the text of an error on one line; a bare error of the system becomes a sentence."""
    if isinstance(error, OSError) and error.errno is not None and error.filename is not None:
        error = with_sentence(error, error.filename, "open")
    return " ".join(str(error).split()) or type(error).__name__


def print_json(obj: object) -> None:
    """Write one JSON value to standard output."""
    sys.stdout.write(json.dumps(obj, indent=2, allow_nan=False) + "\n")


def run_command(command: Callable[P, int | None]) -> Callable[P, None]:
    """Wrap a command function: its return value becomes the exit code, its errors one sentence each.

    `ValueError` and `OSError` end in exit code 2 with a sentence on standard error, and with ``--json``
    (an argument called `json_output`) in ``{"error": {...}}`` on standard output as well. Anything else is
    our own bug and keeps its traceback.
    """

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            code = command(*args, **kwargs)
            sys.stdout.flush()
        except KeyboardInterrupt:
            sys.stderr.write("interrupted\n")
            raise typer.Exit(EXIT_INTERRUPTED) from None
        except BrokenPipeError:
            # The reader (head, less) left. Python would complain once more when it flushes at exit.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(EXIT_BROKEN_PIPE) from None
        except (ValueError, OSError) as error:
            sys.stderr.write(f"error: {sentence(error)}\n")
            if kwargs.get("json_output"):
                print_json({"error": error_object(error)})
            raise typer.Exit(EXIT_UNUSABLE) from None
        if code:
            raise typer.Exit(code)

    return wrapped
