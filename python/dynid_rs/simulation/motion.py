"""What happens in a simulated arm: the link's motion is given, gear, motor and torque follow from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.simulation.gear import wind_up
from dynid_rs.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from dynid_rs.simulation.arm import SimulatedArm

FloatArray = NDArray[np.float64]

FINE_STEP = 5e-4
"""Step of the gears' equations [s]; their error falls with its square."""


@dataclass(frozen=True, eq=False)
class ArmMotion:
    """What really happens in the arm at times `t`: no encoder, no noise, no delay. Arrays (n, n_joints).

    Parameters
    ----------
    t : ndarray (n,)
        [s].
    q, dq, ddq : ndarray
        Link side [rad, rad/s, rad/s^2], exact.
    q_motor, dq_motor, ddq_motor : ndarray
        Motor side, reduced by the gear ratio.
    deflection : ndarray
        Wind-up of the gears, without their kinematic error [rad].
    tau_link : ndarray
        Rigid-body torque that the gears transmit [N m].
    hysteresis : ndarray
        Its hysteretic part z [N m].
    tau : ndarray
        Motor torque times gear ratio [N m].
    """

    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    q_motor: FloatArray
    dq_motor: FloatArray
    ddq_motor: FloatArray
    deflection: FloatArray
    tau_link: FloatArray
    hysteresis: FloatArray
    tau: FloatArray


def solve_motion(arm: SimulatedArm, trajectory: Trajectory, t: FloatArray) -> ArmMotion:
    """Solve the equations of `SimulatedArm` along a trajectory.

    Parameters
    ----------
    arm : SimulatedArm
        Every parameter.
    trajectory : Trajectory
        Motion of the links, at rest at time 0.
    t : ndarray (n,)
        Times at which the answer is wanted [s], increasing, from 0 on.
    """
    q, dq, ddq = trajectory.evaluate(t)
    tau_link = arm.robot.inverse_dynamics(q, dq, ddq, arm.phi)
    delta, ddelta, dddelta = _deflection(arm, trajectory, t)
    stiffness = np.where(arm.flexible, arm.stiffness, 0.0)
    z = np.where(arm.hysteresis > 0, tau_link - stiffness * delta - arm.damping * ddelta, 0.0)
    x, dx, ddx = q + delta, dq + ddelta, ddq + dddelta
    angle = arm.kinematic_cycles * x + arm.kinematic_phase
    slope = arm.kinematic_error * arm.kinematic_cycles * np.cos(angle)
    curve = -arm.kinematic_error * arm.kinematic_cycles**2 * np.sin(angle)
    dq_motor, ddq_motor = dx * (1 + slope), ddx * (1 + slope) + curve * dx**2
    tau = (
        (tau_link + arm.hysteresis_loss * z) / (1 + slope)
        + arm.rotor_inertia * ddq_motor
        + _friction_torque(arm, dq_motor)
        + arm.torque_offset
    )
    q_motor = x + arm.kinematic_error * np.sin(angle)
    return ArmMotion(t, q, dq, ddq, q_motor, dq_motor, ddq_motor, delta, tau_link, z, tau)


def _deflection(arm: SimulatedArm, trajectory: Trajectory, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Deflection at `t` and its first two derivatives, each (n, n_joints)."""
    shape = (len(t), arm.robot.n_joints)
    delta, ddelta, dddelta = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    if not arm.flexible.any():
        return delta, ddelta, dddelta
    from scipy.interpolate import CubicSpline

    grid = FINE_STEP * np.arange(np.ceil(t[-1] / FINE_STEP) + 2, dtype=np.float64)
    tau_link = arm.robot.inverse_dynamics(*trajectory.evaluate(grid), arm.phi)
    for joint in np.flatnonzero(arm.flexible).tolist():
        fine = wind_up(
            tau_link[:, joint],
            FINE_STEP,
            stiffness=float(arm.stiffness[joint]),
            damping=float(arm.damping[joint]),
            hysteresis=float(arm.hysteresis[joint]),
            hysteresis_distance=float(arm.hysteresis_distance[joint]),
        )
        spline = CubicSpline(grid, fine)
        delta[:, joint], ddelta[:, joint], dddelta[:, joint] = spline(t), spline(t, 1), spline(t, 2)
    return delta, ddelta, dddelta


def _friction_torque(arm: SimulatedArm, dq_motor: FloatArray) -> FloatArray:
    torque = np.empty_like(dq_motor)
    for joint in range(dq_motor.shape[1]):
        columns = _core.friction_basis(
            dq_motor[:, joint],
            float(arm.velocity_threshold[joint]),
            float(arm.transition_width[joint]),
        )
        torque[:, joint] = columns @ arm.friction[joint]
    return torque
