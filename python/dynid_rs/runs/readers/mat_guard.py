"""Before scipy reads a MATLAB 5 file: sizes and depth of its elements, without recursion and without taking memory.

scipy descends once per level, in C, and takes memory for as many cells as a structure claims to have.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

from dynid_rs.base.errors import DataError
from dynid_rs.runs.readers.table import damaged, refuse_too_large

DEEPEST = 32
MATRIX, COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT = 1, 2, 3
_HEADER = 128
_BLOCK = 1 << 16


def check_elements(place: Path, file: str) -> None:
    """Refuse a MATLAB 5 file that would take too much memory, or nests its variables too deep.

    Raises
    ------
    DataError
        Too large, too deep, or damaged.
    """
    total = 0
    with place.open("rb") as stream:
        order = "<" if stream.read(_HEADER)[126:128] == b"IM" else ">"
        while len(tag := stream.read(8)) == 8:
            kind, size = struct.unpack(f"{order}II", tag)
            if kind == COMPRESSED:
                end = stream.tell() + size
                source = _Unpacked(stream.read, size)
                total += _walk(source.read, order, None, file)
                stream.seek(end)
            elif kind == MATRIX:
                total += _walk(stream.read, order, size, file)
            else:
                raise damaged("MATLAB", ValueError(f"element of kind {kind}"), file)
            refuse_too_large(total, file)


class _Unpacked:
    """Unpacks a zlib stream as it is asked for."""

    def __init__(self, more: Callable[[int], bytes], size: int) -> None:
        self._more, self._left, self._unpack, self._rest = more, size, zlib.decompressobj(), b""

    def read(self, size: int) -> bytes:
        out = b""
        while len(out) < size and not self._unpack.eof:
            packed = self._rest or self._more(min(_BLOCK, self._left))
            if not self._rest:
                self._left -= len(packed)
            if not packed:
                break
            try:
                out += self._unpack.decompress(packed, size - len(out))
            except zlib.error:
                break  # what is missing is said by who asked for it
            self._rest = self._unpack.unconsumed_tail
        return out


def _walk(read: Callable[[int], bytes], order: str, size: int | None, file: str) -> int:
    """Go over the elements of one variable; returns its size in bytes."""
    if size is None:
        kind, size = struct.unpack(f"{order}II", _exactly(read, 8, file))
        if kind != MATRIX:
            raise damaged("MATLAB", ValueError(f"packed element of kind {kind}"), file)
    left, passed = [size], 8 + size
    _check_cells(read, order, left, file)
    while left:
        if left[-1] < 8:
            _skip(read, left.pop(), file)
            continue
        first, second = struct.unpack(f"{order}II", _exactly(read, 8, file))
        left[-1] -= 8
        if first >> 16:  # a small element: its data stands in the tag
            continue
        padded = second if first == MATRIX else second + -second % 8
        if padded > left[-1] + 7:
            raise damaged("MATLAB", ValueError("an element is larger than the one it is in"), file)
        left[-1] -= padded
        if first != MATRIX:
            _skip(read, padded, file)
        elif second:
            left.append(second)
            if len(left) > DEEPEST:
                raise DataError(
                    f"{file}: nests its variables more than {DEEPEST} deep; save plain arrays",
                    code="too_deep",
                    file=file,
                )
            _check_cells(read, order, left, file)
    return passed


def _check_cells(read: Callable[[int], bytes], order: str, left: list[int], file: str) -> None:
    """A structure has no more cells than there is room for; leaves `left` after the flags and the dimensions."""
    if left[-1] < 24:
        return
    flags = _exactly(read, 16, file)
    kind = struct.unpack(f"{order}I", flags[8:12])[0] & 0xFF
    what, size = struct.unpack(f"{order}II", _exactly(read, 8, file))
    left[-1] -= 24
    if what >> 16:
        return
    padded = size + -size % 8
    if padded > min(left[-1], 8 * DEEPEST):
        raise damaged("MATLAB", ValueError("an array with too many dimensions"), file)
    data = _exactly(read, padded, file)[:size]
    left[-1] -= padded
    cells = 1
    for side in struct.unpack(f"{order}{size // 4}i", data[: size // 4 * 4]):
        cells *= max(side, 0)
    if kind in (_CELL, _STRUCT, _OBJECT) and 8 * cells > max(left[-1], 8):
        raise damaged("MATLAB", ValueError(f"it claims {cells} cells, which it has no room for"), file)


def _exactly(read: Callable[[int], bytes], size: int, file: str) -> bytes:
    data = read(size)
    if len(data) < size:
        raise damaged("MATLAB", ValueError("its end is missing"), file)
    return data


def _skip(read: Callable[[int], bytes], size: int, file: str) -> None:
    while size > 0:
        block = min(size, _BLOCK)
        _exactly(read, block, file)
        size -= block
