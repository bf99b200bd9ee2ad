"""How several laws of friction compare on runs that were not fitted, and which one each joint needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.identification.friction_laws import LAWS, LAWS_BY_JOINT, laws_per_joint
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.assembly import evaluate
from dynid_rs.regression.error_interval import interval_of
from dynid_rs.regression.evaluation import compare, rmse
from dynid_rs.runs.recording import Recording
from dynid_rs.runs.splitting import split_runs

FloatArray = NDArray[np.float64]

N_RESAMPLES = 400
"""Bootstrap resamples of the laws' errors."""
LEAST_BLOCK = 1.0
"""Block [s] that is resampled as a whole."""
LEAST_BLOCKS = 8
"""Fewer blocks have nothing to resample; a short run is cut finer."""
BEYOND = 0.05
"""A difference is beyond noise where at most this part of the resampled ones has the other sign."""


@dataclass(frozen=True, eq=False)
class LawComparison:
    """Errors of several laws on runs that were not fitted.

    Parameters
    ----------
    joints : tuple of str
        Names.
    laws : tuple of str
        Laws, simplest first.
    rmse, interval : ndarray (n_laws, n_joints), (n_laws, n_joints, 2)
        Error on the test runs and its 95 % interval [torque unit]; NaN where the runs are too short to say one.
    best : tuple of str
        Law of the least error, per joint.
    beyond_noise : ndarray (n_laws, n_joints)
        Whether a law is worse than the best one by more than noise explains.
    chosen : tuple of str
        The simplest law that is not worse than the best one beyond noise, per joint.
    models : dict
        Fitted `ThreeLoopIdentifier` of every law.
    """

    joints: tuple[str, ...]
    laws: tuple[str, ...]
    rmse: FloatArray
    interval: FloatArray
    best: tuple[str, ...]
    beyond_noise: NDArray[np.bool_]
    chosen: tuple[str, ...]
    models: dict[str, ThreeLoopIdentifier]

    def __str__(self) -> str:
        """Return a table: a row per joint, a column per law, worse ones beyond noise with a star."""
        width = max(len("joint"), *(len(joint) for joint in self.joints))
        lines = ["  ".join(["joint".ljust(width), *(law.rjust(16) for law in self.laws), "chosen"])]
        for j, joint in enumerate(self.joints):
            cells = [
                f"{self.rmse[k, j]:.4g}{'*' if self.beyond_noise[k, j] else ' '}".rjust(16)
                for k in range(len(self.laws))
            ]
            lines.append("  ".join([joint.ljust(width), *cells, self.chosen[j]]))
        return "\n".join(lines)


def compare_friction_laws(
    robot: _core.RobotModel,
    runs: Sequence[Recording],
    test: Sequence[Recording],
    laws: Sequence[str] = LAWS_BY_JOINT,
    *,
    friction_recording: Recording | Sequence[Recording] | None = None,
    **options: Any,
) -> LawComparison:
    """Fit the whole model with each law and compare errors on test runs, joint by joint.

    Links, rotors and offsets are fitted anew beside each law, by the same second loop; the third loop is left out.

    Parameters
    ----------
    robot : RobotModel
        The arm.
    runs, test : sequence of Recording
        Runs to learn from, and others to test on.
    laws : sequence of str
        Of "coulomb_viscous", "smooth", "stribeck" and "paper"; without "smooth", which all joints have or none, by
        default.
    friction_recording : Recording or sequence of Recording, optional
        Friction experiment.
    options
        More arguments of `ThreeLoopIdentifier`.

    Raises
    ------
    ValueError
        No such law, fewer than one, or no test run.
    """
    laws = [law for law in LAWS if law in [laws_per_joint(name, 1)[0] for name in laws]]
    if not laws or not test:
        raise ValueError("comparing laws takes at least one law and one test run that is not fitted")
    models, errors = {}, []
    for law in laws:
        model = ThreeLoopIdentifier(robot, **{"residual": None, **options, "friction_law": law})
        models[law] = model.fit(list(runs), friction_recording)
        states = [model.states(recording) for recording in test]
        errors.append([np.where(s.counted, compare(s, evaluate(model.model_, s)[0]).error, 0.0) for s in states])
    lengths = [max(1, int(LEAST_BLOCK * s.rate / s.step)) for s in states]
    return _compared(tuple(robot.joint_names), laws, errors, lengths, models)


def _compared(
    joints: tuple[str, ...],
    laws: Sequence[str],
    errors: Sequence[Sequence[FloatArray]],
    lengths: Sequence[int],
    models: dict[str, ThreeLoopIdentifier],
) -> LawComparison:
    """Resample the same blocks of every law's errors (n_rows, n_joints), so that differences keep what they share."""
    rng = np.random.default_rng(0)
    powers = np.array([rmse(parts) for parts in errors])
    sums, counts = [], []
    for run, parts in enumerate(zip(*errors, strict=True)):
        squares = np.array(parts) ** 2
        length = lengths[run]
        n_blocks = min(max(LEAST_BLOCKS, squares.shape[1] // length), squares.shape[1])
        for block in np.array_split(np.arange(squares.shape[1]), n_blocks):
            sums.append(squares[:, block].sum(axis=1))
            counts.append(len(block))
    draws = rng.integers(0, len(sums), (N_RESAMPLES, len(sums)))
    drawn = np.array(sums)[draws].sum(axis=1) / np.array(counts)[draws].sum(axis=1)[:, None, None]
    unknown = (np.nan, np.nan)
    interval = np.array([[interval_of(e) or unknown for e in np.concatenate(parts).T] for parts in errors])
    least = powers.argmin(axis=0)
    best_drawn = np.take_along_axis(drawn, least[None, None, :], axis=1)
    beyond = np.mean(drawn <= best_drawn, axis=0) <= BEYOND
    beyond[least, np.arange(len(joints))] = False
    simplest = np.argmin(beyond, axis=0)
    return LawComparison(
        joints,
        tuple(laws),
        powers,
        interval,
        tuple(laws[k] for k in least),
        beyond,
        tuple(laws[k] for k in simplest),
        models,
    )


def choose_friction_laws(robot: _core.RobotModel, runs: Sequence[Recording], **options: Any) -> tuple[str, ...]:
    """Law of every joint by training runs alone: the last one, or the last third of a lone one, is left out in turn."""
    split = split_runs(runs, [])
    return compare_friction_laws(robot, split.train, split.test, **options).chosen
