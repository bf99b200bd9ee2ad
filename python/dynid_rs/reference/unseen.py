"""Inertials that level gravity hides and a tilt brings out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.reference.plausible import Plausible
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]

USUAL = 0.03
"""Tilt [rad] for which unseen parameters are looked at."""
LEAST_SIGNAL = 0.1
"""What unseen parameters may do counts above this, in standard deviations of the noise over all independent rows: low,
since what the noise is taken for holds the tilt itself."""
N_SAMPLES = 150
"""States of the runs on which unseen parameters are looked for."""
WORTH = 0.2
"""Independent samples that a row is taken for in that."""


def unseen_directions(
    robot: _core.RobotModel,
    runs: Sequence[States],
    weights: FloatArray,
    n_rows: int,
    pulls: Sequence[FloatArray],
    plausible: Plausible,
) -> list[list[tuple[FloatArray, FloatArray]]]:
    """Pairs of gravity and phi whose torque a usual tilt may add beyond base parameters and the tilt itself.

    Parameters
    ----------
    robot, runs : RobotModel, sequence of States
        As they are believed to be, and where they were.
    weights : ndarray (n_joints,)
        Torque channel per N m, over its noise.
    n_rows : int
        Of the fit, per joint.
    pulls : (2,) of ndarray (3,)
        Change of gravity per rad of roll and pitch.
    plausible : Plausible
        Inertial parameters and what is not known of them.
    """
    moving = [np.flatnonzero(states.moving) for states in runs]
    at = [kept[:: max(1, len(runs) * len(kept) // N_SAMPLES)] for kept in moving]
    q, dq, ddq = (
        np.concatenate([getattr(states, name)[kept] for states, kept in zip(runs, at, strict=True)])
        for name in ("q", "dq", "ddq")
    )
    weight = weights[:, None]
    seen = (weight * robot.joint_torque_regressor(q, dq, ddq)).reshape(-1, len(plausible.phi))
    still = np.zeros_like(q)
    regressors = [
        (weight * robot.with_gravity(g.tolist()).joint_torque_regressor(q, still, still)).reshape(len(seen), -1)
        for g in pulls
    ]
    known = np.column_stack([seen, *(Y @ plausible.phi for Y in regressors)])
    norms = np.linalg.norm(known, axis=0)
    u, s, _ = np.linalg.svd(known[:, norms > 0] / norms[norms > 0], full_matrices=False)
    u = u[:, s > 1e-9 * s[0]]
    added = USUAL * np.concatenate([Y @ plausible.root for Y in regressors], axis=1)
    added -= u @ (u.T @ added)
    _, s, vt = np.linalg.svd(added, full_matrices=False)
    signal = s * np.sqrt(WORTH * n_rows / len(q))
    width = plausible.root.shape[1]
    return [
        [(g, USUAL * plausible.root @ v[k * width : (k + 1) * width]) for k, g in enumerate(pulls)]
        for v in vt[signal > LEAST_SIGNAL]
    ]
