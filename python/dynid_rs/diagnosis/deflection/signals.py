"""What two encoders show of one gear: deflection, the load behind it, and where the joint is, run by run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.deflection.load import Load
from dynid_rs.preprocessing import Band, States
from dynid_rs.recording import Recording

if TYPE_CHECKING:
    from dynid_rs.identification import ThreeLoopIdentifier

FloatArray = NDArray[np.float64]

SMOOTH = 10.0
"""Positions of plain arrays are low-passed here [Hz] before they are differentiated."""


@dataclass(frozen=True, eq=False)
class GearSignals:
    """One gear in one run, on a uniform grid.

    Parameters
    ----------
    deflection : ndarray (n,)
        `q_motor - q` as the encoders show it, at the full rate, and not low-passed [rad].
    shift : ndarray (n,)
        How much of it is known to come from the link channel's delay and encoder error so far [rad].
    delay : float
        That delay [s].
    q_shown, q, dq : ndarray (n,)
        Link position that the encoder shows, and the true one with its speed, at the motor channel's instants [rad].
    q_motor : ndarray (n,)
        Motor position [rad].
    load : ndarray (n,)
        Torque that the gear transmits, as predicted [N m]; never the motor's measured torque.
    load_error : ndarray (n, n_directions)
        By how much the prediction is off for each independent direction of what it was learned from, one standard
        deviation each [N m]; no column where the load counts as known.
    used : ndarray (n,) of bool
        Samples that are fitted and scored.
    rate : float
        Samples per second [Hz].
    name : str
        Of the run.
    """

    deflection: FloatArray
    shift: FloatArray
    delay: float
    q_shown: FloatArray
    q: FloatArray
    dq: FloatArray
    q_motor: FloatArray
    load: FloatArray
    load_error: FloatArray
    used: NDArray[np.bool_]
    rate: float
    name: str = "recording"

    def thinned(self, step: int) -> GearSignals:
        """Return the same with every `step`-th sample."""
        arrays = {f.name: getattr(self, f.name) for f in fields(self)}
        kept: dict[str, Any] = {name: x[::step] for name, x in arrays.items() if isinstance(x, np.ndarray)}
        return replace(self, **kept, rate=self.rate / step)

    @staticmethod
    def of_arrays(
        t: FloatArray, q: FloatArray, q_motor: FloatArray, load: FloatArray, *, name: str = "recording"
    ) -> GearSignals:
        """Return the signals of one joint whose load is known otherwise, e.g. from a torque sensor; (n,) each."""
        rate = (len(t) - 1) / (t[-1] - t[0])
        grid = t[0] + np.arange(len(t)) / rate
        q, q_motor, load = (np.interp(grid, t, x) for x in (q, q_motor, load))
        smooth = Band(min(SMOOTH, 0.4 * rate)).apply(q, rate)
        none = np.zeros((len(t), 1))
        dq = np.gradient(smooth, 1 / rate)
        used = np.ones(len(t), dtype=bool)
        return GearSignals(
            q_motor - q, np.zeros(len(t)), 0.0, smooth, smooth, dq, q_motor, load, none, used, float(rate), name
        )


def gear_signals(
    load: Load, fit: ThreeLoopIdentifier, runs: Sequence[Recording | States], delay: FloatArray
) -> list[list[GearSignals]]:
    """Signals of every joint and run: one list per joint.

    Parameters
    ----------
    load : Load
        Predicts what the gears transmit.
    fit : ThreeLoopIdentifier
        Fitted; gives band and rate.
    runs : sequence of Recording or States
        With two encoders. States show the deflection only as far as their low-pass lets it through.
    delay : ndarray (n_joints,)
        Of the link channel behind the motor channel, as far as it is known [s].
    """
    joints: list[list[GearSignals]] = [[] for _ in range(load.robot.n_joints)]
    for run in runs:
        states = run if isinstance(run, States) else fit.states(run)
        raw = states.q_motor - states.q if isinstance(run, States) else _raw_deflection(run, states)
        # The link channel on the motor channel's clock, without the encoder errors that the fit knows of already.
        ahead = _ahead(states, delay).aligned(np.zeros(len(delay)), fit.encoder_error)
        torque = load.torque(ahead)
        errors = load.errors(ahead, torque)
        for j, joint in enumerate(joints):
            joint.append(
                GearSignals(
                    deflection=raw[:, j],
                    shift=ahead.q[:, j] - states.q[:, j],
                    delay=float(delay[j]),
                    q_shown=states.q[:, j],
                    q=ahead.q[:, j],
                    dq=ahead.dq[:, j],
                    q_motor=states.q_motor[:, j],
                    load=torque[:, j],
                    load_error=errors[j],
                    used=states.moving,
                    rate=states.rate,
                    name=states.name,
                )
            )
    return joints


def _raw_deflection(recording: Recording, states: States) -> FloatArray:
    """`q_motor - q` on the grid of `states`, not low-passed more than that grid asks for, (n, n_joints)."""
    if recording.q_motor is None:
        raise ValueError(f"{recording.name}: the deflection of gears needs a second encoder, q_motor")
    deflection = recording.q_motor - recording.q
    step = round(recording.rate / states.rate)
    if step > 1:
        deflection = Band(0.4 * states.rate).apply(deflection, recording.rate)
    if len(recording.t) == len(states.t) and np.array_equal(recording.t, states.t):
        return deflection
    return np.stack([np.interp(states.t, recording.t, column) for column in deflection.T], axis=1)


def _ahead(states: States, delay: FloatArray) -> States:
    """`states` with the link channel as late as the motor channel."""
    from scipy.interpolate import CubicSpline

    if not np.any(delay):
        return states
    moved: dict[str, Any] = {}
    for name in ("q", "dq", "ddq"):
        x = getattr(states, name)
        columns = []
        for j, late in enumerate(delay):
            at = np.clip(states.t + late, states.t[0], states.t[-1])
            columns.append(CubicSpline(states.t, x[:, j])(at))
        moved[name] = np.stack(columns, axis=1)
    return replace(states, **moved)
