"""From a gear's chosen terms to findings: kinds of the catalogue, parameters with units and intervals, errors, plots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.deflection.choice import Choice
from dynid_rs.diagnosis.deflection.gear import Gear
from dynid_rs.diagnosis.deflection.signals import GearSignals
from dynid_rs.diagnosis.deflection.system import System, centred
from dynid_rs.uncertainty import NORMAL_95

FloatArray = NDArray[np.float64]

SPRING = ("compliance", "damping", "cubic", "hysteresis", "link_friction")
"""Terms of an elastic gear."""
KIND_OF = {"delay": "encoder_delay", "backlash": "backlash", "eccentricity": "encoder_eccentricity"}
LEAST_DELAY = 5e-3
"""Of a sample: clocks are not compared more finely."""
CLOSED = 1.83
"""Widths of the smooth sign within which 95 % of a gap are closed."""
PLOTTED = 800
"""Points of a picture at most."""


@dataclass(frozen=True)
class Parameter:
    """A value with its unit and its 95 % interval."""

    name: str
    value: float
    unit: str
    interval: tuple[float, float]


@dataclass(frozen=True, eq=False)
class DeflectionFinding:
    """Something that `q_motor - q` reveals.

    Parameters
    ----------
    kind : str
        Of the catalogue; `gear_kinematic_error` where a gear does not yield but turns unevenly.
    joints : tuple of int
        Where.
    parameters : tuple of Parameter
        Of the first joint's gear; of all, where they share them.
    p_value : float
        Of its leading term beside all others.
    rms_test_before, rms_test_after : tuple of float
        Deflection that is left on the test runs without and with it, per joint of `joints` [rad]; everything that was
        ranked before it is in both.
    ties : tuple of str
        Kinds that would explain as much in its place.
    plot : (x, partial, curve)
        Signal, deflection without everything else, and the fitted part, on the test runs of the first joint.
    signal : str
        What x is.
    """

    kind: str
    joints: tuple[int, ...]
    parameters: tuple[Parameter, ...]
    p_value: float
    rms_test_before: tuple[float, ...]
    rms_test_after: tuple[float, ...]
    ties: tuple[str, ...]
    plot: tuple[FloatArray, FloatArray, FloatArray]
    signal: str

    def to_json(self, joint_names: Sequence[str], rank: int) -> dict[str, Any]:
        """Return an entry of `result.json`'s effects; its errors are deflections, as `unit` says."""
        return {
            "rank": rank,
            "kind": self.kind,
            "joints": [joint_names[j] for j in self.joints],
            "parameters": [
                {"name": p.name, "value": p.value, "unit": p.unit, "interval": list(p.interval)}
                for p in self.parameters
            ],
            "rmse_test_before": list(self.rms_test_before),
            "rmse_test_after": list(self.rms_test_after),
            "unit": "rad",
            "p_value": self.p_value,
            "ties": [{"kind": kind, "joints": [joint_names[j] for j in self.joints]} for kind in self.ties],
        }


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

        level = 0.01 / (len(KIND_OF) * 100)
        return bool(2 * norm.sf(abs(delay) / max(std, 1e-300)) < level) and abs(delay) > LEAST_DELAY / self.gear.runs[0].rate

    def groups(self) -> dict[str, list[str]]:
        """Kinds other than the delay, and the terms that each is made of; the largest first."""
        spring = [name for name in self.names if name in SPRING]
        ripples = [name for name in self.names if name.startswith("ripple")]
        groups: dict[str, list[str]] = {}
        if "compliance" in spring:
            groups["nonlinear_elasticity" if "cubic" in spring else "joint_elasticity"] = spring + ripples
        elif ripples:
            groups["gear_kinematic_error"] = ripples
        for name in ("backlash", "eccentricity"):
            if name in self.names:
                groups[KIND_OF[name]] = [name]
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
        found.append(_parameter("gap", 2 * half, 2 * std, angle))
        width, relative = CLOSED * gear.gear.shapes.width, float(gear.value("backlash'")[1][0])
        found.append(_positive("transition_torque", width, relative, torque))
    if kind == "encoder_eccentricity":
        (cosine, sine), (cosine_std, sine_std) = gear.value("eccentricity")
        found.append(_parameter("e_c", -cosine, cosine_std, angle))
        found.append(_parameter("e_s", -sine, sine_std, angle))
    return tuple(found)


def _spring(gear: Examined, terms: Sequence[str]) -> list[Parameter]:
    angle, torque = gear.units
    (c,), _ = gear.value("compliance")
    found = [_propagated(gear, "stiffness", f"{torque}/{angle}", lambda c: 1 / c, "compliance")]
    if "damping" in terms:
        unit = f"{torque}*s/{angle}"
        found.append(_propagated(gear, "damping", unit, lambda c, b: -b / c**2, "compliance", "damping"))
    if "cubic" in terms:
        found.append(_propagated(gear, "cubic", f"{angle}/({torque})^3", lambda a: a, "cubic"))
    if "hysteresis" in terms:
        found.append(_propagated(gear, "hysteresis", torque, lambda c, h: -h / c, "compliance", "hysteresis"))
        relative = float(gear.value("hysteresis'")[1][0])
        found.append(_positive("hysteresis_distance", gear.gear.shapes.distance, relative, angle))
    if "link_friction" in terms:
        found.append(_propagated(gear, "link_friction", torque, lambda c, f: f / c, "compliance", "link_friction"))
    return found


def _propagated(gear: Examined, name: str, unit: str, formula: Any, *terms: str) -> Parameter:
    """A function of coefficients with the interval that their covariance gives it."""
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
    return _parameter(name, value, np.sqrt(max(variance, 0.0)), unit)


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
    order_std = float(gear.value(f"{name}'")[1][0])
    return [
        _parameter(f"kinematic_error{ending}", size, radial, gear.units[0]),
        _parameter(f"kinematic_cycles{ending}", gear.gear.shapes.orders[index], order_std, "1"),
        # a cos + b sin = size sin(N q_motor + phase)
        _parameter(f"kinematic_phase{ending}", float(np.arctan2(x[0], x[1])), turned, "rad"),
    ]


def _parameter(name: str, value: float, std: float, unit: str) -> Parameter:
    value, spread = float(value), NORMAL_95 * float(std)
    return Parameter(name, value, unit, (value - spread, value + spread))


def _positive(name: str, value: float, relative: float, unit: str) -> Parameter:
    """A shape, whose logarithm was fitted."""
    factor = float(np.e ** min(NORMAL_95 * relative, 50.0))
    return Parameter(name, value, unit, (value / factor, value * factor))


@dataclass(frozen=True, eq=False)
class Tested:
    """The test runs of one gear: what subsets of its terms leave there, each fitted to the training runs."""

    gear: Examined
    system: System

    @staticmethod
    def of(gear: Examined, runs: Sequence[GearSignals]) -> Tested:
        """Put the gear into the test runs."""
        n = sum(len(gear.system.places[name]) for name in gear.names)
        return Tested(gear, gear.gear.on(_without_rotor(gear.gear, runs), gear.names, gear.u, gear.x[:n]).system(gear.names))

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
    from dataclasses import replace

    return [replace(run, load=run.load - gear.rotor * run.load_error[:, -1]) for run in runs]


def _signal(run: GearSignals, name: str, orders: Sequence[float]) -> FloatArray:
    if name == "tooth":
        return np.mod(run.q_motor * orders[0], 2 * np.pi)
    return {"load": run.load, "q": run.q_shown, "dq": run.dq}[name]


def rms(x: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(x**2)))
