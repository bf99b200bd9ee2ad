"""Friction and payload that follow the arm slowly, within limits, by the code that runs online.

The estimate, how it forgets and why nothing winds up: `rust/dynid-core/src/adapt`. The model itself never changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.model.healthy import UNKNOWN_MEMORY
from dynid_rs.model.observer import NO_ANSWER
from dynid_rs.model.watch import Watch
from dynid_rs.regression.uncertainty import NORMAL_95
from dynid_rs.runs.recording import FloatArray, Recording

PARTS = ("friction", "payload")
MOST_MASS = 1e5
"""As `rust/dynid-core/src/adapt/settings.rs` has it [kg]."""


@dataclass(frozen=True)
class Adapted:
    """A change of what is added to a model, as it was said.

    Attributes
    ----------
    t : float
        When [s].
    part : str
        ``"friction"`` or ``"payload"``.
    joint : str
        Whose friction; a payload is on all joints, and has the last.
    before, now : float
        Factor on the joint's friction, or mass [kg], that was said before, and that is used from now on.
    interval : (float, float)
        Where the data say it is, with 95 %.
    moments : (float, float, float) or None
        Of a payload, first moments that are used, in the last link's frame [kg m].
    reason : str
        ``"followed"``, ``"limit"`` (stopped there, the data lie beyond), ``"within"`` (they came back), ``"reset"``.
    """

    t: float
    part: str
    joint: str
    before: float
    now: float
    interval: tuple[float, float]
    moments: tuple[float, float, float] | None
    reason: str


@dataclass(frozen=True, eq=False)
class AdaptedRun:
    """What an adaptation did along a run.

    Attributes
    ----------
    name : str
        Of the run.
    log : tuple of Adapted
        What was said, in order.
    t : ndarray (n_rows,)
        Time at the end of every row [s].
    factors : ndarray (n_rows, n_joints)
        On the joints' friction, as used.
    estimates, std : ndarray (n_rows, n_joints)
        What the data say of the factors, and its standard deviation.
    load : ndarray (n_rows, 4)
        Mass [kg] and first moments [kg m] at the last link, as used.
    mass, mass_std : ndarray (n_rows,)
        What the data say of the mass, and its standard deviation [kg].
    tau, tau_model, tau_measured : ndarray (n_samples, n_joints)
        Torque with what is added, the model's, and the measured one at the same state [torque unit]. A sample is
        predicted before anything is learnt of it.
    status : ndarray of uint32 (n_samples,)
        Bits as in `dynid-estimator`.
    remembered : str
        What is known at the end, for the next run.
    """

    name: str
    log: tuple[Adapted, ...]
    t: FloatArray
    factors: FloatArray
    estimates: FloatArray
    std: FloatArray
    load: FloatArray
    mass: FloatArray
    mass_std: FloatArray
    tau: FloatArray
    tau_model: FloatArray
    tau_measured: FloatArray
    status: NDArray[np.uint32]
    remembered: str = field(default="", repr=False)

    def rmse(self) -> tuple[FloatArray, FloatArray]:
        """Error of the model, and with what was added, per joint (n_joints,) [torque unit], over all answers."""
        good = (self.status & NO_ANSWER) == 0
        both = (np.sqrt(np.mean((self.tau_measured - tau)[good] ** 2, axis=0)) for tau in (self.tau_model, self.tau))
        before, after = both
        return before, after


class Adaptation:
    """Lets friction, or friction and a payload, follow the arm; never the rest.

    Parameters
    ----------
    model : TorqueModel
        What was identified; it stays as it is.
    parts : sequence of str
        Of ``"friction"`` (a factor per joint on all of its friction) and ``"payload"`` (mass and first moments of a
        load at the last link).
    memory : float
        Motion after which a row counts 1/e [s].
    factor : (float, float)
        Least and greatest factor on friction.
    mass : float, optional
        Greatest mass of a payload, what the arm may carry [kg; in ampere: kg times what the channel shows per N m].
    reach : float
        Greatest distance of a payload's centre from the last link's origin [m].
    said : float
        Moves of this part of friction, or of the greatest mass, are said.
    observe : bool
        Whether nothing follows while the momentum observer says that something pushes the arm.
    window : int, optional
        Samples to differentiate over, where positions come alone; about 20 ms by default, 15 ms at 1 kHz.
    watch : Watch, optional
        Of the same model: what its healthy runs have said of the noise. Without one the model's deviation, for two
        seconds.
    """

    def __init__(
        self,
        model: _core.TorqueModel,
        parts: Sequence[str] = ("friction",),
        *,
        memory: float = 60.0,
        factor: tuple[float, float] = (0.5, 2.0),
        mass: float | None = None,
        reach: float = 0.2,
        said: float = 0.05,
        observe: bool = False,
        window: int | None = None,
        watch: Watch | None = None,
    ) -> None:
        self.model = model
        self.parts = parts
        self.memory = memory
        self.factor = factor
        self.mass = mass
        self.reach = reach
        self.said = said
        self.observe = observe
        self.window = window
        self.watch = watch

    def adapt(self, recording: Recording, *, remembered: str | None = None) -> AdaptedRun:
        """Go through a run.

        Parameters
        ----------
        recording : Recording
            From its beginning.
        remembered : str, optional
            What was known at the end of the run before (`AdaptedRun.remembered`); without it the model as identified.

        Raises
        ------
        ValueError
            The run is not one of this robot, in another unit, or lacks a temperature that friction follows; or a limit
            is none.
        FormatError
            What is remembered is of another model, or of an adaptation with other settings.
        """
        from dynid_rs.model.observer import check_run

        check_run(self.model, recording)
        friction, payload = _wanted(self.parts)
        if payload and self.mass is None:
            raise ValueError("mass: say how much the arm may carry [kg]; a payload follows within it")
        if payload and not 0 < (self.mass or 0.0) <= MOST_MASS:
            raise ValueError(f"mass: expected a number above 0 to {MOST_MASS:g}, got {self.mass:g}")
        n = self.model.robot.n_joints
        inflation = getattr(self.watch, "inflation_", np.ones(n))
        memory = getattr(self.watch, "memory_", np.full(n, UNKNOWN_MEMORY))
        names = ("q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor")
        told, rows, tau, tau_model, tau_measured, status, known = _core.adapt_run(
            self.model,
            recording.t,
            tuple(getattr(recording, name) for name in names),
            recording.tau,
            temperature=recording.temperature,
            step=1.0 / recording.rate,
            window=self.window,
            inflation=inflation.tolist(),
            noise_memory=memory.tolist(),
            friction=friction,
            payload=payload,
            row=0.2 if self.watch is None else self.watch.row,
            memory=self.memory,
            factor=self.factor,
            mass=self.mass or 0.0,
            reach=self.reach,
            said=self.said,
            observe=self.observe,
            remembered=remembered,
        )
        ends, factors, estimates, std, load = rows
        joints = self.model.robot.joint_names
        log = tuple(_adapted(one, recording.t, joints) for one in told)
        return AdaptedRun(
            recording.name,
            log,
            recording.t[ends],
            factors,
            estimates,
            std,
            load[:, :4],
            load[:, 4],
            load[:, 5],
            tau,
            tau_model,
            tau_measured,
            status,
            known,
        )

    def adapted_model(self, run: AdaptedRun) -> _core.TorqueModel:
        """Return another model: the identified one with what is used at the end of a run.

        Raises
        ------
        ValueError
            No row of the run was finished.
        """
        if not len(run.t):
            raise ValueError(f"{run.name}: too short to adapt to")
        return _core.with_adapted(self.model, run.factors[-1].tolist(), tuple(run.load[-1].tolist()))


def _wanted(parts: Sequence[str]) -> tuple[bool, bool]:
    if isinstance(parts, str) or not parts or set(parts) - set(PARTS):
        raise ValueError(f"parts: expected a list of {' and '.join(PARTS)}, found {parts!r}")
    return "friction" in parts, "payload" in parts


def _adapted(said: dict[str, Any], t: FloatArray, joints: Sequence[str]) -> Adapted:
    half = NORMAL_95 * said["std"]
    return Adapted(
        float(t[said["sample"]]),
        said["part"],
        joints[said["joint"]],
        said["from"],
        said["to"],
        (said["estimate"] - half, said["estimate"] + half),
        tuple(said["moments"]) if said["part"] == "payload" else None,
        said["reason"],
    )
