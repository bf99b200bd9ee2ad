"""The last fit: joints weigh against each other as they did before anything had a name."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.estimator import clone
from dynid_rs.diagnosis.belief import Belief, fitted
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Place
from dynid_rs.identification.links import LinkDynamicsIdentifier
from dynid_rs.identification.smooth_friction import SmoothFrictionIdentifier
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.regression.evidence import Posterior
from dynid_rs.regression.linear_model import Known
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]

N_ELSEWHERE = 600
"""States at which joints' torques stay: ten for each of the numbers of six links."""


def last_fit(found: Belief, without_name: Collection[Place]) -> ThreeLoopIdentifier:
    """Fit of what is believed, in which torques at places `without_name` say nothing of the links.

    What has no name predicts what is left of its own joints. What it has in common with gravity it has on these runs
    only, so that the links, and all other joints, are those of the fit without it. Where nothing is left of what was
    named, the fit is that at the beginning.
    """
    setup, train = found.setup, found.train
    if setup.is_like(found.declared):
        return found.first
    nameless = [effect for effect in setup.effects if (effect.kind, effect.joints) in without_name]
    if not nameless:
        return weighed_as(found.first, found.fit, setup, train)
    without, fit = found.without(without_name)
    fit = weighed_as(found.first, fit, without, train)
    plan, places = fit.observations_.plan, np.arange(len(fit.links_.x_))
    of_their_joints = np.isin((places - plan.n_base) // plan.n_own, [j for effect in nameless for j in effect.joints])
    at = places[plan.estimable() & ~of_their_joints]
    links = _with_gains_of(fit, setup).set_params(known=Known(fit.links_.x_[at], at))
    return fitted(setup, train, friction=_shapes(found.fit), links=links)


def weighed_as(
    declared: ThreeLoopIdentifier, fit: ThreeLoopIdentifier, setup: Setup, train: Sequence[Recording]
) -> ThreeLoopIdentifier:
    """Fit in which joints' rows say of the links that all share as much, against each other, as in the `declared` fit.

    What a name takes off a joint's residual makes its rows look that much more precise. As far as the name is not quite
    right they would draw the links, and joints that have no name are predicted worse; what they say more exactly moves
    the links where no other joint feels it, on these runs or elsewhere. At these weights the evidence chooses the prior
    anew.
    """
    links = _with_gains_of(fit, setup)
    links.set_params(least_noise=_posterior(declared).noise_std, elsewhere=_elsewhere(fit))
    return fitted(setup, train, friction=_shapes(fit), links=links)


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
