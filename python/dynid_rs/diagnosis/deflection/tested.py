"""A gear in runs that it has not seen: what its terms leave there, and pictures of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.deflection.examined import Examined
from dynid_rs.diagnosis.deflection.gear import Gear
from dynid_rs.diagnosis.deflection.signals import GearSignals
from dynid_rs.diagnosis.deflection.system import System, centred

FloatArray = NDArray[np.float64]

PLOTTED = 800
"""Points of a picture at most."""


@dataclass(frozen=True, eq=False)
class Tested:
    """The test runs of one gear: what subsets of its terms leave there, each fitted to the training runs."""

    gear: Examined
    system: System

    @staticmethod
    def of(gear: Examined, runs: Sequence[GearSignals]) -> Tested:
        """Put the gear into the test runs."""
        n = sum(len(gear.system.places[name]) for name in gear.names)
        return Tested(
            gear, gear.gear.on(_without_rotor(gear.gear, runs), gear.names, gear.u, gear.x[:n]).system(gear.names)
        )

    def left(self, names: Sequence[str]) -> FloatArray:
        """Deflection that the terms `names` leave, in use, all runs."""
        if set(names) == set(self.gear.names):
            u, x = self.gear.u, self.gear.x[: sum(len(self.gear.system.places[name]) for name in names)]
        else:
            u, x = self.gear.system.coefficients(names)
        fitted = self.system.fitted(names, u, x)
        runs = self.system.runs
        return np.concatenate(
            [(w - part)[run.used] for w, part, run in zip(self.system.deflection, fitted, runs, strict=True)]
        )

    def raw(self) -> FloatArray:
        """Deflection as the encoders show it, about its mean in every run."""
        return np.concatenate([centred(run, run.deflection)[run.used] for run in self.system.runs])

    def picture(self, names: Sequence[str], signal: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Signal, partial residual and fitted part of the terms `names`."""
        others = [name for name in self.gear.names if name not in names]
        n = sum(len(self.gear.system.places[name]) for name in self.gear.names)
        x = self.gear.x[:n].copy()
        for name in others:
            x[self.gear.system.among(self.gear.names, name)] = 0.0
        u = self.gear.u if "compliance" in names else np.zeros_like(self.gear.u)
        curve = self.system.fitted(self.gear.names, u, x)
        whole = self.system.fitted(self.gear.names, self.gear.u, self.gear.x[:n])
        runs = self.system.runs
        late = signal == "dq"
        shift = [centred(run, run.shift) if late else np.zeros(len(run.shift)) for run in runs]
        curve = [part + s for part, s in zip(curve, shift, strict=True)]
        left = [w - part for w, part in zip(self.system.deflection, whole, strict=True)]
        at = [_signal(run, signal, self.gear.gear.shapes.orders) for run in runs]
        parts = [
            np.concatenate([x[run.used] for x, run in zip(values, runs, strict=True)])
            for values in (at, [e + part for e, part in zip(left, curve, strict=True)], curve)
        ]
        step = max(1, len(parts[0]) // PLOTTED)
        return parts[0][::step], parts[1][::step], parts[2][::step]


def _without_rotor(gear: Gear, runs: Sequence[GearSignals]) -> list[GearSignals]:
    return [replace(run, load=run.load - gear.rotor * run.load_error[:, -1]) for run in runs]


def _signal(run: GearSignals, name: str, orders: Sequence[float]) -> FloatArray:
    if name == "tooth":
        return np.mod(run.q_motor * orders[0], 2 * np.pi)
    return {"load": run.load, "q": run.q_shown, "dq": run.dq}[name]


def rms(x: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(x**2)))
