"""Gauss-Newton steps on what was accepted of geometry, gravity and encoders, and how sure the result is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.candidate import RunColumns
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.structural import encoder_eccentricity, gravity_tilt, kinematic_error, torque_gain
from dynid_rs.diagnosis.structural.beside import Beside, in_band
from dynid_rs.diagnosis.structural.frames import displacement, is_tilted, moved_joints, tilt_of
from dynid_rs.diagnosis.structural.plausible import Plausible, plausible_phi
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.uncertainty import NORMAL_95, noise_products

FloatArray = NDArray[np.float64]

SETTLED = 0.05
"""A step below this part of every standard error changes nothing."""
FLAT = 1e-12
"""Relative singular values below this are rounding."""


@dataclass(frozen=True, eq=False)
class Part:
    """One accepted effect as unknowns of a linear problem.

    `names`, `units`, `value` of its k parameters; `columns` per run as a candidate has them; `prior` (k,) standard
    deviations of the whole value, infinite where there is none; `apply` (setup, change (k,)) to the setup.
    """

    kind: str
    joints: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    value: FloatArray
    prior: FloatArray
    columns: list[RunColumns]
    apply: Callable[[Setup, FloatArray], Setup]


@dataclass(frozen=True, eq=False)
class Parameters:
    """What an accepted effect is now: `value` and `std_error` (k,), honest under residuals that remember."""

    kind: str
    joints: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    value: FloatArray
    std_error: FloatArray

    @property
    def interval(self) -> FloatArray:
        """95 % interval (k, 2)."""
        half = NORMAL_95 * self.std_error
        return np.stack([self.value - half, self.value + half], axis=1)

    def to_json(self) -> list[dict[str, object]]:
        """Return entries as `result.json` has them."""
        rows = zip(self.names, self.value, self.units, self.interval, strict=True)
        return [{"name": n, "value": float(v), "unit": u, "interval": [float(x) for x in i]} for n, v, u, i in rows]


def whole_model(fit: ThreeLoopIdentifier) -> tuple[Beside, Plausible]:
    """Weighted system of a fit, and a full set of inertial parameters behind it."""
    beside = Beside(fit)
    phi_base = fit.links_.phi_base_
    plausible = plausible_phi(fit.robot, phi_base, beside.base_covariance(), unknown_gain=fit.torque_unit_ == "A")
    return beside, plausible


def refine(setup: Setup, fit: ThreeLoopIdentifier) -> Setup:
    """One Gauss-Newton step on all accepted tilts, displacements and eccentricities, the whole model beside them.

    `fit` is that of `setup`. Returns `setup` itself where no step is worth a refit; gains are fitted by `fit` anyway.
    """
    if not _is_structural(setup):
        return setup
    beside, plausible = whole_model(fit)
    parts = [part for part in _parts(beside, setup, plausible) if part.kind != torque_gain.KIND]
    if not parts:
        return setup
    system, right = _system(beside, parts)
    step, std_error = _solve(system, right)
    if np.all(np.abs(step) <= SETTLED * std_error):
        return setup
    first = 0
    for part in parts:
        width = len(part.names)
        setup = part.apply(setup, step[first : first + width])
        first += width
    return setup


def structural_parameters(fit: ThreeLoopIdentifier, setup: Setup) -> list[Parameters]:
    """Parameters of everything structural in `setup`, whose fit `fit` is, with honest standard errors.

    Displacements in directions that no torque shows have the standard error of their prior. Shapes of friction and
    delays count as known.
    """
    if not _is_structural(setup):
        return []
    beside, plausible = whole_model(fit)
    parts = _parts(beside, setup, plausible)
    if not parts:
        return []
    std_error = np.sqrt(np.diag(_covariance(beside, parts)))
    edges = np.cumsum([0, *(len(part.names) for part in parts)])
    return [
        Parameters(part.kind, part.joints, part.names, part.units, part.value, std_error[first:last])
        for part, first, last in zip(parts, edges[:-1], edges[1:], strict=True)
    ]


def _is_structural(setup: Setup) -> bool:
    """Whether there is any tilt, displacement, eccentricity or gain to speak of."""
    robot = setup.robot
    turned = is_tilted(setup.declared, robot) or len(moved_joints(setup.declared, robot)) > 0
    return bool(turned or np.any(setup.encoder_error) or setup.gain_joints)


def _parts(beside: Beside, setup: Setup, plausible: Plausible) -> list[Part]:
    fit, robot = beside.fit, setup.robot
    parts = []
    free = np.inf
    if is_tilted(setup.declared, robot):
        columns = []
        for states in fit.runs_:
            still = np.zeros_like(states.q)
            pulled = [robot.with_gravity(g.tolist()) for g in gravity_tilt.gravity_steps(setup.declared, robot)]
            torque = [there.inverse_dynamics(states.q, still, still, plausible.phi) for there in pulled]
            columns.append(in_band(fit, states, np.stack(torque, axis=2)))
        value = np.array(tilt_of(setup.declared, robot))
        joints, prior = tuple(range(robot.n_joints)), np.full(2, free)
        parts.append(
            Part(
                gravity_tilt.KIND,
                joints,
                ("roll", "pitch"),
                ("rad", "rad"),
                value,
                prior,
                columns,
                gravity_tilt.turned,
            )
        )
    for j in moved_joints(setup.declared, robot):
        columns = kinematic_error.displacement_columns(beside, setup, plausible, j)
        value = displacement(setup.declared, robot, j)
        names: tuple[str, ...] = ("offset_x", "offset_y", "offset_z", "rotation_x", "rotation_y", "rotation_z")
        apply = _at(kinematic_error.moved, j)
        parts.append(
            Part(
                kinematic_error.KIND,
                (j,),
                names,
                ("m",) * 3 + ("rad",) * 3,
                value,
                kinematic_error.spread(value),
                columns,
                apply,
            )
        )
    for j in np.flatnonzero(np.any(setup.encoder_error, axis=1)).tolist():
        if any(states.two_encoders for states in fit.runs_):
            break  # told by the difference of the two, not by the torque
        columns = encoder_eccentricity.eccentricity_columns(beside, j)
        value, apply = setup.encoder_error[j], _at(encoder_eccentricity.added, j)
        names = ("cosine", "sine")
        parts.append(
            Part(encoder_eccentricity.KIND, (j,), names, ("rad", "rad"), value, np.full(2, free), columns, apply)
        )
    for j in setup.gain_joints:
        value = np.array([fit.links_.torque_scale_[j] - 1.0])
        parts.append(Part(torque_gain.KIND, (j,), ("gain",), ("1",), value, np.full(1, free), [], _unchanged))
    return parts


def _at(change: Callable[[Setup, int, FloatArray], Setup], joint: int) -> Callable[[Setup, FloatArray], Setup]:
    return lambda setup, x: change(setup, joint, x)


def _unchanged(setup: Setup, _: FloatArray) -> Setup:
    return setup


def _system(beside: Beside, parts: list[Part]) -> tuple[FloatArray, FloatArray]:
    """Rows of the unknowns beside which nothing else is left, and what they should explain."""
    wide = beside.left(np.concatenate([beside.stacked(part.columns) for part in parts], axis=1))
    prior, value = (np.concatenate([getattr(part, name) for part in parts]) for name in ("prior", "value"))
    held = np.isfinite(prior)
    pull = np.diag(1 / prior)[held]
    right = np.concatenate([beside.left(beside.residual), -value[held] / prior[held]])
    return np.concatenate([wide, pull]), right


def _solve(system: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least squares and its standard errors (k,) for noise of variance one."""
    norms = np.linalg.norm(system, axis=0)
    norms[norms == 0] = 1.0
    u, s, vt = np.linalg.svd(system / norms, full_matrices=False)
    good = s > FLAT * s[0]
    root = (vt[good].T / s[good]) / norms[:, None]
    return root @ (u.T @ right)[good], np.linalg.norm(root, axis=1)


def _covariance(beside: Beside, parts: list[Part]) -> FloatArray:
    """Sandwich covariance (k, k) of the parts' parameters beside the whole model (`uncertainty.py`)."""
    fit, observations = beside.fit, beside.fit.observations_
    plan = observations.plan
    gains = [part.joints[0] for part in parts if part.kind == torque_gain.KIND]
    linear = [part for part in parts if part.kind != torque_gain.KIND]
    n_used = int(beside.used.sum())
    extra = [beside.stacked(part.columns) for part in linear]
    prior = np.concatenate([part.prior for part in linear]) if linear else np.zeros(0)
    rows = np.concatenate([beside.columns, *extra], axis=1)
    pull = np.zeros((len(prior), rows.shape[1]))
    pull[:, n_used:] = np.diag(1 / prior)
    rows = np.concatenate([rows, pull])
    norms = np.linalg.norm(rows, axis=0)
    norms[norms == 0] = 1.0
    _, s, vt = np.linalg.svd(rows / norms, full_matrices=False)
    inverse = np.where(s > FLAT * s[0], 1 / np.maximum(s**2, 1e-300), 0.0)
    bread = (vt.T * inverse) @ vt / np.outer(norms, norms)
    held = np.concatenate([rows[len(beside.columns) - len(beside.prior) :]])
    meat = held.T @ held
    places_of, columns_of, breads = [], [], []
    position = np.cumsum(beside.used) - 1
    for j, weight in enumerate(beside.weights):
        unknowns = np.append(plan.unknowns(j), plan.n_columns + j)
        known = beside.used[unknowns]
        places = np.concatenate([position[unknowns[known]], np.arange(n_used, rows.shape[1])])
        places_of.append(places)
        columns_of.append(_by_block(beside, linear, j, known))
        breads.append(weight**2 * bread[np.ix_(places, places)])
    left = _residuals(beside)
    products = noise_products(observations, fit.runs_, left, columns_of, breads, power=2)
    for places, product, weight in zip(places_of, products, beside.weights, strict=True):
        meat[np.ix_(places, places)] += weight**4 * product
    covariance = bread @ meat @ bread
    at = {j: int(position[plan.n_columns + j]) for j in gains}
    order: list[int] = []
    first = n_used
    for part in parts:
        if part.kind == torque_gain.KIND:
            order.append(at[part.joints[0]])
        else:
            order += range(first, first + len(part.names))
            first += len(part.names)
    result: FloatArray = covariance[np.ix_(order, order)]
    return result


def _by_block(beside: Beside, linear: list[Part], j: int, known: NDArray[np.bool_]) -> list[FloatArray]:
    """Unweighted columns of joint j's torque per block: the fit's in use, its scale's, then the parts'."""
    observations, links = beside.fit.observations_, beside.fit.links_
    plan = observations.plan
    factor = np.where(np.arange(len(known) - 1) < plan.n_own, 1.0, links.torque_scale_[j])
    load = links.x_[plan.unknowns(j)[plan.n_own :]]
    seen: dict[int, int] = {}
    blocks = []
    for block in observations.blocks:
        first = seen.get(block.run, 0)
        seen[block.run] = last = first + block.n_rows
        rows = block.rows[j][:, :-1]
        own = np.column_stack([rows * factor, rows[:, plan.n_own :] @ load])[:, known]
        extra = [part.columns[block.run].get(j, np.zeros((last, len(part.names))))[first:last] for part in linear]
        blocks.append(np.concatenate([own, *extra], axis=1))
    return blocks


def _residuals(beside: Beside) -> list[FloatArray]:
    from dynid_rs.systems import block_residuals

    links = beside.fit.links_
    return block_residuals(beside.fit.observations_, links.x_, links.torque_scale_)
