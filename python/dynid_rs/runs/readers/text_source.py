"""Text files as bytes of UTF-8: plain, in UTF-16, or packed by gzip or zstd, whose growth is limited."""

from __future__ import annotations

import codecs
import gzip
import io
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any

from dynid_rs.base.arrow_files import arrow_file
from dynid_rs.base.errors import DataError
from dynid_rs.runs.readers.table import damaged, looks_like, refuse_too_large

PACKED = {".gz": ("gzip", b"\x1f\x8b"), ".zst": ("zstd", b"\x28\xb5\x2f\xfd")}
"""Suffix: the packer and the first bytes of its files."""
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_BLOCK = 1 << 18
"""Bytes that are decoded at a time."""


@dataclass(frozen=True)
class Text:
    """A file whose bytes, once unpacked, are text.

    `packer`: its packer's name, or None; `encoding`: what is to be turned into UTF-8, or None where nothing is.
    """

    place: Path
    file: str
    packer: str | None
    encoding: str | None = None

    def read(self, offset: int = 0) -> IO[bytes]:
        """Open the text `offset` bytes after its beginning, counted as they are read.

        A packed file that grows beyond what one run may take, or is damaged, raises `DataError` while it is read.
        """
        if self.packer is None:
            stream: IO[bytes] = self.place.open("rb")
        else:
            stream = io.BufferedReader(_Unpacked(_unpacker(self.place, self.packer), self), 1 << 20)
        if self.encoding is not None:
            stream = io.BufferedReader(_Recoded(stream, self.encoding), 1 << 20)
        elif self.packer is None:
            stream.seek(offset)
            return stream
        while offset > 0:
            skipped = len(stream.read(min(offset, 1 << 20)))
            if not skipped:
                break
            offset -= skipped
        return stream


def text_of(place: Path, file: str) -> Text:
    """Return a file that is to be read as text, unpacked if its suffix says so, in UTF-16 if its mark says so.

    Raises
    ------
    DataError
        Its first bytes are not those of the packer, or it is damaged.
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
    text = Text(place, file, packer)
    with text.read() as stream:
        mark = stream.read(4)
    is_utf_16 = mark.startswith(_UTF_16) and mark != codecs.BOM_UTF32_LE
    return replace(text, encoding="utf-16") if is_utf_16 else text


def _unpacker(place: Path, packer: str) -> Callable[[int], bytes]:
    """Return a function that gives the next bytes of a packed file."""
    if packer == "gzip":
        return gzip.open(place, "rb").read
    import pyarrow as pa

    stream: Any = pa.CompressedInputStream(arrow_file(place), "zstd")
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


class _Recoded(io.RawIOBase):
    """Gives a text in another encoding as UTF-8; what is none of its characters comes as U+FFFD, and is no number."""

    def __init__(self, stream: IO[bytes], encoding: str) -> None:
        self._stream, self._left = stream, b""
        self._decoder = codecs.getincrementaldecoder(encoding)("replace")

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        more = True
        while more and not self._left:
            data = self._stream.read(_BLOCK)
            more = bool(data)
            self._left = self._decoder.decode(data, final=not more).encode()
        taken, self._left = self._left[: len(buffer)], self._left[len(buffer) :]
        buffer[: len(taken)] = taken
        return len(taken)

    def close(self) -> None:
        self._stream.close()
        super().close()
