"""Which runs belong together, and to a robot: decided from a few facts of each, without holding them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.errors import DataError
from dynid_rs.base.findings import joint_words
from dynid_rs.base.quoting import shown_value
from dynid_rs.runs.cells import MIN_SPAN
from dynid_rs.runs.checks.clocks import Clock, check_clocks
from dynid_rs.runs.checks.limits import check_magnitudes
from dynid_rs.runs.checks.motion import extent, moving_joints
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]

MOST_NAMES = 8
"""More runs than this are not all named in one sentence."""


@dataclass(frozen=True, eq=False)
class RunFacts:
    """What decides whether runs belong together: enough to check them without holding them.

    `moves` (n_joints,) which joints move; `lowest, highest` (n_joints,) of the torque; `clock` what tells the unit of
    time.
    """

    name: str
    joints: tuple[str, ...]
    torque_unit: str
    has_motor_encoder: bool
    moves: NDArray[np.bool_]
    lowest: FloatArray
    highest: FloatArray
    clock: Clock

    @staticmethod
    def of(recording: Recording) -> RunFacts:
        """Facts of a run.

        Raises
        ------
        DataError
            It holds a number that no arm has: sums over it would be none.
        """
        for finding in check_magnitudes(recording):
            raise replace(finding, file=recording.name).as_error()
        return RunFacts(
            recording.name,
            recording.joints,
            recording.torque_unit,
            recording.has_motor_encoder,
            moving_joints(recording),
            extent(recording, "tau").lowest,
            extent(recording, "tau").highest,
            Clock.of(recording),
        )


def check_joints(robot: _core.RobotModel, name: str, n_joints: int) -> None:
    """Refuse the run `name` of an arm with another number of joints by a `DataError`."""
    if n_joints != robot.n_joints:
        raise DataError(
            f"{name} has {n_joints} joints, the robot {shown_value(robot.name)} has {robot.n_joints}; is it a run of "
            "this robot?",
            code="wrong_robot",
            file=name,
        )


def check_training_runs(robot: _core.RobotModel, recordings: Sequence[Recording], *, all_move: bool = True) -> None:
    """Refuse runs that no model of `robot` can be learned from; with `all_move` off joints may rest in all of them.

    Raises
    ------
    ValueError
        No run at all.
    DataError
        Runs of another robot or of different kinds, time in another unit, numbers that no arm has, or a joint that
        never moves in any of them.
    """
    if not recordings:
        raise ValueError("no recording to learn from; give at least one")
    check_facts(robot, [RunFacts.of(recording) for recording in recordings], all_move=all_move)


def check_facts(
    robot: _core.RobotModel, runs: Sequence[RunFacts], others: Sequence[Clock] = (), *, all_move: bool = True
) -> None:
    """`check_training_runs` on facts alone; at least one. `others`: clocks of runs that are tested on."""
    first = runs[0]
    check_clocks([*(run.clock for run in runs), *others])
    for recording in runs:
        check_joints(robot, recording.name, len(recording.joints))
        if recording.torque_unit != first.torque_unit or recording.has_motor_encoder != first.has_motor_encoder:
            raise DataError(
                f"{recording.name} and {first.name} hold different signals (torque in {recording.torque_unit} and "
                f"{first.torque_unit}, motor encoder: {recording.has_motor_encoder} and "
                f"{first.has_motor_encoder}); "
                "learn from runs of one kind",
                code="mixed_runs",
                file=recording.name,
            )
    _check_torque(runs)
    moves = np.any([run.moves for run in runs], axis=0)
    for j in np.flatnonzero(~moves) if all_move else ():
        locked = robot.lower[j] == robot.upper[j]
        mend = "its limits lock it, so make it fixed in the robot file" if locked else "record a run that moves it"
        raise DataError(
            f"{_names(runs)}: {joint_words(robot.joint_names[j])} never "
            f"moves (q_{j} stays within {MIN_SPAN:g}); its friction and inertia cannot be learned, {mend}",
            code="joint_never_moves",
            file=first.name,
            column=f"q_{j}",
        )


def check_torque(recordings: Sequence[Recording]) -> None:
    """Refuse torque that never changes: a channel that is not connected, and nothing to learn from or to test on.

    Raises
    ------
    DataError
        A joint's torque is one and the same number in all of `recordings`.
    """
    _check_torque([RunFacts.of(recording) for recording in recordings])


def _check_torque(runs: Sequence[RunFacts]) -> None:
    lowest = np.min([run.lowest for run in runs], axis=0)
    highest = np.max([run.highest for run in runs], axis=0)
    for j in np.flatnonzero(highest <= lowest):
        raise DataError(
            f"{_names(runs)}: the torque of {joint_words(runs[0].joints[j])} is {lowest[j] + 0.0:g} in every row; "
            "is its channel connected, and is it the right column?",
            code="torque_never_changes",
            file=runs[0].name,
            column=f"tau_{j}",
        )


def _names(runs: Sequence[RunFacts]) -> str:
    names = [run.name for run in runs]
    if len(names) <= MOST_NAMES:
        return ", ".join(names)
    return f"{', '.join(names[:3])} and {len(names) - 3} more runs"
