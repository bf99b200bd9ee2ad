"""How the base is mounted: which way gravity pulls, before anything else is asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.identification.loops import declared_plan, moved_apart
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.regression.columns import observe
from dynid_rs.regression.evidence import LEAST_NOISE, WIDTHS, linear_model
from dynid_rs.regression.priors import weak_prior

FloatArray = NDArray[np.float64]


def mounted(setup: Setup, fit: ThreeLoopIdentifier) -> tuple[Setup, float]:
    """Return the setup with gravity along that axis of the base under which the data are most probable, and its odds.

    Level, upside down or on a wall: six directions, all with the file's inertials as the prior's centre or none.
    `fit` is that of `setup`; the odds are logarithmic, against the mounting as it was.
    """
    strength = float(np.linalg.norm(setup.robot.gravity))
    if strength == 0:
        return setup, 0.0
    now = np.asarray(setup.robot.gravity)
    others = [sign * strength * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
    others = [g for g in others if np.linalg.norm(g - now) > 0.5 * strength]
    evidence = [_evidence(setup.robot.with_gravity(g.tolist()), fit) for g in (now, *others)]
    best = int(np.argmax(evidence))
    odds = evidence[best] - evidence[0] - float(np.log(len(evidence)))
    if best == 0 or odds < SURE:
        return setup, 0.0
    return replace(setup, robot=setup.robot.with_gravity(others[best - 1].tolist())), odds


def _evidence(robot: _core.RobotModel, fit: ThreeLoopIdentifier) -> float:
    """Logarithm of the evidence of the declared model under another gravity, friction's shapes as they were."""
    posterior = fit.links_.posterior_
    assert posterior is not None  # every fit that is diagnosed has the weak prior
    plan = declared_plan(robot, fit.observations_.plan.friction[0], apart=moved_apart(fit.runs_))
    observations = observe(plan, fit.runs_)
    factors, n_rows = observations.factors(), observations.n_rows
    size = np.array([np.linalg.norm(R[:, -1]) for R in factors]) / np.sqrt(n_rows)
    prior = weak_prior(plan, factors, n_rows).in_unit(posterior.prior.unit)
    least = LEAST_NOISE * size
    model = linear_model(plan, factors, n_rows, posterior.scale, prior, posterior.n_effective, least)
    choices = [posterior.choice._replace(width=width, centre=centre) for width in WIDTHS for centre in (0.0, 1.0)]
    return max(model.fit(choice, 0.1 * size).evidence for choice in choices)
