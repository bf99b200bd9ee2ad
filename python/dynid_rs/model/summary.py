"""What a torque model holds, as tables: where it was trained, and every coefficient with its unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dynid_rs import _core
from dynid_rs.base.notebook import html_table, text_table
from dynid_rs.base.units import torque_of, unit_text
from dynid_rs.base.wording import kind_words
from dynid_rs.model.units import own_unit, shape_unit

IDLE = "-"
"""Where a joint lacks an effect."""


@dataclass(frozen=True)
class Row:
    """One number per joint: `values` are None where a joint lacks the effect, `units` joint by joint."""

    name: str
    values: tuple[float | None, ...]
    units: tuple[str, ...]


@dataclass(frozen=True)
class ModelSummary:
    """A model in tables; `print` it, or let a notebook show it.

    Parameters
    ----------
    title : str
        Robot, unit, band.
    joints : tuple of str
        In chain order.
    rows : tuple of Row
        What the model leaves, where it was trained, coefficients and shapes.
    notes : tuple of str
        What has no number per joint.
    """

    title: str
    joints: tuple[str, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data: rows by name, values and units by joint."""
        return {
            "title": self.title,
            "rows": {
                row.name: {
                    joint: {"value": value, "unit": unit}
                    for joint, value, unit in zip(self.joints, row.values, row.units, strict=True)
                }
                for row in self.rows
            },
            "notes": list(self.notes),
        }

    def __str__(self) -> str:
        return "\n".join([self.title, text_table(*self._table()), *self.notes])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return html_table(*self._table(), title=self.title, note=" ".join(self.notes))

    def _table(self) -> tuple[list[str], list[list[str]]]:
        head = ["", "unit", *self.joints]
        rows = []
        for row in self.rows:
            units = [unit_text(unit) or "1" for unit in dict.fromkeys(row.units)]
            cells = [IDLE if value is None else f"{value:.4g}" for value in row.values]
            rows.append([row.name, " or ".join(units), *cells])
        return head, rows


def summary(model: _core.TorqueModel) -> ModelSummary:
    """Tables of a model."""
    robot, torque = model.robot, model.torque_unit
    kinds = robot.joint_kinds
    angles = tuple("m" if kind == "prismatic" else "rad" for kind in kinds)
    torques = tuple(torque_of(torque, kind) for kind in kinds)
    q, dq, ddq = model.domain
    rows = [
        Row("left by the model (std)", tuple(map(float, model.noise_std)), torques),
        Row("trained from", tuple(low for low, _ in q), angles),
        Row("trained to", tuple(high for _, high in q), angles),
        Row("trained up to", tuple(dq), tuple(f"{angle}/s" for angle in angles)),
        Row("trained up to", tuple(ddq), tuple(f"{angle}/s^2" for angle in angles)),
    ]
    seen: dict[str, int] = {}
    for effect, coefficients in model.effects:
        rows += _effect_rows(effect, coefficients, kinds, torque, seen)
    if any(float(scale) != 1.0 for scale in model.torque_scale):
        rows.append(Row("torque channel's gain", tuple(map(float, model.torque_scale)), ("1",) * robot.n_joints))
    if any(map(float, model.encoder_delay)):
        rows.append(Row("link encoder late by", tuple(map(float, model.encoder_delay)), ("s",) * robot.n_joints))
    band = model.band
    told = f", errors told below {band[0]:.3g} Hz" if band is not None else ""
    noun = "joint" if robot.n_joints == 1 else "joints"
    title = f"Torque model of {robot.name}: {robot.n_joints} {noun}, in {unit_text(torque)}{told}"
    return ModelSummary(title, tuple(robot.joint_names), tuple(rows), tuple(_notes(model)))


def _effect_rows(
    effect: _core.Effect, coefficients: Any, kinds: Sequence[str], torque: str, seen: dict[str, int]
) -> list[Row]:
    """Coefficients and shape of an effect, nothing for joints that lack it."""
    acts = [bool(row.any()) for row in coefficients]
    if not any(acts):
        return []
    seen[effect.kind] = seen.get(effect.kind, 0) + 1
    again = f" ({seen[effect.kind]})" if seen[effect.kind] > 1 else ""
    name = kind_words(effect.kind) + again
    own = [
        Row(
            _row_name(name, column),
            tuple(float(coefficients[j, k]) if acts[j] else None for j in range(len(kinds))),
            tuple(own_unit(column, torque, kind) for kind in kinds),
        )
        for k, column in enumerate(effect.coefficient_names)
    ]
    shape = [
        Row(
            _row_name(name, parameter),
            tuple(float(values[j]) if acts[j] else None for j in range(len(kinds))),
            tuple(shape_unit(parameter, torque, kind) for kind in kinds),
        )
        for parameter, values in effect.shape
    ]
    return own + shape


def _row_name(effect: str, column: str) -> str:
    words = column.replace("_", " ")
    return words if words == effect else f"{effect}: {words}"


def _notes(model: _core.TorqueModel) -> list[str]:
    said = [f"Terms: {', '.join(name.replace('_', ' ') for name in model.term_names)}."]
    if model.residual is not None:
        inputs, regressions = model.residual
        where = [joint for joint, one in zip(model.robot.joint_names, regressions, strict=True) if one is not None]
        said.append(f"Residual on {inputs.replace('_', ' ')}: {', '.join(where)}.")
    if model.torque_delay.any():
        said.append(_late(model))
    if model.physical is not None:
        said.append("A physically consistent set stands beside it.")
    return said


def _late(model: _core.TorqueModel) -> str:
    """How late the torque channels are; those that are not are not named."""
    shared, *others = {float(f"{1e3 * delay:.3g}") for delay in model.torque_delay}
    if not others:
        return f"The torque channel is late by {shared:g} ms."
    joints = zip(model.robot.joint_names, model.torque_delay, strict=True)
    late = ", ".join(f"{joint} by {1e3 * delay:.3g} ms" for joint, delay in joints if delay)
    return f"Torque channels are late: {late}."
