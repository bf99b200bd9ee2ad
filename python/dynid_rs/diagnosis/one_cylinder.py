"""A cylinder in a wrong valley leaves a rest that looks like a spring or a slow ripple; in the right one none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import Beside, independent_rows
from dynid_rs.diagnosis.candidate import joined, stacked
from dynid_rs.diagnosis.dead_point import KIND
from dynid_rs.diagnosis.hypothesis import Hypothesis, bounds_of
from dynid_rs.diagnosis.kinds import RIPPLES, Kinds
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.state import EVEN, Choice, Search, columns_in, hypothesis_of
from dynid_rs.diagnosis.valleys import best_shape
from dynid_rs.placed import PlacedEffect

FloatArray = NDArray[np.float64]

PATCHES = ("joint_spring", "torque_ripple")
"""Kinds that depend on nothing but the same joint's position."""
CARRIES = 0.2
"""Part of the weight's scatter from which on a spring is no cable that bends: it was built to carry."""


def named_by_task(choice: Choice, kinds: Kinds) -> Choice:
    """A spring that carries much of a joint's weight is a cylinder, if the robot file is believed and data allow it.

    Where thirty degrees were seen the two are one curve; the other name stays as a tie.
    """
    spring = choice.weighed.candidate
    alike = [tie for tie in choice.ties if tie.weighed.evidence > choice.weighed.evidence - EVEN]
    best = max((t for t in alike if t.weighed.candidate.kind == KIND), key=lambda t: t.weighed.evidence, default=None)
    if kinds.belief is None or spring.kind not in PATCHES or best is None:
        return choice
    (j,) = spring.joints
    torque = stacked(spring.columns)[j] @ choice.weighed.gain.coefficients
    q = np.concatenate([states.q[states.rows, j] for states in kinds.runs])
    if torque.std() < CARRIES * kinds.weight[j] or not kinds.belief.supports(j, q, torque):
        return choice
    others = [tie for tie in alike if tie.weighed.candidate.kind != KIND]
    return replace(best, ties=(replace(choice, ties=()), *others))


def without_patches(state: Search) -> Setup:
    """Return the setup with every cylinder alone at its joint, where it explains as much so in a better shape.

    Worth is power less what coefficients and searched shapes cost; a cylinder that needs its neighbours keeps them.
    """
    setup = state.setup
    for k, effect in enumerate(state.setup.effects):
        patches = [p for p, other in enumerate(state.setup.effects) if _patches(other, effect)]
        if effect.kind != KIND or not patches:
            continue
        places = columns_in(state)
        beside = Beside(state.fit, [place for p in (k, *patches) for place in places[p]])
        together = [hypothesis_of(state.setup.effects[p], state.kinds) for p in (k, *patches)]
        alone = best_shape(beside, state.kinds, together[0])
        if _explains_as_much(beside, state.kinds, alone, together):
            effects = [
                e for e in setup.effects if e is not effect and not any(e is state.setup.effects[p] for p in patches)
            ]
            setup = replace(setup, effects=(*effects, alone.placed()))
    return setup


def _patches(other: PlacedEffect, cylinder: PlacedEffect) -> bool:
    if other.kind not in PATCHES or other.joints != cylinder.joints:
        return False
    cycles = dict(other.shape).get("cycles")
    return cycles is None or cycles[0] < RIPPLES[1]


def _explains_as_much(beside: Beside, kinds: Kinds, alone: Hypothesis, together: list[Hypothesis]) -> bool:
    """Whether what `alone` leaves more than all `together` is worth less than their coefficients and shapes."""
    (left, n_alone), (left_by_all, n_all) = (_left(beside, kinds, each) for each in ([alone], together))
    rows = independent_rows(left_by_all, beside.blocks)
    more = 0.5 * float(rows @ np.log(np.sum(left**2, axis=0) / np.sum(left_by_all**2, axis=0)))
    return more <= 0.5 * (n_all - n_alone) * float(np.log(max(float(np.mean(rows)), 2.0)))


def _left(beside: Beside, kinds: Kinds, hypotheses: list[Hypothesis]) -> tuple[FloatArray, int]:
    """What the model with the hypotheses leaves (n_rows, n_joints), and how many numbers they have."""
    columns = joined([stacked(c) for c in kinds.columns(hypotheses)])
    bounds = np.concatenate([bounds_of(h) for h in hypotheses])
    coefficients = beside.gains(columns, [slice(None)], [bounds])[0].coefficients
    n_searched = sum(kinds.candidate(h).n_searched for h in hypotheses)
    return beside.with_columns(columns, coefficients), int(np.count_nonzero(coefficients)) + n_searched
