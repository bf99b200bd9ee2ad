"""The weak prior of every fit: what a stranger would expect of an arm before its data are seen.

Unknowns are Gaussian, ``x ~ N(c x_file, S(w)^2)``:

| unknown | standard deviation |
|---|---|
| link's mass m (the file's, at least 0.3 kg; where it says nothing, more towards the base) | w m / 2 |
| its first moments, its inertia | w m l, w m l^2 with l = 0.15 m |
| rotor's torque, offset | 1, 0.3 of the joint's torque |
| friction: Coulomb, viscous | 1 of the joint's torque |
| what friction's directions differ in, higher orders | b of it |
| an effect that was found | 0.3 of it |
| the same on the other of two joints that it acts on | 0.1 of what the first says |

Coefficients are measured by the root mean square of their column's torque. The width w, whether the file's inertials
are its centre (c = 1) or not (c = 0), and the size b of friction's bends are chosen by the evidence on every data set
(`evidence.py`). So inertials fall back to the file and friction to Coulomb and viscous as far as the data are thin,
and nothing has to be asked of the user.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.regression.columns import FRICTION, Plan
from dynid_rs.regression.linear_model import Choice

FloatArray = NDArray[np.float64]

LEAST_MASS, LENGTH = 0.3, 0.15
"""Mass [kg] of a link that the file says less of, and distance [m] of a link's mass from its frame: an arm's, from a
desk's size to a factory's within the factor that the width w is searched in."""
CARRIES = 1.35
"""Mass of a link over that of the next one towards the tool, where the file says nothing of any: geometric mean over
the arms that example-robot-data declares (`tests/regression/test_priors.py`)."""
USUAL = {"rotor_inertia": 1.0, "torque_offset": 0.3}
"""Torque of declared columns over the joint's own."""
OTHER = 0.3
"""The same of effects that were found. Friction's Coulomb and viscous torque may be as large as the joint's own."""
REACTION = 0.1
"""What the other of two joints feels of a force between them, over what it has to: channels and gears are not exact."""
LEAST_COLUMN = 1e-9
"""A column whose torque is below this part of its joint's is none."""


@dataclass(frozen=True, eq=False)
class WeakPrior:
    """Independent groups of unknowns around a mean.

    Parameters
    ----------
    mean : ndarray (n_columns,)
        What the robot file says of the unknowns; zeros where it says nothing.
    links : ndarray (n_links_seen, n_columns)
        Root L of the links' covariance at width one, ``L'L``.
    others : ndarray (n, n_columns)
        Root of everything else's covariance.
    bends : ndarray (n, n_columns)
        Root of the covariance of friction's asymmetry and higher orders, at size one.
    used : ndarray of bool (n_columns,)
        Unknowns that have a prior: all that are estimable.
    unit : float
        Torque unit per N m: scales links and mean.
    """

    mean: FloatArray
    links: FloatArray
    others: FloatArray
    bends: FloatArray
    used: NDArray[np.bool_]
    unit: float = 1.0
    _rows: dict[Choice, tuple[FloatArray, float]] = field(default_factory=dict)
    _apart: dict[float, tuple[FloatArray, float]] = field(default_factory=dict)
    """Rows of what no link is in, by the size of bends: the same in any unit."""

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.used)

    def rows(self, choice: Choice) -> tuple[FloatArray, float]:
        """Rows ``[A | b]`` of variance one that hold x to its mean, (n_used, n_columns + 1), and ``log det S``."""
        if choice in self._rows:
            return self._rows[choice]
        linked = self._linked
        roots = self._roots(choice)
        links, log_det = _inverse_root(roots[np.any(roots[:, linked], axis=1)], self.used & linked)
        if choice.bends not in self._apart:
            self._apart[choice.bends] = _inverse_root(roots[~np.any(roots[:, linked], axis=1)], self.used & ~linked)
        others, log_det_apart = self._apart[choice.bends]
        across = np.concatenate([links, others])
        target = across @ (choice.centre * self.unit * self.mean)
        self._rows[choice] = np.column_stack([across, target]), log_det + log_det_apart
        return self._rows[choice]

    @cached_property
    def _linked(self) -> NDArray[np.bool_]:
        """Unknowns that links are in, and those that share a root with such, (n_columns,)."""
        linked: NDArray[np.bool_] = np.any(self.links, axis=0)
        roots = np.concatenate([self.bends, self.others]) != 0
        while True:
            wider = linked | np.any(roots[np.any(roots[:, linked], axis=1)], axis=0)
            if np.array_equal(wider, linked):
                return linked
            linked = wider

    def std(self, choice: Choice) -> FloatArray:
        """Standard deviation of every unknown, (n_columns,)."""
        std: FloatArray = np.sqrt(np.sum(self._roots(choice) ** 2, axis=0))
        return std

    def _roots(self, choice: Choice) -> FloatArray:
        return np.concatenate([choice.width * self.unit * self.links, choice.bends * self.bends, self.others])

    def in_unit(self, unit: float) -> WeakPrior:
        """Return the prior for a channel of `unit` torque units per N m."""
        return replace(self, unit=unit, _rows={})


def _inverse_root(roots: FloatArray, used: NDArray[np.bool_]) -> tuple[FloatArray, float]:
    """Root (n_used, n) of the inverse of ``roots' roots``, the covariance of the unknowns in use; its ``log det``."""
    _, R = np.linalg.qr(roots[:, used])
    across = np.zeros((len(R), len(used)))
    across[:, np.flatnonzero(used)] = np.linalg.solve(R.T, np.eye(len(R)))
    return across, 2 * float(np.sum(np.log(np.abs(np.diag(R)))))


def weak_prior(plan: Plan, factors: Sequence[FloatArray], n_rows: int, gains: FloatArray | None = None) -> WeakPrior:
    """Prior on the unknowns of `plan`, whose columns have these factors over `n_rows` rows per joint.

    `gains` (n_joints,) of the torque channels against each other, where they are known.
    """
    robot = plan.robot
    n = robot.n_joints
    phi, rotors = np.asarray(robot.phi), np.asarray(robot.rotor_inertia)
    regroup = _regrouping(plan)
    links = (regroup[:, : 10 * n] * link_spread(phi)).T
    mean = regroup[:, : 11 * n] @ np.concatenate([phi, rotors])
    own = [_own_roots(plan, j, factors[j], n_rows, regroup, rotors[j]) for j in range(n)]
    others = _stacked(plan, [root for joint in own for bends, root in joint if not bends])
    if gains is not None:
        _react(plan, others, gains)
    bends = _stacked(plan, [root for joint in own for bends, root in joint if bends])
    return WeakPrior(mean, links, others, bends, plan.estimable().copy())


def _stacked(plan: Plan, roots: Sequence[FloatArray]) -> FloatArray:
    return np.array(roots).reshape(-1, plan.n_columns)


def _react(plan: Plan, roots: FloatArray, gains: FloatArray) -> None:
    """Change roots so that forces between two joints are one unknown, but for `REACTION`."""
    first = plan.n_base
    for effect in plan.effects:
        for j in range(plan.robot.n_joints):
            partner, felt = effect.reaction(j) or (-1, [])
            for c, ratio in enumerate(felt if partner > j else []):
                share = ratio * gains[partner] / gains[j]
                one, other = (np.zeros(plan.n_columns, dtype=bool) for _ in range(2))
                one[first + j * plan.n_own + c] = other[first + partner * plan.n_own + c] = True
                here, there = (np.flatnonzero(np.any(roots[:, at], axis=1)) for at in (one, other))
                if len(here) == len(there) == 1:
                    std = min(float(roots[here[0], one][0]), float(roots[there[0], other][0]) / share)
                    roots[here[0]] = std * (one + share * other)
                    roots[there[0]] = REACTION * share * std * other
        first += effect.n_columns


def _own_roots(
    plan: Plan, j: int, factor: FloatArray, n_rows: int, regroup: FloatArray, rotor: float
) -> list[tuple[bool, FloatArray]]:
    """Roots of the covariance of joint j's own coefficients, and whether they are of friction's bends, at size one.

    Coefficients that base parameters absorb are included.
    """
    torque = max(float(np.linalg.norm(factor[:, -1])) / np.sqrt(n_rows), 1e-300)
    sizes = np.linalg.norm(factor[:, : plan.n_own], axis=0) / np.sqrt(n_rows)
    first = plan.n_base + j * plan.n_own
    n = plan.robot.n_joints
    roots, column = [], 0
    for effect in plan.effects:
        names = effect.coefficient_names
        for name in names:
            at, root = first + column, np.zeros(plan.n_columns)
            usual, bends = usual_torque(effect, name)
            std = usual * torque / max(sizes[column], LEAST_COLUMN * torque)
            twin = name.removesuffix("_pos") + "_neg" if effect.kind == "friction" else ""
            if name == "rotor_inertia":
                std = max(std, rotor / 2)
            if not plan.own[j, column]:
                if (j, column) in plan.absorbed:
                    absorbed = 10 * n if name == "rotor_inertia" else 11 * n
                    roots.append((False, std * regroup[:, absorbed + j]))
            elif twin in names and name != twin and plan.own[j, column + 1]:
                # What both directions share, and what they differ in.
                std = torque / max(float(np.hypot(*sizes[column : column + 2])), LEAST_COLUMN * torque)
                root[[at, at + 1]] = usual * std
                roots += [(bends, root), (True, std * _signs(plan.n_columns, at))]
            elif not (effect.kind == "friction" and name.endswith("_neg") and plan.own[j, column - 1]):
                root[at] = std
                roots.append((bends, root))
            column += 1
    return roots


def _signs(n_columns: int, at: int) -> FloatArray:
    """One at place `at`, minus one at the next."""
    signs = np.zeros(n_columns)
    signs[[at, at + 1]] = 1.0, -1.0
    return signs


def usual_torque(effect: _core.Effect, name: str) -> tuple[float, bool]:
    """Torque of a coefficient's column over the joint's own, and whether it is one of friction's bends, at size one."""
    if effect.kind in FRICTION:
        return 1.0, not (name in ("coulomb", "viscous") or name.startswith(("coulomb_p", "coulomb_n", "viscous1")))
    return USUAL.get(effect.kind, OTHER), False


def declares_inertia(robot: _core.RobotModel) -> bool:
    """True if the robot file says something of the links: a mass at least, and not the same of most links.

    No arm of three joints and more is built of equal links; where most are, somebody filled the file in (a flange that
    is fixed to a link makes that one different).
    """
    return _is_declared(np.asarray(robot.phi))


def _is_declared(phi: FloatArray) -> bool:
    links = phi.reshape(-1, 10)
    _, alike = np.unique(links, axis=0, return_counts=True)
    return bool(np.any(links[:, 0] > 0)) and not (len(links) > 2 and 2 * alike.max() > len(links))


def link_spread(phi: FloatArray) -> FloatArray:
    """Standard deviation of all links' parameters at width one, (10 n_links,), of what the file says, `phi`."""
    mass = np.maximum(phi[::10], LEAST_MASS)
    if not _is_declared(phi):
        mass = mass.min() * CARRIES ** np.arange(len(mass) - 1.0, -1.0, -1.0)
    spread: FloatArray = np.kron(mass, np.array([0.5, *[LENGTH] * 3, *[LENGTH**2] * 6]))
    return spread


def _regrouping(plan: Plan) -> FloatArray:
    """K (n_columns, 10 n_links + 2 n_joints): unknowns of the fit from links, rotors and offsets."""
    robot = plan.robot
    n = robot.n_joints
    base = robot.base_parameters()
    K = np.zeros((plan.n_columns, 12 * n))
    K[np.arange(plan.n_base), np.asarray(base.pivots)] = 1.0
    K[: plan.n_base, np.asarray(base.dependent)] = base.beta
    kinds = [effect.kind for effect in plan.effects for _ in range(effect.n_columns)]
    for column, kind in enumerate(kinds):
        if kind not in ("rotor_inertia", "torque_offset"):
            continue
        first = 10 * n if kind == "rotor_inertia" else 11 * n
        for j in range(n):
            if (j, column) in plan.absorbed:
                K[: plan.n_base, first + j] = plan.absorbed[j, column]
            elif kind == "rotor_inertia" and plan.own[j, column]:
                K[plan.n_base + j * plan.n_own + column, first + j] = 1.0
    return K
