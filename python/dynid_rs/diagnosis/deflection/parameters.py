"""Coefficients in the words of the catalogue: stiffness, damping, gap, ..., with units and 95 % intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dynid_rs.diagnosis.deflection.examined import Examined
from dynid_rs.uncertainty import NORMAL_95

IDEAL, IDEAL_SHAPE = 2e-3, 2e-2
"""No gear follows a law more closely than this part of its coefficients and of its shapes: one standard deviation."""
LOAD_PHASE = 0.015
"""Of a sample: the load is predicted in a band and its inner friction turns round between two samples, so its time is
not known better. A damping is a delay of the wind-up behind the load, so this is its error over the stiffness."""
IDEAL_GAP = 5e-3
"""The same of a gap: how its teeth share the load is not known, and the load that opens it never to the last."""
CLOSED = 1.83
"""Widths of the smooth sign within which 95 % of a gap are closed."""


@dataclass(frozen=True)
class Parameter:
    """A value with its unit and its 95 % interval."""

    name: str
    value: float
    unit: str
    interval: tuple[float, float]


def parameters_of(gear: Examined, kind: str, terms: Sequence[str]) -> tuple[Parameter, ...]:
    """Parameters of one kind in the words of the catalogue."""
    angle, torque = gear.units
    found: list[Parameter] = []
    if "compliance" in terms:
        found += _spring(gear, terms)
    for name in terms:
        if name.startswith("ripple"):
            found += _ripple(gear, name)
    if kind == "backlash":
        (half,), (std,) = gear.value("backlash")
        found.append(_parameter("gap", 2 * half, float(np.hypot(2 * std, IDEAL_GAP * 2 * half)), angle))
        width, relative = CLOSED * gear.gear.shapes.width, float(gear.value("backlash'")[1][0])
        found.append(_positive("transition_torque", width, relative, torque))
    if kind == "encoder_eccentricity":
        (cosine, sine), (cosine_std, sine_std) = gear.value("eccentricity")
        found.append(_parameter("cosine", -cosine, cosine_std, angle))
        found.append(_parameter("sine", -sine, sine_std, angle))
    return tuple(found)


def _spring(gear: Examined, terms: Sequence[str]) -> list[Parameter]:
    angle, torque = gear.units
    found = [_propagated(gear, "stiffness", f"{torque}/{angle}", lambda c: 1 / c, "compliance")]
    if "damping" in terms:
        unit = f"{torque}*s/{angle}"
        phase = LOAD_PHASE / gear.gear.runs[0].rate / float(gear.value("compliance")[0][0])
        found.append(_propagated(gear, "damping", unit, _damping, "compliance", "damping", floor=phase))
    if "cubic" in terms:
        found.append(_propagated(gear, "cubic", f"{angle}/({torque})^3", lambda a: a, "cubic"))
    if "hysteresis" in terms:
        found.append(_propagated(gear, "hysteresis", torque, lambda c, h: -h / c, "compliance", "hysteresis"))
        relative = float(gear.value("hysteresis'")[1][0])
        found.append(_positive("hysteresis_distance", gear.gear.shapes.distance, relative, angle))
    if "link_friction" in terms:
        found.append(_propagated(gear, "link_friction", torque, lambda c, f: f / c, "compliance", "link_friction"))
    return found


def _damping(compliance: float, coefficient: float) -> float:
    return -coefficient / compliance**2


def _propagated(
    gear: Examined, name: str, unit: str, formula: Callable[..., float], *terms: str, floor: float = 0.0
) -> Parameter:
    """A function of coefficients with the interval that their covariance gives it, and an error of its own."""
    places = [gear.places(term)[0] for term in terms]
    x = gear.x[places]
    value = float(formula(*x))
    slope = []
    for k in range(len(x)):
        by = 1e-6 * abs(x[k]) + 1e-300
        moved = x.copy()
        moved[k] += by
        slope.append((float(formula(*moved)) - value) / by)
    variance = float(np.array(slope) @ gear.covariance[np.ix_(places, places)] @ np.array(slope))
    return _parameter(name, value, float(np.hypot(np.sqrt(max(variance, 0.0)), floor)), unit)


def _ripple(gear: Examined, name: str) -> list[Parameter]:
    x, _ = gear.value(name)
    places = gear.places(name)
    size = float(np.hypot(*x))
    covariance = gear.covariance[np.ix_(places, places)]
    along, across = x / size, np.array([-x[1], x[0]]) / size
    radial = np.sqrt(max(float(along @ covariance @ along), 0.0))
    turned = np.sqrt(max(float(across @ covariance @ across), 0.0)) / size
    index = int(name.removeprefix("ripple "))
    ending = "" if index == 0 else f"_{index + 1}"
    order = gear.gear.shapes.orders[index]
    order_std = float(gear.value(f"{name}'")[1][0])
    return [
        _parameter(f"kinematic_error{ending}", size, radial, gear.units[0]),
        Parameter(
            f"kinematic_cycles{ending}", order, "1", (order - NORMAL_95 * order_std, order + NORMAL_95 * order_std)
        ),
        # a cos + b sin = size sin(N q_motor + phase)
        _parameter(f"kinematic_phase{ending}", float(np.arctan2(x[0], x[1])), turned, "rad"),
    ]


def _parameter(name: str, value: float, std: float, unit: str) -> Parameter:
    value, spread = float(value), NORMAL_95 * float(np.hypot(std, IDEAL * value))
    return Parameter(name, value, unit, (value - spread, value + spread))


def _positive(name: str, value: float, relative: float, unit: str) -> Parameter:
    """A shape, whose logarithm was fitted."""
    factor = float(np.e ** min(NORMAL_95 * float(np.hypot(relative, IDEAL_SHAPE)), 50.0))
    return Parameter(name, value, unit, (value / factor, value * factor))
