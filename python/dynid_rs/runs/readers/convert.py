"""Columns of a file become the signals of a recording: SI, link side, one sign convention."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError
from dynid_rs.runs.cells import FloatArray, check_finite, check_size, check_time, seconds_of
from dynid_rs.runs.parts import MOST_SAID, Split, find_parts, part_name, split_of
from dynid_rs.runs.readers.columns import ColumnMap
from dynid_rs.runs.readers.config import Config, PerJoint
from dynid_rs.runs.readers.table import Columns, Table

_SIGN_OF = {
    "q": "q",
    "dq": "q",
    "ddq": "q",
    "q_reference": "q",
    "q_motor": "q_motor",
    "dq_motor": "q_motor",
    "ddq_motor": "q_motor",
    "tau": "tau",
    "current": "tau",
}


@dataclass(frozen=True)
class _Converter:
    config: Config
    joints: tuple[str, ...]
    kinds: tuple[str, ...]

    def per_joint(self, values: PerJoint, key: str) -> FloatArray:
        n_joints = len(self.joints)
        if len(values) not in (1, n_joints):
            raise DataError(
                f"{self.config.source}, {key}: has {len(values)} numbers, but the robot "
                f"has {n_joints} joints "
                f"({', '.join(self.joints)}); give one number per joint",
                code="bad_config",
                file=self.config.source,
                column=key,
            )
        return np.broadcast_to(np.array(values, dtype=np.float64), (n_joints,))

    def unit(self, signal: str) -> FloatArray:
        """Factor to SI per joint; prismatic joints have lengths where others have angles."""
        factor = self.config.factor
        if signal in ("q", "q_motor", "q_reference"):
            turning, sliding = factor("angle"), factor("length")
        elif signal in ("dq", "dq_motor"):
            turning, sliding = factor("velocity"), factor("length")
        elif signal in ("ddq", "ddq_motor"):
            turning, sliding = factor("angle"), factor("length")
        else:
            turning = sliding = factor({"tau": "torque", "current": "current"}[signal])
        return np.array([sliding if kind == "prismatic" else turning for kind in self.kinds])

    def scale(self, signal: str) -> FloatArray:
        """Everything a column is multiplied by, per joint."""
        scale = self.unit(signal)
        sign = _SIGN_OF[signal]
        if sign in self.config.signs:
            scale = scale * self.per_joint(self.config.signs[sign], f"[signs] {sign}")
        if signal == "current" and self.config.drive_gain is not None:
            scale = scale * self.per_joint(self.config.drive_gain, "[drive] gain")
        if self.config.gear_ratio is not None:
            ratio = self.per_joint(self.config.gear_ratio, "[gear] ratio")
            applies = self.config.gear_apply_to
            if signal in applies:
                scale = scale * ratio if signal == "tau" else scale / ratio
        return scale


@dataclass(frozen=True)
class Converted:
    """Arguments of the recordings that a file gives: of one, or of one per part; where their rows are, and why."""

    parts: tuple[dict[str, Any], ...]
    rows: tuple[tuple[int, int], ...]
    n_rows: int
    split: Split | None = None


def to_parts(
    table: Table, columns: Columns, found: ColumnMap, joints: Sequence[str], kinds: Sequence[str], config: Config
) -> Converted:
    """Convert the mapped columns.

    Parameters
    ----------
    table : Table
        Opened file.
    columns : dict of str to ndarray (n,)
        Its mapped columns as they were loaded.
    found : ColumnMap
        Columns by meaning.
    joints, kinds : sequence of str
        Joint names, and ``"revolute"`` or ``"prismatic"`` for each.
    config : Config
        Units, gear ratios, drive gains, signs.

    Raises
    ------
    DataError
        A cell that is not a finite number, faulty time, a config that does not fit the robot.
    """
    converter = _Converter(config, tuple(joints), tuple(kinds))
    scales = {signal: converter.scale(signal) for signal in found.signals if signal != "temperature"}
    t = seconds(columns[found.time], table, found.time, config)
    if not t.size:
        raise DataError(
            f"{table.file}: no rows, only the names of the columns; record or copy it again",
            code="no_rows",
            file=table.file,
        )
    parts = find_parts(t)
    if not parts.breaks:
        grain = _grain(columns[found.time], config.factor("time"))
        check_time(t, file=table.file, column=found.time, line_of=table.line_of, grain=grain)
    signals: dict[str, Any] = {}
    for signal, names in found.signals.items():
        scale = scales.get(signal, np.ones(len(names)))
        signals[signal] = _stack(table, columns, names, scale) * scale
    parts = parts.in_motion(signals["q"])
    torque_unit = "N*m"
    if "current" in signals:
        signals["tau"] = signals.pop("current")
        torque_unit = "N*m" if config.drive_gain is not None else "A"
    signals.setdefault("tau", np.zeros_like(signals["q"]))  # only where the caller does without torque
    first_line = None if table.first_line is None else table.first_line(len(t))
    arguments = tuple(
        dict(
            t=t[start:stop],
            name=table.file if len(parts.rows) == 1 else part_name(table.file, k, len(parts.rows)),
            joints=tuple(joints),
            kinds=tuple(kinds),
            torque_unit=torque_unit,
            time_unit="ns" if found.time in table.stamps else config.unit("time"),
            first_line=None if first_line is None else first_line + start,
            first_row=start,
            **{signal: values[start:stop] for signal, values in signals.items()},
        )
        for k, (start, stop) in enumerate(parts.rows)
    )
    lines = [table.line_of(row) for row in parts.breaks[:MOST_SAID]] if table.line_of is not None else None
    return Converted(arguments, parts.rows, len(t), split_of(t, parts, lines))


def seconds(values: NDArray[Any], table: Table, column: str, config: Config) -> FloatArray:
    """Time (n,) [s] of a column as it was loaded; stamps and large numbers are counted from the first row."""
    return seconds_of(values, config.factor("time"), stamps=column in table.stamps)


def _grain(values: NDArray[Any], factor: float) -> float | None:
    """Shortest step [s] that floats of a column (n,) can hold as large as they are there; None of what is exact."""
    if values.dtype.kind != "f" or not np.isfinite(values).all():
        return None
    return float(np.spacing(np.abs(values).max())) * factor


def _stack(table: Table, columns: Columns, names: Sequence[str], scale: FloatArray) -> FloatArray:
    """Columns of a signal as they are in the file, (n, n_joints); checked."""
    matrix = np.empty((len(columns[names[0]]), len(names)))
    for joint, name in enumerate(names):
        values = columns[name].astype(np.float64, copy=False)
        check_finite(values, file=table.file, column=name, line_of=table.line_of)
        check_size(values, float(scale[joint]), file=table.file, column=name, line_of=table.line_of)
        matrix[:, joint] = values
    return matrix
