"""A model along recordings: torque at their own stamps, and how much of the measured torque it explains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.errors import DataError
from dynid_rs.model.assembly import evaluate
from dynid_rs.regression.evaluation import Comparison, compare, r2, r2_as_recorded
from dynid_rs.runs.facts import check_joints
from dynid_rs.runs.given import Runs, as_given, as_recordings, is_one
from dynid_rs.runs.preprocessing import Band, States, choose_band, common_rate, prepare
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]


def predict(model: _core.TorqueModel, runs: Runs) -> FloatArray | list[FloatArray]:
    """Torque of each run at its own stamps, (n_samples, n_joints) [torque unit]; a list of them for several runs."""
    given = as_given(runs, model.robot, require_torque=False)
    found = [one.filled([torque_along(model, recording) for recording in one.recordings]) for one in given]
    return found[0] if is_one(runs) else found


def score(
    model: _core.TorqueModel, runs: Runs, *, per_joint: bool = False, as_recorded: bool = False
) -> float | FloatArray:
    """Share of the measured torque's variance that the model explains, R2: mean over the joints, or (n_joints,)."""
    recordings = as_recordings(runs, model.robot)
    check_some(recordings)
    if as_recorded:
        measured = [recording.tau for recording in recordings]
        each = r2_as_recorded(measured, [torque_along(model, recording) for recording in recordings])
    else:
        each = r2(compared(model, recordings))
    return each if per_joint else float(each.mean())


def torque_along(model: _core.TorqueModel, recording: Recording) -> FloatArray:
    """Torque of one recording at its own stamps, (n_samples, n_joints)."""
    (states,) = states_of(model, [recording])
    return at_stamps(recording, states, evaluate(model, states)[0])


def at_stamps(recording: Recording, states: States, torque: FloatArray) -> FloatArray:
    """Torque on the grid of `states` at the stamps of their recording, linear in between."""
    return np.stack([np.interp(recording.t, states.t, column) for column in torque.T], axis=1)


def compared(model: _core.TorqueModel, recordings: Sequence[Recording]) -> list[Comparison]:
    """Measured and predicted torque of recordings, in the model's band.

    Raises
    ------
    DataError
        Recordings of another arm, or in another torque unit.
    """
    states = states_of(model, recordings)
    check_unit(model.torque_unit, recordings)
    return [compare(each, evaluate(model, each)[0]) for each in states]


def states_of(model: _core.TorqueModel, recordings: Sequence[Recording]) -> list[States]:
    """States of recordings in the band where the model's errors are told, else in one that their motion asks for.

    Raises
    ------
    DataError
        Recordings of another arm.
    """
    check_arm(model.robot, recordings)
    if model.band is not None:
        cutoff, rate, standstill = model.band
        return [prepare(recording, Band(cutoff), rate, standstill=standstill) for recording in recordings]
    band, rate = choose_band(list(recordings)), common_rate(list(recordings))
    return [prepare(recording, band, rate) for recording in recordings]


def check_arm(robot: _core.RobotModel, recordings: Sequence[Recording]) -> None:
    """Refuse recordings of an arm with another number of joints by a `DataError`."""
    for recording in recordings:
        check_joints(robot, recording.name, recording.n_joints)


def check_some(recordings: Sequence[Recording]) -> None:
    """Refuse to tell an error of no recording at all by a `ValueError`."""
    if not recordings:
        raise ValueError("no recording to compare with; give at least one")


def check_unit(torque_unit: str, recordings: Sequence[Recording]) -> None:
    """Refuse recordings whose torque is in another unit than a model's by a `DataError`."""
    for recording in recordings:
        if recording.torque_unit != torque_unit:
            raise DataError(
                f"{recording.name}: holds torque in {recording.torque_unit}, the model gives {torque_unit}; give "
                "the drive gains (config: drive.gain), or a model in the unit of the run",
                code="other_unit",
                file=recording.name,
            )
