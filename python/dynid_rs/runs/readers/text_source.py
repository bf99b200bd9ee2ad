"""Text files as bytes: plain, or packed by gzip or zstd, whose growth is limited."""

from __future__ import annotations

import gzip
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from dynid_rs.base.errors import DataError
from dynid_rs.runs.readers.table import damaged, looks_like, refuse_too_large

PACKED = {".gz": ("gzip", b"\x1f\x8b"), ".zst": ("zstd", b"\x28\xb5\x2f\xfd")}
"""Suffix: the packer and the first bytes of its files."""


@dataclass(frozen=True)
class Text:
    """A file whose bytes, once unpacked, are text; `packer` is its packer's name, or None."""

    place: Path
    file: str
    packer: str | None

    def read(self, offset: int = 0) -> IO[bytes]:
        """Open the text `offset` bytes after its beginning.

        A packed file that grows beyond what one run may take, or is damaged, raises `DataError` while it is read.
        """
        if self.packer is None:
            stream: IO[bytes] = self.place.open("rb")
            stream.seek(offset)
            return stream
        opened = _Unpacked(_unpacker(self.place, self.packer), self)
        unpacked = io.BufferedReader(opened, 1 << 20)
        while offset > 0:
            skipped = len(unpacked.read(min(offset, 1 << 20)))
            if not skipped:
                break
            offset -= skipped
        return unpacked


def text_of(place: Path, file: str) -> Text:
    """Return a file that is to be read as text, unpacked if its suffix says so.

    Raises
    ------
    DataError
        Its first bytes are not those of the packer.
    """
    packer, magic = PACKED.get(place.suffix.lower(), (None, b""))
    with place.open("rb") as stream:
        head = stream.read(64)
    if not head.startswith(magic):
        raise DataError(
            f"{file}: expected a file packed by {packer}, but {looks_like(head)}; give it its right suffix",
            code="not_packed",
            file=file,
        )
    refuse_too_large(place.stat().st_size, file)
    return Text(place, file, packer)


def _unpacker(place: Path, packer: str) -> Callable[[int], bytes]:
    """Return a function that gives the next bytes of a packed file."""
    if packer == "gzip":
        return gzip.open(place, "rb").read
    import pyarrow as pa

    stream: Any = pa.CompressedInputStream(pa.OSFile(str(place), "rb"), "zstd")
    return lambda size: bytes(stream.read(size))


class _Unpacked(io.RawIOBase):
    """Counts what comes out: a packed file of a megabyte may unpack to terabytes."""

    def __init__(self, more: Callable[[int], bytes], text: Text) -> None:
        self._more, self._text, self._count = more, text, 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        try:
            data = self._more(len(buffer))
        except Exception as error:  # zlib, gzip, arrow and the system have each their own
            raise damaged(f"{self._text.packer} archive", error, self._text.file) from None
        self._count += len(data)
        refuse_too_large(self._count, self._text.file)
        buffer[: len(data)] = data
        return len(data)
