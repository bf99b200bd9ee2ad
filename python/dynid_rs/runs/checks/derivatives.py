"""Recorded velocities and accelerations against the positions they belong to."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.findings import Finding
from dynid_rs.runs.checks.motion import (
    block_changes,
    block_edges,
    block_integrals,
    correlation,
    label,
    moving_joints,
    rms,
)
from dynid_rs.runs.recording import FloatArray, Recording

MAX_DISAGREEMENT = 0.15
"""Largest error of the integrated velocity over the change of position, both over blocks of 0.1 s."""

NOISE = 2e-4
"""Change of position over a block [rad] that encoder steps alone can make."""

MIN_CORRELATION = 0.98

_FACTORS = {
    "it is in deg/s": 180.0 / np.pi,
    "its sign is flipped": -1.0,
    "it is in rpm": 30.0 / np.pi,
    "it is in rad/s while the position is in degrees": np.pi / 180.0,
}


def check_derivatives(rec: Recording) -> Iterator[Finding]:
    """`dq` against q, `dq_motor` against q_motor, `ddq` against the velocity: refused where they disagree."""
    moves = moving_joints(rec)
    trusted = True
    if rec.dq is not None:
        found = list(_compare(rec, "dq", rec.dq, "q", block_changes(rec, rec.q), moves))
        trusted = not found
        yield from found
    if rec.dq_motor is not None and rec.q_motor is not None:
        changes = block_changes(rec, rec.q_motor)
        yield from _compare(rec, "dq_motor", rec.dq_motor, "q_motor", changes, moves)
    if rec.ddq is not None:
        velocity = rec.dq if rec.dq is not None and trusted else _velocity(rec)
        yield from _compare(rec, "ddq", rec.ddq, "dq", block_changes(rec, velocity), moves)


def agrees_outside(
    rec: Recording, values: FloatArray, velocity: FloatArray, stretches: Sequence[tuple[int, int]]
) -> bool:
    """Whether a velocity (n,) is the derivative of a position (n,) in the blocks that none of `stretches` touches.

    So it is where there is no such block: nothing contradicts it.
    """
    edges = block_edges(rec)
    outside = np.ones(len(edges) - 1, dtype=bool)
    for start, stop in stretches:
        outside &= (edges[1:] < start) | (edges[:-1] >= stop)
    if not outside.any():
        return True
    change = block_changes(rec, values[:, None])[outside, 0]
    error = rms(change - block_integrals(rec, velocity[:, None])[outside, 0])
    return error <= MAX_DISAGREEMENT * max(rms(change), NOISE)


def _velocity(rec: Recording) -> FloatArray:
    """Central difference of q over half a block to each side (n, n_joints)."""
    half = max(1, int(block_edges(rec)[1]) // 2)
    rows = np.arange(rec.n_samples)
    ahead, behind = np.minimum(rows + half, rec.n_samples - 1), np.maximum(rows - half, 0)
    return np.asarray((rec.q[ahead] - rec.q[behind]) / (rec.t[ahead] - rec.t[behind])[:, None])


def _compare(
    rec: Recording,
    signal: str,
    values: FloatArray,
    source: str,
    changes: FloatArray,
    moves: NDArray[np.bool_],
) -> Iterator[Finding]:
    integrals = block_integrals(rec, values)
    for joint in np.flatnonzero(moves).tolist():
        change, integral = changes[:, joint], integrals[:, joint]
        error = rms(change - integral) / max(rms(change), NOISE)
        if error <= MAX_DISAGREEMENT or rms(change - integral) < NOISE:
            continue
        yield Finding(
            f"{signal}_disagrees",
            "warning",
            f"{label(rec, signal, joint)} is not the derivative of {source}_{joint}: they differ by "
            f"{100 * error:.0f} %{_reason(signal, integral, changes, joint)}; {signal} is not used",
            rec.name,
            f"{signal}_{joint}",
            (0, rec.n_samples),
            error,
            "1",
        )


def _reason(signal: str, integral: FloatArray, changes: FloatArray, joint: int) -> str:
    change = changes[:, joint]
    if rms(integral) == 0:
        return ", it is zero"
    if abs(correlation(change, integral)) > MIN_CORRELATION:
        slope = float(change @ integral / (change @ change))
        for reason, factor in _FACTORS.items():
            if abs(slope / factor - 1.0) < 0.1 and (signal != "ddq" or factor == -1.0):
                return f", {reason}"
        return f", it is {slope:.3g} times as large"
    others = [j for j in range(changes.shape[1]) if j != joint]
    for other in others:
        if abs(correlation(changes[:, other], integral)) > MIN_CORRELATION:
            return f", it follows joint {other}"
    return ""
