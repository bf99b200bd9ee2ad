"""`dynid estimate --adapt`: how friction and payload would have followed a run, and what became of the error."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid_rs.base.numbers import significant

if TYPE_CHECKING:
    from dynid_rs._core import TorqueModel
    from dynid_rs.model.adapt import AdaptedRun
    from dynid_rs.runs.recording import Recording


def adapted(
    model: TorqueModel, recording: Recording, parts: str | None, mass: float | None, save: Path | None
) -> AdaptedRun | None:
    """Go through a run as the estimator would, and write the model at its end where that is asked for.

    None where nothing is to follow.

    Raises
    ------
    ValueError
        An option is none, or lacks another one.
    """
    if parts is None:
        if mass is not None or save is not None:
            raise ValueError("--adapt-mass and --save-adapted go with --adapt")
        return None
    from dynid_rs.base.errors import DataError
    from dynid_rs.model.adapt import MOST_MASS, PARTS, Adaptation

    wanted = tuple(parts.split(","))
    if not set(wanted) <= set(PARTS) or len(set(wanted)) < len(wanted):
        raise ValueError(f"--adapt: expected friction, payload or friction,payload, each once, got {parts[:40]!r}")
    if "payload" in wanted and mass is None:
        raise ValueError("--adapt payload: give --adapt-mass KG, what the arm may carry; a payload follows within it")
    if "payload" not in wanted and mass is not None:
        raise ValueError("--adapt-mass is the limit of a payload; give --adapt friction,payload, or leave it out")
    if mass is not None and not 0 < mass <= MOST_MASS:
        raise ValueError(f"--adapt-mass: expected what the arm may carry, above 0 to {MOST_MASS:g} kg, got {mass:g}")
    following = Adaptation(model, wanted, mass=mass)
    run = following.adapt(recording)
    if not len(run.t):
        raise DataError(
            f"{recording.name}: shorter than a fifth of a second, so nothing can follow; give a longer run",
            code="too_short",
            file=recording.name,
        )
    if save is not None:
        following.adapted_model(run).save(save)
    return run


def lines(run: AdaptedRun, model: TorqueModel, parts: str, save: Path | None) -> Iterator[str]:
    """The log, then one line per joint, and the load."""
    from dynid_rs.model.units import load_unit, torque_units

    for one in run.log:
        unit = "" if one.part == "friction" else f" {load_unit(model.torque_unit)}"
        move = f"{_number(one.before)} -> {_number(one.now)}{unit}{_why(one.reason)}"
        yield f"{one.t:.1f} s: {_what(one.part, one.joint)} {move}"
    before, after = run.rmse()
    for j, (joint, unit) in enumerate(zip(model.robot.joint_names, torque_units(model), strict=True)):
        error = f"RMSE {significant(before[j])} -> {significant(after[j])} {unit}"
        factor = f", friction times {_number(run.factors[-1, j])}" if "friction" in parts else ""
        yield f"{joint}: {error} (online, {parts} following{factor} at the end)"
    if "payload" in parts:
        mass, *moments = run.load[-1]
        mass_unit, moment_unit = (load_unit(model.torque_unit, kilograms) for kilograms in ("kg", "kg*m"))
        centre = ", ".join(_number(x) for x in moments)
        yield f"payload at the end: {_number(mass)} {mass_unit}, first moments {centre} {moment_unit}"
    if save is not None:
        yield f"adapted model: {save}"


def answer(run: AdaptedRun, save: Path | None) -> dict[str, Any]:
    """The same for JSON."""
    before, after = run.rmse()
    return {
        "rmse_before": before.tolist(),
        "rmse": after.tolist(),
        "factors": run.factors[-1].tolist(),
        "factor_std": run.std[-1].tolist(),
        "load": run.load[-1].tolist(),
        "log": [
            {
                "t": one.t,
                "part": one.part,
                "joint": one.joint,
                "from": one.before,
                "to": one.now,
                "interval": list(one.interval),
                "moments": None if one.moments is None else list(one.moments),
                "reason": one.reason,
            }
            for one in run.log
        ],
        "saved": None if save is None else str(save),
    }


def _what(part: str, joint: str) -> str:
    return f"{joint}: friction times" if part == "friction" else "payload"


def _why(reason: str) -> str:
    words = {"limit": ", stopped at its limit", "within": ", within its limits again", "reset": ", put back"}
    return words.get(reason, "")


def _number(x: float) -> str:
    return f"{x:.3g}"
