"""External torque along a run, by the generalised momentum: the observer that runs online, over a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.runs.given import Runs, as_recordings
from dynid_rs.runs.recording import FloatArray, Recording

CONTACT = 2048
"""Status bit: something pushes the arm."""
NO_ANSWER = 1 | 16 | 512
"""Status bits of samples whose torque is that of one before."""
SETTLED = 5.0
"""After so many time constants the observer has forgotten what it began with."""
LEAST_SAMPLES = 100
"""Fewer samples of a joint in motion tell no deviation."""


@dataclass(frozen=True, eq=False)
class Observation:
    """What the observer says of a run.

    Attributes
    ----------
    t : ndarray (n_samples,)
        Time of the run [s].
    external : ndarray (n_samples, n_joints)
        What pushes the arm, in the sense of the torques [torque unit].
    threshold : ndarray (n_samples, n_joints)
        Beyond these it is a contact; infinite before the first sample.
    contact : ndarray of bool (n_samples,)
        From when a joint passes its threshold until all are below half of theirs.
    status : ndarray (n_samples,)
        Status bits of the estimator.
    delay : float
        By how much all of this is late [s]: zero where the run holds dq and ddq, else that of the causal filter.
    """

    t: FloatArray
    external: FloatArray
    threshold: FloatArray
    contact: NDArray[np.bool_]
    status: NDArray[np.uint32]
    delay: float


class MomentumObserver:
    """External torque by the generalised momentum (De Luca and Mattone, 2003), without acceleration.

    Runs that hold dq and ddq are taken as they are; else positions, torque and motor side go through the causal
    filter of `dynid-estimator`. Thresholds follow from the deviation that the model expects, the time over which it
    forgets, and how many false contacts per hour are put up with.

    Parameters
    ----------
    model : TorqueModel
        What was identified.
    time_constant : float
        An external torque shows by 63 % after it [s].
    correlation_time : float, optional
        Over which what the model leaves forgets [s]. None: found by `fit`, and without `fit` nothing averages out.
    false_contacts_per_hour : float
        That noise alone may make.
    window : int, optional
        Samples to differentiate over, where positions come alone; about 20 ms by default, 15 ms at 1 kHz.

    Attributes
    ----------
    correlation_time_ : float or None
        Found by `fit`; None where the observer saw more than the model expects.
    """

    def __init__(
        self,
        model: _core.TorqueModel,
        *,
        time_constant: float = 0.02,
        correlation_time: float | None = None,
        false_contacts_per_hour: float = 0.01,
        window: int | None = None,
    ) -> None:
        self.model = model
        self.time_constant = time_constant
        self.correlation_time = correlation_time
        self.false_contacts_per_hour = false_contacts_per_hour
        self.window = window

    def fit(self, X: Runs) -> MomentumObserver:
        """Find the correlation time on runs without contact: a recording, a data frame, or a list of them.

        What the model leaves has the deviation s and the correlation time c, and the observer sees
        s sqrt(c / (c + T)) of it; so c follows from what it does see. The joint that averages out least decides.

        Raises
        ------
        ValueError
            No joint moves long enough in these runs, or a run is not one of this robot.
        """
        recordings = as_recordings(X, self.model.robot)
        gains = np.full((len(recordings), self.model.robot.n_joints), np.nan)
        for row, recording in zip(gains, recordings, strict=True):
            external, _, rest, std, status, _ = self._run(recording, None)
            late = recording.t > recording.t[0] + SETTLED * self.time_constant
            good = late & ((status & NO_ANSWER) == 0)
            moves = good[:, None] & (rest == 0)  # at rest the observer sees friction
            for j in np.flatnonzero(moves.sum(axis=0) >= LEAST_SAMPLES):
                seen, expected = external[moves[:, j], j], std[moves[:, j], j]
                row[j] = np.mean(seen**2) / np.mean(expected**2)
        if not np.any(np.isfinite(gains)):
            raise ValueError("fit: no joint moves long enough in these runs to tell what the model leaves")
        share = float(np.nanmax(gains))
        self.correlation_time_ = self.time_constant * share / (1 - share) if 0 < share < 1 else None
        return self

    def observe(self, recording: Recording) -> Observation:
        """External torque and contacts along a run.

        Raises
        ------
        ValueError
            The run is not one of this robot, in another unit, or lacks a temperature that friction follows.
        """
        known = self.correlation_time
        if known is None:
            known = getattr(self, "correlation_time_", None)
        external, threshold, _, _, status, delay = self._run(recording, known)
        contact = (status & CONTACT) != 0
        return Observation(recording.t, external, threshold, contact, status, delay)

    def _run(
        self, recording: Recording, correlation_time: float | None
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, NDArray[np.uint32], float]:
        check_run(self.model, recording)
        motion = tuple(getattr(recording, name) for name in ("q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor"))
        return _core.observe_momentum(
            self.model,
            recording.t,
            motion,
            recording.tau,
            temperature=recording.temperature,
            step=1.0 / recording.rate,
            window=self.window,
            time_constant=self.time_constant,
            correlation_time=correlation_time,
            false_per_hour=self.false_contacts_per_hour,
        )


def check_run(model: _core.TorqueModel, run: Recording) -> None:
    """Raise ValueError if a run is of another robot or unit, or lacks a temperature that friction follows."""
    n = model.robot.n_joints
    if run.n_joints != n:
        raise ValueError(f"{run.name}: has {run.n_joints} joints, the model has {n}")
    if run.torque_unit != model.torque_unit:
        raise ValueError(f"{run.name}: holds torque in {run.torque_unit}, the model gives {model.torque_unit}")
    follows = any("temperature" in effect.signals and values.any() for effect, values in model.effects)
    if follows and run.temperature is None:
        raise ValueError(f"{run.name}: the model's friction follows a temperature, which the run does not hold")
