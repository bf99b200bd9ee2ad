"""A cylinder in a wrong valley leaves a rest that looks like a spring or a slow ripple; in the right one none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynid_rs.diagnosis.beside import Beside, independent_rows
from dynid_rs.diagnosis.candidate import RunColumns
from dynid_rs.diagnosis.kinds import RIPPLES, Hypothesis, Kinds, bounds_of, joined, stacked
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.state import Search, columns_in, hypothesis_of, worth
from dynid_rs.diagnosis.valleys import KIND, valleys
from dynid_rs.placed import PlacedEffect

PATCHES = ("joint_spring", "torque_ripple")
"""Kinds that depend on nothing but the same joint's position."""


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
        alone = _best_alone(beside, state.kinds, together[0])
        if _worth(beside, state.kinds, [alone]) >= _worth(beside, state.kinds, together):
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


def _best_alone(beside: Beside, kinds: Kinds, cylinder: Hypothesis) -> Hypothesis:
    bounds = bounds_of(cylinder)

    def power(columns: RunColumns) -> float:
        return beside.gains(columns, [slice(None)], [bounds])[0].power

    ends = [kinds.refined(start, power) for start in valleys(beside, kinds, cylinder)]
    return max(ends, key=lambda end: power(stacked(kinds.columns([end])[0])))


def _worth(beside: Beside, kinds: Kinds, hypotheses: list[Hypothesis]) -> float:
    columns = joined([stacked(c) for c in kinds.columns(hypotheses)])
    bounds = np.concatenate([bounds_of(h) for h in hypotheses])
    gain = beside.gains(columns, [slice(None)], [bounds])[0]
    n_searched = sum(kinds.candidate(h).n_searched for h in hypotheses)
    rows = float(np.mean(independent_rows(beside.residual, beside.blocks)))
    return worth(gain.power, beside.n_rows, rows, int(np.count_nonzero(gain.coefficients)) + n_searched)
