"""A kind of the catalogue at a place with a shape, and how far a shape may go."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.placed import CATALOGUE, PlacedEffect

FloatArray = NDArray[np.float64]
Shape = tuple[tuple[str, float], ...]

REFINED: dict[str, dict[str, tuple[str, float, float]]] = {
    "stribeck": {"stribeck_velocity": ("log", 1e-3, 10.0), "exponent": ("log", 0.5, 4.0)},
    "friction_hysteresis": {"presliding_distance": ("log", 1e-5, 0.3)},
    "load_hysteresis": {"presliding_distance": ("log", 1e-5, 0.3)},
    "gear_hysteresis": {"hysteresis_load": ("log", 1e-4, 1e5), "carried_load": ("log", 1e-4, 1e5)},
    "coupled_friction": {"ratio": ("linear", -5.0, 5.0)},
    "torque_ripple": {"cycles": ("linear", 3.0, 1e4)},
    "counterbalance": {
        "b": ("log", 0.02, 0.95),
        "phase": ("linear", -4.0, 4.0),
        "gas_length": ("log", 0.05, 100.0),
    },
    "thermal_friction": {"time_constant": ("log", 5.0, 300.0)},
}
"""Shape parameters that are searched between the grid's values: how, and within which bounds."""
FREE_ENDS = ("b", "carried_load")
"""Shape parameters that may be as small as their search goes: a lever as short as can be is a cylinder all the same,
one that pulls like a weight, and teeth may carry nothing."""
AT_BOUND = 0.01
"""A shape parameter this near to a bound, relatively, stands at it."""


@dataclass(frozen=True)
class Hypothesis:
    """A kind at a place with a shape (of the first joint, where a pair shares one)."""

    kind: str
    joints: tuple[int, ...]
    shape: Shape

    def with_shape(self, name: str, value: float) -> Hypothesis:
        """Return it with one shape parameter at `value`."""
        return replace(self, shape=tuple((n, value if n == name else v) for n, v in self.shape))

    def placed(self) -> PlacedEffect:
        """Return it as an effect of a model."""
        names = [name for name, _ in self.shape]
        rows = [dict(of_partner(self, at)) for at in range(len(self.joints))]
        return PlacedEffect(self.kind, self.joints, tuple((name, tuple(row[name] for row in rows)) for name in names))


def of_partner(hypothesis: Hypothesis, at: int) -> Shape:
    """Shape on joint `at` of the hypothesis: partners see each other, with the inverse ratio."""
    if len(hypothesis.joints) == 1:
        return hypothesis.shape
    shape = dict(hypothesis.shape)
    shape["partner"] = float(hypothesis.joints[1 - at])
    if at == 1 and "ratio" in shape:
        shape["ratio"] = 1 / shape["ratio"]
        shape["transition_width"] = shape["transition_width"] * abs(shape["ratio"])
    return tuple(shape.items())


def bounds_of(hypothesis: Hypothesis) -> FloatArray:
    """What physics allows of the coefficients, (k, 2)."""
    entry = CATALOGUE[hypothesis.kind]
    bounds = [(c["lower"], c["upper"]) for c in entry["coefficients"]]
    return np.array(bounds * len(hypothesis.joints), dtype=np.float64)


def is_valid(kind: str, shape: Shape) -> bool:
    """Whether there is an effect of this shape."""
    try:
        _core.Effect.of(kind, **{name: [value] for name, value in shape})
    except ValueError:
        return False
    return True


def at_a_bound(hypothesis: Hypothesis) -> bool:
    """Whether a searched shape ended where its search had to stop: another kind is meant, or nothing.

    A pre-sliding way of nothing is Coulomb friction. A time constant beyond the run is friction that goes on changing.
    """
    shape = dict(hypothesis.shape)
    for name, (how, low, high) in REFINED.get(hypothesis.kind, {}).items():
        if how != "log" or name == "gas_length":
            continue  # an angle, a ratio or an order may be any; a gas column without end is a plain spring
        if has_no_end(hypothesis.kind, hypothesis.shape):
            continue
        value = abs(shape[name])
        too_low = value <= low * (1 + AT_BOUND) and name not in FREE_ENDS
        if too_low or value >= high * (1 - AT_BOUND):
            return True
    return False


def has_no_end(kind: str, shape: Shape) -> bool:
    """Whether a shape ended where the data cannot follow: warming up that goes on beyond the runs."""
    _, _, high = REFINED["thermal_friction"]["time_constant"]
    return kind == "thermal_friction" and dict(shape)["time_constant"] >= high * (1 - AT_BOUND)
