"""Which effect: a kind of the catalogue at a place with a shape, before any data."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.model.placed import CATALOGUE, PlacedEffect

FloatArray = NDArray[np.float64]
Shape = tuple[tuple[str, float], ...]
Place = tuple[str, tuple[int, ...]]


@dataclass(frozen=True)
class Shaped:
    """A kind of the catalogue at a place with a shape (of the first joint, where a pair shares one)."""

    kind: str
    joints: tuple[int, ...]
    shape: Shape

    def at(self, place: int) -> Shape:
        """Shape on joint number `place` of its joints: partners see each other, with the inverse ratio."""
        if len(self.joints) == 1:
            return self.shape
        shape = dict(self.shape)
        shape["partner"] = float(self.joints[1 - place])
        if place == 1 and "ratio" in shape:
            shape["ratio"] = 1 / shape["ratio"]
            shape["transition_width"] = shape["transition_width"] * abs(shape["ratio"])
        return tuple(shape.items())

    def with_shape(self, name: str, value: float) -> Shaped:
        """Return it with one shape parameter at `value`."""
        return replace(self, shape=tuple((n, value if n == name else v) for n, v in self.shape))

    def reaction(self, place: int) -> FloatArray:
        """Coefficients (k,) on joint number `place` of its joints over those on the first: forces act on both."""
        if place == 0:
            return np.ones(len(CATALOGUE[self.kind]["coefficients"]))
        shape = {name: [value, dict(self.at(1))[name]] for name, value in self.shape}
        felt = _core.Effect.of(self.kind, **shape | {"partner": [1.0, 0.0]}).reaction(0)
        assert felt is not None  # it has a partner
        return np.array(felt[1])

    def placed(self) -> PlacedEffect:
        """Return it as an effect of a model."""
        rows = [dict(self.at(place)) for place in range(len(self.joints))]
        shape = tuple((name, tuple(row[name] for row in rows)) for name, _ in self.shape)
        return PlacedEffect(self.kind, self.joints, shape)


def shaped_as(effect: PlacedEffect) -> Shaped:
    """The effect of a model as a hypothesis has it."""
    shape = effect.shape_at(effect.joints[0])
    if "partner" in shape:
        shape["partner"] = -1.0
    return Shaped(effect.kind, effect.joints, tuple(shape.items()))


def is_valid(kind: str, shape: Shape) -> bool:
    """Whether there is an effect of this shape that a search may have."""
    values = dict(shape)
    if values.get("ratio") == 0.0:
        return False  # a partner that has no part in it is none
    bounded = [p for p in CATALOGUE[kind]["shape"] if p["not_below"] is not None]
    if any(values[p["name"]] < values[p["not_below"]] for p in bounded):
        return False
    try:
        _core.Effect.of(kind, **{name: [value] for name, value in shape})
    except ValueError:
        return False
    return True
