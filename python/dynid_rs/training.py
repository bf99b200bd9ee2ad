"""What may be learned from: runs that belong together, and enough motion in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.checks.motion import MIN_SPAN, extent, moving_joints
from dynid_rs.errors import DataError
from dynid_rs.findings import joint_words
from dynid_rs.known import KnownTerm
from dynid_rs.preprocessing import Band, States, choose_band, common_rate, prepare, without
from dynid_rs.recording import Recording

FloatArray = NDArray[np.float64]

LEAST_TEST_ROWS = 20
"""Fewer rows of a test run say nothing."""
Excluded = Mapping[str, Sequence[tuple[float, float]]]
"""Name of a run to the windows (start, end) [s] in which something from outside acts."""
LEAST_ROWS = 20
"""Rows of the fit that a run has to have in motion."""


MOST_NAMES = 8
"""More runs than this are not all named in one sentence."""


@dataclass(frozen=True, eq=False)
class RunFacts:
    """What decides whether runs belong together: enough to check them without holding them.

    `moves` (n_joints,) which joints move; `lowest, highest` (n_joints,) of the torque.
    """

    name: str
    joints: tuple[str, ...]
    torque_unit: str
    has_motor_encoder: bool
    moves: NDArray[np.bool_]
    lowest: FloatArray
    highest: FloatArray

    @staticmethod
    def of(recording: Recording) -> RunFacts:
        """Facts of a run."""
        return RunFacts(
            recording.name,
            recording.joints,
            recording.torque_unit,
            recording.has_motor_encoder,
            moving_joints(recording),
            extent(recording, "tau").lowest,
            extent(recording, "tau").highest,
        )


@dataclass(frozen=True, eq=False)
class TrainingData:
    """What is learned from: states of the training runs as recorded, of slow runs, and what is known beside them.

    `known` terms (`known.py`); `torque_unit` of all runs; `rate` [Hz] of the grid that `band` is applied on.
    """

    runs: list[States]
    slow_runs: list[States]
    known: list[KnownTerm]
    torque_unit: str
    rate: float
    band: Band

    @property
    def in_ampere(self) -> bool:
        """Whether the joints' relative drive gains are unknowns too."""
        return self.torque_unit == "A"


def prepare_training_data(
    recordings: Sequence[Recording],
    slow: Sequence[Recording],
    known: list[KnownTerm],
    cutoff: float | None,
    excluded: Excluded | None = None,
    *,
    standstill: bool = False,
) -> TrainingData:
    """States of checked runs in one band: `cutoff` [Hz], or chosen from the motion; `excluded` windows by run name.

    Raises
    ------
    DataError
        Too little motion is left in a training run after standstill is taken out.
    """
    rate = common_rate(list(recordings))
    band = Band(cutoff) if cutoff is not None else choose_band(list(recordings))
    runs = prepare_training_runs(recordings, band, rate, excluded, standstill=standstill)
    slow_runs = [prepare(recording, band, rate) for recording in slow]
    return TrainingData(runs, slow_runs, known, recordings[0].torque_unit, rate, band)


def check_training_runs(robot: _core.RobotModel, recordings: Sequence[Recording]) -> None:
    """Refuse runs that no model of `robot` can be learned from.

    Raises
    ------
    ValueError
        No run at all.
    DataError
        Runs of another robot or of different kinds, or a joint that never moves in any of them.
    """
    if not recordings:
        raise ValueError("no recording to learn from; give at least one")
    check_facts(robot, [RunFacts.of(recording) for recording in recordings])


def check_facts(robot: _core.RobotModel, runs: Sequence[RunFacts]) -> None:
    """`check_training_runs` on facts alone; at least one."""
    n, first = robot.n_joints, runs[0]
    for recording in runs:
        if len(recording.joints) != n:
            raise DataError(
                f"{recording.name} has {len(recording.joints)} joints, the robot {robot.name!r} has {n}; "
                "is it a run of this robot?",
                code="wrong_robot",
                file=recording.name,
            )
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
    for j in np.flatnonzero(~moves):
        raise DataError(
            f"{_names(runs)}: {joint_words(robot.joint_names[j])} never "
            f"moves (q_{j} stays within {MIN_SPAN:g}); its friction and inertia cannot be learned, record a run that "
            "moves it",
            code="joint_never_moves",
            file=first.name,
            column=f"q_{j}",
        )


def check_motion(runs: Sequence[States]) -> None:
    """Refuse test runs with hardly any motion.

    Raises
    ------
    DataError
        A run of which next to nothing is left after standstill is taken out.
    """
    for states in runs:
        if len(states.rows) < LEAST_TEST_ROWS:
            seconds = len(states.rows) * states.step / states.rate
            raise DataError(
                f"{states.name}: only {seconds:.2f} s of motion are left to test on after standstill is taken "
                "out; test on a longer motion",
                code="too_little_motion",
                file=states.name,
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
            f"{_names(runs)}: the torque of {joint_words(runs[0].joints[j])} is {lowest[j]:g} in every row; is its "
            "channel connected, and is it the right column?",
            code="torque_never_changes",
            file=runs[0].name,
            column=f"tau_{j}",
        )


def _names(runs: Sequence[RunFacts]) -> str:
    names = [run.name for run in runs]
    if len(names) <= MOST_NAMES:
        return ", ".join(names)
    return f"{', '.join(names[:3])} and {len(names) - 3} more runs"


def prepare_training_runs(
    recordings: Sequence[Recording],
    band: Band,
    rate: float,
    excluded: Excluded | None = None,
    *,
    standstill: bool = False,
) -> list[States]:
    """States of the runs in `band` at `rate` [Hz], without the windows [s] of `excluded`.

    Raises
    ------
    DataError
        Too little motion is left in a run after standstill is taken out.
    """
    windows = excluded or {}
    return [
        prepare_training_run(recording, band, rate, windows.get(recording.name, ()), standstill=standstill)
        for recording in recordings
    ]


def prepare_training_run(
    recording: Recording,
    band: Band,
    rate: float,
    excluded: Sequence[tuple[float, float]] = (),
    *,
    standstill: bool = False,
) -> States:
    """`prepare_training_runs` of one run, less its `excluded` windows [s]."""
    states = without(prepare(recording, band, rate, standstill=standstill), excluded)
    if len(states.rows) < LEAST_ROWS:
        raise DataError(
            f"{states.name}: only {len(states.rows) * states.step / states.rate:.2f} s of motion are left "
            f"after standstill {'and what was excluded ' if excluded else ''}and "
            f"{1 / band.cutoff:.2g} s (1/cutoff) beside it and at both ends are taken out; "
            "record a longer motion, or raise the cutoff",
            code="too_little_motion",
            file=states.name,
        )
    return states
