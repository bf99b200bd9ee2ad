"""What the data cannot show, whatever is in it: said, so that silence is not taken for absence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.findings import Finding
from dynid_rs.model.placed import CATALOGUE
from dynid_rs.runs.recording import Recording

LEAST_WARMTH = 1.0
"""A thermometer that moves less than this over all runs [K] tells nothing about friction."""
TWO_ENCODERS = ("joint_elasticity", "nonlinear_elasticity", "backlash", "gear_hysteresis", "encoder_delay")
"""Kinds that show themselves between motor and link."""
IN_NEWTON_METRES = ("payload", "torque_gain")
"""Kinds whose sizes are in kg, or in parts of a torque that is known."""


def missing_signals(runs: Sequence[Recording]) -> list[Finding]:
    """One finding for every signal that some effects need and the runs lack; (severity "info")."""
    found = []
    if not all(run.has_motor_encoder for run in runs):
        found.append(
            _untestable(
                TWO_ENCODERS, "q_motor", "motor and link positions, and the runs hold one of them; record q_motor_i too"
            )
        )
    if not all(run.temperature is not None for run in runs):
        found.append(
            _untestable(
                ("thermal_friction", "temperature_friction"),
                "temperature",
                "temperature_i, which the runs do not hold: only a warm-up in time or in dissipated power "
                f"was looked for{_too_short(runs)}",
                partly=True,
            )
        )
    elif not any(np.ptp(column) > LEAST_WARMTH for column in _temperatures(runs).T):
        found.append(
            _untestable(
                ("temperature_friction",),
                "temperature",
                f"a temperature that moves by more than {LEAST_WARMTH:g} K over all runs; record from a cold start",
            )
        )
    if any(run.torque_unit == "A" for run in runs):
        found.append(
            _untestable(
                IN_NEWTON_METRES,
                "tau",
                "torque in N*m, and the runs hold currents: masses and common drive gains are known up to a factor; "
                "give --drive-gain",
                partly=True,
            )
        )
    return found


def _temperatures(runs: Sequence[Recording]) -> NDArray[np.float64]:
    return np.concatenate([run.temperature for run in runs if run.temperature is not None])


def _too_short(runs: Sequence[Recording]) -> str:
    """Say where no run lasts as long as a usual warm-up: of one, only the beginning is seen."""
    times = next(shape["grid"] for shape in CATALOGUE["thermal_friction"]["shape"] if shape["name"] == "time_constant")
    longest, usual = max(run.duration for run in runs), min(times)
    if longest >= usual:
        return ""
    return (
        f", and of one that takes {usual:g} s or more the longest run of {longest:.0f} s shows only the beginning: "
        "record some minutes from a cold start"
    )


def _untestable(kinds: Sequence[str], column: str, text: str, *, partly: bool = False) -> Finding:
    names = ", ".join(kinds)
    verb = "cannot be told in full without" if partly else "cannot be told without"
    return Finding("signal_missing", "info", f"{names} {verb} {text}", column=column)
