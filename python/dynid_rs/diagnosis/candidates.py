"""Candidates: a kind at a place with a shape that the runs have not refuted, and what its torque does where that moves.

A kind imitates another one by its shape too. Slopes reach as far as the shape changes little; where a kind can do the
same with quite another shape, that one is a candidate beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.hypotheses import Catalogue, Hypothesis
from dynid_rs.diagnosis.shaped import Place, Shape, Shaped, is_valid
from dynid_rs.diagnosis.shapes import Parameter, searched
from dynid_rs.diagnosis.trials import Value
from dynid_rs.model.placed import CATALOGUE
from dynid_rs.regression.linear_model import Columns

FloatArray = NDArray[np.float64]

PHASE = "phase"
"""The shape parameter that is an angle."""
SPREAD, STEP = 0.5, 0.1
"""How far a shape parameter of a candidate may be off beforehand (as a logarithm where it has a scale), over the gaps
between the few that are kept; and the step of slopes."""
SHAPES, ALIVE = 6, 6.0
"""Shapes of a kind that are kept at most, and nats behind the best up to which one is: e^6 to 1 is refuted."""
LOOKED_AT = 48
"""Shapes of the grid that are looked at, those first that explain most."""
APART = 1.0
"""Distance of two shapes, in spreads, below which the slopes of one reach the other."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A kind at a place with its likeliest shape; or a function of an angle without a name (`any_function.py`).

    Parameters
    ----------
    kind, joints, shape
        As a hypothesis has them; of a function `unknown`, its joint, and the window that it is made on.
    unit : ndarray (k,)
        Own coefficients, in their own units, that are usual beforehand.
    mean : ndarray (k,)
        What the runs say they are if the kind is there, over `unit`.
    instead_of : tuple of int
        Places among the declared unknowns that it stands in the place of: its own, where it has the name.
    """

    kind: str
    joints: tuple[int, ...]
    shape: Shape
    unit: FloatArray
    mean: FloatArray
    instead_of: tuple[int, ...] = ()

    @property
    def place(self) -> Place:
        """Kind and joints."""
        return self.kind, self.joints


def alive(
    catalogue: Catalogue, value: Value, model: Beside, most: int = SHAPES
) -> list[tuple[Candidate, Columns, float]]:
    """Shapes of a place that the runs have not refuted, far apart, each with its slopes and how probable it is.

    The likeliest comes first; no more than `most`.
    """
    from scipy.special import softmax

    h, size = value.hypothesis, size_of(value.hypothesis, value.columns)
    own = Shaped(h.kind, h.joints, h.shape)
    grid = [s for s in catalogue.grid if (s.kind, s.joints) == h.place and s != own and most > 1]
    scores = np.array(
        [score.value for score in model.screened([replace(g, sizes=(size,)) for g in catalogue.of(grid)])]
    )
    chosen = [own]
    for k in np.argsort(-scores, kind="stable")[:LOOKED_AT].tolist():
        if len(chosen) < 2 * most and all(distance(grid[k], other) > APART for other in chosen):
            chosen.append(grid[k])
    every = [h, *catalogue.of(chosen[1:])]
    found = []
    for one in every:
        plain = {j: size * part for j, part in one.columns.items()}
        mean = model.with_columns(plain).best.x[-len(one.unit) :]
        candidate = Candidate(one.kind, one.joints, one.shape, size * one.unit, mean)
        found.append((candidate, with_slopes(catalogue, candidate, mean, plain)))
    wide = [
        replace(one, columns=columns, unit=np.ones(width_of(c)), bounds=_free(width_of(c)), sizes=(1.0,))
        for one, (c, columns) in zip(every, found, strict=True)
    ]
    values = np.array([score.value for score in model.screened(wide)])
    values[0] = values.max()  # it was polished
    kept = [k for k in np.argsort(-values, kind="stable").tolist() if values[k] > values[0] - ALIVE][:most]
    kept = [0, *(k for k in kept if k)][:most]
    weights = softmax(values[kept]).tolist()
    return [(*found[k], weight) for k, weight in zip(kept, weights, strict=True)]


def _free(width: int) -> FloatArray:
    """Bounds (width, 2) of coefficients that may be anything."""
    return np.tile([-np.inf, np.inf], (width, 1))


def distance(one: Shaped, other: Shaped) -> float:
    """Of two shapes of a kind, in spreads; where a parameter differs that is not searched they are far apart."""
    free, apart = {parameter["name"]: parameter for parameter in searched(one.kind)}, [0.0]
    for (name, a), (_, b) in zip(one.shape, other.shape, strict=True):
        if a != b:
            apart.append(_between(free[name], a, b) / SPREAD if name in free else np.inf)
    return float(np.linalg.norm(apart))


def _between(parameter: Parameter, a: float, b: float) -> float:
    """From one value of a shape parameter to another: a ratio's logarithm, or on a turn, or a difference."""
    if parameter["scale"] == "log":
        return abs(float(np.log(a / b))) if a * b > 0 else np.inf
    return abs((a - b + np.pi) % (2 * np.pi) - np.pi) if parameter["name"] == PHASE else abs(a - b)


def cell(parameter: Parameter, value: float) -> float:
    """Standard deviation of a shape parameter about a value of the whole grid, as a logarithm where it has a scale.

    Normal distributions about all values of an even grid add up to the density of its cells, one over the step, where
    they are as wide as the step over the root of two pi.
    """
    scaled = parameter["scale"] == "log"
    grid = [np.log(abs(x)) if scaled else x for x in parameter["grid"] if not scaled or x * value > 0]
    if len(grid) < 2:
        return SPREAD
    return float(np.ptp(grid)) / (len(grid) - 1) / math.sqrt(2 * math.pi)


def with_slopes(
    catalogue: Catalogue,
    h: Candidate | Hypothesis,
    mean: FloatArray,
    columns: Columns,
    spread: Callable[[Parameter, float], float] = lambda parameter, value: SPREAD,
) -> Columns:
    """Columns of a kind, and behind them what its torque changes by where its shape is a little another one.

    Those are for coefficients that are standard normal beforehand: a kind imitates another one by its shape too.
    `mean` (k,) of its own coefficients, over their units; `spread` of each parameter beforehand.
    """
    free = free_shape(h) if h.kind in CATALOGUE else []
    if not free:
        return columns
    own = Shaped(h.kind, h.joints, h.shape)
    size = h.unit * mean
    steps = [(_moved(own, parameter, -STEP), _moved(own, parameter, STEP)) for parameter in free]
    ends = iter(catalogue.of([shaped for pair in steps for shaped in pair]))
    slopes: dict[int, list[FloatArray]] = {j: [] for j in columns}
    for parameter, low, high in zip(free, ends, ends, strict=True):
        off = spread(parameter, dict(own.shape)[parameter["name"]])
        for j, parts in slopes.items():
            torque = [end.columns[j] @ (size / np.where(end.unit > 0, end.unit, np.inf)) for end in (low, high)]
            parts.append(off * (torque[1] - torque[0]) / (2 * STEP))
    return {j: np.column_stack([part, *slopes[j]]) for j, part in columns.items()}


def width_of(candidate: Candidate) -> int:
    """Coefficients of a candidate: its own, and those of its shape."""
    return len(candidate.unit) + (len(free_shape(candidate)) if candidate.kind in CATALOGUE else 0)


def free_shape(h: Candidate | Hypothesis) -> list[Parameter]:
    """Shape parameters that lie between the grid's values too, where a little less and more is a shape."""
    own = Shaped(h.kind, h.joints, h.shape)
    return [
        parameter
        for parameter in searched(h.kind)
        if (parameter["scale"] == "linear" or dict(h.shape)[parameter["name"]] != 0.0)
        and all(is_valid(own.kind, _moved(own, parameter, step).shape) for step in (-STEP, STEP))
    ]


def _moved(own: Shaped, parameter: Parameter, step: float) -> Shaped:
    """A shape with one parameter moved: what has a scale by a factor, all else by the step."""
    value = dict(own.shape)[parameter["name"]]
    moved = value * (1 + step) if parameter["scale"] == "log" else value + step
    return own.with_shape(parameter["name"], moved)


def size_of(h: Hypothesis, columns: Columns) -> float:
    """By how much the columns of a place are larger than its hypothesis': the size that is likeliest beforehand."""
    j = next(iter(columns))
    return float(np.linalg.norm(columns[j]) / max(float(np.linalg.norm(h.columns[j])), 1e-300))
