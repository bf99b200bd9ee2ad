"""Files for pyarrow, which takes names in UTF-8 alone, and calls a file damaged whose name is none."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def arrow_file(place: Path) -> Any:
    """`pyarrow.NativeFile` to read a file from; all of its bytes at once where its name is none for pyarrow.

    Raises
    ------
    OSError
        The file cannot be opened.
    """
    import pyarrow as pa

    try:
        str(place).encode()
    except UnicodeEncodeError:
        return pa.BufferReader(place.read_bytes())
    return pa.OSFile(str(place), "rb")
