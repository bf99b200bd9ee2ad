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
from dynid_rs.regression.error_interval import change_interval, rmse_interval
from dynid_rs.regression.evaluation import Comparison, band_rmse, compare
from dynid_rs.runs.recording import Recording
from dynid_rs.runs.splitting import split_runs

FloatArray = NDArray[np.float64]


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
        Whether a law is worse than the best one by more than noise explains: the 95 % interval of the change, for
        errors that remember each other, lies above nothing. Where none can be said, it is not.
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
    models, comparisons = {}, []
    for law in laws:
        model = ThreeLoopIdentifier(robot, **{"residual": None, **options, "friction_law": law})
        models[law] = model.fit(list(runs), friction_recording)
        states = [model.states(recording) for recording in test]
        comparisons.append([compare(s, evaluate(model.model_, s)[0]) for s in states])
    return _compared(tuple(robot.joint_names), laws, comparisons, models)


def _compared(
    joints: tuple[str, ...],
    laws: Sequence[str],
    comparisons: Sequence[Sequence[Comparison]],
    models: dict[str, ThreeLoopIdentifier],
) -> LawComparison:
    """Hold every law's errors against those of the best one, place by place, so that what they share does not count."""
    powers = np.array([band_rmse(list(each)) for each in comparisons])
    unknown = (np.nan, np.nan)
    interval = np.array([[pair or unknown for pair in rmse_interval(each)] for each in comparisons])
    least = powers.argmin(axis=0)
    beyond = np.zeros(powers.shape, dtype=bool)
    for best in set(least.tolist()):
        joints_of = least == best
        for k, each in enumerate(comparisons):
            changes = change_interval(each, comparisons[best])
            beyond[k, joints_of] = np.array([pair is not None and pair[0] > 0 for pair in changes])[joints_of]
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
