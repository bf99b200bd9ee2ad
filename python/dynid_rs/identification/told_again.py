"""The error of a saved model on a run, told as `result.json` tells it: in the model's band, where the arm moves."""

from __future__ import annotations

from collections.abc import Sequence

from dynid_rs import _core
from dynid_rs.identification.training import check_motion
from dynid_rs.model.assembly import evaluate
from dynid_rs.regression.evaluation import Comparison, compare
from dynid_rs.runs.checks import contradicting_signals
from dynid_rs.runs.preprocessing import Band, prepare, without
from dynid_rs.runs.recording import Recording

MOST_FINER = 100.0
"""A grid finer than so many samples per recorded one is no result of this run's robot, and would fill the memory."""


def compared_in_band(
    model: _core.TorqueModel, recording: Recording, excluded: Sequence[tuple[float, float]] = ()
) -> Comparison:
    """Measured torque of a run and the model's, in the band in which the model's errors are told.

    Its error is to the last digit that of `result.json` where the model was saved with it and the run is one of its
    test runs.

    Parameters
    ----------
    model : TorqueModel
        With a band.
    recording : Recording
        With torque, as its file has it.
    excluded : sequence of (start, end)
        Times [s] that are not scored: `data.excluded` of `result.json`.

    Raises
    ------
    ValueError
        The model says no band, or the run is too short for it.
    DataError
        There is hardly any motion in the run.
    """
    if model.band is None:
        raise ValueError("the model does not say in which band its errors are told; identify again")
    cutoff, rate, standstill = model.band
    if rate > MOST_FINER * recording.rate:
        raise ValueError(
            f"the model's errors are told at {rate:g} samples per second, and {recording.name} has "
            f"{recording.rate:.4g}; give a run that is recorded as fast as those it was made of"
        )
    told = recording.without(*contradicting_signals(recording))
    states = without(prepare(told, Band(cutoff), rate, standstill=standstill), excluded)
    check_motion([states])
    return compare(states, evaluate(model, states)[0])
