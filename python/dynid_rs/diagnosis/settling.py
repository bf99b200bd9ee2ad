"""Everything fitted again after a change, and shapes that settle beside all the rest."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.candidate import stacked
from dynid_rs.diagnosis.hypothesis import bounds_of, has_no_end
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shape_search import refined_shape
from dynid_rs.diagnosis.state import Search, columns_in, fitted, hypothesis_of
from dynid_rs.diagnosis.structural import refine
from dynid_rs.diagnosis.valleys import explained
from dynid_rs.diagnosis.warmth import WARMTH, common_clock, sharing_clocks
from dynid_rs.recording import Recording

FloatArray = NDArray[np.float64]

REFINEMENTS = 3
"""Most Gauss-Newton steps on geometry, gravity and encoders, each with a fit of its own."""
ROUNDS, AGREED = 4, 1e-3
"""Most fits until warmth and friction agree, and the change of a coefficient, over the greatest, at which they do."""
BESIDE_FRICTION = (
    "stribeck",
    "friction_hysteresis",
    "load_hysteresis",
    "load_dependent_friction",
    "position_dependent_friction",
)
"""Kinds that turn round with the joint's own direction, as friction does."""


def settle(state: Search, train: Sequence[Recording], places: Iterable[int]) -> None:
    """Shapes of the effects at `places` and of friction in turn; everything is fitted again where one has moved."""
    polished = polish(state, places)
    if polished.effects != state.setup.effects:
        state.setup = polished
        state.fit = fitted(state.setup, train)
        state.kinds = Kinds(state.fit, state.kinds)
    _follow_friction(state, train)


def _follow_friction(state: Search, train: Sequence[Recording]) -> None:
    """What warmth takes is a part of friction as it is fitted beside it: in turn, until the two agree."""
    for _ in range(ROUNDS):
        followed, moved = [], 0.0
        for effect in state.setup.effects:
            now = effect
            if effect.kind == WARMTH:
                (j,) = effect.joints
                was, friction = effect.shape_at(j), state.kinds.friction_of(j)
                size = max(map(abs, friction.values()), default=0.0)
                moved = max(moved, *(abs(was[name] - value) / max(size, 1e-300) for name, value in friction.items()))
                now = hypothesis_of(effect, state.kinds).placed()
            followed.append(now)
        if moved < AGREED:
            return
        state.setup = replace(state.setup, effects=tuple(followed))
        state.fit = fitted(state.setup, train)
        state.kinds = Kinds(state.fit, state.kinds)


def refit(state: Search, train: Sequence[Recording], new: int = 0) -> None:
    """Fit everything again; the shapes of the last `new` effects and of friction settle in turn."""
    state.fit = fitted(state.setup, train)
    for _ in range(REFINEMENTS):
        refined = refine(state.setup, state.fit)
        if refined is state.setup:
            break
        state.setup = refined
        state.fit = fitted(state.setup, train)
    state.kinds = Kinds(state.fit, state.kinds)
    settle(state, train, range(len(state.setup.effects) - new, len(state.setup.effects)))


def polish(state: Search, places: Iterable[int]) -> Setup:
    """Shapes of the effects at `places`, each refined beside all the rest; joints on one clock together."""
    effects = list(state.setup.effects)
    places, groups = set(places), sharing_clocks(effects)
    plan = state.fit.observations_.plan
    friction = np.arange(plan.n_own)[plan.friction[1]]
    for group in (group for group in groups if places & set(group)):
        beside = Beside(state.fit, [column for k in group for column in columns_in(state)[k]])
        warming = common_clock(beside, state.kinds, [hypothesis_of(effects[k], state.kinds) for k in group])
        for k, hypothesis in zip(group, warming, strict=True):
            effects[k] = hypothesis.placed()
    for k in sorted(places - {k for group in groups for k in group}):
        hypothesis = hypothesis_of(effects[k], state.kinds)
        without = columns_in(state)[k]
        # Where friction begins to slip and what its neighbours in the catalogue do look alike: both move at once.
        together = hypothesis.kind in BESIDE_FRICTION
        bounds = bounds_of(hypothesis)
        if together:
            j = hypothesis.joints[0]
            without = [*without, *((j, int(column)) for column in friction)]
            used = plan.own[j, plan.friction[1]]
            free = np.where(used, np.inf, 0.0)
            bounds = np.concatenate([bounds, np.stack([-free, free], axis=1)])
        power = explained(Beside(state.fit, without), state.kinds, hypothesis, bounds)
        if has_no_end(hypothesis.kind, hypothesis.shape):
            starts = [h for h in state.kinds.grid([hypothesis.kind]) if h.joints == hypothesis.joints]
            hypothesis = max(starts, key=lambda h: power(stacked(state.kinds.columns([h])[0])))
        refined = refined_shape(state.kinds, hypothesis, power, with_friction=together, own_order=True)
        effects[k] = refined.placed()
    return replace(state.setup, effects=tuple(effects))
