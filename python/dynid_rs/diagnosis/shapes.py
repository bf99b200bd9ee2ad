"""Shapes between the grid's values, by the evidence."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.hypotheses import Catalogue, Hypothesis
from dynid_rs.diagnosis.shaped import Shaped, is_valid
from dynid_rs.model.placed import CATALOGUE

Parameter = dict[str, Any]

MOST_TRIES = 40
"""Shapes that are tried; the evidence is smooth near its best."""
CLOSE = 0.02
"""Steps of the search that are none, in its own coordinates: octaves where a parameter has a scale."""


def searched(kind: str) -> list[Parameter]:
    """Shape parameters of a kind that lie between the grid's values too."""
    return [p for p in CATALOGUE[kind]["shape"] if p["lowest"] is not None]


def in_range(parameter: Parameter, value: float) -> bool:
    """Whether a value is one that a shape parameter may have; what has a scale may be of either sign."""
    size = abs(value) if parameter["scale"] == "log" else value
    return bool(parameter["lowest"] < size < parameter["highest"])


def is_at_an_end(s: Shaped) -> bool:
    """Whether a size among the searched parameters is where the kind's shapes end: the data want one beyond them."""
    return any(
        not in_range(parameter, dict(s.shape)[parameter["name"]] * factor)
        for parameter in searched(s.kind)
        if parameter["scale"] == "log"
        for factor in (2.0**-CLOSE, 2.0**CLOSE)
    )


def polished(beside: Beside, catalogue: Catalogue, hypothesis: Hypothesis) -> Hypothesis:
    """Return the hypothesis with the shape near its own under which the data are most probable.

    What returns has a first harmonic: with twice its cycles, where those do as well.
    """
    if hypothesis.kind not in CATALOGUE or not searched(hypothesis.kind):
        return hypothesis
    value, best = _near(beside, catalogue, hypothesis)
    cycles = dict(best.shape).get("cycles")
    if cycles is None or value <= SURE:  # of what the data do not see every multiple does as well
        return best
    twice = Shaped(best.kind, best.joints, best.shape).with_shape("cycles", 2 * cycles)
    if not is_valid(twice.kind, twice.shape):
        return best
    (other,) = catalogue.of([twice])
    return _near(beside, catalogue, other)[1] if beside.screened([other])[0].value > value - SURE else best


def _near(beside: Beside, catalogue: Catalogue, hypothesis: Hypothesis) -> tuple[float, Hypothesis]:
    """The most probable shape near that of a hypothesis, and its score."""
    from scipy.optimize import minimize

    free = searched(hypothesis.kind)
    start = Shaped(hypothesis.kind, hypothesis.joints, hypothesis.shape)
    best = (beside.screened([hypothesis])[0].value, hypothesis)

    def shaped(x: np.ndarray) -> Shaped | None:
        moved = start
        for parameter, value in zip(free, x, strict=True):
            own = dict(start.shape)[parameter["name"]]
            new = own * float(np.exp2(value)) if parameter["scale"] == "log" else own + float(value)
            if not in_range(parameter, new):
                return None
            moved = moved.with_shape(parameter["name"], new)
        return moved if is_valid(moved.kind, moved.shape) and catalogue.returns(moved) else None

    def less(x: np.ndarray) -> float:
        nonlocal best
        there = shaped(x)
        if there is None:
            return 1e6
        (h,) = catalogue.of([there])
        value = beside.screened([h])[0].value
        if value > best[0]:
            best = (value, h)
        return -value

    steps = [0.5 if p["scale"] == "log" else 0.1 for p in free]
    simplex = np.concatenate([np.zeros((1, len(free))), np.diag(steps)])
    options: Any = {"initial_simplex": simplex, "maxfev": MOST_TRIES, "xatol": CLOSE, "fatol": 0.05}
    minimize(less, np.zeros(len(free)), method="Nelder-Mead", options=options)
    return best
