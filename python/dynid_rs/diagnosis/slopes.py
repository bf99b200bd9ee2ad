"""How the torque changes with the shapes of effects and of friction: for steps towards better ones, and for intervals.

Signs of effects turn round with their joint's friction (`relative_to` in the catalogue), so the width of that sign is
one parameter of all of them: a wide sign that nearly hides a peak of friction, and a narrow one beside a smaller peak,
may fit alike.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.shaped import Shaped, is_valid, shaped_as
from dynid_rs.diagnosis.shapes import searched
from dynid_rs.identification.smooth_friction import shape_slopes
from dynid_rs.model.placed import CATALOGUE, PlacedEffect, shapes_of_sign
from dynid_rs.regression.linear_model import Columns

FloatArray = NDArray[np.float64]

STEP = 1e-2
"""Step of a shape parameter's derivative, relative or in its own unit."""


@dataclass(frozen=True, eq=False)
class Slope:
    """Change of the torque with one shape parameter (with the logarithm of a scale).

    `effect` is None for friction on joint `joint`, whose width carries the signs of all effects there.
    """

    effect: PlacedEffect | None
    joint: int
    name: str
    columns: Columns


def effect_slopes(found: Belief) -> list[Slope]:
    """Of every effect's shapes that are searched."""
    slopes = []
    for effect, x in coefficients_of(found):
        for parameter in searched(effect.kind):
            columns = _slope(found, effect, parameter["name"], x)
            if columns is not None:
                slopes.append(Slope(effect, effect.joints[0], parameter["name"], columns))
    return slopes


def friction_slopes(found: Belief) -> list[Slope]:
    """Of every joint's friction: width, with the signs that follow it, and sharpness."""
    fit, n = found.fit, found.setup.robot.n_joints
    plan = fit.observations_.plan
    following: list[list[Columns]] = [[{}, {}] for _ in range(n)]
    for effect, x in coefficients_of(found):
        own = following[effect.joints[0]]
        for name, k in shapes_of_sign(effect.kind).items():
            own[k] = _sum(own[k], _slope(found, effect, name, x) or {})
    slopes = []
    for j, signs in enumerate(following):
        both = shape_slopes(plan, fit.links_, fit.runs_, j)
        for k, name in enumerate(("transition_width", "sharpness")):
            slopes.append(Slope(None, j, name, _sum(signs[k], {j: both[:, k : k + 1]})))
    return slopes


def coefficients_of(found: Belief) -> Iterator[tuple[PlacedEffect, FloatArray]]:
    """Every torque that was found, with its coefficients."""
    for effect, places in zip(found.setup.effects, found.places(), strict=True):
        yield effect, found.fit.links_.x_[[at for _, at in places]]


def is_logarithmic(kind: str, name: str) -> bool:
    """Whether a shape parameter is a scale."""
    parameter = next(p for p in CATALOGUE[kind]["shape"] if p["name"] == name)
    return bool(parameter["scale"] != "linear")


def _slope(found: Belief, effect: PlacedEffect, name: str, own: FloatArray) -> Columns | None:
    """One column; None at the edge of what the shape may be."""
    shaped = shaped_as(effect)
    value = dict(shaped.shape)[name]
    if is_logarithmic(effect.kind, name):
        ends, width = [value / (1 + STEP), value * (1 + STEP)], 2 * float(np.log1p(STEP))
    else:
        ends, width = [value - STEP, value + STEP], 2 * STEP
    both: list[Shaped] = [shaped.with_shape(name, end) for end in ends]
    if not all(is_valid(s.kind, s.shape) for s in both):
        return None
    low, high = (found.catalogue.torque(s, own) for s in both)
    return {j: ((high[j] - low[j]) / width)[:, None] for j in low}


def _sum(one: Columns, other: Columns) -> Columns:
    return {j: np.sum([part[j] for part in (one, other) if j in part], axis=0) for j in {**one, **other}}
