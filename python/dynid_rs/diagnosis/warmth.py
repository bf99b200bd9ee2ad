"""An arm that warms up as a whole: friction of all joints follows their thermometers, or joints share one clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.candidate import Candidate, joined, stacked
from dynid_rs.diagnosis.choice import Weighed
from dynid_rs.diagnosis.hypothesis import REFINED, Hypothesis, Shape, at_a_bound, bounds_of, has_no_end
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shape_search import NEAR
from dynid_rs.diagnosis.state import hypothesis_of
from dynid_rs.placed import CATALOGUE, PlacedEffect

FloatArray = NDArray[np.float64]

WARMTH = "temperature_friction"
WARMING = "thermal_friction"
WIDTH = "transition_width"
OCTAVES = 2.0
"""How far from where it began a common time constant is searched."""
DRIVES = 0.1
"""Part of the rows on which a warm joint's friction may drive it, where it turns round or the fit is unsure."""


def warm_arm(kinds: Kinds, setup: Setup) -> list[Candidate]:
    """Friction of all joints with a thermometer, times one and the same ``1 + c (T - T_0)``: one candidate or none.

    Once it is accepted every joint has a coefficient of its own.
    """
    if any(effect.kind == WARMTH for effect in setup.effects):
        return []
    hypotheses = kinds.grid([WARMTH])
    if len(hypotheses) < 2:
        return []
    columns = kinds.columns(hypotheses)
    (coefficient,) = CATALOGUE[WARMTH]["coefficients"]
    placed = tuple(hypothesis.placed() for hypothesis in hypotheses)

    def accept(setup: Setup, coefficients: FloatArray) -> Setup:
        return replace(setup, effects=(*setup.effects, *placed))

    return [
        Candidate(
            kind=WARMTH,
            joints=tuple(hypothesis.joints[0] for hypothesis in hypotheses),
            coefficient_names=(coefficient["name"],),
            units=(coefficient["unit"],),
            bounds=bounds_of(hypotheses[0]),
            columns=[
                {j: column for own in columns for j, column in own[run].items()} for run in range(len(kinds.runs))
            ],
            accept=accept,
        )
    ]


def on_one_clock(kinds: Kinds, setup: Setup) -> list[Candidate]:
    """Friction of every other joint that warms up by a clock which was found on one: no shape of its own is searched.

    Gears of one make, with one grease, warm up alike; a single one of them may tell too little of how fast.
    """
    warming = [effect for effect in setup.effects if effect.kind == WARMING]
    there = {j for effect in warming for j in effect.joints}
    others = [j for j in range(len(kinds.widths)) if j not in there]
    clocks = dict.fromkeys(clock(effect) for effect in warming if _tells_time(hypothesis_of(effect, kinds)))
    hypotheses = [
        Hypothesis(WARMING, (j,), (*shape, (WIDTH, float(kinds.widths[j])))) for shape in clocks for j in others
    ]
    kinds.columns(hypotheses)  # of all in one pass
    return [replace(kinds.candidate(hypothesis), n_searched=0) for hypothesis in hypotheses]


def _tells_time(warming: Hypothesis) -> bool:
    """Whether the data know how fast an effect warms up: its time constant stands at no end of its search."""
    return not at_a_bound(warming) and not has_no_end(warming.kind, warming.shape)


def sharing_clocks(effects: Sequence[PlacedEffect]) -> list[list[int]]:
    """Indices of effects that warm up by the same clock, where several do."""
    groups: dict[Shape, list[int]] = {}
    for k, effect in enumerate(effects):
        if effect.kind == WARMING:
            groups.setdefault(clock(effect), []).append(k)
    return [group for group in groups.values() if len(group) > 1]


def clock(effect: PlacedEffect) -> Shape:
    """How fast a friction warms up, and by what: its shape but for the width of the transition."""
    return tuple((name, value) for name, value in effect.shape_at(effect.joints[0]).items() if name != WIDTH)


def common_clock(beside: Beside, kinds: Kinds, warming: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The same effects with the one time constant that takes off most together; `beside` is without any of them."""
    from scipy.optimize import minimize_scalar

    name, (_, low, high) = next(iter(REFINED[WARMING].items()))
    bounds = np.concatenate([bounds_of(h) for h in warming])
    start = float(np.log2(dict(warming[0].shape)[name]))

    def at(octave: float) -> list[Hypothesis]:
        return [h.with_shape(name, float(np.exp2(octave))) for h in warming]

    def cost(octave: float) -> float:
        columns = joined([kinds.once(h) for h in at(octave)])
        return -beside.gains(columns, [slice(None)], [bounds])[0].power

    near = (max(np.log2(low), start - OCTAVES), min(np.log2(high), start + OCTAVES))
    found = minimize_scalar(cost, bounds=near, method="bounded", options={"xatol": NEAR})
    return at(found.x) if found.fun < cost(start) else list(warming)


def takes_too_much(beside: Beside, kinds: Kinds, weighed: Weighed) -> bool:
    """Whether a warm-up takes more friction than there is, so that what is left drives the joint: then it is none."""
    candidate = weighed.candidate
    if candidate.kind != WARMING:
        return False
    (j,) = candidate.joints
    columns, coefficients = stacked(candidate.columns), weighed.gain.coefficients
    friction = beside.friction_with(j, columns, coefficients) + columns[j] @ coefficients
    dq = np.concatenate([states.dq_motor[states.rows, j] for states in kinds.runs])
    return bool(np.mean(dq * friction < 0) > DRIVES)
