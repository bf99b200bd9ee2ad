"""Measured and predicted torque along a run, and what the model leaves of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.drawing import chosen_joints, line, panels, titled
from dynid_rs.base.units import labelled, unit_text
from dynid_rs.model.along import compared
from dynid_rs.model.units import torque_units
from dynid_rs.regression.evaluation import band_rmse, r2
from dynid_rs.runs.given import Runs, as_recordings


def plot_residual(
    model: _core.TorqueModel, run: Runs, *, joints: Sequence[str | int] | None = None, axes: Any = None
) -> NDArray[Any]:
    """`TorqueModel.plot_residual`; `_core.pyi` says what is drawn."""
    recordings = as_recordings(run, model.robot)
    robot = model.robot
    chosen = chosen_joints(joints, robot.joint_names)
    comparisons = compared(model, recordings)
    drawn = panels(len(chosen), 2, axes)
    error, explained = band_rmse(comparisons), r2(comparisons)
    units = torque_units(model)
    for (left, right), j in zip(drawn, chosen, strict=True):
        start, clock = 0.0, len(comparisons) == 1
        for k, comparison in enumerate(comparisons):
            states = comparison.states
            t = states.t if clock else states.t - states.t[0] + start  # one run behind the other
            # Rows stand on a grid that leaves out what is not scored: lines break there.
            seen = np.full((3, len(states.grid)), np.nan)
            at = states.rows // states.step
            told = comparison.measured[:, j], comparison.predicted[:, j], comparison.error[:, j]
            for place, values in zip(seen, told, strict=True):
                place[at] = np.where(states.counted[:, j], values, np.nan)
            first = {"measured": "measured", "predicted": "model"} if k == 0 else {}
            line(left, t[states.grid], seen[0], color="0.7", linewidth=2.2, label=first.get("measured"))
            line(left, t[states.grid], seen[1], color="C0", label=first.get("predicted"))
            line(right, t[states.grid], seen[2], color="C3", label=None)
            start = float(t[-1])
        noise = float(model.noise_std[j])
        right.axhspan(-noise, noise, color="0.5", alpha=0.2, linewidth=0, label="\u00b1 std on training runs")
        left.set_ylabel(labelled("current" if units[j] == "A" else "torque", units[j]))
        right.set_ylabel(labelled("left", units[j]))
        right.set_title(
            f"RMSE {error[j]:.3g} {unit_text(units[j])}, R\u00b2 {explained[j]:.4f}", loc="right", fontsize="small"
        )
    titled(drawn, [robot.joint_names[j] for j in chosen])
    for panel in drawn[0]:
        panel.legend(fontsize="small", framealpha=0.7, edgecolor="none", loc="upper right")
    for panel in drawn[-1]:
        panel.set_xlabel(labelled("time", "s"))
    if axes is None:
        names = ", ".join(recording.name for recording in recordings)
        band = comparisons[0].states.band.cutoff
        drawn[0, 0].figure.suptitle(f"{names}: below {band:.3g} Hz, where joints move", fontsize="medium")
    return drawn
