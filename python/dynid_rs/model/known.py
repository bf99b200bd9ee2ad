"""Effects whose coefficients are known, from a data sheet or another experiment: taken off the torque, never fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.errors import DataError
from dynid_rs.runs.preprocessing import States, is_of_load

FloatArray = NDArray[np.float64]
KnownTerm = tuple[_core.Effect, FloatArray]
"""An effect with its shape, and its coefficients (n_joints, n_columns); zero for joints that lack it."""


def check_known(known: Sequence[KnownTerm], robot: _core.RobotModel, torque_unit: str) -> list[KnownTerm]:
    """Return the terms with their coefficients as arrays.

    Raises
    ------
    ValueError
        Coefficients of another shape or not finite, a kind that is fitted in every model, or one that is there twice.
    DataError
        The torque is in ampere: known coefficients are in N m.
    """
    if known and torque_unit != "N*m":
        raise DataError(
            f"known terms are in N*m and the torque is in {torque_unit}; give the drive gains, or leave the terms out",
            code="known_in_ampere",
        )
    entries = {entry["kind"]: entry for entry in _core.effect_catalogue()}
    checked: list[KnownTerm] = []
    for effect, values in known:
        kind = effect.kind
        coefficients = np.asarray(values, dtype=np.float64)
        expected = (robot.n_joints, effect.n_columns)
        if coefficients.shape != expected or not np.all(np.isfinite(coefficients)):
            raise ValueError(
                f"known {kind}: coefficients must be finite and of shape {expected}, one row per joint, found shape "
                f"{coefficients.shape}"
            )
        if entries[kind]["declared"]:
            raise ValueError(f"known {kind}: is fitted in every model, so it cannot be a known term; leave it out")
        if is_of_load(entries[kind]["signals"]):
            raise ValueError(
                f"known {kind}: depends on the load, which is known only after the fit; a known term may depend on "
                "motion alone"
            )
        if kind in {other.kind for other, _ in checked}:
            raise ValueError(f"known {kind}: is there twice; give one effect with the coefficients of all joints")
        checked.append((effect, coefficients))
    return checked


def known_torque(known: Sequence[KnownTerm], states: States) -> FloatArray:
    """Torque of all terms along a run, (n, n_joints) [N m], by the code that runs online."""
    total = np.zeros_like(states.tau)
    for effect, coefficients in known:
        total += _core.effect_torque(
            effect, coefficients, *states.signals(), step=1 / states.rate, temperature=states.temperature
        )
    return total


def less_known(known: Sequence[KnownTerm], runs: Sequence[States]) -> list[States]:
    """Return the same runs with the terms' torque taken off the measured one."""
    if not known:
        return list(runs)
    return [replace(states, tau=states.tau - known_torque(known, states)) for states in runs]
