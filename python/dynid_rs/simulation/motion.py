"""What happens in a simulated arm: the link's motion is given, gear, motor and torque follow from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.simulation.effects.base import Signals
from dynid_rs.simulation.gear import wind_up
from dynid_rs.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

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
        Rigid-body torque [N m].
    tau_gear : ndarray
        What the gears transmit: `tau_link` and what springs, cylinders and contacts add to it [N m].
    hysteresis : ndarray
        Its hysteretic part z [N m].
    tau : ndarray
        Motor torque times gear ratio [N m].
    effects : tuple of ndarray
        Torque that each effect of the arm adds, link side or motor side [N m]; zeros where it adds none.
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
    tau_gear: FloatArray
    hysteresis: FloatArray
    tau: FloatArray
    effects: tuple[FloatArray, ...] = ()


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
    grid = FINE_STEP * np.arange(np.ceil(t[-1] / FINE_STEP) + 2, dtype=np.float64)
    gears = _gears(arm, trajectory, grid)
    motion = _without_motor_effects(arm, trajectory, gears, t)
    remembering = [effect.remembers for effect in arm.effects]
    fine = signals(arm, _without_motor_effects(arm, trajectory, gears, grid)) if any(remembering) else None
    parts, own = [], signals(arm, motion)
    for effect in arm.effects:
        if effect.remembers and fine is not None:
            # What a memory holds must not depend on when somebody looks.
            on_grid = effect.motor_torque(arm, fine)
            part = None if on_grid is None else _between(on_grid, t)
        else:
            part = effect.motor_torque(arm, own)
        parts.append(np.zeros_like(motion.tau) if part is None else part)
    effects = tuple(link_part + part for link_part, part in zip(motion.effects, parts, strict=True))
    return replace(motion, tau=_sum(motion.tau, parts), effects=effects)


def signals(arm: SimulatedArm, motion: ArmMotion) -> Signals:
    """Return what effects see of a motion before they add to the motors' torque."""
    return Signals(
        t=motion.t,
        q=motion.q,
        dq=motion.dq,
        ddq=motion.ddq,
        q_motor=motion.q_motor,
        dq_motor=motion.dq_motor,
        ddq_motor=motion.ddq_motor,
        tau_link=motion.tau_link,
        tau_motor=motion.tau,
        friction=friction_torque(arm, motion.dq_motor),
    )


@dataclass(frozen=True, eq=False)
class _Gear:
    """How far one gear winds up over time: by its spring, and by what effects add."""

    spring: CubicSpline
    further: CubicSpline


def _gears(arm: SimulatedArm, trajectory: Trajectory, grid: FloatArray) -> dict[int, _Gear]:
    """Gears that yield, solved on the fine grid."""
    yielding = [effect for effect in arm.effects if effect.yields]
    soft = arm.flexible | np.isin(np.arange(arm.robot.n_joints), [j for effect in yielding for j in effect.joints])
    if not soft.any():
        return {}
    from scipy.interpolate import CubicSpline

    q, dq, ddq = trajectory.evaluate(grid)
    links = _link_effects(arm, grid, q)
    tau_gear = _sum(arm.robot.inverse_dynamics(q, dq, ddq, arm.phi), links)
    further = _sum(np.zeros_like(q), [effect.deflection(tau_gear) for effect in yielding])
    gears = {}
    for joint in np.flatnonzero(soft).tolist():
        spring = wind_up(
            tau_gear[:, joint],
            FINE_STEP,
            stiffness=float(arm.stiffness[joint]),
            damping=float(arm.damping[joint]),
            hysteresis=float(arm.hysteresis[joint]),
            hysteresis_distance=float(arm.hysteresis_distance[joint]),
        )
        gears[joint] = _Gear(CubicSpline(grid, spring), CubicSpline(grid, further[:, joint]))
    return gears


def _without_motor_effects(
    arm: SimulatedArm, trajectory: Trajectory, gears: dict[int, _Gear], t: FloatArray
) -> ArmMotion:
    """Everything but what effects add on the motor side; `effects` holds their link side."""
    q, dq, ddq = trajectory.evaluate(t)
    links = _link_effects(arm, t, q)
    tau_link = arm.robot.inverse_dynamics(q, dq, ddq, arm.phi)
    tau_gear = _sum(tau_link, links)
    delta, ddelta, dddelta, z = (np.zeros_like(q) for _ in range(4))
    for joint, gear in gears.items():
        spring, rate = gear.spring(t), gear.spring(t, 1)
        if arm.hysteresis[joint] > 0:
            z[:, joint] = tau_gear[:, joint] - arm.stiffness[joint] * spring - arm.damping[joint] * rate
        delta[:, joint] = spring + gear.further(t)
        ddelta[:, joint] = rate + gear.further(t, 1)
        dddelta[:, joint] = gear.spring(t, 2) + gear.further(t, 2)
    x, dx, ddx = q + delta, dq + ddelta, ddq + dddelta
    angle = arm.kinematic_cycles * x + arm.kinematic_phase
    slope = arm.kinematic_error * arm.kinematic_cycles * np.cos(angle)
    curve = -arm.kinematic_error * arm.kinematic_cycles**2 * np.sin(angle)
    dq_motor, ddq_motor = dx * (1 + slope), ddx * (1 + slope) + curve * dx**2
    tau = (
        (tau_gear + arm.hysteresis_loss * z) / (1 + slope)
        + arm.rotor_inertia * ddq_motor
        + friction_torque(arm, dq_motor)
        + arm.torque_offset
    )
    q_motor = x + arm.kinematic_error * np.sin(angle)
    return ArmMotion(
        t, q, dq, ddq, q_motor, dq_motor, ddq_motor, delta, tau_link, tau_gear, z, tau, effects=tuple(links)
    )


def _link_effects(arm: SimulatedArm, t: FloatArray, q: FloatArray) -> list[FloatArray]:
    torques = [effect.link_torque(arm, t, q) for effect in arm.effects]
    return [np.zeros_like(q) if torque is None else torque for torque in torques]


def _sum(start: FloatArray, parts: Sequence[FloatArray | None]) -> FloatArray:
    total = start.copy()
    for part in parts:
        if part is not None:
            total += part
    return total


def _between(on_grid: FloatArray, t: FloatArray) -> FloatArray:
    """Values on the fine grid, straight in between, at `t` (n,) [s]."""
    grid = FINE_STEP * np.arange(len(on_grid))
    return np.stack([np.interp(t, grid, column) for column in on_grid.T], axis=1)


def friction_torque(arm: SimulatedArm, dq_motor: FloatArray) -> FloatArray:
    """Torque of the declared friction (n, n_joints) [N m]."""
    torque = np.empty_like(dq_motor)
    for joint in range(dq_motor.shape[1]):
        columns = _core.friction_basis(
            dq_motor[:, joint],
            float(arm.velocity_threshold[joint]),
            float(arm.transition_width[joint]),
        )
        torque[:, joint] = columns @ arm.friction[joint]
    return torque
