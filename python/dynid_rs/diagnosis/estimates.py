"""How well the numbers of the effects are known, beside all else that is fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.hypotheses import Place, is_valid, shaped_as
from dynid_rs.diagnosis.shapes import searched
from dynid_rs.diagnosis.structural import value_of
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.placed import CATALOGUE, PlacedEffect
from dynid_rs.regression.linear_model import Columns
from dynid_rs.regression.scales import SCALE_SPREAD
from dynid_rs.regression.uncertainty import NORMAL_95

FloatArray = NDArray[np.float64]

STEP = 1e-2
"""Step of a shape parameter's derivative, relative or in its own unit."""
UNKNOWN = float(np.log(10.0))
"""A scale that may be ten times as large or as small is not known."""


@dataclass(frozen=True)
class Estimate:
    """One number of an effect: value and 95 % `interval`, None where it is not known; `joint` that it belongs to."""

    name: str
    joint: int
    value: float
    interval: tuple[float, float] | None
    unit: str


def estimates(found: Belief) -> dict[Place, list[Estimate]]:
    """Numbers of every name with intervals: from the covariance with all of them, and all shapes, unknown together."""
    fit, setup = found.fit, found.setup
    beside = found.beside
    model = beside.model
    size = len(beside.best.x)
    shapes: dict[Place, list[str]] = {}
    places = {effect: [at for _, at in own] for effect, own in zip(setup.effects, found.places(), strict=True)}
    for effect in setup.effects:
        own = fit.links_.x_[places[effect]]
        shapes[effect.kind, effect.joints] = []
        for name in (parameter["name"] for parameter in searched(effect.kind)):
            slope = _slope(found, effect, name, own)
            if slope is not None:
                model = model.beside(slope)
                shapes[effect.kind, effect.joints].append(name)
    structural = found.structure()
    for h in structural:
        model = model.beside(h.columns)
    best = model.fit(beside.best.choice, beside.best.noise)
    std = np.sqrt(np.maximum(np.diag(best.covariance), 0.0))
    known: dict[Place, list[Estimate]] = {place: [] for place in found.named}
    at = size
    for effect in setup.effects:
        place = (effect.kind, effect.joints)
        known[place] = _coefficients(effect, fit.links_.x_[places[effect]], std[places[effect]])
        for name in shapes[place]:
            known[place].append(_shape(effect, name, float(std[at])))
            at += 1
    for h in structural:
        spread = std[at : at + len(h.unit)] * h.unit
        values = value_of(setup, h.kind, h.joints)
        known[h.place] = [
            Estimate(name, h.joints[0], float(value), (float(value - half), float(value + half)), unit)
            for name, value, unit, half in zip(h.names, values, h.units, NORMAL_95 * spread, strict=False)
        ]
        at += len(h.unit)
    for place in found.named:
        if place[0] == "torque_gain" and not known[place]:
            known[place] = [_gain(fit, place[1][0], std)]
    return known


def _coefficients(effect: PlacedEffect, values: FloatArray, std: FloatArray) -> list[Estimate]:
    entry = CATALOGUE[effect.kind]["coefficients"]
    found = []
    for k, (value, half) in enumerate(zip(values, NORMAL_95 * std, strict=True)):
        c = entry[k % len(entry)]
        low, high = max(float(value - half), c["lower"]), min(float(value + half), c["upper"])
        found.append(Estimate(c["name"], effect.joints[k // len(entry)], float(value), (low, high), c["unit"]))
    return found


def _shape(effect: PlacedEffect, name: str, std: float) -> Estimate:
    parameter = next(p for p in CATALOGUE[effect.kind]["shape"] if p["name"] == name)
    value, half = effect.shape_at(effect.joints[0])[name], NORMAL_95 * std
    interval: tuple[float, float] | None = None
    if parameter["scale"] == "linear":
        interval = (value - half, value + half)
    elif half < UNKNOWN:
        ends = sorted(value * np.exp([-half, half]))
        interval = (float(ends[0]), float(ends[1]))
    return Estimate(name, effect.joints[0], value, interval, parameter["unit"])


def _slope(found: Belief, effect: PlacedEffect, name: str, own: FloatArray) -> Columns | None:
    """Change of an effect's torque with a shape parameter (with its logarithm, of a scale), one column."""
    shaped = shaped_as(effect)
    parameter = next(p for p in CATALOGUE[effect.kind]["shape"] if p["name"] == name)
    value = dict(shaped.shape)[name]
    linear = parameter["scale"] == "linear"
    ends = [value - STEP, value + STEP] if linear else [value / (1 + STEP), value * (1 + STEP)]
    both = [shaped.with_shape(name, end) for end in ends]
    if not all(is_valid(s.kind, s.shape) for s in both):
        return None
    width = 2 * STEP if linear else 2 * float(np.log1p(STEP))
    low, high = found.catalogue.of(both)
    return {
        j: ((high.columns[j] / _safe(high.unit) - low.columns[j] / _safe(low.unit)) @ own / width)[:, None]
        for j in low.columns
    }


def _safe(unit: FloatArray) -> FloatArray:
    return np.where(unit > 0, unit, 1.0)


def _gain(fit: ThreeLoopIdentifier, j: int, std: FloatArray) -> Estimate:
    """A gain that is fitted in every round; its standard deviation stands behind the fit's own unknowns."""
    scale = fit.links_.torque_scale_
    free = [int(k) for k in np.flatnonzero(scale != 1.0)]
    value = float(scale[j] - 1)
    own = fit.observations_.plan.n_columns + free.index(j) if j in free else None
    half = 0.0 if own is None else NORMAL_95 * SCALE_SPREAD * float(scale[j] * std[own])  # of its logarithm
    return Estimate("gain", j, value, (value - half, value + half), "1")
