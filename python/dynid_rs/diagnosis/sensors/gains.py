"""Drive gains: a torque channel that shows (1 + c) times the torque, seen through parameters that joints share.

Only relative gains can be seen: one common factor is the same as heavier links. That one needs a payload of known mass,
or the robot file's inertials.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.sensors.beside import Beside
from dynid_rs.diagnosis.sensors.clocks import torque_parts
from dynid_rs.findings import Finding, joint_words
from dynid_rs.identification import ThreeLoopIdentifier

FloatArray = NDArray[np.float64]

LEVEL = 2e-3
"""Chance that an arm with true gains is said to have a wrong one; shared by its joints."""
AGREES = 1e-2
"""Gravity's and inertia's part disagree about the gain where chance alone would do so less often."""
LEAST_GAIN = 2e-3
"""Gains closer to 1 than this are what drives are sold with."""
N_STEPS = 3


def torque_gains(fit: ThreeLoopIdentifier, beside: Beside | None = None) -> tuple[FloatArray, FloatArray]:
    """Gain errors c (n_joints,) [1] and their standard errors beside the whole model.

    Joints that need a gain are chosen one after the other; theirs are estimated side by side, each of the others'
    beside them. In ampere gains belong to the declared model: zeros with infinite errors.
    """
    return _estimate(fit, beside)[:2]


def gain_findings(fit: ThreeLoopIdentifier, beside: Beside | None = None) -> list[Finding]:
    """Findings about channels whose gain differs from the others'."""
    value, std_error, chosen = _estimate(fit, beside)
    names = fit.robot.joint_names
    return [
        Finding(
            "torque_gain",
            "info",
            f"the torque of {joint_words(names[j])} reads {100 * value[j]:+.1f} % (standard error "
            f"{100 * std_error[j]:.1f} %) against what the other joints say of the links that they share; correct its "
            "drive gain, or let the model have one. Only gains against each other can be seen: a common one needs a "
            "payload of known mass or trusted inertials",
            column=f"tau_{j}",
            value=float(value[j]),
            unit="1",
        )
        for j in chosen
        if abs(value[j]) > LEAST_GAIN
    ]


def _estimate(fit: ThreeLoopIdentifier, beside: Beside | None) -> tuple[FloatArray, FloatArray, list[int]]:
    n = fit.robot.n_joints
    value, std_error = np.zeros(n), np.full(n, np.inf)
    if fit.torque_unit_ == "A":
        return value, std_error, []
    beside = Beside(fit) if beside is None else beside
    chosen = _choose(fit, beside)
    if chosen:
        for _ in range(N_STEPS):
            weighed = beside.weigh(beside.load[:, chosen])
            step = np.clip(np.nan_to_num(weighed.value), -0.3, 0.5)
            value[chosen] = (1 + value[chosen]) * (1 + step) - 1
            std_error[chosen] = weighed.std_error
            beside = Beside(fit, fit.links_.torque_scale_ * (1 + value))
    for j in range(n):
        if j not in chosen:
            weighed = beside.weigh(beside.load[:, [*chosen, j]])
            if np.isfinite(weighed.value[-1]):
                value[j], std_error[j] = weighed.value[-1], weighed.std_error[-1]
    return value, std_error, chosen


def _choose(fit: ThreeLoopIdentifier, beside: Beside) -> list[int]:
    """Joints that need a gain of their own, by forward steps; at least one joint is the measure of the others."""
    from scipy.stats import t

    n = beside.n_joints
    chosen: list[int] = []
    parts = [torque_parts(fit, k) for k in range(len(fit.runs_))]
    gravity, inertia = (
        beside.apart([s.in_band(run[part]) for s, run in zip(fit.runs_, parts, strict=True)]) for part in range(2)
    )
    left = beside.left(beside.torque)
    while len(chosen) < n - 1:
        gained = np.zeros(n)
        for j in set(range(n)) - set(chosen):
            weighed = beside.weigh(beside.load[:, [*chosen, j]])
            if not abs(weighed.value[-1]) > t.isf(LEVEL / (2 * n), max(weighed.dof, 1)) * weighed.std_error[-1]:
                continue
            # A gain knows nothing of where a torque comes from.
            split = beside.weigh(np.column_stack([gravity[:, j], inertia[:, j], beside.load[:, chosen]]))
            if _alike(split.value[:2], split.covariance[:2, :2]):
                kept = beside.left(beside.load[:, [*chosen, j]])
                gained[j] = np.sum((kept @ np.linalg.lstsq(kept, left, rcond=None)[0]) ** 2)
        if not gained.any():
            break
        chosen.append(int(np.argmax(gained)))
    return chosen


def _alike(value: FloatArray, covariance: FloatArray) -> bool:
    """Whether two estimates (2,) are there and agree."""
    from scipy.stats import norm

    if not np.isfinite(value).all():
        return False
    spread = np.sqrt(covariance[0, 0] + covariance[1, 1] - 2 * covariance[0, 1])
    return bool(abs(value[0] - value[1]) < norm.isf(AGREES / 2) * spread)
