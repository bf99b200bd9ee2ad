"""Torques whose formula is a column of the compiled core: friction of every kind, ripple, springs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.simulation.effects.base import LabEffect, Signals, Value

if TYPE_CHECKING:
    from dynid_rs.simulation.arm import SimulatedArm

FloatArray = NDArray[np.float64]

LINK_SIDE = ("joint_spring", "counterbalance")
"""They pull at the link: the gear transmits them."""


@dataclass(frozen=True, eq=False)
class ColumnEffect(LabEffect):
    """A kind of the core's catalogue with its shape parameters and coefficients.

    `shape` gives each shape parameter one value per joint; `coefficients` is (n_joints, n_columns), zero
    where the effect does not act.
    """

    shape: Mapping[str, FloatArray] = None  # type: ignore[assignment]
    coefficients: FloatArray = None  # type: ignore[assignment]

    @property
    def remembers(self) -> bool:
        """Whether the core's formula has a memory."""
        return bool(entry_of(self.kind)["memory"])

    def link_torque(self, arm: SimulatedArm, t: FloatArray, q: FloatArray) -> FloatArray | None:
        """Torque of springs and cylinders, which depends on the position alone."""
        if self.kind not in LINK_SIDE:
            return None
        still = np.zeros_like(q)
        return np.asarray(_core.effect_torque(self._effect(), self.coefficients, q, still, still))

    def motor_torque(self, arm: SimulatedArm, signals: Signals) -> FloatArray | None:
        """Torque of everything else, on the motor side."""
        if self.kind in LINK_SIDE:
            return None
        s = signals
        step = float(s.t[1] - s.t[0]) if self.remembers else None
        sides = (s.q, s.dq, s.ddq, s.q_motor, s.dq_motor, s.ddq_motor)
        predicted = {"tau_link": s.tau_link, "tau_motor": s.tau_motor}
        return np.asarray(_core.effect_torque(self._effect(), self.coefficients, *sides, **predicted, step=step))

    def _effect(self) -> _core.Effect:
        return _core.Effect.of(self.kind, **self.shape)


def entry_of(kind: str) -> Mapping[str, Any]:
    """Return what the core's catalogue says about a kind.

    Raises
    ------
    KeyError
        There is no such kind.
    """
    return _catalogue()[kind]


def column_effect(
    kind: str, joints: tuple[int, ...], size: float, shape: Mapping[str, Any], coefficients: Mapping[str, Any]
) -> ColumnEffect:
    """Build an effect from values per joint (n_joints,) of shape parameters and coefficients, by their names."""
    entry = entry_of(kind)
    names = [c["name"] for c in entry["coefficients"]]
    units = {item["name"]: _plain(item["unit"]) for item in (*entry["shape"], *entry["coefficients"])}
    table = np.stack([coefficients[name] for name in names], axis=1)
    picked = list(joints)
    values = tuple(
        Value(name, np.asarray(numbers)[picked].tolist(), units[name])
        for name, numbers in (*shape.items(), *coefficients.items())
    )
    return ColumnEffect(kind, joints, size, values, shape=shape, coefficients=table)


@cache
def _catalogue() -> Mapping[str, Mapping[str, Any]]:
    return {entry["kind"]: entry for entry in _core.effect_catalogue()}


def _plain(unit: str) -> str:
    return unit.replace("{torque}", "N*m").replace("{angle}", "rad")
