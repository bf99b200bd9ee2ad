"""Runs as HDF5, and as MATLAB files of version 7.3, which are HDF5 inside."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dynid_rs.base.errors import DataError, MissingLibraryError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import file_name, shown
from dynid_rs.runs.readers.arrays import columns_of, short_names
from dynid_rs.runs.readers.table import Columns, Table, as_numbers, damaged, not_of_kind, refuse_too_large

MOST_OBJECTS = 10_000
DEEPEST = 16
_MAGIC = b"\x89HDF\r\n\x1a\n"
_OBJECTS = ("table", "timetable", "timeseries", "datetime", "duration", "categorical", "string", "containers.Map")
_MATLAB_HEAD = 512
"""Bytes that MATLAB writes before the HDF5 file proper."""


def open_hdf5(path: str | Path) -> Table:
    """Open HDF5: datasets (n,) or (n, n_joints), in any groups; links to other files are not followed.

    Raises
    ------
    DataError
        Not HDF5, damaged, arrays that are no signals, too large.
    MissingLibraryError
        The library is not installed.
    OSError
        The file cannot be opened.
    """
    place, file = check_readable(path), file_name(path)
    with place.open("rb") as stream:
        head = stream.read(_MATLAB_HEAD + len(_MAGIC))
    is_matlab = head[_MATLAB_HEAD:] == _MAGIC
    if not head.startswith(_MAGIC) and not is_matlab:
        raise not_of_kind("an HDF5 file", head, file, "not_hdf5")
    kind = "MATLAB 7.3" if is_matlab else "HDF5"
    try:
        import h5py
    except ImportError:
        raise MissingLibraryError("h5py", "io", f"{file}: HDF5 and MATLAB 7.3 files") from None
    try:
        with h5py.File(place, "r") as opened:
            shapes, fields, opaque = _datasets(opened, h5py, file)
    except DataError:
        raise
    except Exception as error:  # h5py says OSError, KeyError, RuntimeError, ... of damage
        raise damaged(kind, error, file) from None
    names = short_names(list(shapes))
    if opaque and not any(len(shape) and max(shape) > 1 for shape in shapes.values()):
        raise refuse_objects(opaque, file)
    found, n_rows = columns_of({names[path]: shape for path, shape in shapes.items()}, file, across=is_matlab)
    paths = {name: path for path, name in names.items()}

    def load(wanted: Sequence[str]) -> Columns:
        needed = {found[name].array for name in wanted}
        refuse_too_large(8 * sum(math.prod(shapes[paths[array]]) for array in needed), file)
        try:
            with h5py.File(place, "r") as opened:
                arrays = {array: _read(opened, *fields[paths[array]]) for array in needed}
        except Exception as error:
            raise damaged(kind, error, file) from None
        return {name: as_numbers(found[name].of(arrays[found[name].array]), file, name) for name in wanted}

    notes = (f"{shown(', '.join(opaque), 80)}: objects of MATLAB, which are not read",) if opaque else ()
    return Table(file, kind, tuple(found), n_rows, load, notes=notes)


def refuse_objects(names: Sequence[str], file: str) -> DataError:
    """Return the error for a MATLAB file whose run is in an object that only MATLAB can read."""
    name = shown(names[0])
    return DataError(
        f"{file}: {name} is an object of MATLAB (table, timetable, timeseries), which only MATLAB can read; save plain "
        f"arrays: s = table2struct({name}, 'ToScalar', true); save('run.mat', '-struct', 's')",
        code="matlab_object",
        file=file,
        column=name,
    )


def _datasets(
    opened: Any, h5py: Any, file: str
) -> tuple[dict[str, tuple[int, ...]], dict[str, tuple[str, str | None]], list[str]]:
    """Shapes of all datasets of numbers by path, where each is read from (dataset, field), and objects of MATLAB."""
    shapes: dict[str, tuple[int, ...]] = {}
    fields: dict[str, tuple[str, str | None]] = {}
    opaque: list[str] = []
    seen, ways, count = {h5py.h5o.get_info(opened.id).addr}, [("", opened, 0)], 0
    while ways:
        prefix, group, depth = ways.pop()
        for key in group:
            count += 1
            if count > MOST_OBJECTS or depth > DEEPEST:
                raise DataError(
                    f"{file}: holds more than {MOST_OBJECTS} objects, or nests them more than {DEEPEST} deep; write "
                    "the run into a file of its own",
                    code="too_large",
                    file=file,
                )
            if key.startswith("#") or not isinstance(group.get(key, getlink=True), h5py.HardLink):
                continue  # MATLAB's own references; links may point to other files
            item, path = group[key], f"{prefix}/{key}"
            address = h5py.h5o.get_info(item.id).addr
            if isinstance(item, h5py.Group) and address not in seen:
                seen.add(address)
                ways.append((path, item, depth + 1))
            elif isinstance(item, h5py.Dataset):
                kind = item.attrs.get("MATLAB_class", b"")
                word = kind.decode("ascii", "replace") if isinstance(kind, bytes) else str(kind)
                if word in _OBJECTS or "MATLAB_object_decode" in item.attrs:
                    opaque.append(key)
                elif item.external is None and not item.is_virtual and word not in ("char", "cell"):
                    _add(shapes, fields, path, item)
    return shapes, fields, opaque


def _add(shapes: dict[str, tuple[int, ...]], fields: dict[str, tuple[str, str | None]], path: str, item: Any) -> None:
    if item.shape is None:
        return
    if item.dtype.names is not None:  # a table of records, as PyTables writes it
        for name in item.dtype.names:
            if item.dtype[name].kind in "fiu":
                shapes[f"{path}/{name}"], fields[f"{path}/{name}"] = tuple(item.shape), (path, name)
    elif item.dtype.kind in "fiu":
        shapes[path], fields[path] = tuple(item.shape), (path, None)


def _read(opened: Any, path: str, name: str | None) -> Any:
    return opened[path][()] if name is None else opened[path].fields(name)[()]
