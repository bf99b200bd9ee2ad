"""External torque along a run, by the generalised momentum: the observer that runs online, over a recording."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.files import write_json
from dynid_rs.base.json_file import is_object
from dynid_rs.base.quoting import shown, shown_value
from dynid_rs.model.contact_levels import Seen, fit_tails, fit_variances
from dynid_rs.runs.given import Runs, as_recordings
from dynid_rs.runs.recording import FloatArray, Recording

CONTACT = 2048
"""Status bit: something pushes the arm."""
NO_ANSWER = 1 | 16 | 512
"""Status bits of samples without a torque of their own: not finite, repeated, settling."""
SETTLED = 5.0
"""After so many time constants the observer has forgotten what it began with."""
SAME_RATE = 0.02
"""Relative difference of rates that are one."""
TIME_CONSTANTS = (1e-5, 100.0)
"""Times [s] that an observer may take."""
WINDOWS = range(5, 102, 2)
"""Numbers of samples to differentiate over."""
LEAST_SAMPLES = 100
"""Fewer samples of a joint in motion tell no deviation."""


class Directions(Protocol):
    """By which parameters a model may be off, as `parameter_directions` returns them."""

    def to_json(self) -> list[dict[str, Any]]:
        """As a `contact.json` holds them."""


@dataclass(frozen=True, eq=False)
class _Said:
    """What the compiled observer says of a run, (n_samples, n_joints) each but for the last two."""

    external: FloatArray
    threshold: FloatArray
    rest: FloatArray
    std: FloatArray
    guide: FloatArray
    doing: FloatArray
    torque: FloatArray
    of_parameters: FloatArray
    status: NDArray[np.uint32]
    delay: float


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
    guide : ndarray (n_samples, n_joints)
        What of `external` lies beyond the thresholds, smooth at its edge: what an arm may follow that a hand guides
        [torque unit].
    status : ndarray (n_samples,)
        Status bits of the estimator.
    delay : float
        By how much all of this is late [s]: zero where the run holds dq and ddq, else that of the causal filter. A
        joint whose torque channel is early is later by as much.
    """

    t: FloatArray
    external: FloatArray
    threshold: FloatArray
    contact: NDArray[np.bool_]
    guide: FloatArray
    status: NDArray[np.uint32]
    delay: float


class MomentumObserver:
    """External torque by the generalised momentum (De Luca and Mattone, 2003), without acceleration.

    Runs that hold dq and ddq are taken as they are; else positions, torque and motor side go through the causal
    filter of `dynid-estimator`. Thresholds follow from how far off the observer is where nothing pushes, and from how
    many false contacts per hour are put up with. `fit` learns it from runs without contact: per joint, for one that
    moves, that stands, and that has just begun, stopped or turned, and by its torque; `directions` add what the
    parameters are not known by, which is large outside of what the model was trained on. Without `fit`, or where its
    runs are too short (less than about two minutes), they follow from the deviation that the model expects and the time
    over which it forgets.

    Parameters
    ----------
    model : TorqueModel
        What was identified.
    time_constant : float
        An external torque shows by 63 % after it [s].
    correlation_time : float, optional
        Over which what the model leaves forgets [s]. None: found by `fit`, and without `fit` nothing averages out.
        Where it is given, `fit` learns nothing else either.
    false_contacts_per_hour : float
        That an arm that nothing touches may make.
    window : int, optional
        Samples to differentiate over, where positions come alone; about 20 ms by default, 15 ms at 1 kHz.
    directions : ParameterDirections, optional
        How well the parameters are known, from `parameter_directions`. None: they count as known.

    Raises
    ------
    ValueError
        A time constant or a window that the observer does not take.

    Attributes
    ----------
    correlation_time_ : float or None
        Found by `fit`; None where the observer saw more than the model expects.
    uncertainty_ : dict or None
        Found by `fit`: what `save` writes. None where its runs are too short.
    greatest_ : ndarray (n_joints,)
        Greatest external torque of these runs, what a constant threshold is usually set by [torque unit].
    """

    def __init__(
        self,
        model: _core.TorqueModel,
        *,
        time_constant: float = 0.02,
        correlation_time: float | None = None,
        false_contacts_per_hour: float = 0.01,
        window: int | None = None,
        directions: Directions | None = None,
    ) -> None:
        if not TIME_CONSTANTS[0] <= time_constant <= TIME_CONSTANTS[1]:
            low, high = TIME_CONSTANTS
            raise ValueError(f"time_constant: a number of seconds from {low:g} to {high:g}, found {time_constant:g}")
        if window is not None and window not in WINDOWS:
            raise ValueError(f"window: an odd number of samples from 5 to 101, found {shown_value(window)}")
        self.model = model
        self.time_constant = time_constant
        self.correlation_time = correlation_time
        self.false_contacts_per_hour = false_contacts_per_hour
        self.window = window
        self.directions = directions

    def fit(self, X: Runs) -> MomentumObserver:
        """Learn from runs without contact that the model was not fitted on: a recording, a data frame, or a list.

        What the model leaves has the deviation s and the correlation time c, and the observer sees
        s sqrt(c / (c + T)) of it; so c follows from what it does see. The joint that averages out least decides.
        What else is learned, and how, is in `model/contact_levels.py`.

        Raises
        ------
        ValueError
            No joint moves long enough in these runs, or a run is not one of this robot; begins with their names.
        """
        recordings = as_recordings(X, self.model.robot)
        gains = np.full((len(recordings), self.model.robot.n_joints), np.nan)
        for row, recording in zip(gains, recordings, strict=True):
            said = self._run(recording, None)
            moves = self._good(recording, said)[:, None] & (said.rest == 0)  # at rest the observer sees friction
            for j in np.flatnonzero(moves.sum(axis=0) >= LEAST_SAMPLES):
                seen, expected = said.external[moves[:, j], j], said.std[moves[:, j], j]
                row[j] = np.mean(seen**2) / np.mean(expected**2)
        if not np.any(np.isfinite(gains)):
            names = _names(recordings)
            raise ValueError(
                f"{names}: no joint moves long enough to tell what the model leaves; name runs in which the arm works"
            )
        share = float(np.nanmax(gains))
        self.correlation_time_ = self.time_constant * share / (1 - share) if 0 < share < 1 else None
        self.uncertainty_ = None if self.correlation_time is not None else self._learn(recordings)
        return self

    def observe(self, recording: Recording) -> Observation:
        """External torque and contacts along a run.

        Raises
        ------
        ValueError
            The run is not one of this robot, in another unit or at another rate than what was learned from, or lacks a
            temperature that friction follows.
        """
        learned = getattr(self, "uncertainty_", None)
        if learned is not None and abs(recording.rate * learned["step"] - 1) > SAME_RATE:
            raise ValueError(
                f"{shown(recording.name)}: recorded at {recording.rate:g} Hz, thresholds were learned at "
                f"{1 / learned['step']:g} Hz, and the observer's noise follows the rate; learn them from runs at this"
            )
        known = self.correlation_time
        if known is None:
            known = getattr(self, "correlation_time_", None)
        said = self._run(recording, known, learned)
        contact = (said.status & CONTACT) != 0
        return Observation(recording.t, said.external, said.threshold, contact, said.guide, said.status, said.delay)

    def save(self, path: str | PathLike[str]) -> None:
        """Write what `fit` has learned, for `load` and for ``dynid-estimator --observe --contacts``.

        Raises
        ------
        ValueError
            Nothing was learned.
        OSError
            The system refuses.
        """
        learned = getattr(self, "uncertainty_", None)
        if learned is None:
            raise ValueError("save: nothing was learned; fit on at least two minutes of runs without contact")
        write_json(path, learned | {"false_contacts_per_hour": float(self.false_contacts_per_hour)})

    @staticmethod
    def load(path: str | PathLike[str], model: _core.TorqueModel) -> MomentumObserver:
        """Return an observer of `model` as `save` has written it.

        Raises
        ------
        FormatError
            The file is none, of a newer program, of another arm, or in another unit.
        ValueError
            It is of a model with other effects.
        OSError
            The system refuses.
        """
        mend = "write it anew with `dynid contact MODEL --healthy RUN --save`"
        if not is_object(path):
            raise _core.FormatError(f"{Path(path)}: not an observer's uncertainty: it is no JSON object; {mend}")
        try:
            joints, unit, _, window, time_constant, per_hour = _core.read_contact(Path(path), model)
        except _core.FormatError:
            raise
        except ValueError as error:
            raise ValueError(f"{Path(path)}: damaged, or of another model ({error}); {mend}") from None
        other = (
            "of an arm with other joints than the model's" if tuple(joints) != tuple(model.robot.joint_names) else ""
        )
        if not other and unit != model.torque_unit:
            other = f"in another unit than the model, which is in {model.torque_unit}"
        if other:
            raise _core.FormatError(f"{Path(path)}: {other}; {mend}")
        found = MomentumObserver(model, time_constant=time_constant, false_contacts_per_hour=per_hour, window=window)
        found.uncertainty_ = json.loads(Path(path).read_bytes())
        return found

    def _learn(self, recordings: Sequence[Recording]) -> dict[str, Any] | None:
        """What a `contact.json` holds; None where the runs are too short."""
        n = self.model.robot.n_joints
        step, names = 1.0 / recordings[0].rate, _names(recordings)
        if any(abs(run.rate * step - 1) > SAME_RATE for run in recordings):
            raise ValueError(
                f"{names}: recorded at different rates, which the observer's noise follows; give runs of one rate"
            )
        learned: dict[str, Any] = {
            "format": "dynid-contact",
            "version": 2,
            "joints": list(self.model.robot.joint_names),
            "torque_unit": self.model.torque_unit,
            "step": step,
            "window": self.window,
            "time_constant": float(self.time_constant),
            "false_contacts_per_hour": 1.0,
            **{name: [1.0] * n for name in ("moving", "standing", "turning", "torque")},
            **{name: [False] * n for name in ("stops_known", "turns_known")},
            "tail": {name: [1.0] * n for name in ("level", "per_hour", "growth")},
            "directions": [],
        }
        seen = []
        for run in recordings:
            said = self._run(run, None, learned)
            good = self._good(run, said)
            seen.append(Seen(said.external[good], said.doing[good], said.torque[good], step))
        self.greatest_ = np.max([np.abs(one.external).max(axis=0) for one in seen], axis=0)
        learned |= fit_variances(seen, self.time_constant, names)
        deviations = []
        for run in recordings:
            said = self._run(run, None, learned, per_hour=float(n))  # with these tails thresholds are one deviation
            s = np.maximum(said.threshold - said.rest, np.finfo(float).tiny)
            beyond = np.maximum(np.abs(said.external) - said.rest, 0.0) / s
            deviations.append(beyond[self._good(run, said)])
        tail = fit_tails(deviations, step)
        if tail is None:
            return None
        # What the parameters are off by on these runs is in what they left; on top it counts twice there, and is small.
        directions = [] if self.directions is None else self.directions.to_json()
        return learned | {"tail": tail, "directions": directions}

    def _good(self, recording: Recording, said: _Said) -> NDArray[np.bool_]:
        """Samples (n_samples,) that were answered, after the observer has forgotten what it began with."""
        late = recording.t > recording.t[0] + SETTLED * self.time_constant
        good: NDArray[np.bool_] = late & ((said.status & NO_ANSWER) == 0)
        return good

    def _run(
        self,
        recording: Recording,
        correlation_time: float | None,
        uncertainty: dict[str, Any] | None = None,
        per_hour: float | None = None,
    ) -> _Said:
        check_run(self.model, recording)
        motion = tuple(getattr(recording, name) for name in ("q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor"))
        said, sources, status, delay = _core.observe_momentum(
            self.model,
            recording.t,
            motion,
            recording.tau,
            temperature=recording.temperature,
            step=1.0 / recording.rate,
            window=self.window,
            time_constant=self.time_constant,
            correlation_time=correlation_time,
            false_per_hour=self.false_contacts_per_hour if per_hour is None else per_hour,
            uncertainty=None if uncertainty is None else json.dumps(uncertainty),
        )
        external, threshold, rest, std, guide = said
        doing, torque, of_parameters = sources
        return _Said(external, threshold, rest, std, guide, doing, torque, of_parameters, status, delay)


def _names(recordings: Sequence[Recording]) -> str:
    return ", ".join(shown(recording.name) for recording in recordings)


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
