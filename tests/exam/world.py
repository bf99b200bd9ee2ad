"""The arm at work: rigid torque, gears, rotors and friction along every run, before anything is hidden."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from exam.arm import GRAVITY, Arm, draw_arm
from exam.draw import Case, log_uniform, stream
from exam.motion import make_motion

FloatArray = NDArray[np.float64]

LEAST_RATE = 250.0
"""The arm is computed at least this often [Hz], however seldom it is recorded."""
AMBIENT = 22.0
"""Temperature of the room [degC]."""


@dataclass(frozen=True, eq=False)
class States:
    """One run of the arm, (n, n_joints) each; every `every`-th instant is recorded."""

    run: int
    every: int
    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    tau_rigid: FloatArray
    tau_link: FloatArray
    q_motor: FloatArray
    dq_motor: FloatArray
    ddq_motor: FloatArray
    warm: FloatArray

    def at(self, chosen) -> States:
        """Return these instants only."""
        names = ("t", "q", "dq", "ddq", "tau_rigid", "tau_link", "q_motor", "dq_motor", "ddq_motor", "warm")
        return replace(self, every=1, **{name: getattr(self, name)[chosen] for name in names})

    @property
    def recorded(self) -> States:
        """The instants that a recording has."""
        return self.at(slice(None, None, self.every))


@dataclass(frozen=True, eq=False)
class World:
    """The arm, what its joints are like (each (n_joints,)), and its runs."""

    case: Case
    arm: Arm
    model: pin.Model
    coulomb: FloatArray
    viscous: FloatArray
    width: FloatArray
    asymmetry: FloatArray
    offset: FloatArray
    rotor: FloatArray
    compliance: FloatArray
    gap: FloatArray
    torque_std: FloatArray
    amperes: FloatArray
    runs: tuple[States, ...]

    @property
    def train(self) -> tuple[States, ...]:
        """Runs that are given for learning."""
        return self.runs[: self.case.n_train]

    def sign(self, dq: FloatArray) -> FloatArray:
        """Coulomb's sign, rounded as the case has it; `dq` (n, n_joints) [rad/s]."""
        return rounded(self.case.sign_law, dq / self.width)

    def friction(self, dq: FloatArray) -> FloatArray:
        """Coulomb and viscous friction (n, n_joints) [N m], a little stronger one way than the other."""
        return (self.coulomb * self.sign(dq) + self.viscous * dq) * (1 + self.asymmetry * np.sign(dq))

    def motor_torque(self, s: States) -> FloatArray:
        """Torque of the motors (n, n_joints) [N m] that a rigid body with friction needs."""
        return s.tau_link + self.rotor * s.ddq_motor + self.friction(s.dq_motor) + self.offset

    def with_gears(self, s: States, tau_link: FloatArray) -> States:
        """Return the run with this torque behind the gears; the motor side follows from it."""
        if not (np.any(self.compliance) or np.any(self.gap)):
            return replace(s, tau_link=tau_link, q_motor=s.q, dq_motor=s.dq, ddq_motor=s.ddq)
        turn = self.compliance * tau_link + self.gap / 2 * np.tanh(tau_link / (0.1 * self.torque_std))
        spline = CubicSpline(s.t, turn)
        speed, push = spline(s.t, 1), spline(s.t, 2)
        return replace(s, tau_link=tau_link, q_motor=s.q + turn, dq_motor=s.dq + speed, ddq_motor=s.ddq + push)


def rounded(law: str, x: FloatArray) -> FloatArray:
    """Sign of `x`, rounded within about one."""
    if law == "arctan":
        return 2 / np.pi * np.arctan(x)
    return np.tanh(x) if law == "tanh" else x / np.sqrt(1 + x**2)


def inverse_dynamics(model: pin.Model, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
    """Torque (n, n_joints) [N m] of a rigid arm, by Pinocchio's recursion."""
    data = model.createData()
    return np.array([pin.rnea(model, data, *state).copy() for state in zip(q, dq, ddq, strict=True)])


def gravity_difference(model: pin.Model, change: FloatArray, q: FloatArray) -> FloatArray:
    """Torque (n, n_joints) [N m] by which a change (3,) of gravity shows; torque is linear in gravity."""
    turned = model.copy()
    turned.gravity.linear = change
    data, rest = turned.createData(), np.zeros(turned.nv)
    return np.array([pin.rnea(turned, data, state, rest, rest).copy() for state in q])


def make_world(case: Case) -> World:
    """Draw joints, let the arm move; gears are still rigid."""
    arm = draw_arm(case)
    model = arm.model()
    runs = tuple(make_run(case, model, run) for run in range(case.n_runs))
    rng = stream(case.seed, 3)
    n = case.n_joints
    rigid = np.vstack([s.tau_rigid for s in runs[: case.n_train]])
    speed = np.abs(np.vstack([s.dq for s in runs[: case.n_train]])).max(axis=0)
    size = np.hypot(rigid.std(axis=0), 0.03 * _weights(arm))
    coulomb = size * rng.uniform(0.05, 0.25, n)
    world = World(
        case=case,
        arm=arm,
        model=model,
        coulomb=coulomb,
        viscous=coulomb / speed * rng.uniform(0.3, 1.5, n),
        width=speed * log_uniform(rng, 0.003, 0.03, n),
        asymmetry=rng.uniform(-0.08, 0.08, n),
        offset=coulomb * rng.uniform(-0.5, 0.5, n),
        rotor=_inertia(model, runs[0].q) * rng.uniform(0.1, 0.8, n),
        compliance=np.zeros(n),
        gap=np.zeros(n),
        torque_std=np.ones(n),
        amperes=1 / log_uniform(rng, 0.5, 20.0, n) if case.current else np.ones(n),
        runs=runs,
    )
    torque = np.vstack([world.motor_torque(s) for s in world.train])
    return replace(world, torque_std=torque.std(axis=0))


def make_run(case: Case, model: pin.Model, run: int) -> States:
    """Let the arm move: one run of a case, gears still rigid."""
    rng = stream(case.seed, 4, run)
    n = int(case.durations[run] * case.rate)
    stamps = (np.arange(n) + 1 + case.jitter * rng.uniform(-0.5, 0.5, n)) / case.rate
    every = int(np.ceil(LEAST_RATE / case.rate))
    t = np.interp(np.arange((n - 1) * every + 1) / every, np.arange(n), stamps)
    motion = make_motion(case, run, t)
    tau = inverse_dynamics(model, motion.q, motion.dq, motion.ddq)
    q, dq, ddq = motion.q, motion.dq, motion.ddq
    return States(run, every, t, q, dq, ddq, tau, tau, q, dq, ddq, _warmth(case, run, t))


def _warmth(case: Case, run: int, t: FloatArray) -> FloatArray:
    """How warm each joint is (n, n_joints), 0 cold and 1 in the end; a recorded run may start warm."""
    rng = stream(case.seed, 5)
    slow = max(case.durations) * rng.uniform(0.2, 0.8)
    slow = slow * np.ones(case.n_joints)
    start = stream(case.seed, 5, run).uniform(0.0, 0.6, case.n_joints) if case.temperature else 0.0
    return 1 - (1 - start) * np.exp(-(t - t[0])[:, None] / slow)


def warm_time(case: Case) -> float:
    """Time constant [s] of what warms up."""
    return float(max(case.durations) * stream(case.seed, 5).uniform(0.2, 0.8))


def _weights(arm: Arm) -> FloatArray:
    """Moment [N m] of the weight behind each joint with the arm stretched out, roughly."""
    masses = np.array([inertia.mass for inertia in arm.true])
    lengths = np.array([np.linalg.norm(joint.offset) for joint in arm.joints[1:]] + [0.1 * arm.reach])
    return np.array([GRAVITY * masses[k:].sum() * lengths[k:].sum() / 2 for k in range(arm.n_joints)])


def _inertia(model: pin.Model, q: FloatArray) -> FloatArray:
    """Mean inertia (n_joints,) [kg m^2] that each joint feels along a run."""
    data = model.createData()
    chosen = q[:: max(1, len(q) // 20)]
    return np.mean([np.diag(pin.crba(model, data, state)).copy() for state in chosen], axis=0)
