"""Runs as NPZ: sizes are checked before memory is taken, and nothing is ever unpickled."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import file_name, shown
from dynid_rs.runs.readers.table import (
    Columns,
    Table,
    as_numbers,
    looks_like,
    refuse_duplicates,
    refuse_too_large,
)

_SUFFIX = ".npy"
_ENCRYPTED = 0x1


@dataclass(frozen=True)
class _Member:
    entry: str
    shape: tuple[int, ...]
    fortran_order: bool
    dtype: np.dtype[Any]


def open_npz(path: str | Path) -> Table:
    """Open an NPZ file: arrays ``t`` (n,), and per signal ``q_0`` (n,), ... or one ``q`` (n, n_joints).

    Raises
    ------
    DataError
        Not NPZ, damaged, encrypted, pickled objects, arrays of different length, too large.
    OSError
        The file cannot be opened.
    """
    file = file_name(path)
    place = check_readable(path)
    with place.open("rb") as stream:
        head = stream.read(64)
    if not head.startswith(b"PK"):
        raise DataError(
            f"{file}: expected an NPZ file (numpy.savez), but {looks_like(head)}; "
            "give the file the suffix of its format or write it again",
            code="not_npz",
            file=file,
        )
    # zipfile and numpy answer damage with errors of many classes (zlib, struct, tokenize, ...): one fact.
    try:
        with zipfile.ZipFile(place) as archive:
            members = _members(archive, file)
    except DataError:
        raise
    except Exception as error:
        raise _damaged(file, error) from None
    sources = _columns(members, file)
    n_rows = _one_length(members, sources, file)

    def load(wanted: Sequence[str]) -> Columns:
        needed = {sources[name][0] for name in wanted}
        for name in needed:
            if members[name].shape[0] != n_rows:
                length = members[name].shape[0]
                raise _refused(file, name, "length", f"has {length} samples, but time has {n_rows}; cut them alike")
        refuse_too_large(sum(_n_bytes(members[name]) for name in needed), file)
        try:
            with zipfile.ZipFile(place) as archive:
                arrays = {name: _read(archive, members[name]) for name in needed}
        except Exception as error:
            raise _damaged(file, error) from None
        columns = {}
        for name in wanted:
            member, index = sources[name]
            values = arrays[member] if index is None else arrays[member][:, index]
            columns[name] = as_numbers(values, file, name)
        return columns

    return Table(file, "NPZ", tuple(sources), n_rows, load)


def _members(archive: zipfile.ZipFile, file: str) -> dict[str, _Member]:
    """Headers of all arrays; no data is read."""
    entries = archive.infolist()
    refuse_duplicates([entry.filename for entry in entries], file)
    members = {}
    for entry in entries:
        name = entry.filename.removesuffix(_SUFFIX)
        if entry.flag_bits & _ENCRYPTED:
            raise _refused(file, name, "encrypted", "is encrypted, which NPZ does not know; save it without")
        if not entry.filename.endswith(_SUFFIX):
            raise _refused(file, name, "not_npz", "is not a NumPy array; write the file with numpy.savez")
        with archive.open(entry) as stream:
            version = np.lib.format.read_magic(stream)
            read_header = (
                np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            )
            shape, fortran_order, dtype = read_header(stream)
            header_size = stream.tell()
        if dtype.hasobject:
            raise _refused(
                file,
                name,
                "pickled",
                "holds pickled Python objects, which are never read; save plain numbers",
            )
        member = _Member(entry.filename, tuple(shape), bool(fortran_order), dtype)
        if any(side < 0 for side in member.shape) or _n_bytes(member) != entry.file_size - header_size:
            raise _damaged(file, ValueError(f"array {shown(name)} has another size than its header says"))
        members[name] = member
    return members


def _n_bytes(member: _Member) -> int:
    return math.prod(member.shape) * member.dtype.itemsize


def _columns(members: dict[str, _Member], file: str) -> dict[str, tuple[str, int | None]]:
    """Columns of the table: one per vector, one per column of a matrix (``q`` (n, 6) gives q_0 ... q_5)."""
    sources: list[tuple[str, tuple[str, int | None]]] = []
    for name, member in members.items():
        if len(member.shape) == 1:
            sources.append((name, (name, None)))
        elif len(member.shape) == 2 and member.shape[1] <= 1000:
            sources += [(f"{name}_{j}", (name, j)) for j in range(member.shape[1])]
        # Scalars and tensors are no signals: metadata of the writer.
    refuse_duplicates([name for name, _ in sources], file)
    return dict(sources)


def _one_length(members: dict[str, _Member], sources: dict[str, tuple[str, int | None]], file: str) -> int:
    lengths = {member: members[member].shape[0] for member, _ in sources.values()}
    if not lengths:
        raise DataError(f"{file}: holds no array with samples; save t, q and tau", code="empty_file", file=file)
    # Other arrays (gains, names) may lie beside the signals; time says how long a signal is.
    return next((lengths[name] for name in ("t", "time", "timestamp") if name in lengths), max(lengths.values()))


def _read(archive: zipfile.ZipFile, member: _Member) -> NDArray[Any]:
    with archive.open(member.entry) as stream:
        return np.asarray(np.lib.format.read_array(stream, allow_pickle=False))


def _refused(file: str, name: str, code: str, text: str) -> DataError:
    return DataError(f"{file}: array {shown(name)} {text}", code=code, file=file, column=shown(name))


def _damaged(file: str, error: Exception) -> DataError:
    reason = shown(" ".join(str(error).split()) or type(error).__name__, 160)
    return DataError(f"{file}: this NPZ file is damaged ({reason}); copy or record it again", code="damaged", file=file)
