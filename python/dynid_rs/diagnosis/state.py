"""State of a search: what was found so far, the fit of it, and where its columns stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.choice import Weighed
from dynid_rs.diagnosis.hypothesis import Hypothesis
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.evaluation import rmse
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.placed import PlacedEffect, own_columns
from dynid_rs.recording import Recording

FloatArray = NDArray[np.float64]

EVEN = 3.0
"""Two models whose logarithmic evidence differs by less are a tie (odds of twenty to one)."""
TRUSTED = 0.05
"""Relative uncertainty of a robot file's inertials where effects are searched for under them."""


@dataclass(frozen=True, eq=False)
class Choice:
    """A candidate that passed every test, its family-wise p value, what explains the same as well, and what worse."""

    weighed: Weighed
    p_value: float
    ties: tuple[Choice, ...] = ()
    refuted: tuple[Weighed, ...] = ()


@dataclass(frozen=True, eq=False)
class Step:
    """One step of the search: what was "added" or "dropped", and what is left on the training rows (n_joints,)."""

    action: str
    choice: Choice
    rmse: FloatArray


@dataclass
class Search:
    """State of the search."""

    setup: Setup
    fit: ThreeLoopIdentifier
    kinds: Kinds
    steps: list[Step] = field(default_factory=list)
    n_tests: float = float("nan")
    """Independent candidates that a scan is worth, under the residual of the first fit."""


def fitted(setup: Setup, train: Sequence[Recording]) -> ThreeLoopIdentifier:
    """Declared model and what was found, without a third loop."""
    return setup.identifier(residual=None, **trusted(setup)).fit([setup.corrected(recording) for recording in train])


def trusted(setup: Setup) -> dict[str, Any]:
    """Options under which the robot file is trusted, where it is to be believed.

    Under the weight that the evidence finds while an effect is missing the parameters imitate it, so a search trusts
    the file as far as such files usually can be.
    """
    links = setup.options.get("links")
    if links is None or links.prior != "robot" or links.prior_spread is not None:
        return {}
    return {"links": clone(links).set_params(prior_spread=TRUSTED)}


def still_trusted(setup: Setup, train: Sequence[Recording]) -> dict[str, Any]:
    """The same for the model of what was found: where the evidence, with all that in, has nothing against it."""
    from dynid_rs.evidence import lost_evidence

    options = trusted(setup)
    if not options or not setup.effects:
        return {}
    fit = setup.identifier(residual=None).fit([setup.corrected(recording) for recording in train])
    posterior = fit.links_.posterior_
    assert posterior is not None  # prior="robot" always has one
    return options if lost_evidence(fit.observations_, posterior, TRUSTED) < EVEN else {}


def hypothesis_of(effect: PlacedEffect, kinds: Kinds) -> Hypothesis:
    """A placed effect as a hypothesis, friction's transition at its new width."""
    shape = effect.shape_at(effect.joints[0])
    if "transition_width" in shape:
        shape["transition_width"] = float(kinds.widths[effect.joints[0]])
    if "partner" in shape:
        shape["partner"] = -1.0
    if effect.kind == "temperature_friction":  # a part of friction as it is fitted now
        shape |= kinds.friction_of(effect.joints[0])
    return Hypothesis(effect.kind, effect.joints, tuple(shape.items()))


def columns_in(state: Search) -> list[list[tuple[int, int]]]:
    """Joint and own column of every coefficient of every effect of the setup, in the fit's plan."""
    columns = own_columns(state.setup.effects, 0)
    width = 1 + max((column for places in columns for _, column in places), default=-1)
    # They stand right before friction, whatever a law of friction has put before them.
    first = state.fit.observations_.plan.friction[1].start - width
    return [[(j, first + column) for j, column in places] for places in columns]


def worth(power: float, n_rows: int, independent: float, n_free: int) -> float:
    """Approximate evidence of a gain, from the scan alone."""
    share = min(power / n_rows, 1 - 1e-9)
    return float(-0.5 * independent * np.log1p(-share) - 0.5 * n_free * np.log(max(independent, 2.0)))


def rms(fit: ThreeLoopIdentifier) -> FloatArray:
    """What the fit leaves on its training rows, (n_joints,)."""
    return rmse([Beside(fit).residual])
