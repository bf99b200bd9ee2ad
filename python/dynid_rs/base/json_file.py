"""JSON that somebody else may have written: read whole, and refused in one sentence with its place."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable, with_sentence

_BEGINNING = 1 << 12
"""Bytes in which an object shows itself, after blanks."""


def is_object(path: str | os.PathLike[str]) -> bool:
    """Whether a file begins as a JSON object does; what comes then is for its reader to say.

    Raises
    ------
    OSError
        The system refuses to read it.
    DataError
        It is a device or a pipe, or holds no byte.
    """
    place = check_readable(path)
    try:
        with place.open("rb") as file:
            return file.read(_BEGINNING).lstrip().startswith(b"{")
    except OSError as error:
        raise with_sentence(error, path, "read") from None


def read_json(path: Path, refuse: Callable[[str], NoReturn]) -> Any:
    """Content of a file; what is no JSON is handed to `refuse`, which raises.

    Raises
    ------
    OSError
        The system refuses to read it.
    DataError
        By `refuse`.
    """
    check_readable(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise with_sentence(error, path, "read") from None
    except UnicodeDecodeError as error:
        refuse(f"byte {error.start} is not UTF-8 text")
    try:
        return json.loads(text, parse_constant=lambda word: refuse(f"{word} is not a JSON number"))
    except json.JSONDecodeError as error:
        refuse(f"line {error.lineno}, column {error.colno}: this is not JSON ({error.msg.lower()})")
    except DataError:
        raise
    except (ValueError, RecursionError):
        refuse("this is not JSON that can be read (a number too long or brackets too deep)")
