"""Search of a gear's shape parameters: the load within which play is crossed, the way over which hysteresis turns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.deflection.system import centred, inverse
from dynid_rs.diagnosis.deflection.terms import PLAY, columns_of
from dynid_rs.diagnosis.peak import highest

if TYPE_CHECKING:
    from dynid_rs.diagnosis.deflection.gear import Gear

FloatArray = NDArray[np.float64]

WIDTHS = (0.002, 0.005, 0.012, 0.03, 0.07)
"""Of the load's greatest value."""
DISTANCES = (0.01, 0.03, 0.1, 0.3)
"""Of the wind-up's range."""
ROTOR_SHARES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.95)
"""Of the load's standard deviation, in what follows the acceleration."""
NEAR = 1.5
"""Factor within which a distance is searched again along the way that it led to."""
REFINED = 8
"""Evaluations of a refined search."""


class Beside:
    """Terms that stay, and the power that one further column takes off what they leave."""

    def __init__(self, gear: Gear, names: Sequence[str]) -> None:
        self._runs = gear.runs
        system = gear.system(names)
        self._rows = np.concatenate(
            [
                np.column_stack([errors, *(columns[k] for columns in system.columns.values())])[run.used]
                for k, (errors, run) in enumerate(zip(system.errors, gear.runs, strict=True))
            ]
        )
        normal = self._rows.T @ self._rows
        normal[: system.n_errors, : system.n_errors] += system.noise_power * np.eye(system.n_errors)
        self._inverse = inverse(normal)
        w = np.concatenate([w[run.used] for w, run in zip(system.deflection, gear.runs, strict=True)])
        self._solution = self._inverse @ (self._rows.T @ w)
        self._left = w - self._rows @ self._solution
        self._n_errors = system.n_errors

    def gain(self, *columns: Sequence[FloatArray]) -> tuple[float, FloatArray, FloatArray]:
        """Power that columns, (n,) per run, take off, and the coefficients u, x with theirs in the last places."""
        z = np.stack(
            [
                np.concatenate([centred(run, x)[run.used] for run, x in zip(self._runs, column, strict=True)])
                for column in columns
            ],
            axis=1,
        )
        shared = self._inverse @ (self._rows.T @ z)
        free = z.T @ (z - self._rows @ shared)
        along = inverse(free) @ (z.T @ self._left)
        solution = np.concatenate([self._solution - shared @ along, along])
        return float(along @ free @ along), solution[: self._n_errors], solution[self._n_errors :]


def rotor_share(gear: Gear) -> float:
    """How much of the load is a rotor that moves on the motor's side of the gear, over the last error direction.

    A torque does not tell such a rotor from the link's own inertia; wind-up and play do.
    """
    smooth = [name for name in gear.names if name in ("delay", "eccentricity")]
    beside = Beside(gear, smooth)

    def gain(share: float) -> float:
        tried = gear.without_rotor(share)
        loads = [run.load for run in tried.runs]
        steps = [columns_of("backlash", run, gear.shapes, run.load)[:, 0] for run in tried.runs]
        return beside.gain(loads, steps)[0]

    _, (share, _) = highest(gain, ROTOR_SHARES, REFINED)
    return share


def find_width(gear: Gear) -> Gear:
    """Return the gear with the width of its play that explains most."""
    if "backlash" not in gear.names:
        return gear
    beside = Beside(gear, [name for name in gear.names if name not in PLAY])
    top = max(float(np.abs(run.load).max()) for run in gear.runs)

    def gain(width: float) -> float:
        shapes = replace(gear.shapes, width=width)
        steps = [columns_of("backlash", run, shapes, run.load)[:, 0] for run in gear.runs]
        return beside.gain(steps)[0]

    return replace(gear, shapes=replace(gear.shapes, width=_best(gain, [share * top for share in WIDTHS])))


def find_distance(gear: Gear) -> Gear:
    """Return the gear with the way of its hysteresis that explains most, and the state along it."""
    names = [name for name in gear.names if name != "hysteresis"]
    beside = Beside(gear, names)

    def paths_of(tried: Gear) -> list[FloatArray]:
        _, u, x = beside.gain(tried.z)
        return tried.path([*names, "hysteresis"], u, x)

    paths = paths_of(gear)

    def gain(distance: float) -> float:
        return beside.gain(replace(gear, shapes=replace(gear.shapes, distance=distance)).remembering(paths).z)[0]

    reach = max(float(np.ptp(path)) for path in paths)
    grid = [share * reach for share in DISTANCES]
    for _ in range(2):
        best = _best(gain, grid)
        grid = [best / NEAR, best, best * NEAR]
        gear = replace(gear, shapes=replace(gear.shapes, distance=best)).remembering(paths)
        paths = paths_of(gear)
    return gear.remembering(paths)


def _best(gain: Callable[[float], float], grid: Sequence[float]) -> float:
    """Value of greatest gain, from a grid and refined in its logarithm between the neighbours."""
    first, refined = highest(lambda x: gain(float(np.e**x)), [float(np.log(value)) for value in grid], REFINED)
    return float(np.e ** max(first, refined, key=lambda end: end[1])[0])
