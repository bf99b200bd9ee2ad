"""What a deflection may be made of: terms with their columns, the signs that physics gives, and what they presuppose.

``q_motor - q = o + tau/K - D/K^2 d(tau - z_max z)/dt + c tau^3 + g/2 s(tau/w) - z_max/K z + d dq - e_c cos q - ...``
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.deflection.signals import GearSignals

FloatArray = NDArray[np.float64]

MOST_ECCENTRICITY = 0.25
"""An encoder whose error is larger [rad] shows another joint."""
LEAST_SIDE = 0.02
"""Play is seen where the load has either sign in this part of the samples at least."""
LEAST_TURN = 1.0
"""Over less than this angle [rad] an error once per turn is a mere bend, which everything slow can imitate."""
REVERSAL_WIDTH = 0.01
"""Of the greatest speed: where friction on the link's side changes its sign."""

ENGAGED = 1.6
"""How teeth share the load while play is crossed is not one law: a step may have a sharper or a softer shoulder, made
of steps this factor wider and narrower. It leaves the gap itself alone."""


@dataclass(frozen=True)
class Term:
    """One reason why the motor is not where the link is.

    Parameters
    ----------
    name : str
        Of the term.
    sign : int
        Of its coefficient; 0 where both are possible.
    parent : str
        Term without which it has no meaning; empty where it stands by itself.
    turning : bool
        Whether only joints that turn can have it.
    most : float
        Greatest size of its coefficients that is no nonsense.
    """

    name: str
    sign: int = 0
    parent: str = ""
    turning: bool = False
    most: float = np.inf


TERMS = {
    term.name: term
    for term in (
        Term("delay"),
        Term("compliance", sign=1),
        Term("damping", sign=-1, parent="compliance"),
        Term("cubic", parent="compliance"),
        Term("hysteresis", sign=-1, parent="compliance"),
        Term("link_friction", sign=1, parent="compliance"),
        Term("backlash", sign=1),
        Term("engagement", parent="backlash"),
        Term("eccentricity", turning=True, most=MOST_ECCENTRICITY),
    )
}


PLAY = ("backlash", "engagement")
"""Terms of a gap."""


def term(name: str) -> Term:
    """Return the term of a name; `ripple 0` is the first of the gear's kinematic errors."""
    return TERMS.get(name) or Term(name, turning=True)


@dataclass(frozen=True)
class Shapes:
    """What does not enter linearly, of one gear.

    Parameters
    ----------
    width : float
        Load within which the play is crossed [N m].
    distance : float
        Way over which the hysteretic torque turns round [rad].
    orders : tuple of float
        Cycles per turn of the gear's kinematic errors.
    """

    width: float = 1.0
    distance: float = 1.0
    orders: tuple[float, ...] = ()

    def bent(self, name: str, by: float) -> Shapes:
        """Return the same with the shape of one term changed: `by` in the logarithm, of an order in cycles."""
        if name == "backlash":
            return replace(self, width=self.width * float(np.e**by))
        if name == "hysteresis":
            return replace(self, distance=self.distance * float(np.e**by))
        orders = list(self.orders)
        orders[_index(name)] += by
        return replace(self, orders=tuple(orders))


def ripple_name(index: int) -> str:
    """Name of the term of one kinematic error."""
    return f"ripple {index}"


def _index(name: str) -> int:
    return int(name.removeprefix("ripple "))


def has_shape(name: str) -> bool:
    """Whether a term has a shape parameter."""
    return name in ("backlash", "hysteresis") or name.startswith("ripple ")


def columns_of(name: str, run: GearSignals, shapes: Shapes, z: FloatArray, lost: float = 0.0) -> FloatArray:
    """Deflection per unit coefficient, (n, n_columns); `lost` [N m] of the load is what z takes before the spring."""
    load = run.load
    if name == "delay":
        return run.dq[:, None]
    if name == "compliance":
        return load[:, None]
    if name == "damping":
        return np.gradient(load - lost * z, 1 / run.rate)[:, None]
    if name == "cubic":
        return load[:, None] ** 3
    if name == "backlash":
        return step(load, shapes.width)[:, None]
    if name == "engagement":
        wider, narrower = (step(load, shapes.width * factor) for factor in (ENGAGED, 1 / ENGAGED))
        return (wider + narrower - 2 * step(load, shapes.width))[:, None]
    if name == "hysteresis":
        return z[:, None]
    if name == "link_friction":
        return step(run.dq, REVERSAL_WIDTH * float(np.abs(run.dq).max()))[:, None]
    if name == "eccentricity":
        # The motor's angle: it does not hold the error itself.
        return np.stack([np.cos(run.q_motor), np.sin(run.q_motor)], axis=1)
    angle = shapes.orders[_index(name)] * run.q_motor
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def step(x: FloatArray, width: float) -> FloatArray:
    """Smooth sign of x (n,), -1 to 1 over about twice `width`."""
    return np.asarray(_core.friction_basis(np.ascontiguousarray(x), 0.0, max(width, 1e-12))[:, :2].sum(axis=1))


def presliding(path: FloatArray, distance: float) -> FloatArray:
    """State z of Dahl's model along a way (n,) that turns round over `distance`, at rest at first."""
    along = np.ascontiguousarray(path[:, None])
    still = np.zeros_like(along)
    effect = _core.Effect.of("friction_hysteresis", presliding_distance=np.array([max(distance, 1e-12)]))
    return np.asarray(_core.effect_columns(effect, still, still, still, along, still, still)[:, 0, 0])
