"""Runs as MATLAB files: versions 4 to 7 by scipy, behind a guard; version 7.3 is HDF5."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import file_name, shown
from dynid_rs.runs.readers.arrays import columns_of, short_names
from dynid_rs.runs.readers.hdf5 import open_hdf5, refuse_objects
from dynid_rs.runs.readers.mat_guard import check_elements
from dynid_rs.runs.readers.table import Columns, Table, as_numbers, damaged, not_of_kind, refuse_too_large

_VERSION_5, _VERSION_73 = b"MATLAB 5.0", b"MATLAB 7.3"
_NUMBERS = ("double", "single", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64")
_OBJECTS = ("opaque", "object", "function", "unknown")
DEEPEST = 8
MOST = 10_000
"""Arrays in structures."""


def open_matlab(path: str | Path) -> Table:
    """Open a MATLAB file: vectors and matrices of samples, also in structures (``log.q``).

    Raises
    ------
    DataError
        Not MATLAB, damaged, objects that only MATLAB can read, too large.
    MissingLibraryError
        Version 7.3 without the library.
    OSError
        The file cannot be opened.
    """
    place, file = check_readable(path), file_name(path)
    with place.open("rb") as stream:
        head = stream.read(128)
    if head.startswith(_VERSION_73):
        return open_hdf5(path)
    is_five = head.startswith(_VERSION_5) or (len(head) == 128 and head[126:128] in (b"IM", b"MI"))
    is_four = len(head) >= 20 and head[:4] in (bytes(4), b"\x0a\0\0\0", b"\x14\0\0\0", b"\0\0\x03\xe8")
    if not is_five and not is_four:
        raise not_of_kind("a MATLAB file", head, file, "not_matlab")
    kind = "MATLAB 5" if is_five else "MATLAB 4"
    refuse_too_large(place.stat().st_size, file)
    if is_five:
        check_elements(place, file)
    arrays, opaque = _arrays(place, file, kind)
    if opaque and not any(values.size > 1 for values in arrays.values()):
        raise refuse_objects(opaque, file)
    names = short_names(list(arrays))
    values = {names[path]: array for path, array in arrays.items()}
    found, n_rows = columns_of({name: array.shape for name, array in values.items()}, file)

    def load(wanted: Sequence[str]) -> Columns:
        return {name: as_numbers(found[name].of(values[found[name].array]), file, name) for name in wanted}

    notes = (f"{shown(', '.join(opaque), 80)}: objects of MATLAB, which are not read",) if opaque else ()
    return Table(file, kind, tuple(found), n_rows, load, notes=notes)


def _arrays(place: Path, file: str, kind: str) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Arrays of numbers by path, and the names of objects."""
    from scipy.io import loadmat, whosmat

    # scipy answers damage with errors of many classes (zlib, struct, numpy, ...): one fact.
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of duplicate names: the last one counts in MATLAB as well
            known = whosmat(str(place))
            wanted = [name for name, _, of in known if of in (*_NUMBERS, "struct")]
            content = loadmat(str(place), variable_names=wanted, simplify_cells=True) if wanted else {}
    except Exception as error:
        raise damaged(kind, error, file) from None
    arrays: dict[str, NDArray[Any]] = {}
    ways = [(f"/{name}", content[name], 0) for name in wanted if name in content]
    while ways:
        path, value, depth = ways.pop(0)
        if isinstance(value, dict) and depth < DEEPEST:
            ways += [(f"{path}/{key}", inner, depth + 1) for key, inner in value.items()]
        elif isinstance(value, list) and depth < DEEPEST:
            ways += [(f"{path}_{k}", inner, depth + 1) for k, inner in enumerate(value[:MOST])]
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
            arrays[path] = value
        if len(arrays) > MOST:
            raise DataError(f"{file}: holds more than {MOST} arrays; save the run alone", code="too_large", file=file)
    return arrays, [name for name, _, of in known if of in _OBJECTS]
