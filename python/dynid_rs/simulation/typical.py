"""An industrial arm around any robot file: gears, motors and sensors of a plausible size."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.simulation.arm import SimulatedArm
from dynid_rs.simulation.limits import motion_limits, plausible_effort, typical_inertia

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel

FloatArray = NDArray[np.float64]

DELAY = 0.0028
"""Link channel behind motor channel [s], as measured on a KUKA KR300 with two encoders (2.6-3.2 ms)."""

NOISE = 0.005
"""Standard deviation of the torque noise over the effort limit."""

_WIND_UP = 2e-3
"""Deflection at the effort limit [rad]; gears of this class are sold with 3 to 8 arc minutes."""

_DAMPING_RATIO = 0.03
_HYSTERESIS = 0.015
_HYSTERESIS_DISTANCE = 1e-4
_COULOMB = 0.04
_VISCOUS = (0.08, -0.03, 0.01)
"""Share of the effort limit at the velocity limit, orders 1 to 3: degressive, as lubricants are."""

_ASYMMETRY = 0.06
_KINEMATIC_ERROR = 2e-5
"""Amplitude [rad], 4 arc seconds: a precise gear."""

_KINEMATIC_CYCLES = 50.0
"""Teeth or pins that pass per turn of the joint; slow enough to be seen at 250 Hz."""

_LINK_STEP = 2 * np.pi / 2**20
_MOTOR_STEP = 2 * np.pi / 2**22
"""A 16-bit motor encoder behind a gear of about 64."""


def typical_arm(
    robot: RobotModel,
    *,
    noise: float = 1.0,
    stiffness: float | FloatArray | None = None,
    delay: float = DELAY,
    encoder_noise: float = 0.0,
) -> SimulatedArm:
    """Return a plausible industrial arm with the robot's kinematics, inertia and limits. Nothing is random.

    Turning joints get elastic gears; sliding joints are rigid. Gears, friction and noise follow the effort
    limits, damping and undeclared rotors the inertia at typical poses.

    Parameters
    ----------
    robot : RobotModel
        Any serial chain.
    noise : float
        Scale of the torque noise, 1 = 0.5 % of the effort limits. 0 also makes the encoders exact.
    stiffness : float or ndarray (n_joints,), optional
        Of the turning joints' gears [N m/rad].
    delay : float
        Link channel behind motor channel [s].
    encoder_noise : float
        Standard deviation of the noise of both encoders [rad], before their steps.

    Raises
    ------
    ValueError
        A negative noise, a stiffness that is not positive.
    """
    if not (np.isfinite(noise) and noise >= 0):
        raise ValueError(f"noise must be at least 0, got {noise:g}")
    effort, speed, inertia = plausible_effort(robot), motion_limits(robot).velocity, typical_inertia(robot)
    turning = np.array([kind == "revolute" for kind in robot.joint_kinds])
    given = effort / _WIND_UP if stiffness is None else np.broadcast_to(stiffness, effort.shape)
    if not (given > 0).all():
        raise ValueError(f"stiffness must be positive, got {np.min(given):g} N*m/rad")
    elastic = turning & np.isfinite(given)
    declared_rotor = np.asarray(robot.rotor_inertia)
    return SimulatedArm(
        robot,
        stiffness=np.where(elastic, given, np.inf),
        damping=np.where(elastic, 2 * _DAMPING_RATIO * np.sqrt(np.where(elastic, given, 0.0) * inertia), 0.0),
        hysteresis=np.where(elastic, _HYSTERESIS * effort, 0.0),
        hysteresis_distance=np.full(effort.size, _HYSTERESIS_DISTANCE),
        hysteresis_loss=np.where(elastic, 1.0, 0.0),
        kinematic_error=np.where(elastic, _KINEMATIC_ERROR, 0.0),
        kinematic_cycles=np.full(effort.size, _KINEMATIC_CYCLES),
        kinematic_phase=np.arange(effort.size, dtype=np.float64),
        rotor_inertia=np.where(declared_rotor > 0, declared_rotor, 0.3 * inertia),
        friction=_friction(effort, speed),
        velocity_threshold=0.01 * speed,
        transition_width=0.005 * speed,
        torque_offset=0.005 * effort * np.where(np.arange(effort.size) % 2, -1.0, 1.0),
        noise_std=noise * NOISE * effort,
        link_resolution=np.full(effort.size, _LINK_STEP if noise > 0 else 0.0),
        motor_resolution=np.full(effort.size, _MOTOR_STEP if noise > 0 else 0.0),
        link_noise=np.full(effort.size, encoder_noise),
        motor_noise=np.full(effort.size, encoder_noise),
        delay=delay,
    )


def _friction(effort: FloatArray, speed: FloatArray) -> FloatArray:
    """Coefficients (n_joints, 8); the two directions differ a little."""
    pairs = []
    for order, share in enumerate((_COULOMB, *_VISCOUS)):
        size = share * effort / speed**order
        # The even orders keep their sign when speed changes its own: mirrored coefficients resist both ways.
        mirror = -1.0 if order == 2 else 1.0
        pairs += [(1 + _ASYMMETRY) * size, mirror * (1 - _ASYMMETRY) * size]
    return np.stack(pairs, axis=1)
