"""A simulated arm: exact rigid-body dynamics behind elastic gears, friction and two encoders."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.runs.recording import Recording
from dynid_rs.simulation.effects.base import LabEffect, Readings
from dynid_rs.simulation.motion import ArmMotion, solve_motion
from dynid_rs.simulation.tracking import SENSOR_SHARE, TrackedMotion
from dynid_rs.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel

FloatArray = NDArray[np.float64]

MAX_DELAY = 0.1
N_FRICTION = len(_core.FRICTION_NAMES)

_UNITS = {
    "stiffness": "N*m/rad",
    "damping": "N*m*s/rad",
    "hysteresis": "N*m",
    "hysteresis_distance": "rad",
    "hysteresis_loss": "1",
    "kinematic_error": "rad",
    "kinematic_cycles": "1",
    "kinematic_phase": "rad",
    "rotor_inertia": "kg*m^2",
    "friction": "N*m*(s/rad)^k",
    "velocity_threshold": "rad/s",
    "transition_width": "rad/s",
    "torque_offset": "N*m",
    "noise_std": "N*m",
    "link_resolution": "rad",
    "motor_resolution": "rad",
    "link_noise": "rad",
    "motor_noise": "rad",
}
_MAY_BE_NEGATIVE = ("kinematic_phase", "friction", "torque_offset")


# One value for every joint, spread by `__post_init__`.
_NONE: Any = 0.0
_INFINITE: Any = np.inf
_SMALL_WAY: Any = 1e-4
_SMALL_SPEED: Any = 1e-2
_ONCE: Any = 1.0


@dataclass(frozen=True, eq=False)
class SimulatedArm:
    """A robot with gears, motors and sensors. `SimulatedArm(robot)` is ideal: each fault is one argument.

    With x = q + delta, the output of the gear, and e(x) = a sin(N x + phase), its kinematic error::

        link side    tau_gear = K delta + D ddelta + z,   tau_gear = tau_link + what effects add there
        encoders     q at t - delay,   q_motor = x + e(x) at t
        motor side   tau = (tau_gear + c z) / (1 + e'(x)) + J ddq_motor + friction(dq_motor) + offset + effects + noise

    The division keeps power through a gear whose ratio varies. c z is tooth friction that the housing
    takes up: the motor feels it, the link does not, and the deflection and its rate tell it. By itself it
    could give energy back, so it must stay below the Coulomb friction it belongs to.

    Every per-joint field takes one number for all joints or one per joint. Motor-side quantities are
    reduced to the link side. For sliding joints read m and N for rad and N m.

    Parameters
    ----------
    robot : RobotModel
        Kinematics and gravity; its limits are not looked at here.
    phi : ndarray (10 n_joints,), optional
        True inertial parameters, order of `LINK_PARAMETER_NAMES`; the robot's own when left out.
    stiffness, damping : ndarray (n_joints,)
        K [N m/rad], infinite for a rigid gear, and D [N m s/rad].
    hysteresis, hysteresis_distance : ndarray (n_joints,)
        Greatest hysteretic torque [N m] and the way over which it turns round [rad] (Dahl).
    hysteresis_loss : ndarray (n_joints,)
        c, the share of z that is lost between motor and link.
    kinematic_error, kinematic_cycles, kinematic_phase : ndarray (n_joints,)
        a [rad], N [cycles per turn of the joint] and phase [rad].
    rotor_inertia : ndarray (n_joints,)
        J [kg m^2].
    friction : ndarray (n_joints, 8)
        Coefficients of `_core.friction_basis`, order of `FRICTION_NAMES`.
    velocity_threshold, transition_width : ndarray (n_joints,)
        Shape of the friction [rad/s].
    torque_offset, noise_std : ndarray (n_joints,)
        Of the measured torque [N m]; the noise is white.
    link_resolution, motor_resolution : ndarray (n_joints,)
        Steps of the encoders [rad]; 0 for an ideal one.
    link_noise, motor_noise : ndarray (n_joints,)
        Standard deviation of the encoders' white noise [rad], before the steps.
    delay : float
        How much later the link channel is than the motor channel [s].
    effects : tuple of LabEffect
        What else acts, of `dynid_rs.simulation.effects`; `equip` puts them in.

    Raises
    ------
    ValueError
        A field of the wrong shape or sign, or a gear that would give energy back.
    """

    robot: RobotModel
    phi: FloatArray | None = None
    stiffness: FloatArray = _INFINITE
    damping: FloatArray = _NONE
    hysteresis: FloatArray = _NONE
    hysteresis_distance: FloatArray = _SMALL_WAY
    hysteresis_loss: FloatArray = _NONE
    kinematic_error: FloatArray = _NONE
    kinematic_cycles: FloatArray = _ONCE
    kinematic_phase: FloatArray = _NONE
    rotor_inertia: FloatArray = _NONE
    friction: FloatArray = _NONE
    velocity_threshold: FloatArray = _NONE
    transition_width: FloatArray = _SMALL_SPEED
    torque_offset: FloatArray = _NONE
    noise_std: FloatArray = _NONE
    link_resolution: FloatArray = _NONE
    motor_resolution: FloatArray = _NONE
    link_noise: FloatArray = _NONE
    motor_noise: FloatArray = _NONE
    delay: float = 0.0
    effects: tuple[LabEffect, ...] = ()

    def __post_init__(self) -> None:
        n = self.robot.n_joints
        phi = self.robot.phi if self.phi is None else self.phi
        object.__setattr__(self, "phi", _spread("phi", phi, (10 * n,)))
        for name in _UNITS:
            shape = (n, N_FRICTION) if name == "friction" else (n,)
            values = _spread(name, getattr(self, name), shape)
            if name not in _MAY_BE_NEGATIVE and (values < 0).any():
                raise ValueError(f"{name} must not be negative, got {values.min():g} {_UNITS[name]}")
            object.__setattr__(self, name, values)  # the only way in, the class is frozen
        for name in ("stiffness", "hysteresis_distance", "transition_width"):
            if (getattr(self, name) <= 0).any():
                raise ValueError(f"{name} must be positive, got 0 {_UNITS[name]}")
        if not abs(self.delay) <= MAX_DELAY:
            raise ValueError(f"delay must lie within {MAX_DELAY:g} s of zero, got {self.delay:g} s")
        if (self.kinematic_error * self.kinematic_cycles >= 1).any():
            raise ValueError("kinematic_error * kinematic_cycles must be below 1: the gear would reverse")
        coulomb = self.friction[:, :2].min(axis=1)
        if (self.hysteresis_loss * self.hysteresis > coulomb).any():
            raise ValueError(
                "hysteresis_loss * hysteresis must not exceed the Coulomb friction of the joint: "
                "the gear would give energy back"
            )

    @property
    def flexible(self) -> NDArray[np.bool_]:
        """Which gears wind up (n_joints,)."""
        return np.isfinite(self.stiffness)

    def rigid(self) -> SimulatedArm:
        """Return the same arm with rigid and exact gears: q_motor is q."""
        none = np.zeros(self.robot.n_joints)
        return replace(
            self,
            stiffness=none + np.inf,
            damping=none,
            hysteresis=none,
            hysteresis_loss=none,
            kinematic_error=none,
            effects=tuple(effect for effect in self.effects if not effect.yields),
        )

    def motion(self, trajectory: Trajectory, t: FloatArray) -> ArmMotion:
        """Solve the gears along a trajectory and return everything at times `t` (n,) [s], from 0 on."""
        return solve_motion(self, trajectory, t)

    def record(
        self,
        trajectory: Trajectory,
        rate: float,
        rng: np.random.Generator,
        name: str = "recording",
        *,
        derivatives: bool = False,
        stamp_jitter: float = 0.0,
    ) -> Recording:
        """Measure one run.

        Parameters
        ----------
        trajectory : Trajectory
            Motion of the links; a `TrackedMotion` brings the noise of its controller along.
        rate : float
            Samples per second [Hz].
        rng : Generator
            Source of all chance.
        name : str
            Name of the run.
        derivatives : bool
            Add the exact `dq`, `ddq` of the link channel and `dq_motor`.
        stamp_jitter : float
            Standard deviation of the time stamps about the true sampling instants [s]; cut off at 0.4 steps.

        Returns
        -------
        Recording
            Link channel `delay` late, both encoders in steps, torque with noise.
        """
        t = np.arange(int(np.floor(trajectory.duration * rate + 1e-9)) + 1) / rate
        motion = self.motion(trajectory, t)
        readings = Readings(*trajectory.evaluate(t - self.delay), self._late_torque(trajectory, motion))
        for effect in self.effects:
            readings = effect.read(readings, t)
        shape = motion.q.shape
        torque_noise = self.noise_std * rng.standard_normal(shape)
        jitter = np.clip(stamp_jitter * rng.standard_normal(t.size), -0.4 / rate, 0.4 / rate)
        link_noise, motor_noise = (std * rng.standard_normal(shape) for std in (self.link_noise, self.motor_noise))
        if isinstance(trajectory, TrackedMotion):
            # What the controller saw is what is recorded, and what the drive did unseen is missing in the torque.
            torque_noise = SENSOR_SHARE * torque_noise - trajectory.drive(t)
            motor_noise = trajectory.encoder_noise(t)
        return Recording(
            t=t + jitter,
            q=_in_steps(readings.q + link_noise, self.link_resolution),
            q_motor=_in_steps(motion.q_motor + motor_noise, self.motor_resolution),
            tau=readings.tau + torque_noise,
            dq=readings.dq if derivatives else None,
            ddq=readings.ddq if derivatives else None,
            dq_motor=motion.dq_motor if derivatives else None,
            temperature=readings.temperature,
            name=name,
            joints=tuple(self.robot.joint_names),
        )

    def of_run(self, run: int, duration: float, rng: np.random.Generator) -> SimulatedArm:
        """Return the arm of one run [duration in s]: where things touch it, how warm it is."""
        return replace(self, effects=tuple(effect.of_run(run, duration, rng) for effect in self.effects))

    def _late_torque(self, trajectory: Trajectory, motion: ArmMotion) -> FloatArray:
        """Torque as late as its channel is (n, n_joints) [N m]."""
        lag = np.zeros(self.robot.n_joints)
        for effect in self.effects:
            lag += 0.0 if effect.lag is None else effect.lag
        tau = motion.tau.copy()
        for late in np.unique(lag[lag != 0]):
            tau[:, lag == late] = self.motion(trajectory, np.maximum(motion.t - late, 0.0)).tau[:, lag == late]
        return tau

    def to_json(self) -> dict[str, object]:
        """Return every parameter with its unit; an infinite stiffness is null."""
        values: dict[str, object] = {"phi": np.asarray(self.phi).tolist(), "delay": self.delay}
        for name in _UNITS:
            array = getattr(self, name)
            values[name] = (
                array.tolist()
                if name == "friction"
                else [value if isfinite(value) else None for value in array.tolist()]
            )
        return {"parameters": values, "units": {"delay": "s", **_UNITS}}


def _spread(name: str, value: Any, shape: tuple[int, ...]) -> FloatArray:
    try:
        values = np.array(np.broadcast_to(np.asarray(value, dtype=np.float64), shape))
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be one number or an array {shape}, got {np.shape(value)}") from None
    bad = np.isnan(values) | ((name != "stiffness") & np.isinf(values))
    if bad.any():
        raise ValueError(f"{name} must be finite, got {values[bad][0]:g}")
    return values


def _in_steps(q: FloatArray, resolution: FloatArray) -> FloatArray:
    step = np.where(resolution > 0, resolution, 1.0)
    return np.where(resolution > 0, np.round(q / step) * step, q)
