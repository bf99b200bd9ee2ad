"""The load behind a gear: what the torque model says of it, and how far that may be off."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.columns import Block, Observations
from dynid_rs.links import LinkDynamicsIdentifier
from dynid_rs.preprocessing import States
from dynid_rs.uncertainty import parameter_covariance

if TYPE_CHECKING:
    from dynid_rs.identification import ThreeLoopIdentifier

FloatArray = NDArray[np.float64]

LINK_SIDE = ("joint_spring", "counterbalance")
"""Effects that pass through the gear beside the rigid body; friction and rotor act on the motor's side of it."""
SCALE = 2e-3
"""No torque is known better than this part of it, whatever its noise: one standard deviation of a common scale."""
WEAK = 1e-12
"""Directions below this part of the greatest variance (in standard deviations of their own) do not count."""


@dataclass(frozen=True, eq=False)
class Load:
    """Torque that gears transmit, as identified from motor torques, and the independent directions of its error.

    Parameters
    ----------
    robot : RobotModel
        Geometry and gravity.
    pivots : ndarray (n_base,)
        Places of the base parameters in phi.
    phi_base : ndarray (n_base,)
        Their values.
    effects : sequence of (Effect, ndarray (n_joints, n_columns))
        What acts on the links beside the rigid body.
    torque_scale : ndarray (n_joints,)
        Of every joint's torque channel.
    root : ndarray (n_base, n_directions)
        Root of the base parameters' covariance.
    rotor_hidden : tuple of int
        Joints whose rotor is not told from the link's own inertia by the torque. Only the link's part goes through the
        gear, so nothing is known of how the load follows this joint's acceleration.
    """

    robot: _core.RobotModel
    pivots: NDArray[np.int64]
    phi_base: FloatArray
    effects: Sequence[tuple[_core.Effect, FloatArray]]
    torque_scale: FloatArray
    root: FloatArray
    rotor_hidden: tuple[int, ...]

    def torque(self, states: States) -> FloatArray:
        """Predicted load along a run, (n, n_joints) [torque unit]; `states` with the link channel on time."""
        phi = np.zeros(10 * self.robot.n_joints)
        phi[self.pivots] = self.phi_base
        torque: FloatArray = self.robot.inverse_dynamics(states.q, states.dq, states.ddq, phi) * self.torque_scale
        for effect, coefficients in self.effects:
            torque = torque + _core.effect_torque(effect, coefficients, *states.signals())
        return torque

    def errors(self, states: States, torque: FloatArray) -> list[FloatArray]:
        """Load per standard deviation of every direction, and of the hidden rotor last; per joint (n, n_directions)."""
        base = self.robot.joint_torque_regressor(states.q, states.dq, states.ddq)[:, :, self.pivots]
        errors = []
        for j in range(self.robot.n_joints):
            own = self.pivots >= 10 * j
            error = base[:, j, own] @ self.root[own] * self.torque_scale[j]
            # One standard deviation of what nothing is known of: as much as the whole load.
            hidden = states.ddq[:, j] * (torque[:, j].std() / max(float(states.ddq[:, j].std()), 1e-300))
            scale = SCALE * torque[:, j]
            errors.append(np.column_stack([error, scale, hidden if j in self.rotor_hidden else np.zeros(len(hidden))]))
        return errors


def identified_load(fit: ThreeLoopIdentifier, loss: Sequence[FloatArray] | None = None) -> Load:
    """Load of a fitted model.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        Fitted.
    loss : sequence of ndarray (n, n_joints), optional
        State of each gear's hysteretic part along the training runs. What a gear loses there is a torque on the
        motor's side that follows the load; without a column of its own it would pass for load.
    """
    observations, links = fit.observations_, fit.links_
    if loss is not None and any(np.any(x) for x in loss):
        observations = _with_loss(fit, loss)
        links = copy(fit.links_)
        links.fit(observations, fit_scale=fit.torque_unit_ == "A", again=True)
    plan = observations.plan
    covariance = parameter_covariance(observations, links, fit.runs_)[: plan.n_base, : plan.n_base]
    std = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    variances, vectors = np.linalg.eigh(covariance / np.outer(std, std))
    kept = variances > WEAK * variances[-1]
    root = std[:, None] * vectors[:, kept] * np.sqrt(variances[kept])
    rotor = [effect.kind for effect in plan.effects].index("rotor_inertia")
    column = sum(effect.n_columns for effect in plan.effects[:rotor])
    hidden = tuple(j for j in range(plan.robot.n_joints) if (j, column) in plan.absorbed)
    effects = _link_side(fit, links)
    return Load(plan.robot, plan.pivots, links.phi_base_, effects, links.torque_scale_, root, hidden)


def _link_side(fit: ThreeLoopIdentifier, links: LinkDynamicsIdentifier) -> list[tuple[_core.Effect, FloatArray]]:
    plan = fit.observations_.plan
    edges = np.cumsum([0, *(effect.n_columns for effect in plan.effects)])
    fitted = [(e, links.own_[:, a:b]) for e, (a, b) in zip(plan.effects, pairwise(edges), strict=True)]
    return [(effect, x) for effect, x in [*fitted, *fit.known_] if effect.kind in LINK_SIDE]


def _with_loss(fit: ThreeLoopIdentifier, loss: Sequence[FloatArray]) -> Observations:
    """Rows of the fit with one more own column: the states `loss` in the band, where a joint has one."""
    old = fit.observations_
    n = old.plan.robot.n_joints
    has = np.any([np.any(x, axis=0) for x in loss], axis=0)
    # The column is what it is, whatever it is called: any effect with one coefficient per joint stands for it.
    stands_for = _core.Effect.of("joint_spring", rest_position=np.zeros(n))
    plan = replace(old.plan, effects=(*old.plan.effects, stands_for), own=np.column_stack([old.plan.own, has]))
    in_band = [states.in_band(x) for states, x in zip(fit.runs_, loss, strict=True)]
    taken = [0] * len(in_band)
    blocks = []
    for block in old.blocks:
        first = taken[block.run]
        taken[block.run] += block.n_rows
        part = in_band[block.run][first : first + block.n_rows]
        rows = [
            np.ascontiguousarray(np.insert(joint, old.plan.n_own, part[:, j], axis=1))
            for j, joint in enumerate(block.rows)
        ]
        blocks.append(Block(block.run, rows, [_core.triangular_factor(joint) for joint in rows]))
    return Observations(plan, blocks)
