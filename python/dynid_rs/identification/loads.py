"""Torques that a fit predicts: what the gears carry, and what the motors have to make."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.identification.links import LinkDynamicsIdentifier
from dynid_rs.regression.columns import Observations, Plan
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]

MIXED = (-1.0, 1.0)
"""Bounds of what the fit before may have of the next torque."""
SAME_LOAD = 1e-6
"""Part of a torque by which it may be another one than its fit was asked with: a thousandth of what any drive shows."""


def link_load(plan: Plan, links: LinkDynamicsIdentifier) -> Callable[[States], FloatArray]:
    """Rigid-body torque [N m] that fitted links predict at every sample, (n, n_joints)."""
    phi = np.zeros(10 * plan.robot.n_joints)
    phi[plan.pivots] = links.phi_base_
    return lambda states: plan.robot.inverse_dynamics(states.q, states.dq, states.ddq, phi)


def load_rows(observations: Observations, links: LinkDynamicsIdentifier) -> list[FloatArray]:
    """Rigid-body torque of every joint in the torque unit at the fit's rows, (n_rows,) each."""
    plan = observations.plan
    return [
        scale * (rows[:, plan.n_own : -1] @ links.x_[plan.unknowns(j)[plan.n_own :]])
        for j, (rows, scale) in enumerate(zip(observations.joint_rows(), links.torque_scale_, strict=True))
    ]


def link_torque(plan: Plan, links: LinkDynamicsIdentifier, states: States) -> FloatArray:
    """Rigid-body torque of the second loop at every sample, (n, n_joints) in the torque unit."""
    return link_load(plan, links)(states) * links.torque_scale_


def with_load(plan: Plan, links: LinkDynamicsIdentifier, own: FloatArray) -> Callable[[States], States]:
    """Runs with the torques that effects of the load are made of: of fitted links, and of the motors.

    `own` (n_joints, n_own): coefficients of the plan's effects, of which the declared ones are the motors' too.
    """
    load = link_load(plan, links)
    declared = [(effect, values) for effect, values in plan.terms(own) if effect.is_declared]

    def loaded(states: States) -> States:
        tau_link = load(states)
        tau_motor = _core.motor_torque(
            declared, links.torque_scale_, *states.signals(), tau_link=tau_link, step=1 / states.rate
        )
        return replace(states, tau_link=tau_link, tau_motor=tau_motor)

    return loaded


class Settling:
    """Torques of the motors from fit to fit, until the ones that a fit is asked with are those that it gives.

    A fit with c m^3 beside it leaves the motor s - c m^3 of a torque s = m + c m^3: an error of m comes back -3 c m^2
    times as large. Anderson's mixing (J. ACM 12, 1965) of the last two fits, joint by joint, takes that out.
    """

    def __init__(self) -> None:
        self._last: tuple[FloatArray, FloatArray] | None = None

    def next(self, asked: Sequence[States], given: Sequence[States]) -> list[States]:
        """Runs for the next fit: `given` by a fit that was `asked` with others."""
        before, after = (_stacked(runs) for runs in (asked, given))
        off, mixed = after - before, after
        if self._last is not None:
            change, step = off - self._last[0], after - self._last[1]
            size = np.sum(change**2, axis=0)
            part = np.sum(off * change, axis=0) / np.where(size > 0, size, 1.0)
            mixed = after - np.clip(part, *MIXED) * step
        self._last = off, after
        edges = np.cumsum([len(states.t) for states in given])[:-1]
        return [replace(states, tau_motor=tau) for states, tau in zip(given, np.split(mixed, edges), strict=True)]


def has_settled(asked: Sequence[States], given: Sequence[States]) -> bool:
    """Whether a fit gives the torques of links and motors that it was asked with."""
    pairs = [
        pair
        for one, other in zip(asked, given, strict=True)
        for pair in ((one.tau_link, other.tau_link), (one.tau_motor, other.tau_motor))
    ]
    return all(
        before is not None
        and after is not None
        and bool(np.all(np.linalg.norm(after - before, axis=0) <= SAME_LOAD * np.linalg.norm(after, axis=0)))
        for before, after in pairs
    )


def _stacked(runs: Sequence[States]) -> FloatArray:
    return np.concatenate([states.tau_motor for states in runs if states.tau_motor is not None])
