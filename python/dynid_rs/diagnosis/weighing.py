"""The last fit: joints weigh against each other by what they may leave on motion that was not seen."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.estimator import clone
from dynid_rs.diagnosis.belief import Belief, fitted
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Place
from dynid_rs.diagnosis.signs import beyond_bounds
from dynid_rs.diagnosis.standing import harms
from dynid_rs.diagnosis.trials import blocks, whole_runs
from dynid_rs.identification.links import LinkDynamicsIdentifier
from dynid_rs.identification.smooth_friction import SmoothFrictionIdentifier
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.regression.evidence import Posterior
from dynid_rs.regression.linear_model import Known
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]
Parts = list[NDArray[np.bool_]]

ELSEWHERE = 2.5
"""What a joint leaves on other motion over what it leaves where it was learned: on nine of ten joints of measured arms,
diagnosed, no more than 2.4."""
N_ELSEWHERE = 600
"""States at which joints' torques stay: ten for each of the numbers of six links."""


def last_fit(found: Belief, without_name: Collection[Place]) -> ThreeLoopIdentifier:
    """Fit of what is believed within the bounds of its sizes; torques `without_name` say nothing of the links."""
    places, zero = found.places(), set[int]()
    while True:
        fit = _with_zero(found, without_name, sorted(zero))
        more = beyond_bounds(found.setup.effects, places, fit.links_.x_) - zero
        if not more or fit is found.first:
            return fit
        zero |= more


def _with_zero(found: Belief, without_name: Collection[Place], zero: Sequence[int]) -> ThreeLoopIdentifier:
    """Fit of what is believed in which the unknowns at places `zero` are zero.

    What has no name predicts what is left of its own joints. What it has in common with gravity it has on these runs
    only, so that the links, and all other joints, are those of the fit without it. Where nothing is left of what was
    named, the fit is that at the beginning.
    """
    setup, train = found.setup, found.train
    if setup.is_like(found.declared):
        return found.first
    nameless = [effect for effect in setup.effects if (effect.kind, effect.joints) in without_name]
    if not nameless:
        return weighed_again(found.first, found.fit, setup, train, zero)
    without, fit = found.without(without_name)
    fit = weighed_again(found.first, fit, without, train, zero)
    plan, places = fit.observations_.plan, np.arange(len(fit.links_.x_))
    of_their_joints = np.isin((places - plan.n_base) // plan.n_own, [j for effect in nameless for j in effect.joints])
    at = places[(plan.estimable() & ~of_their_joints) | np.isin(places, zero)]
    links = _with_gains_of(fit, setup).set_params(known=Known(fit.links_.x_[at], at))
    return fitted(setup, train, friction=_shapes(found.fit), links=links)


def weighed_again(
    declared: ThreeLoopIdentifier,
    fit: ThreeLoopIdentifier,
    setup: Setup,
    train: Sequence[Recording],
    zero: Sequence[int] = (),
) -> ThreeLoopIdentifier:
    """Fit in which joints' rows say as much of the links as if they had the noise of motion that was not seen.

    What a name takes off a joint's residual makes its rows look that much more precise. As far as the name is not quite
    right they would draw the links, and joints that have no name are predicted worse; what they say more exactly moves
    the links where no other joint feels it, on these runs or elsewhere. At these weights the evidence
    chooses the prior anew; where some joint is then predicted worse than by the declared fit, on parts that were left
    out, that of the declared fit, or else of `fit`, stays if it does no such harm. Unknowns at places `zero` are zero.
    """
    links = _with_gains_of(fit, setup)
    links.set_params(least_noise=_least_noise(declared, fit), elsewhere=_elsewhere(fit))
    if zero:
        links.set_params(known=Known(np.zeros(len(zero)), np.array(zero)))
    again = partial(fitted, setup, train, friction=_shapes(fit))
    weighed = again(links=links)
    likeliest, ways = _posterior(weighed).choice, _ways(fit)
    for choice in dict.fromkeys((likeliest, _posterior(declared).choice, _posterior(fit).choice)):
        tried = weighed
        if choice != likeliest:
            tried = again(links=clone(links).set_params(believed=choice))
        if not _does_harm(declared, tried, ways):
            return tried
    return weighed


def _least_noise(declared: ThreeLoopIdentifier, fit: ThreeLoopIdentifier) -> FloatArray:
    """Noise of joints' rows, (n_joints,): what a joint may leave elsewhere, and no more than in the declared model."""
    before, after = (_posterior(each).noise_std for each in (declared, fit))
    return np.minimum(before, ELSEWHERE * after)


def _with_gains_of(fit: ThreeLoopIdentifier, setup: Setup) -> LinkDynamicsIdentifier:
    """Fit of the links with the drives' gains of another fit: nothing that is weighed otherwise tells them better."""
    links: LinkDynamicsIdentifier = clone(setup.options.get("links") or LinkDynamicsIdentifier())
    return links.set_params(gains_of=_posterior(fit))


def _elsewhere(fit: ThreeLoopIdentifier) -> FloatArray:
    """Columns of the links (N_ELSEWHERE, n_joints, 10 n_links) where every joint moves as on the runs, but by itself.

    Joints that move together on the runs hide from each other what another run will show.
    """
    q, dq, ddq = (np.concatenate([getattr(states, name) for states in fit.runs_]) for name in ("q", "dq", "ddq"))
    rng, size = np.random.default_rng(0), (N_ELSEWHERE, q.shape[1])
    angles = rng.uniform(q.min(axis=0), q.max(axis=0), size)
    rates = [rng.normal(size=size) * x.std(axis=0) for x in (dq, ddq)]
    columns: FloatArray = fit.robot.joint_torque_regressor(angles, *rates)
    return columns


def _shapes(fit: ThreeLoopIdentifier) -> SmoothFrictionIdentifier:
    """Friction whose shapes stay as they are."""
    return SmoothFrictionIdentifier((fit.friction_.transition_width_, fit.friction_.sharpness_), held=True)


def _posterior(fit: ThreeLoopIdentifier) -> Posterior:
    posterior = fit.links_.posterior_
    assert posterior is not None  # every fit that is diagnosed has the weak prior
    return posterior


def _shown(fit: ThreeLoopIdentifier) -> tuple[NDArray[np.int64], list[int]]:
    """Phase of the motion at every row of a fit, (n_rows,), and rows per run."""
    return fit.observations_.phase, [len(states.rows) for states in fit.runs_]


def _ways(fit: ThreeLoopIdentifier) -> list[Parts]:
    """Ways to leave out parts of a fit's runs: in the order of their motion, and whole runs."""
    phase, lengths = _shown(fit)
    return [blocks(phase), whole_runs(phase, lengths)]


def _does_harm(other: ThreeLoopIdentifier, fit: ThreeLoopIdentifier, ways: Sequence[Parts]) -> bool:
    """Whether some joint of parts that were left out is predicted worse by `fit` than by another."""
    lost = [(_left_out(fit, parts), _left_out(other, parts)) for parts in ways]
    return any(bool(np.any(harms(after, before, len(ways)))) for after, before in lost)


def _left_out(fit: ThreeLoopIdentifier, parts: Parts) -> FloatArray:
    """Power per part and joint, (n_parts, n_joints), at the fit's own prior and noise."""
    posterior = _posterior(fit)
    model = posterior.model(fit.observations_.plan, fit.observations_.joint_rows())
    return model.left_out(replace(model.fit(posterior.choice, posterior.noise_std), noise=posterior.noise_std), parts)
