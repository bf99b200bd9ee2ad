"""What the report is made of: ``result.json`` and ``residuals.parquet``, checked once, here."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.arrow_arrays import to_numpy
from dynid_rs.base.arrow_files import arrow_file
from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable, with_sentence
from dynid_rs.base.json_file import read_json
from dynid_rs.base.quoting import shown, shown_value
from dynid_rs.base.together import finish_killed
from dynid_rs.report.shape import DIAGNOSIS_SHAPE, RESULT_SHAPE, is_diagnosis

Array = NDArray[np.float64]

RESULT_FILE = "result.json"
RESIDUALS_FILE = "residuals.parquet"
FORMAT, VERSION = "dynid-result", 1
_MEND = "write it again with `dynid identify`"


@dataclass(frozen=True, eq=False)
class Signals:
    """The table of ``residuals.parquet``: one row per sample.

    Parameters
    ----------
    run : ndarray, (n,)
        Index into `run_names`.
    run_names : tuple of str
        Recorded files, in order of appearance.
    is_test : ndarray of bool, (n,)
        Whether the sample belongs to a test run.
    columns : dict of str to ndarray, each (n,)
        ``t`` [s] and, per joint index i, ``measured_i``, ``predicted_i``, the terms, ``residual_i``
        [torque unit], ``q_i`` and ``dq_i``.
    """

    run: NDArray[np.int64]
    run_names: tuple[str, ...]
    is_test: NDArray[np.bool_]
    columns: dict[str, Array]


@dataclass(frozen=True, eq=False)
class Source:
    """Everything the report says comes from here: the checked result and the checked table."""

    result: dict[str, Any]
    signals: Signals


def source_of(result: dict[str, Any], table: Mapping[str, NDArray[Any]]) -> Source:
    """Source from what `dynid identify` is about to write: the content of ``result.json`` and of the table."""
    run_names, run_code = _distinct(table["run"])
    columns = {name: values for name, values in table.items() if name not in ("run", "set")}
    return Source(result, Signals(run_code, run_names, table["set"] == "test", columns))


def _distinct(labels: NDArray[Any]) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Distinct labels in order of appearance, and each label's index among them."""
    places = {name: k for k, name in enumerate(dict.fromkeys(labels.tolist()))}
    return tuple(places), np.array([places[name] for name in labels.tolist()], dtype=np.int64)


def read_source(directory: Path) -> Source:
    """Read and check what ``dynid identify`` wrote into `directory`.

    Raises
    ------
    FileNotFoundError, OSError
        The folder or one of the two files is missing or cannot be read.
    DataError
        A file is not what it should be; the sentence names file and place.
    """
    named = "name the folder that `dynid identify -o` wrote"
    if directory.is_file():
        raise NotADirectoryError(f"{directory}: this is a file, and a folder with results is expected; {named}")
    if directory.is_dir() and not any((directory / name).exists() for name in (RESULT_FILE, RESIDUALS_FILE)):
        raise FileNotFoundError(f"{directory}: there is no {RESULT_FILE} in this folder; {named}")
    if not directory.is_dir():
        raise FileNotFoundError(f"{directory}: there is no such folder; name the one that `dynid identify -o` wrote")
    finish_killed(directory)  # else a result might be read beside the table of another one
    result = read_result(directory / RESULT_FILE)
    return Source(result, _read_signals(directory / RESIDUALS_FILE, len(result["joints"])))


def read_result(path: Path) -> dict[str, Any]:
    """Content of a `result.json`.

    Raises
    ------
    OSError
        The system refuses to read it.
    DataError
        It is not what `dynid identify` or `dynid diagnose` writes.
    """
    result = read_json(path, lambda text: _refuse(path, text))
    if not isinstance(result, dict) or result.get("format") != FORMAT:
        _refuse(path, f'"format" must be "{FORMAT}"')
    if result.get("version") != VERSION:
        found = shown_value(result.get("version"))
        raise DataError(
            f'{path}: "version" must be {VERSION}, found {found}; use the dynid that wrote it',
            code="result_version",
            file=str(path),
        )
    joints = result.get("joints")
    if not isinstance(joints, list) or not joints:
        _refuse(path, '"joints" must be a list of at least one name')
    fault = _find_fault(result, RESULT_SHAPE, "", len(joints))
    if fault is None and is_diagnosis(result):
        fault = _find_fault(result, DIAGNOSIS_SHAPE, "", len(joints))
    if fault:
        _refuse(path, fault)
    return result


def _find_fault(value: Any, shape: Any, where: str, n_joints: int) -> str | None:
    """Return the first place where `value` has not the shape it should have, as half a sentence."""
    if isinstance(shape, Mapping):
        return _find_fault_in_object(value, shape, where, n_joints)
    if isinstance(shape, list | tuple):
        return _find_fault_in_list(value, shape, where, n_joints)
    if shape == "interval":
        pair = isinstance(value, list) and len(value) == 2 and all(_is_number(bound) for bound in value)
        return None if pair else f'"{where}" must be two numbers, found {_seen(value)}'
    if shape is float:
        return None if _is_number(value) else f'"{where}" must be a finite number, found {_seen(value)}'
    if shape == "kept":  # one answer for the robot, or one per joint
        if isinstance(value, list):
            return _find_fault_in_list(value, ("per joint", bool), where, n_joints)
        shape = bool
    expected = {str: "text", bool: "true or false"}[shape]
    return None if isinstance(value, shape) else f'"{where}" must be {expected}, found {_seen(value)}'


def _find_fault_in_object(value: Any, shape: Mapping[str, Any], where: str, n_joints: int) -> str | None:
    if not isinstance(value, dict):
        return f'"{where}" must be an object, found {_seen(value)}'
    for key, inner in shape.items():
        name = key.removesuffix("?")
        place = f"{where}.{name}" if where else name
        if value.get(name) is None:
            if name == key:
                return f'"{place}" is missing'
            continue
        fault = _find_fault(value[name], inner, place, n_joints)
        if fault:
            return fault
    return None


def _find_fault_in_list(value: Any, shape: Any, where: str, n_joints: int) -> str | None:
    if not isinstance(value, list):
        return f'"{where}" must be a list, found {_seen(value)}'
    per_joint = isinstance(shape, tuple)
    if per_joint and len(value) != n_joints:
        return f'"{where}" must hold one entry per joint ({n_joints}), found {len(value)}'
    inner = shape[-1]
    faults = (
        _find_fault(item, inner, f"{where}[{index}]", n_joints)
        for index, item in enumerate(value)
        if not (per_joint and item is None)
    )
    return next((fault for fault in faults if fault), None)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _seen(value: Any) -> str:
    return shown(json.dumps(value), 30)


def _read_signals(path: Path, n_joints: int) -> Signals:
    import pyarrow as pa
    import pyarrow.parquet as pq

    check_readable(path)
    try:
        table = pq.read_table(arrow_file(path), use_threads=False)
    except pa.ArrowException as error:
        _refuse(path, f"this is not a readable Parquet file ({' '.join(str(error).split())[:120]})")
    except OSError as error:
        # Arrow raises a bare OSError for a damaged file too; the system's own errors carry a number.
        if error.errno is not None:
            raise with_sentence(error, path, "read") from None
        _refuse(path, "this is not a readable Parquet file; it is damaged or cut off")
    wanted = [f"{signal}_{i}" for i in range(n_joints) for signal in ("measured", "predicted", "residual", "dq")]
    missing = [name for name in ("run", "set", "t", *wanted) if name not in table.column_names]
    if missing:
        _refuse(path, f"column {missing[0]} is missing", column=missing[0])
    if table.num_rows == 0:
        _refuse(path, "it holds no rows")
    columns = {}
    for name in table.column_names:
        if name in ("run", "set"):
            continue
        try:
            values = np.asarray(to_numpy(table.column(name)), dtype=np.float64)
        except (ValueError, TypeError, pa.ArrowException):
            _refuse(path, f"column {name} must hold numbers", column=name)
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values)))
            _refuse(path, f"column {name}, row {row}: not a finite number", column=name, row=row)
        columns[name] = values
    run_code, run_names = _codes(table.column("run"))
    set_code, set_names = _codes(table.column("set"))
    is_test = np.asarray([name == "test" for name in set_names])[set_code]
    return Signals(run_code, run_names, is_test, columns)


def _codes(column: Any) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Turn an Arrow column of labels into indices of distinct names, in order of appearance."""
    import pyarrow as pa

    encoded = column.cast(pa.string()).fill_null("").combine_chunks().dictionary_encode()
    codes = np.asarray(to_numpy(pa.chunked_array([encoded.indices])), dtype=np.int64)
    return codes, tuple(encoded.dictionary.to_pylist())


def _refuse(path: Path, fault: str, *, column: str | None = None, row: int | None = None) -> NoReturn:
    raise DataError(f"{path}: {fault}; {_MEND}", code="bad_result", file=str(path), column=column, row=row)
