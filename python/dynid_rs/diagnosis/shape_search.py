"""The shape near a hypothesis' own that takes off most, beside all the rest."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.candidate import joined
from dynid_rs.diagnosis.hypothesis import REFINED, Hypothesis, is_valid
from dynid_rs.diagnosis.kinds import Kinds

FloatArray = NDArray[np.float64]

STARTS = {"stribeck": ("exponent", (1.0, 2.0))}
"""Shape parameters whose search has several valleys, and where it begins besides."""
OCTAVE = 0.02
"""Part of what a ripple takes off that its first harmonic has to be: less is the chance of two more coefficients."""
SEARCH_STEPS = 40
"""Most evaluations of one search, for each parameter."""
NEAR, ALIKE = 3e-3, 1e-2
"""Where a search ends: shapes this near (octaves), and weighted residual powers this near (chance alone moves them by
about 1)."""


def refined_shape(
    kinds: Kinds, hypothesis: Hypothesis, power: Any, *, with_friction: bool = False, own_order: bool = False
) -> Hypothesis:
    """Hypothesis with the shape near its own that takes off most; `power` of columns {joint: (n_rows, k)}.

    What is believed of a shape is held against it, in the unit of `power`: see `valleys.explained`.

    `with_friction`: the width of friction's transition is searched too, and friction's columns with it stand
    behind the hypothesis' own in what `power` is given. `own_order`: a ripple may turn out to have twice its order.
    """
    name, starts = STARTS.get(hypothesis.kind, ("", ()))
    tried = [_refined(kinds, hypothesis, power, with_friction)]
    for start in starts if with_friction else ():
        tried.append(_refined(kinds, hypothesis.with_shape(name, start), power, with_friction))
    if own_order and hypothesis.kind == "torque_ripple":
        return _fundamental(kinds, *tried[0], power)
    return max(tried, key=lambda pair: pair[0])[1]


def _fundamental(kinds: Kinds, taken: float, ripple: Hypothesis, power: Any) -> Hypothesis:
    """The ripple at twice its order where that takes off as much: its second harmonic was the line."""
    low, high = REFINED[ripple.kind]["cycles"][1:]
    double = 2 * dict(ripple.shape)["cycles"]
    if not low <= double <= high:
        return ripple
    found, other = _refined(kinds, ripple.with_shape("cycles", double), power, False)
    return other if found > (1 - OCTAVE) * taken else ripple


def _refined(kinds: Kinds, hypothesis: Hypothesis, power: Any, with_friction: bool) -> tuple[float, Hypothesis]:
    """Power and hypothesis of one search from the hypothesis' own shape."""
    from scipy.optimize import minimize

    searched = dict(REFINED.get(hypothesis.kind, {}))
    shape = dict(hypothesis.shape)
    if with_friction:
        searched["transition_width"] = ("log", 1e-4, 1.0)
        shape.setdefault("transition_width", float(kinds.widths[hypothesis.joints[0]]))
    if not searched:
        return 0.0, hypothesis

    def at(x: FloatArray) -> tuple[Hypothesis, dict[str, float]]:
        moved = dict(shape)
        for (name, (how, low, high)), value in zip(searched.items(), x, strict=True):
            sign = -1.0 if how == "log" and shape[name] < 0 else 1.0
            real = sign * float(np.exp2(value)) if how == "log" else float(value)
            moved[name] = sign * min(max(abs(real), low), high) if how == "log" else min(max(real, low), high)
        return replace(hypothesis, shape=tuple((name, moved[name]) for name, _ in hypothesis.shape)), moved

    def cost(x: FloatArray) -> float:
        h, moved = at(x)
        if not is_valid(h.kind, h.shape):
            return np.inf
        columns = kinds.once(h)
        if with_friction:
            columns = joined([columns, kinds.friction(h.joints[0], moved["transition_width"])])
        return kinds.doubt(h) - float(power(columns))

    start = np.array(
        [
            np.log2(min(max(abs(shape[name]), low), high)) if how == "log" else shape[name]
            for name, (how, low, high) in searched.items()
        ]
    )
    spans = [0.5 if how == "log" else _span(name) for name, (how, *_) in searched.items()]
    simplex = np.vstack([start, *(start + span * row for span, row in zip(spans, np.eye(len(start)), strict=True))])
    options: Any = {
        "initial_simplex": simplex,
        "maxfev": SEARCH_STEPS * len(start),
        "xatol": NEAR,
        "fatol": ALIKE,
    }
    found = minimize(cost, start, method="Nelder-Mead", options=options)
    return (-float(found.fun), at(found.x)[0]) if found.fun < cost(start) else (-cost(start), hypothesis)


def _span(name: str) -> float:
    return {"phase": 0.3, "ratio": 0.2, "cycles": 0.2}[name]
