"""TOML files that people write: small, UTF-8, and refused in one sentence where they are not."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import file_name, shown_ends

MOST_BYTES = 1 << 20
"""What a person writes by hand is far shorter."""


def read_toml(path: str | Path, code: str) -> dict[str, Any]:
    """Tables and values of a TOML file; `code` is that of the error where it is none.

    Raises
    ------
    DataError
        Too large, not UTF-8, not TOML; names the file.
    OSError
        The file cannot be opened.
    """
    place, file = check_readable(path), file_name(path)
    if place.stat().st_size > MOST_BYTES:
        raise DataError(f"{file}: is larger than {MOST_BYTES} bytes, expected a short TOML file", file=file)
    try:
        return tomllib.loads(place.read_text(encoding="utf-8"))
    except UnicodeDecodeError:
        raise DataError(f"{file}: is not UTF-8 text; save it as UTF-8", code=code, file=file) from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise DataError(f"{file}: is not valid TOML: {shown_ends(str(error))}", code=code, file=file) from None
