"""Shapes that are not the laboratory's own: every case draws the shape parameters of its effect anew."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dynid_rs.simulation.effects.base import LabEffect
from dynid_rs.simulation.effects.columns import ColumnEffect, column_effect, entry_of

FloatArray = NDArray[np.float64]

FACTORS = {
    "stribeck": ("stribeck_velocity", 0.5, 2.0),
    "friction_hysteresis": ("presliding_distance", 0.3, 3.0),
    "load_hysteresis": ("presliding_distance", 0.3, 3.0),
    "thermal_friction": ("time_constant", 0.15, 1.5),
    "counterbalance": ("b", 0.6, 1.4),
}
"""Shape parameter and the range of the factor on the laboratory's value, drawn in its logarithm."""
CYCLES = {"position_dependent_friction": (1, 3), "torque_ripple": (5, 100)}
"""Cycles per turn."""
TURNED = {
    "position_dependent_friction": (("position_friction_cos", "position_friction_sin"),),
    "torque_ripple": (("ripple_cos1", "ripple_sin1"), ("ripple_cos2", "ripple_sin2")),
}
"""Pairs of coefficients that are turned by a drawn phase."""


def varied(effect: ColumnEffect, n_joints: int, rng: np.random.Generator) -> Callable[[float], LabEffect]:
    """(size) -> the effect with a drawn shape, and coefficients `size` times its own."""
    kind = effect.kind
    shape = {name: np.array(values) for name, values in effect.shape.items()}
    names = [c["name"] for c in entry_of(kind)["coefficients"]]
    coefficients = {name: np.array(effect.coefficients[:, at]) for at, name in enumerate(names)}
    if kind in FACTORS:
        name, low, high = FACTORS[kind]
        shape[name] = shape[name] * 2.0 ** rng.uniform(np.log2(low), np.log2(high))
    if kind in CYCLES:
        low, high = CYCLES[kind]
        shape["cycles"] = np.full(n_joints, float(round(2.0 ** rng.uniform(np.log2(low), np.log2(high)))))
    if kind == "coupled_friction":
        shape["ratio"] = np.full(n_joints, float(rng.choice([-1.0, 1.0])))
    for cosine, sine in TURNED.get(kind, ()):
        a, b, phase = coefficients[cosine], coefficients[sine], rng.uniform(0.0, 2 * np.pi)
        coefficients[cosine] = np.cos(phase) * a + np.sin(phase) * b
        coefficients[sine] = np.cos(phase) * b - np.sin(phase) * a

    def of_size(size: float) -> LabEffect:
        return column_effect(kind, effect.joints, size, shape, {name: size * x for name, x in coefficients.items()})

    return of_size
