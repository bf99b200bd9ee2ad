"""By which parameters a model may be off, because its runs could not tell them better: a few sets of parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.regression.columns import Plan

FloatArray = NDArray[np.float64]

N_STATES = 2000
"""States at which directions are compared; the share they keep is then known within a few hundredths."""
BEYOND = 1.5
"""Speeds and accelerations go up to so many times those of the training runs, speeds at least to the robot file's."""
WIDER = 3.0
"""Directions are longer than the covariance says: it knows the noise and the prior, not that friction's law and the
prior's mean are only about right, which shows where no run has been. Chosen on six arms of the exam (seeds 3, 5, 8, 11,
14, 17) whose training runs were slow and in phase: at work they exceeded thresholds for one false contact per hour in
30 % of the seconds with 1, 17 % with 1.5, 10 % with 2, 0.7 % with 3 and with 5. Where a model was trained as it works,
thresholds are a few per cent higher by it."""
KEPT = 0.99
"""Share of the variance that the directions keep, on every joint."""
UNSEEN = {"tau_link", "tau_motor", "temperature", "step"}
"""Effects that need one of these count as known: the observer does not look at it."""
MOST = 32
"""Directions at most: each costs one more evaluation of the inverse dynamics per sample."""


@dataclass(frozen=True, eq=False)
class ParameterDirections:
    """Columns d_k of a root D of the parameters' covariance, C = D D', with its deviations taken `WIDER` times wider.

    Attributes
    ----------
    phi : ndarray (n_directions, 10 n_links)
        Inertial parameters.
    effects : tuple of ndarray (n_directions, n_joints, n_columns)
        Coefficients of every effect of the model, in its order.
    kept : ndarray (n_joints,)
        Share of the torque's variance that they keep at states far beyond the training runs.
    """

    phi: FloatArray
    effects: tuple[FloatArray, ...]
    kept: FloatArray

    def to_json(self) -> list[dict[str, list[float] | list[list[float]]]]:
        """As a `contact.json` holds them."""
        return [
            {"phi": phi.tolist(), "effects": [effect[k].ravel().tolist() for effect in self.effects]}
            for k, phi in enumerate(self.phi)
        ]


def parameter_directions(identifier: ThreeLoopIdentifier, *, random_state: int = 0) -> ParameterDirections:
    """Return a root of the covariance of what `identifier` has fitted, with the fewest columns that tell its torque.

    Raises
    ------
    ValueError
        The identifier is not fitted.
    """
    covariance = identifier.parameter_covariance(gains_known=True)
    links, plan = identifier.links_, identifier.observations_.plan
    return directions_of(covariance, plan, identifier.model_, links.noise_std_, random_state=random_state)


def directions_of(
    covariance: FloatArray, plan: Plan, model: _core.TorqueModel, noise: FloatArray, *, random_state: int = 0
) -> ParameterDirections:
    """Return a root of a covariance, with the fewest columns that tell the torque of a model.

    With C = L L' and S the sum of y' y / sigma_j^2 over states drawn far beyond the training runs, the columns of L V
    for the eigenvectors V of L' S L to its greatest eigenvalues leave out the least of the variance y C y' (Eckart and
    Young, 1936). One direction may hold coefficients of all joints at once where these are independent: a
    joint's torque knows its own alone, so y C y' stays the same. So the own coefficients of joint j are split into what
    follows the base parameters, which goes with them, and the rest, which is laid side by side over the joints.

    Parameters
    ----------
    covariance : ndarray (n_columns, n_columns)
        Of the unknowns of the plan: base parameters, then each joint's own coefficients.
    plan, model : Plan, TorqueModel
        What its unknowns are, and what they make.
    noise : ndarray (n_joints,)
        What the joints' torques are weighed by [torque unit].
    """
    n, n_base = plan.robot.n_joints, plan.n_base
    covariance = _given(covariance, _unseen(plan))
    base, own = _columns(plan, *_states(model, np.random.default_rng(random_state)))
    noise = np.maximum(noise, 1e-300)
    among_base = covariance[:n_base, :n_base]
    inverse = np.linalg.pinv(among_base, rcond=1e-10, hermitian=True)
    places = [n_base + j * plan.n_own + np.arange(plan.n_own) for j in range(n)]
    # Own coefficients of a joint: what follows the base parameters, and the rest.
    slopes = [covariance[at, :n_base] @ inverse for at in places]
    rests = [
        WIDER * _root(covariance[np.ix_(at, at)] - slope @ covariance[:n_base, at])
        for slope, at in zip(slopes, places, strict=True)
    ]
    followed = [base[:, j] + own[:, j] @ slopes[j] for j in range(n)]
    root = WIDER * _root(among_base)
    root = root @ _leading(np.concatenate([rows / sigma for rows, sigma in zip(followed, noise, strict=True)]) @ root)
    rests = [rest @ _leading(own[:, j] @ rest) for j, rest in enumerate(rests)]
    # Mean variance of every joint's torque by every column, (n_joints, n_columns).
    of_base = np.array([np.mean((rows @ root) ** 2, axis=0) for rows in followed])
    of_own = np.array([np.mean((own[:, j] @ rest) ** 2, axis=0) for j, rest in enumerate(rests)])
    total = np.maximum(of_base.sum(axis=1) + of_own.sum(axis=1), 1e-300)
    n_own = _fewest(of_own, total, MOST // 2)
    n_shared = _fewest(of_base, total, MOST - n_own)
    phi = np.zeros((n_shared + n_own, 10 * n))
    phi[:n_shared, plan.pivots] = root[:, :n_shared].T
    coefficients = np.zeros((len(phi), n, plan.n_own))
    for j in range(n):
        coefficients[:n_shared, j] = (slopes[j] @ root[:, :n_shared]).T
        coefficients[n_shared:, j] = rests[j][:, :n_own].T
    kept = (of_base[:, :n_shared].sum(axis=1) + of_own[:, :n_own].sum(axis=1)) / total
    return ParameterDirections(phi, _of_effects(plan, model, coefficients), kept)


def _states(model: _core.TorqueModel, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """States (N_STATES, n_joints) far beyond the training runs: q over a whole turn, dq, ddq."""
    low, high = np.array(model.domain[0]).T
    turns = np.array(model.robot.joint_kinds) == "revolute"
    low, high = np.where(turns, np.minimum(low, -np.pi), low), np.where(turns, np.maximum(high, np.pi), high)
    limits = np.array(model.robot.velocity_limits)
    trained = BEYOND * np.array(model.domain[1])
    speed = np.maximum(trained, np.where(np.isfinite(limits), limits, 0.0))
    push = BEYOND * np.array(model.domain[2])
    shape = (N_STATES, len(low))
    return rng.uniform(low, high, shape), rng.uniform(-speed, speed, shape), rng.uniform(-push, push, shape)


def _columns(plan: Plan, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Base columns (n, n_joints, n_base) and own columns (n, n_joints, n_own) of every joint's torque."""
    base = plan.robot.joint_torque_regressor(q, dq, ddq)[:, :, plan.pivots]
    n = plan.robot.n_joints
    own = []
    for effect in plan.effects:
        if _counts_as_known(effect):
            own.append(np.zeros((len(q), n, effect.n_columns)))
            continue
        own.append(_core.effect_columns(effect, q, dq, ddq))
    return base, np.concatenate(own, axis=2)


def _counts_as_known(effect: _core.Effect) -> bool:
    return bool(effect.has_memory or UNSEEN.intersection(effect.signals))


def _unseen(plan: Plan) -> NDArray[np.intp]:
    """Places of the unknowns of effects that count as known."""
    of_joint = np.concatenate([np.full(effect.n_columns, _counts_as_known(effect)) for effect in plan.effects])
    own = plan.n_base + np.arange(plan.robot.n_joints)[:, None] * plan.n_own + np.flatnonzero(of_joint)
    return own.ravel()


def _given(covariance: FloatArray, known: NDArray[np.intp]) -> FloatArray:
    """The covariance of the others where some unknowns are known; zero of those.

    Friction that remembers is nearly Coulomb's: left as unknown as the runs leave it, and its torque not looked at, it
    would make Coulomb's, which the two together are well known by, many times as unknown as it is.
    """
    among = covariance[np.ix_(known, known)]
    scale = np.sqrt(np.maximum(np.diag(among), 1e-300))
    inverse = np.linalg.pinv(among / np.outer(scale, scale), rcond=1e-10, hermitian=True) / np.outer(scale, scale)
    rest: FloatArray = covariance - covariance[:, known] @ inverse @ covariance[known]
    rest[known] = rest[:, known] = 0.0
    return rest


def _root(covariance: FloatArray) -> FloatArray:
    """L with L L' = covariance; what rounding made negative is none."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def _leading(rows: FloatArray) -> FloatArray:
    """Right singular vectors of rows, from the greatest on, as columns."""
    leading: FloatArray = np.linalg.svd(rows, full_matrices=False)[2].T
    return leading


def _fewest(variances: FloatArray, total: FloatArray, most: int) -> int:
    """How many columns (n_joints, n_columns) leave out no more than half of what may be left out, on every joint."""
    left = variances.sum(axis=1, keepdims=True) - np.cumsum(variances, axis=1)
    needed = 1 + int(np.count_nonzero(left > (1 - KEPT) / 2 * total[:, None], axis=1).max())
    return min(needed, most, int(variances.shape[1]))


def _of_effects(plan: Plan, model: _core.TorqueModel, coefficients: FloatArray) -> tuple[FloatArray, ...]:
    """Coefficients of the model's effects: those of the plan, then those that were known, which are not off."""
    parts, first = [], 0
    for effect in plan.effects:
        parts.append(coefficients[:, :, first : first + effect.n_columns])
        first += effect.n_columns
    parts += [np.zeros((len(coefficients), *values.shape)) for _, values in model.effects[len(plan.effects) :]]
    return tuple(parts)
