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
LEAST_HELD, LEAST_CHANGES, MOSTLY = 3, 20, 0.8
"""Rows that a held value stands for, how often that has to be seen, and in what share of the cases."""
LEAST_DELAY = 0.01
"""Seconds: a model that takes the velocity's derivative for acceleration is wrong by the jerk of so much time."""
DELAY_SHARE = 0.8
"""Share of the difference that a delay has to explain."""
MOST_DELAY = 0.5
"""Seconds, or a tenth of a short run: rows at the ends are left out by so much."""
STEPS = 8
"""Towards a delay: each leaves of it what is of its second order, so that three or four reach it."""

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
        reason = ""
        if error <= MAX_DISAGREEMENT or rms(change - integral) < NOISE:
            # Too late for a model's acceleration, though its integral hardly shows it.
            reason = (
                _hold(values[:, joint], rec) or _delay(rec, values[:, joint], source, joint) if signal != "ddq" else ""
            )
            if not reason:
                continue
        else:
            reason = _reason(signal, integral, changes, joint)
            if not reason and signal != "ddq":
                reason = _hold(values[:, joint], rec) or _delay(rec, values[:, joint], source, joint)
        yield Finding(
            f"{signal}_disagrees",
            "warning",
            f"{label(rec, signal, joint)} is not the derivative of {source}_{joint}: they differ by "
            f"{100 * error:.0f} %{reason}; {signal} is not used",
            rec.name,
            f"{signal}_{joint}",
            (0, rec.n_samples),
            error,
            "1",
        )


def _hold(values: FloatArray, rec: Recording) -> str:
    """Say that a channel is held for several samples while it changes; empty where it is not.

    In a channel that is sampled as it should be, a value that stands is as likely to stand once more: what stands for
    the same number of rows nearly every time is written less often than it is recorded.
    """
    changed = np.flatnonzero(np.diff(values))
    if len(changed) < LEAST_CHANGES:
        return ""
    lengths = np.diff(changed)
    usual = int(np.median(lengths))
    if usual < LEAST_HELD or np.mean(np.abs(lengths - usual) <= 1) < MOSTLY:
        return ""
    return f", it is held for {usual} rows ({1e3 * usual * rec.median_step:.3g} ms) at a time"


def _delay(rec: Recording, values: FloatArray, source: str, joint: int) -> str:
    """Say that a velocity comes late; empty where it does not, or where that cannot be told.

    ``q(t - delay) - integral of dq`` is nothing but a drift and an error of scale if dq is late. To first order in what
    is left of the delay it is that times dq: a straight line, whose slope is the next step towards the delay. Believed
    where a shift explains most of what there is without one.
    """
    position = getattr(rec, source)[:, joint]
    dt = np.diff(rec.t)
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * dt)])
    seconds = rec.t - rec.t[0]
    most = min(MOST_DELAY, 0.1 * seconds[-1])
    kept = (seconds >= most) & (seconds <= seconds[-1] - most)  # where the shifted position has been recorded
    drift = np.stack([np.ones_like(seconds), seconds, seconds**2, integral], axis=1)[kept]
    scale = np.maximum(np.abs(drift).max(axis=0), 1e-300)
    basis, _ = np.linalg.qr(drift / scale)

    def beside(x: FloatArray) -> FloatArray:
        return np.asarray(x - basis @ (basis.T @ x))

    speed = beside(values[kept])
    power = float(speed @ speed)
    without = beside((position - integral)[kept])
    if power <= 0 or rms(without) <= NOISE / 2:
        return ""
    delay, left = 0.0, without
    for _ in range(STEPS):
        closer = delay + float(left @ speed) / power
        shifted = beside((np.interp(seconds - closer, seconds, position) - integral)[kept])
        if abs(closer) > most or rms(shifted) >= rms(left):
            break
        delay, left = closer, shifted
    share = 1.0 - (rms(left) / rms(without)) ** 2
    if abs(delay) < max(LEAST_DELAY, 1.5 * rec.median_step) or share < DELAY_SHARE:
        return ""
    return f", it comes {1e3 * abs(delay):.0f} ms {'late' if delay > 0 else 'early'} (a slow filter, or another clock)"


def _reason(signal: str, integral: FloatArray, changes: FloatArray, joint: int) -> str:
    change = changes[:, joint]
    if rms(integral) == 0:
        return ", it is zero"
    if abs(correlation(change, integral)) > MIN_CORRELATION:
        slope = float(change @ integral / (change @ change))
        for reason, factor in _FACTORS.items():
            if abs(slope / factor - 1.0) < 0.1 and (signal != "ddq" or factor == -1.0):
                return f", {reason}"
        if abs(slope - 1.0) > MAX_DISAGREEMENT:  # else the size is not what is wrong
            return f", it is {slope:.3g} times as large"
    others = [j for j in range(changes.shape[1]) if j != joint]
    for other in others:
        if abs(correlation(changes[:, other], integral)) > MIN_CORRELATION:
            return f", it follows joint {other}"
    return ""
