"""Another gravity than the robot's: a base that hangs, stands on a wall or on a slope, or another size."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs.sensors.changes import Bench, Trial
from dynid_rs.sensors.fit import ArmFit, fit_arms

FloatArray = NDArray[np.float64]

EARTH = 9.81
"""Free fall [m/s^2]: 9.78 at the equator, 9.83 at the poles."""
ELSEWHERE = 0.02
"""Relative difference from which on a size is not Earth's, and Earth's is tried too."""
STEPS = (0.4, 0.2, 0.1, 0.05)
"""Turns [rad] that are tried about the best direction so far, one after the other."""
UNFELT = 1e-3
"""Share of a gravity's length below which nothing of it is felt."""
AT_ONCE = 120
"""Runs under one gravity each whose moments are in memory together; more would only take more of it."""
GRAIN = 1.5 * STEPS[-1]
"""Turn [rad] up to which a direction is the robot's own: the last step, and what it may be off by. A base
that is so little off level is a tilt, which a diagnosis names."""


def gravity_trial(
    bench: Bench, fitted: Callable[[Sequence[Bench]], list[ArmFit]] | None = None
) -> tuple[Trial, FloatArray]:
    """The gravity (3,) [m/s^2] under which the runs are most probable: any direction, the robot's size or Earth's.

    What of it no torque shows (along the axes, where all are parallel) stays as the robot has it.
    `fitted` explains the runs under several gravities; as they stand on the bench by default.
    """
    fits = _as_they_stand if fitted is None else fitted

    def likeliest(gravities: Sequence[FloatArray]) -> tuple[ArmFit, FloatArray]:
        n = max(1, AT_ONCE // len(bench.rows))
        parts = [gravities[first : first + n] for first in range(0, len(gravities), n)]
        found = [fit for part in parts for fit in fits([bench.turned(gravity) for gravity in part])]
        return max(zip(found, gravities, strict=True), key=lambda one: one[0].log)

    declared = float(np.linalg.norm(bench.robot.gravity))
    strengths = [declared] if declared > 0 else []
    if abs(declared - EARTH) > ELSEWHERE * EARTH:
        strengths.append(EARTH)
    corners = np.array(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3)).reshape(3, -1).T
    directions = [corner / np.linalg.norm(corner) for corner in corners if np.any(corner)]
    best = likeliest(_as_felt(bench, [strength * direction for strength in strengths for direction in directions]))
    for step in STEPS:
        best = max(best, likeliest(_as_felt(bench, _around(best[1], step))), key=lambda one: one[0].log)
    n = bench.robot.n_joints
    return Trial("mounting", tuple(range(n)), tuple(range(len(bench.rows))), best[0]), best[1]


def is_another(gravity: FloatArray, declared: FloatArray) -> bool:
    """Whether a gravity (3,) is of another size than the robot's, or from further away than the search's grain."""
    size, was = float(np.linalg.norm(gravity)), float(np.linalg.norm(declared))
    if abs(size - was) > ELSEWHERE * was:
        return True
    return float(gravity @ declared) < float(np.cos(GRAIN)) * size * was


def _as_they_stand(benches: Sequence[Bench]) -> list[ArmFit]:
    return fit_arms(benches[0].prior, [bench.plain for bench in benches], benches[0].size)


def _as_felt(bench: Bench, gravities: Sequence[FloatArray]) -> list[FloatArray]:
    """Gravities (3,) as long as they are, turned so that what no torque shows of them is as the robot has it."""
    felt = bench.felt
    if len(felt) in (0, 3):
        return list(gravities)
    was = np.asarray(bench.robot.gravity)
    hidden = was - felt.T @ (felt @ was)
    turned = []
    for gravity in gravities:
        seen, size = felt.T @ (felt @ gravity), float(np.linalg.norm(gravity))
        length = float(np.linalg.norm(seen))
        if length < UNFELT * size:
            continue
        # A robot file whose gravity is mostly out of sight says nothing of what is seen: all of it is, then.
        beside = hidden if 2 * float(hidden @ hidden) < size**2 else np.zeros(3)
        turned.append(beside + seen * np.sqrt(size**2 - float(beside @ beside)) / length)
    return turned


def _around(gravity: FloatArray, turn: float) -> list[FloatArray]:
    """Eight vectors (3,) as long as one, in a ring of half angle `turn` [rad] around it."""
    first = np.cross(gravity, np.eye(3)[int(np.argmin(np.abs(gravity)))])
    first *= np.linalg.norm(gravity) / np.linalg.norm(first)
    second = np.cross(gravity, first) / np.linalg.norm(gravity)
    angles = np.arange(8) * np.pi / 4
    across = [np.cos(angle) * first + np.sin(angle) * second for angle in angles]
    return [np.cos(turn) * gravity + np.sin(turn) * aside for aside in across]
