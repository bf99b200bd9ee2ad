"""One gear after the choice of its terms, and the kinds of the catalogue that these are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.deflection.choice import Choice
from dynid_rs.diagnosis.deflection.gear import Gear
from dynid_rs.diagnosis.deflection.system import System
from dynid_rs.diagnosis.deflection.terms import PLAY

FloatArray = NDArray[np.float64]

SPRING = ("compliance", "damping", "cubic", "hysteresis", "link_friction")
"""Terms of an elastic gear."""
KIND_OF = {"delay": "encoder_delay", "backlash": "backlash", "eccentricity": "encoder_eccentricity"}
LEAST_DELAY = 5e-3
"""Of a sample: clocks are not compared more finely."""
LATE = 1e-5
"""Chance of a delay where there is none, of one joint."""


@dataclass(frozen=True, eq=False)
class Examined:
    """One gear after the choice: its terms with coefficients and covariance, shapes behind them."""

    joint: int
    gear: Gear
    choice: Choice
    u: FloatArray
    x: FloatArray
    covariance: FloatArray
    system: System
    units: tuple[str, str]

    @property
    def names(self) -> tuple[str, ...]:
        """Terms in use."""
        return self.choice.names

    def places(self, name: str) -> list[int]:
        """Places of a term's coefficients, or of its shape's change (name and a prime), in `x` and `covariance`."""
        columns = [*self.names, *(other for other in self.system.columns if other.endswith("'"))]
        return self.system.among(columns, name)

    def value(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Coefficients of a term and their standard errors."""
        places = self.places(name)
        return self.x[places], np.sqrt(np.maximum(np.diag(self.covariance)[places], 0.0))

    @property
    def delay(self) -> tuple[float, float]:
        """Of the link channel [s], and its standard error."""
        value, std = self.value("delay")
        return self.gear.runs[0].delay + float(value[0]), float(std[0])

    @property
    def is_late(self) -> bool:
        """Whether the two channels have different clocks."""
        delay, std = self.delay
        from scipy.stats import norm

        significant = bool(2 * norm.sf(abs(delay) / max(std, 1e-300)) < LATE)
        return significant and abs(delay) > LEAST_DELAY / self.gear.runs[0].rate

    def groups(self) -> dict[str, list[str]]:
        """Kinds other than the delay, and the terms that each is made of; the largest first."""
        spring = [name for name in self.names if name in SPRING]
        ripples = [name for name in self.names if name.startswith("ripple")]
        groups: dict[str, list[str]] = {}
        if "compliance" in spring:
            groups["nonlinear_elasticity" if "cubic" in spring else "joint_elasticity"] = spring + ripples
        elif ripples:
            groups["gear_kinematic_error"] = ripples
        if "backlash" in self.names:
            groups["backlash"] = [name for name in self.names if name in PLAY]
        if "eccentricity" in self.names:
            groups[KIND_OF["eccentricity"]] = ["eccentricity"]
        size = {kind: self._size(names) for kind, names in groups.items()}
        return dict(sorted(groups.items(), key=lambda item: -size[item[0]]))

    def _size(self, names: list[str]) -> float:
        others = [name for name in self.names if name not in names]
        return self.system.power(others)


def kinds_of(terms: Sequence[str]) -> tuple[str, ...]:
    """Kinds of the catalogue that terms belong to."""
    kinds = [KIND_OF.get(name, "joint_elasticity") for name in terms]
    kinds = ["nonlinear_elasticity" if name == "cubic" else kind for name, kind in zip(terms, kinds, strict=True)]
    return tuple(dict.fromkeys(kinds))
