"""Planning the friction experiment: legs at graded speeds joint by joint (Eq. 8), then time-reversed pairs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.excitation.friction_segments import FrictionExperiment, Leg, ReversedPair
from dynid_rs.simulation.limits import MotionLimits, motion_limits

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel

FloatArray = NDArray[np.float64]

USAGE = 0.95
"""Share of the limits that is used: a controller that follows overshoots a little."""
LEAST_RAMP = 0.25
"""Shortest ramp [s]; slow legs need not start with a jerk."""
LEAST_CRUISE = 0.4
"""Shortest stretch of constant speed that is worth a leg [s]; filters settle within half of it."""
REST = 0.4
"""Rest between two motions [s]: it tells them apart."""
MOST_REPEATS = 20
"""Most times that a leg which its limits keep short is repeated."""
LEVELS = (1.0, 0.3, 0.1, 0.03)
"""Speeds of the time-reversed pairs over the greatest: slow ones dwell where friction turns round."""
SPREAD = 0.3
"""Frequencies of the joints' sines differ by this much in all, so that no two move in step."""


def plan_friction_experiment(
    robot: RobotModel,
    limits: MotionLimits | None = None,
    *,
    joints: Sequence[int] | None = None,
    n_speeds: int = 10,
    slowest: float = 2e-3,
    leg_time: float = 2.0,
    pair_time: float = 20.0,
    levels: Sequence[float] = LEVELS,
    pose: FloatArray | None = None,
) -> FrictionExperiment:
    """Plan legs of constant speed in both directions over the same positions, and time-reversed pairs.

    Every joint moves alone on its legs, the others rest in `pose`; in the pairs all joints move at once, so a pair is
    the quicker experiment, but it needs a free box of positions around the pose. Nothing is random.

    Parameters
    ----------
    robot : RobotModel
        The arm.
    limits : MotionLimits, optional
        What every joint may do; `motion_limits(robot)` if None.
    joints : sequence of int, optional
        Joints whose friction is wanted; all if None. The others never move, except into the pose.
    n_speeds : int
        Speeds of the legs, geometric from `slowest` times the velocity limit to the limit, or to what fits between the
        position limits. 0 leaves the legs out.
    slowest : float
        Slowest leg over the velocity limit.
    leg_time : float
        Time at constant speed per speed and direction [s]; short legs are repeated.
    pair_time : float
        Time of one pass of a pair [s]. 0 leaves the pairs out.
    levels : sequence of float
        Greatest speeds of the pairs, over the velocity limit.
    pose : ndarray (n_joints,), optional
        Where joints rest and around which they move [rad, m]; the middle of the limits if None.

    Raises
    ------
    ValueError
        Numbers out of range, a pose outside the limits, or limits that leave no room for a leg; names the joint.
    """
    limits = motion_limits(robot) if limits is None else limits
    names = list(robot.joint_names)
    wanted = list(range(len(names))) if joints is None else [int(j) for j in joints]
    _check(names, limits, wanted, n_speeds, slowest, leg_time, pair_time, levels)
    pose = (limits.lower + limits.upper) / 2 if pose is None else np.asarray(pose, dtype=np.float64)
    _check_pose(names, limits, pose)
    segments: list[Leg | ReversedPair] = [_rest(pose)]
    if n_speeds:
        for j in wanted:
            segments += _legs(names[j], limits, j, pose, n_speeds, slowest, leg_time)
    if pair_time:
        for level in levels:
            segments += [_pair(names, limits, wanted, pose, level, pair_time), _rest(pose)]
    return FrictionExperiment(tuple(segments))


def _legs(
    name: str, limits: MotionLimits, j: int, pose: FloatArray, n_speeds: int, slowest: float, leg_time: float
) -> list[Leg | ReversedPair]:
    """Out and back at every speed, about the pose's own position or as near to it as the limits allow."""
    room = USAGE * (limits.upper[j] - limits.lower[j])
    top, least = _top_speed(limits, j, room), slowest * limits.velocity[j]
    if top <= least:
        need = least * (_ramp(limits, j, least) + LEAST_CRUISE)
        raise ValueError(
            f"the limits leave no room for a leg of joint {name}: it may move {room:.3g} rad (or m) and a leg at "
            f"{least:.3g} rad/s takes {need:.3g}; widen its position limits, or lower `slowest` or its velocity limit"
        )
    edge = (1 - USAGE) / 2 * (limits.upper[j] - limits.lower[j])
    segments: list[Leg | ReversedPair] = []
    here = pose
    for speed in np.geomspace(least, top, n_speeds):
        ramp = _ramp(limits, j, speed)
        cruise = min(leg_time, room / speed - ramp)
        way = speed * (ramp + cruise)
        start = pose.copy()
        low, high = limits.lower[j] + edge, limits.upper[j] - edge
        start[j] = np.clip(pose[j] - way / 2, low, max(high - way, low))
        velocity = np.zeros_like(pose)
        velocity[j] = speed
        segments += [_move(limits, here, start), _rest(start)]
        for _ in range(min(MOST_REPEATS, max(1, round(leg_time / cruise)))):
            out = Leg(start, velocity, ramp, cruise)
            back = Leg(out.end, -velocity, ramp, cruise)
            segments += [out, _rest(out.end), back, _rest(start)]
        here = start
    return [*segments, _move(limits, here, pose), _rest(pose)]


def _top_speed(limits: MotionLimits, j: int, room: float) -> float:
    """Greatest speed at which ramps and the shortest stretch of constant speed fit into `room`."""
    low, high = 0.0, USAGE * float(limits.velocity[j])
    if high * (_ramp(limits, j, high) + LEAST_CRUISE) <= room:
        return high
    for _ in range(60):
        middle = (low + high) / 2
        fits = middle * (_ramp(limits, j, middle) + LEAST_CRUISE) <= room
        low, high = (middle, high) if fits else (low, middle)
    return low


def _ramp(limits: MotionLimits, j: int, speed: float) -> float:
    """Time of a ramp: its greatest acceleration is twice the mean one."""
    return max(LEAST_RAMP, 2 * speed / (USAGE * float(limits.acceleration[j])))


def _move(limits: MotionLimits, start: FloatArray, end: FloatArray) -> Leg:
    """Shortest leg without a stretch of constant speed from `start` to `end`, all joints at once."""
    way = np.abs(end - start)
    time = np.max([way / (USAGE * limits.velocity), np.sqrt(2 * way / (USAGE * limits.acceleration))])
    ramp = max(LEAST_RAMP, float(time))
    return Leg(start, (end - start) / ramp, ramp, 0.0)


def _rest(pose: FloatArray) -> Leg:
    return Leg(pose, np.zeros_like(pose), REST / 2, 0.0)


def _pair(
    names: Sequence[str], limits: MotionLimits, joints: Sequence[int], pose: FloatArray, level: float, time: float
) -> ReversedPair:
    """Sines whose speed reaches `level` of the limit, each at a frequency of its own, within every limit."""
    # A sine of the greatest speed and acceleration; the slower levels are the same with smaller amplitudes.
    share = 1 - SPREAD * np.arange(len(pose)) / max(len(pose) - 1, 1)
    omega = share * limits.acceleration / limits.velocity
    amplitude = np.zeros_like(pose)
    room = USAGE * np.minimum(limits.upper - pose, pose - limits.lower)
    for j in joints:
        if room[j] <= 0:
            raise ValueError(
                f"the limits leave no room for a motion of joint {names[j]} about {pose[j]:.3g} rad; "
                "choose a pose within them"
            )
        amplitude[j] = min(room[j], limits.velocity[j] / omega[j])
    unit = ReversedPair(pose, amplitude, omega, time, time / 4)
    t = np.linspace(0.0, time, max(2000, int(1000 * time)))
    _, dq, ddq = unit.evaluate(t)
    most = np.maximum(
        np.abs(dq).max(axis=0) / (USAGE * limits.velocity), np.abs(ddq).max(axis=0) / (USAGE * limits.acceleration)
    )
    return ReversedPair(pose, level * amplitude / np.maximum(most, 1.0), omega, time, time / 4)


def _check(
    names: Sequence[str],
    limits: MotionLimits,
    joints: Sequence[int],
    n_speeds: int,
    slowest: float,
    leg_time: float,
    pair_time: float,
    levels: Sequence[float],
) -> None:
    n = len(names)
    for what in ("lower", "upper", "velocity", "acceleration"):
        values = np.asarray(getattr(limits, what), dtype=np.float64)
        if values.shape != (n,) or not np.isfinite(values).all():
            raise ValueError(f"limits.{what} must hold {n} finite numbers, one per joint, got {values.tolist()}")
    for j, name in enumerate(names):
        if not (limits.lower[j] < limits.upper[j] and limits.velocity[j] > 0 and limits.acceleration[j] > 0):
            raise ValueError(
                f"the limits leave no room for a leg of joint {name}: position {limits.lower[j]:g} to "
                f"{limits.upper[j]:g}, velocity {limits.velocity[j]:g}, acceleration {limits.acceleration[j]:g}; "
                "all must leave some motion"
            )
    if not joints or len(set(joints)) != len(joints) or not all(0 <= j < n for j in joints):
        raise ValueError(f"joints must be different indices from 0 to {n - 1}, got {list(joints)}")
    if n_speeds < 0 or (n_speeds == 0 and pair_time == 0):
        raise ValueError(f"n_speeds must be at least 1 without pairs and never negative, got {n_speeds}")
    if not 0 < slowest < 1:
        raise ValueError(f"slowest must lie between 0 and 1 (a share of the velocity limit), got {slowest:g}")
    if not LEAST_CRUISE <= leg_time < np.inf:
        raise ValueError(f"leg_time must be at least {LEAST_CRUISE:g} s, got {leg_time:g}")
    if pair_time and not 4.0 <= pair_time < np.inf:
        raise ValueError(f"pair_time must be 0 (no pairs) or at least 4 s, got {pair_time:g}")
    if not all(0 < level <= 1 for level in levels):
        raise ValueError(f"levels must lie above 0 and at most at 1, got {list(levels)}")


def _check_pose(names: Sequence[str], limits: MotionLimits, pose: FloatArray) -> None:
    if pose.shape != limits.lower.shape or not np.isfinite(pose).all():
        raise ValueError(f"pose must hold {len(names)} finite positions, one per joint, got {pose.tolist()}")
    for j in np.flatnonzero((pose < limits.lower) | (pose > limits.upper)).tolist():
        raise ValueError(
            f"the pose's {names[j]} = {pose[j]:.4g} lies outside its limits {limits.lower[j]:.4g} to "
            f"{limits.upper[j]:.4g}; choose a pose within them"
        )
