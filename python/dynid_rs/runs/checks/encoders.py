"""Motor encoders against link encoders: flipped, swapped, not divided by the gear ratio, late."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid_rs.base.findings import Finding, Severity, joint_words
from dynid_rs.runs.checks.motion import angle_unit, correlation, extent, is_same, label, moving_joints, rms
from dynid_rs.runs.recording import FloatArray, Recording

MAX_DEFLECTION = 0.1
"""Largest plausible difference of the two encoders over the motion of the joint."""

MIN_CORRELATION = 0.98
MIN_FOLLOWING = 0.9
"""A gear under a load far beyond what it is made for yields by half of its joint's motion; then the encoders still
follow each other so well."""
MAX_OFFSET = 0.05
"""Constant difference [rad] beyond any elastic deflection."""

MIN_DELAY_SHARE = 0.9
MIN_DELAY = 1e-4


def check_encoders(rec: Recording) -> Iterator[Finding]:
    """Say how many encoders there are, and compare them joint by joint."""
    if rec.q_motor is None:
        yield Finding(
            "single_encoder",
            "info",
            "one encoder per joint: no deflection, the third loop works on q and dq alone",
            rec.name,
        )
        return
    moves, motors = moving_joints(rec), extent(rec, "q_motor")
    for joint in range(rec.n_joints):
        if is_same(rec.q_motor[:, joint], rec.q[:, joint]):
            yield _finding(
                rec, joint, "motor_copy", "info", "is a copy of the link position: this joint has one encoder"
            )
        elif moves[joint] or motors.highest[joint] - motors.lowest[joint] > MAX_OFFSET:
            yield from _compare(rec, rec.q_motor, joint)


def _compare(rec: Recording, motors: FloatArray, joint: int) -> Iterator[Finding]:
    q = np.ascontiguousarray(rec.q[:, joint])
    deflection = motors[:, joint] - q
    offset = float(np.mean(deflection))
    deflection -= offset
    delay = list(_delay(rec, q, deflection, joint))
    # Fast joints are far apart by their clocks alone: what counts is what a delay leaves.
    left = deflection - sum((finding.value or 0.0) for finding in delay) * np.gradient(q, rec.t)
    if rms(left) > MAX_DEFLECTION * max(rms(q - q.mean()), 1e-9):
        yield _mismatch(rec, motors, joint)
        return
    if abs(offset) > MAX_OFFSET:
        unit = angle_unit(rec, joint)
        yield _finding(
            rec,
            joint,
            "encoder_offset",
            "warning",
            f"lies {offset:+.3g} {unit} beside q_{joint}: the encoders have different zeros; subtract the offset",
            offset,
            unit,
        )
    yield from delay


def _mismatch(rec: Recording, motors: FloatArray, joint: int) -> Finding:
    motor, link = motors[:, joint], rec.q[:, joint]
    own = correlation(motor, link)
    centred = link - link.mean()
    slope = float(centred @ (motor - motor.mean()) / max(float(centred @ centred), 1e-30))
    if abs(own) > MIN_CORRELATION and abs(slope + 1.0) < MAX_DEFLECTION:
        return _finding(
            rec,
            joint,
            "motor_flipped",
            "error",
            f"runs against q_{joint}: its sign is flipped; write -1 for it in dynid.toml under [signs] q_motor",
            slope,
            "1",
        )
    if abs(own) > MIN_CORRELATION:
        return _finding(
            rec,
            joint,
            "motor_scale",
            "error",
            f"moves {slope:.5g} times as far as q_{joint}: it is not divided by the "
            "gear ratio (or has another "
            "unit); give [gear] ratio in dynid.toml",
            slope,
            "1",
        )
    for other in range(rec.n_joints):
        if other != joint and abs(correlation(motor, rec.q[:, other])) > MIN_CORRELATION:
            return _finding(
                rec,
                joint,
                "motor_swapped",
                "error",
                f"follows {joint_words(rec.joints[other])} (q_{other}), not its own: the "
                "columns are swapped; map them in "
                "dynid.toml under [columns]",
            )
    if own > MIN_FOLLOWING:
        text = f"follows q_{joint} only roughly (correlation {own:.2f}): a gear that yields much, or a wrong channel"
        return _finding(rec, joint, "motor_disagrees", "warning", text, own, "1")
    text = f"does not follow q_{joint} (correlation {own:.2f}): one of the two channels is wrong"
    return _finding(rec, joint, "motor_disagrees", "error", text, own, "1")


def _delay(rec: Recording, q: FloatArray, deflection: FloatArray, joint: int) -> Iterator[Finding]:
    """Tell a channel that comes late: the difference is proportional to velocity (first-order shift)."""
    dq = np.gradient(q, rec.t)
    power, whole, common = float(dq @ dq), float(deflection @ deflection), float(dq @ deflection)
    if power == 0 or whole == 0:
        return
    delay, share = common / power, common * common / (power * whole)
    if share > MIN_DELAY_SHARE and abs(delay) > MIN_DELAY:
        late, early = ("q", "q_motor") if delay > 0 else ("q_motor", "q")
        yield _finding(
            rec,
            joint,
            "encoder_delay",
            "info",
            f"and q_{joint} differ as if {late}_{joint} came about {abs(delay) * 1e3:.2g} ms after {early}_{joint} "
            f"({100 * share:.0f} % of their difference); an estimate from speed alone: `dynid identify` fits the delay "
            "beside the gear's yielding, and removes it before deflection is used",
            delay,
            "s",
        )


def _finding(
    rec: Recording,
    joint: int,
    code: str,
    severity: Severity,
    text: str,
    value: float | None = None,
    unit: str | None = None,
) -> Finding:
    column = f"q_motor_{joint}"
    message = f"{label(rec, 'q_motor', joint)} {text}"
    return Finding(code, severity, message, rec.name, column, (0, rec.n_samples), value, unit)
