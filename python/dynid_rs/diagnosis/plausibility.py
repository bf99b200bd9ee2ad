"""Is there a model to look for effects in at all? Errors as large as the torque have other causes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid_rs import _core
from dynid_rs.base.findings import Finding, joint_words
from dynid_rs.regression.evaluation import Comparison, band_rmse, share_left, torque_std

UNLIKE = 5.0
"""A run whose error is this many times that of the other runs, on most joints, is another robot or another unit."""
LEAST_ERROR = 0.02
"""Of the torque's standard deviation: smaller errors may differ by any factor between good runs."""


def implausible(robot: _core.RobotModel, comparisons: Sequence[Comparison]) -> list[Finding]:
    """Errors that no missing effect explains.

    Parameters
    ----------
    robot : RobotModel
        Names the joints.
    comparisons : sequence of Comparison
        Model, with all that was found, and measured torque of every run, training and test.

    Returns
    -------
    list of Finding
        `residual_exceeds_torque` (error): on some joint the model leaves as much as there is;
        `run_unlike_others` (warning): one run does not belong to the others.
    """
    return lost_joints(robot, comparisons) + _odd_runs(comparisons)


def lost_joints(robot: _core.RobotModel, comparisons: Sequence[Comparison]) -> list[Finding]:
    """Return `residual_exceeds_torque` (error) if the model leaves as much as a joint's torque."""
    share = share_left(comparisons)
    lost = np.flatnonzero(share >= 1)
    if not len(lost):
        return []
    worst = int(np.argmax(share))
    names = joint_words(*(robot.joint_names[j] for j in lost))
    message = (
        f"on {names} the model leaves as much as the torque itself ({share[worst]:.3g} times as much on "
        f"{robot.joint_names[worst]}); that is no missing effect: check units and signs of the torque, the order of "
        "the joints and the robot file (`dynid inspect --robot`)"
    )
    return [
        Finding("residual_exceeds_torque", "error", message, column=f"tau_{worst}", value=float(share[worst]), unit="1")
    ]


def _odd_runs(comparisons: Sequence[Comparison]) -> list[Finding]:
    if len(comparisons) < 2:
        return []
    size = np.maximum(torque_std(comparisons), 1e-300)
    told = np.array([c.states.counted.any(axis=0) for c in comparisons])
    errors = np.array([band_rmse([c]) for c in comparisons]) / size
    found = []
    for k, comparison in enumerate(comparisons):
        others = told & (np.arange(len(told)) != k)[:, None]
        joints = np.flatnonzero(told[k] & others.any(axis=0))
        if not len(joints):
            continue
        usual = np.array([np.median(errors[others[:, j], j]) for j in joints])
        factor = float(np.median(errors[k, joints] / np.maximum(usual, 1e-300)))
        if factor >= UNLIKE and np.median(errors[k, joints]) >= LEAST_ERROR:
            name = comparison.states.name
            message = (
                f"{name}: the model leaves {factor:.0f} times as much as on the other runs; it may be of "
                "another robot, tool or payload, or in another unit. If something was changed before it, leave it out "
                "here and diagnose it with --reference"
            )
            found.append(Finding("run_unlike_others", "warning", message, file=name, value=factor, unit="1"))
    return found
