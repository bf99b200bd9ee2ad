"""How large an effect is where it counts: what the declared model cannot absorb, over the torque noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.simulation.effects.base import LabEffect, equip
from dynid_rs.simulation.effects.wish import Wish, build_effect
from dynid_rs.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from dynid_rs.simulation.arm import SimulatedArm

FloatArray = NDArray[np.float64]

RATE = 50.0
"""Samples per second [Hz]; a declared model has too few parameters to hide behind sparse samples."""

_TOLERANCE = 0.01
_MAX_STEPS = 20
_RCOND = 1e-10


def unabsorbed(arm: SimulatedArm, effects: Sequence[LabEffect], trajectories: Sequence[Trajectory]) -> FloatArray:
    """Return the RMS (n_joints,) [N m] that effects leave after a fit of the declared model.

    The arm is taken rigid, without noise and delay, and moved exactly along the trajectories. The declared
    model is the rigid body with free inertial parameters, and rotor, offset and friction of Eqs. 9-11 with the
    arm's own shapes; it is fitted by least squares to what the channels show. Effects that are different in
    every run act as in run 0, 1, ...

    Parameters
    ----------
    arm : SimulatedArm
        The arm without the effects.
    effects : sequence of LabEffect
        What is put in.
    trajectories : sequence of Trajectory
        One per run.
    """
    declared = arm.robot
    none = np.zeros(declared.n_joints)
    silent = replace(
        arm.rigid(),
        delay=0.0,
        noise_std=none,
        link_resolution=none,
        motor_resolution=none,
        link_noise=none,
        motor_noise=none,
    )
    equipped = equip(silent, effects)
    base = declared.base_parameters()
    observed, torques = [], []
    for run, trajectory in enumerate(trajectories):
        own = equipped.of_run(run, trajectory.duration, np.random.default_rng([0, run]))
        shown = own.record(trajectory, RATE, np.random.default_rng(0), derivatives=True)
        t = np.arange(shown.n_samples) / RATE
        motor = own.motion(trajectory, t)
        links = base.reduce(declared.joint_torque_regressor(shown.q, np.asarray(shown.dq), np.asarray(shown.ddq)))
        drives = [_drive_columns(arm, joint, motor.dq_motor, motor.ddq_motor) for joint in range(declared.n_joints)]
        observed.append((links, drives))
        torques.append(shown.tau)
    return _left(observed, torques)


def scale_to(wish: Wish, arm: SimulatedArm, ratio: float, trajectories: Sequence[Trajectory]) -> Wish:
    """Return the wish with the size at which the effect leaves `ratio` times the torque noise.

    Size 1 of most kinds scales linearly, so that two steps suffice; the others are searched.

    Parameters
    ----------
    wish : Wish
        Kind and place; the sign of its size is kept.
    arm : SimulatedArm
        With all its gears and its noise, as `typical_arm` gives it.
    ratio : float
        RMS that the declared model cannot absorb over `noise_std`, on the joint where it is greatest.
    trajectories : sequence of Trajectory
        What the ratio holds for.

    Raises
    ------
    ValueError
        A ratio that is not positive, an arm without noise, or an effect that cannot leave so much: the
        declared model absorbs it, or no larger size is possible.
    """
    if not (np.isfinite(ratio) and ratio > 0):
        raise ValueError(f"the ratio must be positive, got {ratio:g}")
    if not (arm.noise_std > 0).all():
        raise ValueError("an effect is scaled to the torque noise, and this arm has none")
    size = 1.0 if wish.size > 0 else -1.0
    for _ in range(_MAX_STEPS):
        scaled = replace(wish, size=size)
        left = unabsorbed(arm, [build_effect(scaled, arm)], trajectories)
        reached = float(np.max(left / arm.noise_std))
        if abs(reached - ratio) <= _TOLERANCE * ratio:
            return scaled
        if reached < 1e-6:
            break
        size *= ratio / reached
    raise ValueError(
        f"{wish.kind} cannot be scaled to {ratio:g} times the torque noise: at size {size:g} the declared model "
        f"leaves {reached:.3g} times"
    )


def _drive_columns(arm: SimulatedArm, joint: int, dq: FloatArray, ddq: FloatArray) -> FloatArray:
    """Columns of rotor, offset and friction of one joint (n, 10)."""
    friction = _core.friction_basis(
        dq[:, joint], float(arm.velocity_threshold[joint]), float(arm.transition_width[joint])
    )
    return np.column_stack([friction, ddq[:, joint], np.ones(len(dq))])


def _left(observed: list[tuple[FloatArray, list[FloatArray]]], torques: list[FloatArray]) -> FloatArray:
    """RMS of the residual of one least-squares fit over all joints and runs (n_joints,)."""
    n_joints = torques[0].shape[1]
    width = [observed[0][1][joint].shape[1] for joint in range(n_joints)]
    rows = []
    for links, drives in observed:
        block = np.zeros((*links.shape[:2], sum(width)))
        for joint in range(n_joints):
            first = sum(width[:joint])
            block[:, joint, first : first + width[joint]] = drives[joint]
        rows.append(np.concatenate([links, block], axis=2))
    A = np.concatenate(rows)
    y = np.concatenate(torques)
    # Joints count alike, whatever they carry; columns too.
    weight = 1 / np.maximum(y.std(axis=0), 1e-9 * max(float(np.abs(y).max()), 1e-9))
    flat, target = (A * weight[None, :, None]).reshape(-1, A.shape[2]), (y * weight).ravel()
    scale = np.linalg.norm(flat, axis=0)
    scale[scale == 0] = 1.0
    solution = np.linalg.lstsq(flat / scale, target, rcond=_RCOND)[0]
    residual = (target - flat @ (solution / scale)).reshape(y.shape) / weight
    return np.asarray(np.sqrt(np.mean(residual**2, axis=0)))
