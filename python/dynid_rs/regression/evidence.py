"""The second loop under the weak prior: its width and centre by the evidence, the likelihood tempered by memory.

Width w and centre c of the prior (`priors.py`) are those under which the data are most probable (`linear_model.py`).

Neighbouring samples are not independent: a row of joint j counts as ``k_j = 1 / (1 + 2 sum rho)`` of one
(`memory.residual_memory`). The residual's memory lowers how much the data count; it is not filtered out, for a filter
fitted to a misfit would call the misfit noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.memory import residual_memory, returning
from dynid_rs.regression.columns import Observations, Plan
from dynid_rs.regression.linear_model import Choice, Fit, Known, LinearModel, fits
from dynid_rs.regression.priors import WeakPrior, declares_inertia, weak_prior
from dynid_rs.regression.scales import SCALE_SPREAD, in_reach
from dynid_rs.regression.systems import block_residuals

FloatArray = NDArray[np.float64]

WIDTHS = (0.3, 1.0, 3.0, 10.0, 100.0, 1e3, 1e4)
"""Widths of the prior that are compared: from a file that is as good as such files are to an arm of tons without
one."""
TRUSTED = (0.03, 0.1, 0.3, 1.0)
"""The same where the user trusts the robot file."""
BENDS = (0.03, 0.2)
"""Sizes of friction's bends that are compared: hardly any, and a curved law's."""
SCALE_STEPS = 4
"""Gauss-Newton steps on the gains in a round; gains ten times off are reached."""
STEP_SIZES = (1.0, 0.3, 0.1)
"""Parts of such a step that are tried."""
COMMON = np.geomspace(0.1, 10.0, 41)
"""Multiples of the gains of all joints but the first that are compared, 12 % apart: steps on single gains end where
joints agree with each other and the first one, whose misfit passes for noise, no longer counts."""
ROUNDS = 3
"""Rounds of memory and width; the width is one of a few, so it settles at once."""
LEAST_NOISE = 1e-6
"""No joint's noise counts as less than this part of its torque: rounding."""
FIRST_MEMORY = 0.1
"""Independent samples that a row counts as before there is a residual."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Solution under the weak prior.

    Parameters
    ----------
    x : ndarray (n_columns,)
        Most probable unknowns.
    noise_std : ndarray (n_joints,)
        sigma_j [torque unit].
    choice : Choice
        Of the prior.
    evidence : float
        Logarithm, up to a constant that every fit of the same rows shares.
    n_directions : int
        Combinations of the links' parameters, and of what cannot be told from them, that have a prior.
    n_determined : float
        Of these, how many the data determine.
    n_effective : ndarray (n_joints,)
        Independent samples that the rows are worth, ``k_j n``.
    weights : ndarray (n_joints,)
        ``w_j`` of the joints' rows.
    scale : ndarray (n_joints,)
        Torque channel per link torque relative to the first joint's.
    prior : WeakPrior
        As it was used.
    pull : ndarray (n_used, n_columns + 1)
        Its rows ``[A | b]``.
    converged : bool
        Whether width and centre were the same in the last two rounds.
    """

    x: FloatArray
    noise_std: FloatArray
    choice: Choice
    evidence: float
    n_directions: int
    n_determined: float
    n_effective: FloatArray
    weights: FloatArray
    scale: FloatArray
    prior: WeakPrior
    pull: FloatArray
    n_rounds: int
    converged: bool

    def model(
        self,
        plan: Plan,
        rows: Sequence[FloatArray],
        *,
        n_effective: FloatArray | None = None,
    ) -> LinearModel:
        """Model of rows ``[own | base | torque]`` per joint under this fit's prior and gains.

        With its memory, unless told otherwise.
        """
        n_effective = self.n_effective if n_effective is None else n_effective
        size = np.sqrt([np.mean(part[:, -1] ** 2) for part in rows])
        least_noise = np.maximum(LEAST_NOISE * size, 1e-300)
        return linear_model(plan, rows, len(rows[0]), self.scale, self.prior, n_effective, least_noise)

    @property
    def relative_uncertainty(self) -> float:
        """Standard deviation of a link's mass beforehand, over its mass."""
        return self.choice.width / 2


def fit_with_prior(
    observations: Observations,
    *,
    free: NDArray[np.bool_] | None = None,
    unknown_gain: bool = False,
    trusted: bool = False,
    held: Posterior | None = None,
    scale: FloatArray | None = None,
    least_noise: FloatArray | None = None,
    elsewhere: FloatArray | None = None,
    believed: Choice | None = None,
    known: Known | None = None,
    gains_of: Posterior | None = None,
) -> Posterior:
    """Fit all unknowns under the weak prior.

    Parameters
    ----------
    observations : Observations
        Rows and factors.
    free : ndarray (n_joints,), optional
        Joints whose drive gains relative to the others are estimated too; none by default.
    unknown_gain : bool
        The torque's unit is an unknown multiple of N m: taken from the sizes of measured and declared torque.
    trusted : bool
        The user trusts the robot file's inertials: they are the prior's centre, and its width is small.
    held : Posterior, optional
        Earlier fit of nearly the same rows, whose width, centre and memory stay.
    scale : ndarray (n_joints,), optional
        Where the search for the gains of the joints in `free` begins.
    least_noise : ndarray (n_joints,), optional
        [torque unit] Against each other joints weigh as if none had less noise.
    elsewhere : ndarray (n, n_joints, 10 n_links), optional
        Columns of the links at states that no run has shown, for `least_noise`: joints' torques stay there too.
    believed : Choice, optional
        Width, centre and size of bends of the prior, instead of those that the evidence chooses.
    known : Known, optional
        Unknowns that are known: all others are fitted beside them.
    gains_of : Posterior, optional
        Earlier fit whose gains, and whose unit, stay.
    """
    plan, factors, n_rows = observations.plan, observations.factors(), observations.n_rows
    n = plan.robot.n_joints
    size = np.array([max(float(np.linalg.norm(R[:, -1])) / np.sqrt(n_rows), 1e-300) for R in factors])
    least = LEAST_NOISE * size if least_noise is None else np.maximum(least_noise, LEAST_NOISE * size)
    if gains_of is not None:
        free, scale = None, gains_of.scale
    gains = np.ones(n) if gains_of is None and (free is None or not free.any()) else scale
    prior = weak_prior(plan, factors, n_rows, held.scale if held is not None else gains)
    widths = [(w, c) for w in (TRUSTED if trusted else WIDTHS) for c in _centres(plan.robot, trusted)]
    choice = Choice() if believed is None else believed
    scale = np.ones(n) if scale is None else scale
    noise, n_effective = 0.1 * size, np.full(n, FIRST_MEMORY * n_rows)
    if held is not None:
        choice, noise, n_effective = held.choice, held.noise_std, held.n_effective
        scale = held.scale if gains_of is None else gains_of.scale
    if unknown_gain:
        earlier = held if gains_of is None else gains_of
        prior = prior.in_unit(earlier.prior.unit if earlier is not None else _unit(plan, factors, scale))
    chosen: list[Choice] = []
    apart = True
    for k in range(ROUNDS if held is None else 1):
        if k and free is not None and free.any():  # gains tell what a force between two joints is in either channel
            prior = weak_prior(plan, factors, n_rows, scale).in_unit(prior.unit)
        model = linear_model(plan, factors, n_rows, scale, prior, n_effective, least)
        if held is not None or believed is not None:
            best = model.fit(choice, noise)
        else:
            best = _likeliest(model, noise, [choice._replace(width=w, centre=c) for w, c in widths])
            best = _likeliest(model, best.noise, [best.choice._replace(bends=size) for size in BENDS])
        choice = best.choice
        if free is not None and free.any():
            best, scale = _with_gains(best, plan.n_base, scale, free)
            if unknown_gain and held is None and apart:
                ways = _in_common(best, plan.n_base, prior, scale, free, 0.1 * size)
                end, own, gains = max(ways, key=lambda way: way[0].evidence)
                apart = end.evidence > best.evidence  # else nothing is to be found there next time
                if apart:
                    best, prior, scale = end, own, gains
        noise = best.noise
        chosen.append(choice)
        if held is None:
            found = _worth(observations, best.x, scale)
            n_effective = found if len(chosen) == 1 else np.maximum(n_effective, found)
    model = linear_model(plan, factors, n_rows, scale, prior, n_effective, least)

    end = model.fit(choice, noise)
    if known is not None:
        end = end.given(known)
    elif least_noise is not None:
        model = replace(model, least_noise=LEAST_NOISE * size)
        noise = model.fit(choice, noise).noise
        unseen = [] if elsewhere is None else _elsewhere(plan, model, elsewhere * scale[:, None])
        end = _kept_at(model, end, noise, unseen).at(choice, noise)
    pull = prior.rows(choice)[0]
    of_links = pull[np.any(pull[:, : plan.n_base], axis=1), :-1]
    n_determined = len(of_links) - float(np.sum((of_links @ end.covariance) * of_links))
    return Posterior(
        end.x,
        end.noise,
        choice,
        end.evidence,
        len(of_links),
        n_determined,
        n_effective,
        end.weights,
        scale,
        prior,
        pull,
        len(chosen),
        len(set(chosen[-2:])) == 1,
    )


def _worth(observations: Observations, x: FloatArray, scale: FloatArray) -> FloatArray:
    """Independent samples that every joint's rows are worth by what `x` leaves of them, (n_joints,)."""
    left = observations.by_run(block_residuals(observations, x, scale))
    n = observations.plan.robot.n_joints
    worth: FloatArray = observations.n_counted / [residual_memory([run[:, j] for run in left]) for j in range(n)]
    if observations.runs:
        whole, counted = np.concatenate(left), np.concatenate([block.counted for block in observations.blocks])
        phase = observations.phase
        worth /= [returning(whole[c, j], phase[c]) for j, c in enumerate(counted.T)]
    return worth


def _elsewhere(plan: Plan, model: LinearModel, links: FloatArray) -> list[FloatArray]:
    """Columns of every joint's links at other states, (n, k_j), as heavy as its rows are if it never rests.

    `links` (n, n_joints, 10 n_links) as the joints' channels show them.
    """
    found = []
    for j, (part, at) in enumerate(zip(model.rows, model.places, strict=True)):
        of_links = at < plan.n_base
        rows = np.zeros((len(links), part.shape[1] - 1))
        rows[:, of_links] = links[:, j, plan.pivots[at[of_links]]]
        found.append(np.sqrt(model.n_rows / len(links)) * rows)
    return found


def _kept_at(model: LinearModel, fit: Fit, noise: FloatArray, elsewhere: Sequence[FloatArray]) -> LinearModel:
    """Return a model in which joints' torques stay at those of `fit` as much as they weighed more in it than now.

    To the joint whose noise has fallen most, to `noise` (n_joints,), all others weigh what they did in `fit`; what they
    weigh more than their own rows do holds them where it has them, on these rows and on those from `elsewhere`.
    """
    fallen = (fit.noise / noise) ** 2
    rows = []
    for j, (more, part, at) in enumerate(zip(fallen.max() / fallen - 1, model.rows, model.places, strict=True)):
        columns = np.concatenate([part[:, :-1], *elsewhere[j : j + 1]])
        there = np.column_stack([columns, columns @ fit.x[at]])
        rows.append(np.concatenate([part, np.sqrt(more) * there]))
    return LinearModel(rows, model.places, model.prior, model.n_effective, model.least_noise, model.n_rows)


def _with_gains(best: Fit, n_base: int, scale: FloatArray, free: NDArray[np.bool_]) -> tuple[Fit, FloatArray]:
    """Fit and gains (n_joints,) after Gauss-Newton steps on those in `free`, as long as they are likelier.

    A step is towards the most probable gains beside the most probable unknowns; the evidence has these integrated out.
    Where runs tell little of either, one lies far from the other.
    """
    for _ in range(SCALE_STEPS):
        ratio = _improved(best, n_base, scale, free) / scale
        for size in STEP_SIZES:
            gains = scale * ratio**size
            tried = _at_gains(best.model, n_base, gains / scale).fit(best.choice, best.noise)
            if tried.evidence + _of_gains(gains) > best.evidence + _of_gains(scale):
                best, scale = tried, gains
                break
        else:
            break
    return best, scale


def _of_gains(scale: FloatArray) -> float:
    """Logarithm of how probable gains (n_joints,) are beforehand, up to a constant."""
    return -0.5 * float(np.sum((np.log(scale) / SCALE_SPREAD) ** 2))


def _improved(fit: Fit, n_base: int, scale: FloatArray, free: NDArray[np.bool_]) -> FloatArray:
    """One Gauss-Newton step on the gains (n_joints,) of the joints in `free`, beside all other unknowns of `fit`.

    A gain's column is the load of its joint's links; what the other unknowns can imitate of it is taken off as in
    `linear_model.py`, so that no system of all unknowns is solved again.
    """
    joints = np.flatnonzero(free)
    taken, own, moment = np.empty((len(fit.x), len(joints))), np.empty(len(joints)), np.empty(len(joints))
    for k, j in enumerate(joints.tolist()):
        part, at = fit.model.rows[j][:, :-1], fit.model.places[j]
        links = at < n_base
        load = part[:, links] @ fit.x[at[links]] * (fit.weights[j] / scale[j])
        taken[:, k] = fit.whitener[:, at] @ (fit.weights[j] * (load @ part))
        own[k], moment[k] = load @ load, fit.weights[j] * (load @ fit.residual[j])
    spread = SCALE_SPREAD * scale[joints]
    S = np.diag(own + spread**-2) - taken.T @ taken
    change = np.zeros(len(scale))
    change[joints] = np.linalg.solve(S, moment - np.log(scale[joints]) / (SCALE_SPREAD * spread))
    return in_reach(scale, change)


def _in_common(
    best: Fit, n_base: int, prior: WeakPrior, scale: FloatArray, free: NDArray[np.bool_], noise: FloatArray
) -> Iterable[tuple[Fit, WeakPrior, FloatArray]]:
    """Fits with all gains in `free` changed by a common factor, over the first joint's, with their priors and gains."""
    ratios = [np.where(free, factor, 1.0) for factor in COMMON]
    priors = [prior.in_unit(prior.unit / factor) for factor in COMMON]
    models = [_at_gains(best.model, n_base, ratio, own) for ratio, own in zip(ratios, priors, strict=True)]
    ends = fits([(model, best.choice, noise) for model in models])
    return zip(ends, priors, [ratio * scale for ratio in ratios], strict=True)


def _at_gains(model: LinearModel, n_base: int, ratio: FloatArray, prior: WeakPrior | None = None) -> LinearModel:
    """Return a model whose gains are multiples (n_joints,) of what they are, under another prior if one is given."""
    rows, grams = [], []
    for r, part, gram, at in zip(ratio, model.rows, model.grams, model.places, strict=True):
        units = np.append(np.where(at < n_base, r, 1.0), 1.0)
        rows.append(part * units)
        grams.append(gram * np.outer(units, units))
    return replace(model, rows=rows, grams=grams, prior=model.prior if prior is None else prior)


def linear_model(
    plan: Plan,
    rows: Sequence[FloatArray],
    n_rows: int,
    scale: FloatArray,
    prior: WeakPrior,
    n_effective: FloatArray,
    least_noise: FloatArray,
) -> LinearModel:
    """Model of rows ``[own | base | torque]`` per joint, or of factors that stand for `n_rows` of them."""
    places, scaled = [], []
    for j, part in enumerate(rows):
        at = plan.unknowns(j)
        kept = plan.estimable()[at]
        units = np.ones(len(at))
        units[plan.n_own :] = scale[j]
        scaled.append(np.ascontiguousarray(np.column_stack([(part[:, :-1] * units)[:, kept], part[:, -1]])))
        places.append(at[kept])
    return LinearModel(scaled, places, prior, n_effective, least_noise, n_rows)


def _likeliest(model: LinearModel, noise: FloatArray, choices: Sequence[Choice]) -> Fit:
    """Fit under that of several priors under which the data are most probable."""
    return max(fits([(model, choice, noise) for choice in choices]), key=lambda fit: fit.evidence)


def _centres(robot: _core.RobotModel, trusted: bool) -> tuple[float, ...]:
    if not declares_inertia(robot):
        return (0.0,)
    return (1.0,) if trusted else (0.0, 1.0)


def _unit(plan: Plan, factors: Sequence[FloatArray], scale: FloatArray) -> float:
    """Torque unit per N m of the first joint: median over all of what the torque has of the file's links.

    Off the joint's own columns, so that friction is no load; `scale` (n_joints,) of the joints as far as it is known.
    """
    robot = plan.robot
    phi = np.asarray(robot.phi) if declares_inertia(robot) else np.zeros(10 * robot.n_joints)
    base = robot.base_parameters()
    phi_base = phi[np.asarray(base.pivots)] + np.asarray(base.beta) @ phi[np.asarray(base.dependent)]
    ratios, acting = [], np.repeat(plan.acting, [effect.n_columns for effect in plan.effects], axis=1)
    for j, R in enumerate(factors):
        own = R[:, : plan.n_own][:, acting[j]]
        beside = np.linalg.qr(own, mode="complete")[0][:, own.shape[1] :].T @ R[:, plan.n_own :]
        declared = scale[j] * (beside[:, :-1] @ phi_base[plan.pivots >= 10 * j])
        if declared @ beside[:, -1] > 0:
            ratios.append(float(declared @ beside[:, -1] / (declared @ declared)))
    return float(np.median(ratios)) if ratios else 1.0
