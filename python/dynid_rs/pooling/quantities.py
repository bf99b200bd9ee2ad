"""Quantities of an arm that mean something by themselves, each linear in the unknowns, with standard errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.units import angle_units, torque_of
from dynid_rs.model.units import own_unit
from dynid_rs.pooling.arm import ArmEstimate

FloatArray = NDArray[np.float64]

KINDS = ("friction", "offset", "coefficient", "base", "gain", "error")


@dataclass(frozen=True, eq=False)
class Quantity:
    """One quantity of all arms of a type.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    name : str
        As the unknowns have it, or the kind.
    place : str
        Joint or link.
    unit : str
        Of the values; "1" for gains, and for errors, whose logarithm is meant.
    y, s : ndarray (n_arms,)
        Estimates and standard errors.
    at : float, optional
        Speed at which friction is meant.
    at_unit : str, optional
        Of that speed, which an ampere does not tell.
    """

    kind: str
    name: str
    place: str
    unit: str
    y: FloatArray
    s: FloatArray
    at: float | None = None
    at_unit: str | None = None


def quantities(arms: Sequence[ArmEstimate]) -> list[Quantity]:
    """Friction, constant torque and other coefficients of every joint, base parameters, and errors on test runs."""
    first = arms[0]
    x = np.stack([arm.x for arm in arms])
    std = np.sqrt(np.maximum(np.stack([np.diag(arm.covariance) for arm in arms]), 0.0))
    found = []
    speed = np.median([arm.speed for arm in arms], axis=0)
    at: tuple[float, str] | tuple[None, None]
    for j, joint in enumerate(first.joints):
        rows = [arm.friction_at(j, float(speed[j])) for arm in arms]
        for kind, k in (("friction", 0), ("offset", 1)):
            y, s = _linear(arms, [pair[k] for pair in rows])
            unit = torque_of(first.torque_unit, first.kinds[j])
            at = (float(speed[j]), f"{angle_units(first.kinds)[j]}/s") if kind == "friction" else (None, None)
            found.append(Quantity(kind, kind, joint, unit, y, s, *at))
        for name in first.own_names:
            place = first.own(j, name)
            if place is not None and name not in (*first.friction_names, "torque_offset"):
                unit = own_unit(name, first.torque_unit, first.kinds[j])
                found.append(Quantity("coefficient", name, joint, unit, x[:, place], std[:, place]))
    found += [
        Quantity("base", name, first.base_links[k], first.base_units[k], x[:, k], std[:, k])
        for k, name in enumerate(first.names)
    ]
    for j, joint in enumerate(first.joints):
        share = np.array([arm.error[j] / max(arm.torque_std[j], 1e-300) for arm in arms])
        logs = np.log(np.maximum(share, 1e-12))
        spread = np.array([arm.error_spread[j] for arm in arms])
        found.append(Quantity("error", "error", joint, "1", logs, spread))
    return found


def _linear(arms: Sequence[ArmEstimate], rows: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    y = np.array([row @ arm.x for arm, row in zip(arms, rows, strict=True)])
    power = np.array([row @ arm.covariance @ row for arm, row in zip(arms, rows, strict=True)])
    return y, np.sqrt(np.maximum(power, 0.0))
