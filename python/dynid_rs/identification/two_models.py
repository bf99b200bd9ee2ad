"""Two models held against each other on the same runs, in the same band, at the same samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dynid_rs import _core
from dynid_rs.base.errors import DataError
from dynid_rs.identification.training import check_motion
from dynid_rs.model.assembly import evaluate
from dynid_rs.regression.error_interval import change_interval, rmse_interval
from dynid_rs.regression.evaluation import band_rmse, compare, torque_std
from dynid_rs.runs.checks import contradicting_signals
from dynid_rs.runs.preprocessing import Band, choose_band, common_rate, prepare
from dynid_rs.runs.recording import Recording


def compare_models(
    a: _core.TorqueModel, b: _core.TorqueModel, runs: Sequence[Recording], *, cutoff: float | None = None
) -> dict[str, Any]:
    """Errors of two models on `runs`, where the arm moves.

    Parameters
    ----------
    a, b : TorqueModel
        Of one arm, in one torque unit.
    runs : sequence of Recording
        With torque.
    cutoff : float, optional
        Band [Hz]; the narrower one of the two models' own by default, or one that the motion asks for.

    Returns
    -------
    dict
        `cutoff` [Hz]; `torque_std`, `a`, `b` (n_joints,) [torque unit]; `a_interval`, `b_interval`, and
        `change_interval` of ``b / a - 1``, 95 %, None where a joint's run is too short to say.

    Raises
    ------
    DataError
        Models or runs of different arms or torque units; runs with hardly any motion.
    """
    check_alike(a, b)
    for run in runs:
        if run.torque_unit != a.torque_unit:
            raise DataError(
                f"{run.name}: holds torque in {run.torque_unit}, the models give {a.torque_unit}; give --drive-gain, "
                "or models in the unit of the run",
                code="other_unit",
                file=run.name,
            )
    own = [model.band[0] for model in (a, b) if model.band is not None]
    told = [run.without(*contradicting_signals(run)) for run in runs]
    band = Band(cutoff if cutoff is not None else min(own)) if own or cutoff is not None else choose_band(told)
    states = [prepare(run, band, common_rate(told)) for run in told]
    check_motion(states)
    one, two = ([compare(s, evaluate(model, s)[0]) for s in states] for model in (a, b))
    return {
        "cutoff": band.cutoff,
        "torque_std": torque_std(one).tolist(),
        "a": band_rmse(one).tolist(),
        "b": band_rmse(two).tolist(),
        "a_interval": rmse_interval(one),
        "b_interval": rmse_interval(two),
        "change_interval": change_interval(two, one),
    }


def check_alike(a: _core.TorqueModel, b: _core.TorqueModel) -> None:
    """Refuse models that cannot be compared.

    Raises
    ------
    DataError
        Of arms with other joints, or in different torque units.
    """
    if a.robot.joint_names != b.robot.joint_names:
        raise DataError(
            f"the models are of different arms: joints {', '.join(a.robot.joint_names)} and "
            f"{', '.join(b.robot.joint_names)}; compare models of the same arm",
            code="wrong_reference",
        )
    if a.torque_unit != b.torque_unit:
        raise DataError(
            f"one model gives {a.torque_unit}, the other one {b.torque_unit}; identify both with the same drive gains",
            code="other_unit",
        )
