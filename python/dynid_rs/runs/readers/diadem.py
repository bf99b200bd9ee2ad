"""Traces as DIAdem files, which KUKA's controllers write: a .dat with names of channels, their numbers beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import file_name, shown
from dynid_rs.runs.cells import FloatArray
from dynid_rs.runs.readers.table import Columns, Table, refuse_duplicates, refuse_too_large

HEADS = (b"DIAEXTENDED", b"DIAdem", b"#BEGINGLOBALHEADER", b"#BEGINCHANNELHEADER")
MAX_HEADER = 1 << 20
_TYPES = {"REAL64": "<f8", "REAL32": "<f4", "INT32": "<i4", "INT16": "<i2", "WORD32": "<u4", "WORD16": "<u2"}
_NAME, _UNIT, _KIND, _FILE, _STORED, _TYPE, _LENGTH, _OFFSET, _START, _STEP = (
    *("200", "202", "210", "211", "213", "214", "220", "221", "240", "241"),
)


@dataclass(frozen=True)
class _Channel:
    fields: dict[str, str]
    file: str

    def text(self, key: str) -> str:
        return self.fields.get(key, "").strip()

    def number(self, key: str, usual: float) -> float:
        try:
            return float(self.text(key) or usual)
        except ValueError:
            raise self.fault(f"{shown(self.text(key))!r} is not a number (field {key})") from None

    def fault(self, text: str) -> DataError:
        name = shown(self.text(_NAME))
        return DataError(f"{self.file}, channel {name}: {text}", code="damaged", file=self.file, column=name)


def is_diadem(place: Path) -> bool:
    """Whether a file starts as a DIAdem header does."""
    with place.open("rb") as stream:
        return stream.read(64).lstrip(b"\xef\xbb\xbf").startswith(HEADS)


def open_diadem(path: str | Path) -> Table:
    """Open a trace: `path` is the header, whose data lies in the same folder.

    Raises
    ------
    DataError
        A header that is none, or data that is not what it says.
    OSError
        A file cannot be opened.
    """
    place, file = check_readable(path), file_name(path)
    refuse_too_large(place.stat().st_size, file)
    with place.open("rb") as stream:
        text = stream.read(MAX_HEADER).decode("cp1252", "replace")
    channels = _channels(text, file)
    if not channels:
        raise DataError(f"{file}: names no channels; copy the trace again", code="empty_file", file=file)
    names = [channel.text(_NAME) for channel in channels]
    refuse_duplicates(names, file)
    by_name = dict(zip(names, channels, strict=True))
    n_rows = int(min(channels[0].number(_LENGTH, 0), 2**40))

    def load(wanted: Sequence[str]) -> Columns:
        refuse_too_large(8 * n_rows * len(wanted), file)
        return {name: _read(by_name[name], channels, place, n_rows) for name in wanted}

    units = {name: channel.text(_UNIT) for name, channel in by_name.items() if channel.text(_UNIT)}
    return Table(file, "DIAdem", tuple(names), n_rows, load, units=units)


def _channels(text: str, file: str) -> list[_Channel]:
    found: list[_Channel] = []
    fields: dict[str, str] | None = None
    for line in text.splitlines():
        word = line.strip()
        if word == "#BEGINCHANNELHEADER":
            fields = {}
        elif word == "#ENDCHANNELHEADER" and fields is not None:
            found.append(_Channel(fields, file))
            fields = None
        elif fields is not None:
            key, _, value = word.partition(",")
            fields[key] = value
    return found


def _read(channel: _Channel, channels: Sequence[_Channel], place: Path, n_rows: int) -> FloatArray:
    start, step = channel.number(_START, 0.0), channel.number(_STEP, 1.0)
    if channel.text(_KIND).upper().startswith("IMPLI"):
        return start + step * np.arange(n_rows, dtype=np.float64)
    kind = _TYPES.get(channel.text(_TYPE).upper())
    if kind is None:
        raise channel.fault(f"holds {shown(channel.text(_TYPE))}, expected one of {', '.join(_TYPES)}")
    data = check_readable(_beside(place, channel))
    offset = int(channel.number(_OFFSET, 1)) - 1
    width = 1
    if channel.text(_STORED).upper().startswith("BLOCK"):  # one number of every channel in turn
        width = sum(other.text(_FILE).lower() == channel.text(_FILE).lower() for other in channels)
    size = np.dtype(kind).itemsize
    n_needed = offset + (n_rows - 1) * width + 1
    if offset < 0 or n_needed * size > data.stat().st_size:
        raise channel.fault(f"{data.name} is shorter than the header says; copy both files again")
    numbers = np.memmap(data, dtype=kind, mode="r", offset=offset * size, shape=((n_rows - 1) * width + 1,))
    # Here start and step are an offset and a factor of the stored number.
    return np.array(numbers[::width], dtype=np.float64) * step + start


def _beside(place: Path, channel: _Channel) -> Path:
    """The data file: in the folder of its header, whatever path it once had, in capitals or not."""
    name = channel.text(_FILE).replace("\\", "/").rpartition("/")[2]
    same = [other for other in place.parent.iterdir() if other.name.lower() == name.lower()] if name else []
    if not same:
        raise channel.fault(f"its numbers are in {shown(name) or 'no file'}, which does not lie beside the header")
    return same[0]
