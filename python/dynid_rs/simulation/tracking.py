"""A controller that follows a plan: the motion that really happens, with its error and what caused it."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from dynid_rs.simulation.arm import SimulatedArm

FloatArray = NDArray[np.float64]

CYCLE = 1e-3
"""Cycle of the controller [s]; what disturbs it is straight between two cycles."""

BANDWIDTH = 10.0
DAMPING = 0.7
MIN_BANDWIDTH, MAX_BANDWIDTH = 1.0, 30.0

_ROLL_OFF = 2.5
"""Corner of the low-pass between a disturbance and the link, over the bandwidth: drive, filters, gear."""

_ROLL_OFF_STAGES = 2
_DRIFT_CORNER = 3.0
_DRIVE_SHARE = 0.5
_MOST_ACCELERATION = 5000.0
"""[rad/s^2]. A link that its motor could accelerate faster has no masses in its file; it counts as this light."""

_AFTER = 0.2
"""The controller goes on after the last sample [s], for channels that are early."""

_ORDER = 14
"""Of the power series between two cycles: its next term is below 1e-16 of the state at the highest bandwidth."""

_CHUNK = 1 << 16
_ERROR, _RATE, _PUSH, _NOISE = 0, 1, 2, 2 + 2 * _ROLL_OFF_STAGES
_N_STATES = 2 + 4 * _ROLL_OFF_STAGES


@dataclass(frozen=True)
class Tracking:
    """A controller per joint, and what it cannot compensate.

    Feed-forward carries the rigid body and the rotor. With e = q - q_ref, bandwidth w and damping d, the
    rest obeys in every joint::

        e'' + 2 d w e' + w^2 e = F [push / inertia - w^2 n - 2 d w n']

    push is minus the torque that is not fed forward along the plan (friction, ripple, springs, offset) plus
    a random drive disturbance; n is what the encoder of the controller, on the motor side, shows beside q: the
    gear's wind-up along the plan, and noise. F is a low-pass (two critically damped stages at 2.5 w). The
    system is solved exactly for inputs that are straight between two cycles of 1 ms.

    The drive disturbance is torque that the torque channel does not show. The measured torque therefore
    errs by its negative, and this error is correlated with the motion, as in every closed loop.

    Parameters
    ----------
    bandwidth : float
        w / 2 pi [Hz].
    damping : float
        d.
    disturbance : float
        Standard deviation of a slow drive disturbance (corner 3 Hz) over the effort limit. The white
        part is half of the variance of the torque noise and needs no number of its own.

    Raises
    ------
    ValueError
        A number out of its range.
    """

    bandwidth: float = BANDWIDTH
    damping: float = DAMPING
    disturbance: float = 0.0

    def __post_init__(self) -> None:
        if not MIN_BANDWIDTH <= self.bandwidth <= MAX_BANDWIDTH:
            raise ValueError(
                f"the bandwidth of tracking must lie between {MIN_BANDWIDTH:g} and {MAX_BANDWIDTH:g} Hz, "
                f"got {self.bandwidth:g} Hz"
            )
        if not 0.1 <= self.damping <= 2.0:
            raise ValueError(f"the damping of tracking must lie between 0.1 and 2, got {self.damping:g}")
        if not 0 <= self.disturbance <= 1:
            raise ValueError(
                f"the disturbance must lie between 0 and 1 (of the effort limit), got {self.disturbance:g}"
            )

    def to_json(self) -> dict[str, object]:
        """Return every number of the controller."""
        return {
            "bandwidth_hz": self.bandwidth,
            "damping": self.damping,
            "roll_off_hz": _ROLL_OFF * self.bandwidth,
            "cycle_s": CYCLE,
            "disturbance_of_effort": self.disturbance,
            "drive_share_of_noise_variance": _DRIVE_SHARE,
        }

    def system(self) -> tuple[FloatArray, FloatArray]:
        """Return A (10, 10) and B (10, 2) of x' = A x + B (push / inertia, n).

        States: e, e', the filtered push in two stages of (value, rate), the filtered n likewise.
        """
        w, corner = 2 * np.pi * self.bandwidth, 2 * np.pi * _ROLL_OFF * self.bandwidth
        A, B = np.zeros((_N_STATES, _N_STATES)), np.zeros((_N_STATES, 2))
        for source, first in enumerate((_PUSH, _NOISE)):
            for stage in range(_ROLL_OFF_STAGES):
                value = first + 2 * stage
                A[value, value + 1] = 1.0
                A[value + 1, value], A[value + 1, value + 1] = -(corner**2), -2 * corner
                if stage:
                    A[value + 1, value - 2] = corner**2
                else:
                    B[value + 1, source] = corner**2
        push, noise = _PUSH + 2 * (_ROLL_OFF_STAGES - 1), _NOISE + 2 * (_ROLL_OFF_STAGES - 1)
        A[_ERROR, _RATE] = 1.0
        A[_RATE, _ERROR], A[_RATE, _RATE] = -(w**2), -2 * self.damping * w
        A[_RATE, push] = 1.0
        A[_RATE, noise], A[_RATE, noise + 1] = -(w**2), -2 * self.damping * w
        return A, B


class TrackedMotion:
    """The motion of the links under a controller: plan plus error, smooth, with exact derivatives.

    Parameters
    ----------
    plan : Trajectory
        What the controller is told.
    tracking : Tracking
        The controller.
    push : ndarray (n_cycles, n_joints)
        Torque that is not fed forward, over the inertia [rad/s^2], from time 0 on.
    deflection : ndarray (n_cycles, n_joints)
        Motor side minus link side along the plan [rad].
    drive : ndarray (n_cycles, n_joints)
        Drive disturbance that the torque channel does not show [N m].
    inertia : ndarray (n_joints,)
        What a push has to move [kg m^2].
    noise : ndarray (n_cycles, n_joints)
        Noise of the motor encoder [rad].
    """

    def __init__(
        self,
        plan: Trajectory,
        tracking: Tracking,
        *,
        push: FloatArray,
        deflection: FloatArray,
        drive: FloatArray,
        inertia: FloatArray,
        noise: FloatArray,
    ) -> None:
        self.plan = plan
        self.tracking = tracking
        self._drive = drive
        self._noise = noise
        A, B = tracking.system()
        # The inputs join the state: their values, and their slopes, which are constant within a cycle.
        whole = np.zeros((_N_STATES + 4, _N_STATES + 4))
        whole[:_N_STATES, :_N_STATES], whole[:_N_STATES, _N_STATES : _N_STATES + 2] = A, B
        whole[_N_STATES : _N_STATES + 2, _N_STATES + 2 :] = np.eye(2)
        self._states = _run(
            A, B, whole, np.stack([push + drive / inertia, deflection + noise], axis=2), push, deflection
        )
        rows, row = [], np.eye(_N_STATES + 4)[_ERROR]
        for order in range(_ORDER + 1):
            rows.append(row / factorial(order))
            row = row @ whole
        self._series = np.stack(rows, axis=1)

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s], as planned."""
        return self.plan.duration

    def evaluate(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration at times `t` (n,) [s], each (n, n_joints)."""
        q, dq, ddq = self.plan.evaluate(t)
        e, de, dde = self.error(t)
        return q + e, dq + de, ddq + dde

    def error(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Actual minus planned position and its first two derivatives, each (n, n_joints)."""
        shape = (len(t), self._states.shape[1])
        e, de, dde = np.empty(shape), np.empty(shape), np.empty(shape)
        for start in range(0, len(t), _CHUNK):
            part = slice(start, start + _CHUNK)
            cycle, late = self._cycle(t[part])
            series = self._states[cycle] @ self._series
            for out, order in ((e, 0), (de, 1), (dde, 2)):
                weights = [np.prod(np.arange(k - order + 1, k + 1), dtype=float) for k in range(order, _ORDER + 1)]
                powers = late[:, None] ** np.arange(_ORDER + 1 - order) * np.array(weights)
                out[part] = np.einsum("ijk,ik->ij", series[:, :, order:], powers)
        before = np.asarray(t) < 0
        de[before] = dde[before] = 0.0
        return e, de, dde

    def drive(self, t: FloatArray) -> FloatArray:
        """Drive disturbance (n, n_joints) [N m] that acts on the arm and that the torque channel lacks."""
        return self._straight(self._drive, t)

    def encoder_noise(self, t: FloatArray) -> FloatArray:
        """Noise of the motor encoder (n, n_joints) [rad]: the same that the controller saw."""
        return self._straight(self._noise, t)

    def _cycle(self, t: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
        inside = np.clip(np.asarray(t, dtype=np.float64), 0.0, CYCLE * (len(self._states) - 1))
        cycle = np.minimum((inside / CYCLE).astype(np.int64), len(self._states) - 1)
        return cycle, inside - CYCLE * cycle

    def _straight(self, values: FloatArray, t: FloatArray) -> FloatArray:
        cycle, late = self._cycle(t)
        share = (late / CYCLE)[:, None]
        return np.asarray((1 - share) * values[cycle] + share * values[np.minimum(cycle + 1, len(values) - 1)])


def track(arm: SimulatedArm, plan: Trajectory, tracking: Tracking, rng: np.random.Generator) -> TrackedMotion:
    """Let a controller move an arm along a plan.

    Parameters
    ----------
    arm : SimulatedArm
        Its friction, gears and noise disturb the controller.
    plan : Trajectory
        At rest at time 0.
    tracking : Tracking
        The controller.
    rng : Generator
        Source of the disturbance and of the encoder's noise.
    """
    from dynid_rs.simulation.limits import plausible_effort, typical_inertia

    t = CYCLE * np.arange(np.ceil((plan.duration + _AFTER) / CYCLE) + 1)
    # Without the gears' memory, which costs most of a simulation and changes the error by microradians.
    motion = arm.rigid().motion(plan, t)
    effort = plausible_effort(arm.robot)
    inertia = np.maximum(typical_inertia(arm.robot) + arm.rotor_inertia, effort / _MOST_ACCELERATION)
    fed_forward = motion.tau_link + arm.rotor_inertia * motion.ddq
    wind_up = np.where(arm.flexible, motion.tau_gear / arm.stiffness, 0.0)
    shape = (t.size, arm.robot.n_joints)
    white = np.sqrt(_DRIVE_SHARE) * arm.noise_std * rng.standard_normal(shape)
    slow = tracking.disturbance * effort * _slow_noise(rng.standard_normal(shape))
    return TrackedMotion(
        plan,
        tracking,
        push=(fed_forward - motion.tau) / inertia,
        deflection=wind_up,
        drive=white + slow,
        inertia=inertia,
        noise=arm.motor_noise * rng.standard_normal(shape),
    )


SENSOR_SHARE = float(np.sqrt(1 - _DRIVE_SHARE))
"""Of the torque noise, what the sensor itself adds where a controller moves the arm."""


def _slow_noise(white: FloatArray) -> FloatArray:
    """First-order coloured noise of unit variance (n, m), by Tustin's rule."""
    from scipy.signal import lfilter

    half = np.pi * _DRIFT_CORNER * CYCLE
    pole = (1 - half) / (1 + half)
    start = white[:1]
    slow, _ = lfilter([np.sqrt(1 - pole**2)], [1.0, -pole], white[1:], axis=0, zi=pole * start)
    return np.concatenate([start, slow])


def _run(
    A: FloatArray, B: FloatArray, whole: FloatArray, inputs: FloatArray, push: FloatArray, deflection: FloatArray
) -> FloatArray:
    """States at every cycle with the inputs and their slopes appended: (n_cycles, n_joints, 14)."""
    from scipy.linalg import expm

    step = expm(whole * CYCLE)
    slopes = np.diff(inputs, axis=0, append=inputs[-1:]) / CYCLE
    states = np.concatenate([np.empty((*inputs.shape[:2], _N_STATES)), inputs, slopes], axis=2)
    forced = states[:, :, _N_STATES:] @ step[:_N_STATES, _N_STATES:].T
    free = step[:_N_STATES, :_N_STATES].T
    # The controller has held the arm for a long time before the run.
    held = np.stack([push[0], deflection[0]], axis=1)
    x = np.linalg.solve(A, -(B @ held.T)).T
    for cycle, push_of_cycle in enumerate(forced):
        states[cycle, :, :_N_STATES] = x
        x = x @ free + push_of_cycle
    return states
