"""Hints on motion that will not separate the parameters well."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid_rs.base.findings import Finding, joint_words
from dynid_rs.runs.checks.motion import angle_unit, block_velocity, correlation, moving_joints, spans
from dynid_rs.runs.recording import FloatArray, Recording

MIN_DURATION = 5.0
SMALL_SPAN = 0.2
SLOW = 0.1
MIN_REVERSALS = 4
MIN_MOVING_SHARE = 0.5
TOGETHER = 0.98
_STILL = 0.01


def check_excitation(rec: Recording) -> Iterator[Finding]:
    """Short runs, small, slow, rare or one-way motion, joints that move together."""
    if rec.duration < MIN_DURATION:
        yield Finding(
            "short_run",
            "info",
            f"{rec.duration:.3g} s are short; the slowest motion should repeat a few times",
            rec.name,
            value=rec.duration,
            unit="s",
        )
    velocity = block_velocity(rec)
    moves, ranges = moving_joints(rec), spans(rec)
    speeds = np.percentile(np.abs(velocity), 98, axis=0)
    for joint in np.flatnonzero(moves).tolist():
        fast = np.sign(velocity[:, joint]) * (np.abs(velocity[:, joint]) > 0.05 * speeds[joint])
        directions = fast[fast != 0]
        reversals = int(np.count_nonzero(np.diff(directions)))
        share = float(np.mean(np.abs(velocity[:, joint]) > _STILL))
        unit = angle_unit(rec, joint)
        if ranges[joint] < SMALL_SPAN:
            yield _hint(rec, joint, f"moves by only {ranges[joint]:.2g} {unit}", "small_motion", ranges[joint], unit)
        if speeds[joint] < SLOW:
            text = f"reaches only {speeds[joint]:.2g} {unit}/s: inertia and viscous friction hardly show"
            yield _hint(rec, joint, text, "slow_motion", speeds[joint], f"{unit}/s")
        if reversals < MIN_REVERSALS:
            times = "once" if reversals == 1 else f"{reversals} times"
            text = f"changes its direction {times}: friction hardly separates from gravity"
            yield _hint(rec, joint, text, "few_reversals", reversals, "1")
        if share < MIN_MOVING_SHARE:
            yield _hint(rec, joint, f"stands still {100 * (1 - share):.0f} % of the time", "mostly_still", share, "1")
    yield from _together(rec, velocity, np.flatnonzero(moves).tolist())


def _together(rec: Recording, velocity: FloatArray, moving: list[int]) -> Iterator[Finding]:
    left = list(moving)
    while left:
        first = left.pop(0)
        values = {other: correlation(velocity[:, first], velocity[:, other]) for other in left}
        group = [other for other in left if abs(values[other]) > TOGETHER]
        left = [other for other in left if other not in group]
        if group:
            least = min((values[other] for other in group), key=abs)
            names = joint_words(*(rec.joints[joint] for joint in (first, *group)))
            yield Finding(
                "joints_together",
                "warning",
                f"{names} always move together (correlation of their velocities {least:.3f}); their "
                "parameters cannot be told apart",
                rec.name,
                f"q_{group[0]}",
                (0, rec.n_samples),
                least,
                "1",
            )


def _hint(rec: Recording, joint: int, text: str, code: str, value: float, unit: str) -> Finding:
    message = f"{joint_words(rec.joints[joint])} {text}"
    return Finding(code, "info", message, rec.name, f"q_{joint}", (0, rec.n_samples), float(value), unit)
