"""Two encoders, two clocks: the delay of the link channel behind the motor channel.

A delay makes ``q_motor - q`` proportional to speed, an elastic gear makes it proportional to load, a gear with friction
adds a part with the sign of the speed. All three are fitted side by side, or elasticity would be taken for time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.findings import Finding
from dynid_rs.runs.preprocessing import States
from dynid_rs.runs.slope import slope

FloatArray = NDArray[np.float64]

N_PARTS = 10
"""Parts of the data that are left out in turn for the interval."""
SIGN_WIDTH = 0.01
"""Speed [rad/s] over which the gear's friction changes its sign."""


@dataclass(frozen=True, eq=False)
class EncoderDelay:
    """Delay per joint [s], (n_joints,), its standard error, and which joints have two different channels at all."""

    value: FloatArray
    std_error: FloatArray
    measured: NDArray[np.bool_]


def estimate_encoder_delay(runs: Sequence[States], tau_link: Sequence[FloatArray]) -> EncoderDelay:
    """Delay of the link channel behind the motor channel.

    Parameters
    ----------
    runs : sequence of States
        Runs with two encoders, not aligned.
    tau_link : sequence of ndarray (n, n_joints)
        Rigid-body torque predicted by a model, never the measured one.
    """
    n = runs[0].q.shape[1]
    value, std_error, measured = np.zeros(n), np.zeros(n), np.zeros(n, dtype=bool)
    for j in range(n):
        systems = [_system(states, load, j) for states, load in zip(runs, tau_link, strict=True)]
        columns = np.concatenate([system[0] for system in systems])
        gap = np.concatenate([system[1] for system in systems])
        if len(gap) < 20 * N_PARTS or np.ptp(gap) < 1e-12:
            continue  # the second channel is a copy, or the joint hardly moved
        measured[j] = True
        # Triangular factors stand for their rows, so that leaving a part out reads none of them again.
        scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        parts = np.array_split(np.column_stack([columns / scale, gap]), N_PARTS)
        factors = [_core.triangular_factor(part) for part in parts]
        value[j] = _delay(factors) / scale[0]
        without = np.array([_delay(factors[:k] + factors[k + 1 :]) / scale[0] for k in range(N_PARTS)])
        std_error[j] = np.sqrt((N_PARTS - 1) / N_PARTS * np.sum((without - without.mean()) ** 2))
    return EncoderDelay(value, std_error, measured)


def with_fitted_delay(findings: Sequence[Finding], delay: EncoderDelay | None) -> list[Finding]:
    """Findings with the fitted delay instead of the checks' estimates, which know no model: one number, once."""
    if delay is None or not delay.measured.any():
        return list(findings)
    others = [finding for finding in findings if finding.code != "encoder_delay"]
    if len(others) == len(findings):
        return others
    middle = float(np.median(delay.value[delay.measured]))
    late, early = ("link", "motor") if middle >= 0 else ("motor", "link")
    values = np.sort(1e3 * delay.value[delay.measured] * (1 if middle >= 0 else -1))
    low, high = f"{values[0]:.2f}", f"{values[-1]:.2f}"
    message = (
        f"the {late} encoders come {low if low == high else f'{low} to {high}'} ms after the {early} encoders, fitted "
        "beside the gears' yielding; the delay is removed before deflection is used"
    )
    return [*others, Finding("encoder_delay", "info", message, value=middle, unit="s")]


def _system(states: States, tau_link: FloatArray, j: int) -> tuple[FloatArray, FloatArray]:
    """Columns speed, load, sign of speed, constant; and ``q_motor - q``, all in the band."""
    # The derivative of the position: a recorded velocity may lag behind by itself.
    speed = slope(states.q_motor[:, j], states.rate)
    sign = _core.friction_basis(speed, 0.0, SIGN_WIDTH)[:, :2].sum(axis=1)
    raw = np.stack([speed, tau_link[:, j], sign, states.q_motor[:, j] - states.q[:, j]], axis=1)
    filtered = states.band.apply(raw, states.rate)
    moves = np.abs(speed) > 0.01 * np.abs(speed).max(initial=0.0)
    rows = np.flatnonzero(states.moving & moves)
    columns = np.concatenate([filtered[rows, :3], np.ones((len(rows), 1))], axis=1)
    return columns, filtered[rows, 3]


def _delay(factors: Sequence[FloatArray]) -> float:
    """Coefficient of the first column, by triangular factors of ``[columns | gap]``."""
    factor = _core.triangular_factor(np.concatenate(factors))
    x = np.linalg.lstsq(factor[:, :-1], factor[:, -1], rcond=None)[0]
    if x[1] < 0:  # a gear yields in the direction of its load; with one bound, the best within it is on it
        x = np.linalg.lstsq(factor[:, [0, 2, 3]], factor[:, -1], rcond=None)[0]
    return float(x[0])
