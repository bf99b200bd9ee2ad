"""Faults of the arm and its motion: mounting, contact, payload, joints that stand, motion that shows nothing."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from exam.draw import log_uniform
from exam.world import inverse_dynamics
from numpy.typing import NDArray

from bad_data.sets import RunSet, loaded, moved, turned_gravity
from bad_data.story import Story, Wanted, any_joint, any_run, columns_of, files_of, name_of, some_or_all

FloatArray = NDArray[np.float64]

FELT = 10.0
"""Times the noise that all rows of a push together leave: a joint that is pushed by more shows it, however strong its
drive is."""


def mounting(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """The base hangs, stands on a wall or on a slope; the robot file says level."""
    spoiled = made.copied()
    kind = ("ceiling", "wall", "slope", "wall", "slope")[variant % 5]
    angle = {"ceiling": np.pi, "wall": np.pi / 2, "slope": float(np.radians(rng.uniform(15.0, 60.0)))}[kind]
    heading = float(rng.uniform(-np.pi, np.pi)) if kind == "slope" else float(rng.integers(4)) * np.pi / 2
    axis = np.array([np.cos(heading), np.sin(heading), 0.0])
    gravity = pin.exp3(angle * axis).T @ made.world.model.gravity.linear
    for k in range(made.n_runs):
        spoiled.columns[k] = loaded(made, k, turned_gravity(made, k, gravity))
    wanted = Wanted(("mounting",), files_of(tuple(range(made.n_runs))))
    return Story(f"{kind}, {np.degrees(angle):.0f} deg", spoiled, wanted)


def contact(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """Something pushes a link for a part of a second."""
    spoiled = made.copied()
    k = any_run(rng, made)
    s = made.world.runs[k]
    link = int(rng.integers(2, made.n_joints + 1))
    seconds = float(rng.uniform(0.3, 0.9))
    start = float(s.t[int(0.15 * len(s.t))] + rng.uniform(0, 1) * (0.7 * (s.t[-1] - s.t[0]) - seconds))
    phase = np.clip((s.t - start) / seconds, 0.0, 1.0)
    force = rng.normal(size=3)
    torque = _pushed(made, s.q, link, force / np.linalg.norm(force)) * np.sin(np.pi * phase)[:, None]
    ratio = np.abs(torque).max(axis=0) / made.world.torque_std
    torque *= float(rng.uniform(0.4, 1.2)) / ratio.max()
    power = 0.5 * seconds * made.case.rate * np.abs(torque).max(axis=0) ** 2  # of half a sine
    felt = np.sqrt(power) > FELT * np.hypot(made.sensors.noise, made.sensors.quantum)
    joints = [int(j) for j in np.flatnonzero(felt | (ratio > 0.2 * ratio.max()))]
    spoiled.columns[k] = loaded(made, k, torque)
    rows = np.searchsorted(spoiled.columns[k]["t"], [start, start + seconds])
    wanted = Wanted(("contact",), (name_of(k),), columns_of("tau", joints), (int(rows[0]), int(rows[1])))
    return Story(f"link {link}, {seconds:.2f} s", spoiled, wanted)


def _pushed(made: RunSet, q: FloatArray, link: int, force: FloatArray) -> FloatArray:
    """Torque (n, n_joints) of a force of 1 N in the world's axes at a link's frame and beyond it."""
    model = made.world.model
    data = model.createData()
    reach = pin.SE3(np.eye(3), np.full(3, 0.1 * made.world.arm.reach))
    torque = np.zeros_like(q)
    for row, state in enumerate(q):
        jacobian = pin.computeJointJacobian(model, data, state, link)
        turn = data.oMi[link].rotation
        torque[row] = -jacobian.T @ (reach.toDualActionMatrix() @ np.concatenate([turn.T @ force, np.zeros(3)]))
    return torque


def payload(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """One run carries something, the others do not: the last or any other."""
    spoiled = made.copied()
    k = made.n_runs - 1 if variant % 2 == 0 else any_run(rng, made)
    s = made.world.runs[k]
    mass = float(rng.uniform(0.08, 0.3)) * made.case.mass
    centre = rng.normal(size=3)
    centre *= float(rng.uniform(0.05, 0.2)) * made.world.arm.reach / np.linalg.norm(centre)
    model = made.world.model.copy()
    body = pin.Inertia(mass, centre, np.eye(3) * mass * (0.05 * made.world.arm.reach) ** 2)
    model.appendBodyToJoint(made.n_joints, body, pin.SE3.Identity())
    extra = inverse_dynamics(model, s.q, s.dq, s.ddq) - s.tau_rigid
    spoiled.columns[k] = loaded(made, k, extra)
    return Story(f"{mass:.1f} kg on {made.case.mass:.0f} kg", spoiled, Wanted(("payload_change",), (name_of(k),)))


def still_joint(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """A joint that stands still all the time, in one run or in all."""
    spoiled = made.copied()
    runs = some_or_all(rng, made)
    j = any_joint(rng, made)
    for k in runs:
        s = made.world.runs[k]
        q, dq, ddq = s.q.copy(), s.dq.copy(), s.ddq.copy()
        q[:, j], dq[:, j], ddq[:, j] = q[0, j], 0.0, 0.0
        spoiled.columns[k] = moved(made, k, q, dq, ddq)
    where = "one run" if len(runs) == 1 else "all runs"
    return Story(f"joint {j}, {where}", spoiled, Wanted(("joint_never_moves",), files_of(runs), (f"q_{j}",)))


def poor_motion(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """Motion that hardly shows anything: small, slow, together, one way only, at rest nearly always."""
    spoiled = made.copied()
    kind = ("small", "together", "slow", "one way", "mostly still")[variant % 5]
    runs = tuple(range(made.n_runs))
    for k in runs:
        s = made.world.runs[k]
        spoiled.columns[k] = moved(made, k, *_poor(rng, kind, s.t, s.q, s.dq, s.ddq))
    code = {
        "small": "small_motion",
        "together": "joints_together",
        "slow": "slow_motion",
        "one way": "few_reversals",
        "mostly still": "mostly_still",
    }[kind]
    return Story(kind, spoiled, Wanted((code,), files_of(runs), columns_of("q", range(made.n_joints))))


def _poor(rng: np.random.Generator, kind: str, t, q, dq, ddq) -> tuple[FloatArray, FloatArray, FloatArray]:
    middle, n = q.mean(axis=0), q.shape[1]
    if kind == "small":
        scale = float(log_uniform(rng, 0.02, 0.12)) / np.ptp(q, axis=0)
        return middle + scale * (q - middle), scale * dq, scale * ddq
    if kind == "together":
        sizes, lead = rng.uniform(0.3, 0.8, n) * rng.choice([-1, 1], n), int(np.argmax(np.ptp(q, axis=0)))
        span = np.ptp(q[:, lead])
        return tuple(
            offset + np.outer(x[:, lead] / span, sizes) for offset, x in ((middle, q - middle), (0.0, dq), (0.0, ddq))
        )
    seconds = t - t[0]
    if kind == "slow":
        omega, phase = 2 * np.pi / rng.uniform(25.0, 60.0, n), rng.uniform(0, 2 * np.pi, n)
        size = rng.uniform(0.03, 0.06, n) / omega
        angle = np.outer(seconds, omega) + phase
        return middle + size * np.sin(angle), size * omega * np.cos(angle), -size * omega**2 * np.sin(angle)
    x = seconds / seconds[-1]
    way = rng.uniform(0.5, 1.5, n) * rng.choice([-1, 1], n)
    if kind == "mostly still":
        share, start = float(rng.uniform(0.1, 0.3)), float(rng.uniform(0.1, 0.6))
        phase = np.clip((x - start) / share, 0.0, 1.0)
        x = np.sin(6 * np.pi * phase) * np.sin(np.pi * phase) ** 2
        dx, ddx = np.gradient(x, t), np.gradient(np.gradient(x, t), t)
    else:
        ramp = x**3 * (10 - 15 * x + 6 * x**2)
        x, dx, ddx = ramp, np.gradient(ramp, t), np.gradient(np.gradient(ramp, t), t)
    return tuple(offset + np.outer(part, 0.5 * way) for offset, part in ((middle, x), (0.0, dx), (0.0, ddx)))
