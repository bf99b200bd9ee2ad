"""How well the numbers of the effects are known, beside all else that is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.hypotheses import Hypothesis
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Place
from dynid_rs.diagnosis.shapes import searched
from dynid_rs.diagnosis.slopes import Slope, effect_slopes, friction_slopes, is_logarithmic
from dynid_rs.diagnosis.structural import value_of
from dynid_rs.diagnosis.structural.torque_gain import gain_spread
from dynid_rs.diagnosis.trials import blocks
from dynid_rs.identification.smooth_friction import SPREAD
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.placed import CATALOGUE, PlacedEffect
from dynid_rs.regression.kept_columns import effect_rows
from dynid_rs.regression.linear_model import Columns, Fit, LinearModel
from dynid_rs.regression.uncertainty import NORMAL_95

FloatArray = NDArray[np.float64]

STEP = 1e-6
"""Change [rad, m, s] along which what is told of a structure is a straight line."""
CYCLES = "1/turn"
"""Unit of shapes that count."""
WIDTHS, SHARPNESSES = (0.5, 1.0, 2.0), (1.0, 2.0, 4.0)
"""Widths of a sign over its own, and sharpnesses (an arctan's, a tanh's, nearly a corner's): between them lies any sign
that is round."""
UNKNOWN = float(np.log(10.0))
"""A scale that may be ten times as large or as small is not known."""


@dataclass(frozen=True)
class Estimate:
    """One number of an effect: value and 95 % `interval`, None where it is not known.

    `joint` that it belongs to; None where it is one number of all joints that the effect acts on.
    """

    name: str
    joint: int | None
    value: float
    interval: tuple[float, float] | None
    unit: str


def estimates(found: Belief) -> dict[Place, list[Estimate]]:
    """Numbers of every name with intervals: from the covariance with all of them, and all shapes, unknown together."""
    fit, setup = found.fit, found.setup
    size = len(found.beside.best.x)
    places = _places(found)
    slopes, structural = effect_slopes(found), found.structure()
    std = _spread(found, slopes, structural)
    known: dict[Place, list[Estimate]] = {place: [] for place in found.named}
    at = size
    for effect in setup.effects:
        place = (effect.kind, effect.joints)
        scale = fit.links_.torque_scale_ if "tau_link" in CATALOGUE[effect.kind]["signals"] else np.ones_like(std)
        # Of currents no torque is known: what is one is told as the joint's channel shows it.
        shown = scale if fit.torque_unit_ == "A" else np.ones_like(scale)
        known[place] = _coefficients(effect, fit.links_.x_[places[effect]], std[places[effect]], scale, shown)
        known[place] += _chosen(effect)
        for slope in slopes:
            if slope.effect is effect:
                known[place].append(_shape(effect, slope.name, float(std[at]), shown))
                at += 1
    for h in structural:
        values = value_of(setup, h.kind, h.joints)
        halves = NORMAL_95 * _spread_of_value(setup, h, std[at : at + len(h.unit)] * h.unit)
        known[h.place] = [
            Estimate(name, _only(h.joints), float(value), (float(value - half), float(value + half)), unit)
            for name, value, unit, half in zip(h.names, values, h.units, halves, strict=False)
        ]
        at += len(h.unit)
    for place in found.named:
        if place[0] == "torque_gain" and not known[place]:
            known[place] = [_gain(fit, place[1][0], std)]
    return known


def sized_torques(found: Belief) -> set[PlacedEffect]:
    """Torques of which some coefficient is not zero at 95 %, at the shape that they have, all else unknown.

    How high a peak is may be open where its width is, and yet there is one.
    """
    slopes, structural, x, sized = effect_slopes(found), found.structure(), found.fit.links_.x_, set()
    for effect, at in _places(found).items():
        std = _spread(found, [slope for slope in slopes if slope.effect is not effect], structural)[at]
        entry = CATALOGUE[effect.kind]["coefficients"]
        lower, upper = (np.array([entry[k % len(entry)][end] for k in range(len(at))]) for end in ("lower", "upper"))
        if np.any(np.abs(np.clip(x[at], lower, upper)) > NORMAL_95 * std):
            sized.add(effect)
    return sized


def may_be_nothing(found: Belief) -> list[PlacedEffect]:
    """Torques of which no coefficient has a size, nor have all of them together, at 95 %.

    Wald's test: ``x' S^-1 x`` of the coefficients x with covariance S, against chi-squared of as many. Two columns may
    be alike, and neither is known where their sum is.
    """
    from scipy.special import chdtri

    slopes, structural, x, sized = effect_slopes(found), found.structure(), found.fit.links_.x_, sized_torques(found)
    nothing = []
    for effect, at in _places(found).items():
        if effect in sized:
            continue
        _, best = _beside_all(found, [slope for slope in slopes if slope.effect is not effect], structural)
        S = best.covariance[np.ix_(at, at)]
        if float(x[at] @ np.linalg.pinv(S, hermitian=True) @ x[at]) < chdtri(len(at), 0.05):
            nothing.append(effect)
    return nothing


def _places(found: Belief) -> dict[PlacedEffect, list[int]]:
    """Where the coefficients of every torque stand among the fit's unknowns."""
    own = zip(found.setup.effects, found.places(), strict=True)
    return {effect: [at for _, at in places] for effect, places in own}


def _spread(found: Belief, slopes: Sequence[Slope], structural: Sequence[Hypothesis]) -> FloatArray:
    """Standard deviations of all unknowns, then of `slopes`, of changes of structure and of friction's shapes."""
    model, best = _beside_all(found, slopes, structural)
    spread: FloatArray = np.maximum(np.sqrt(np.maximum(np.diag(best.covariance), 0.0)), _scatter(model, best))
    return spread


def _beside_all(found: Belief, slopes: Sequence[Slope], structural: Sequence[Hypothesis]) -> tuple[LinearModel, Fit]:
    """The model of all unknowns, then of `slopes`, of changes of structure and of friction's shapes, and its fit."""
    beside, places = found.beside, _places(found)
    model = beside.model.beside(
        *(slope.columns for slope in slopes),
        *(h.columns for h in structural),
        *({j: SPREAD * column for j, column in slope.columns.items()} for slope in friction_slopes(found)),
    )
    # A peak of friction is told by what is left of friction, so it is known as well as the sign's rounding is.
    peaks = [e for e in places if len(e.joints) == 1 and CATALOGUE[e.kind]["signals"] == ["dq_motor"]]
    model = model.beside(*(_any_rounding(found, effect, places[effect]) for effect in peaks))
    return model, model.fit(beside.best.choice, beside.best.noise)


def _spread_of_value(setup: Setup, h: Hypothesis, spread: FloatArray) -> FloatArray:
    """Standard deviations of what a change of structure is, (k,), from those `spread` (n,) of its further changes.

    Each by itself, in their own units [rad, m, s]. The same but for a base near a wall: how it is rolled is the less
    told the nearer it stands. `h` may have more coefficients than numbers are told of it.
    """
    now = value_of(setup, h.kind, h.joints)
    moved = [value_of(h.accept(setup, STEP * row), h.kind, h.joints) - now for row in np.eye(len(h.unit))]
    slopes = ((np.stack(moved, axis=1) + np.pi) % (2 * np.pi) - np.pi) / STEP  # an angle of pi is one of -pi
    told: FloatArray = np.sqrt((slopes**2) @ spread**2)
    return told


def _any_rounding(found: Belief, effect: PlacedEffect, places: Sequence[int]) -> Columns:
    """What the whole friction of the effect's first joint would be more with its sign rounded in another way.

    Narrow and wide, early and late: the declared family is one of many, and none that a gear has to keep to.
    """
    fit, j = found.fit, effect.joints[0]
    _, at = fit.observations_.plan.friction
    size = abs(fit.links_.own_[j, at][0]) + float(np.abs(fit.links_.x_[list(places)]).mean())
    width, n = fit.friction_.transition_width_[j], fit.robot.n_joints

    def sign(width: float, sharpness: float) -> FloatArray:
        rounded = _core.Effect.of(
            "smooth_friction", transition_width=np.full(n, width), sharpness=np.full(n, sharpness)
        )
        return np.concatenate([effect_rows(rounded, states, j)[:, 0] for states in fit.runs_])

    own = sign(width, fit.friction_.sharpness_[j])
    others = [sign(factor * width, sharpness) - own for factor, sharpness in product(WIDTHS, SHARPNESSES)]
    return {j: size * np.stack(others, axis=1)}


def _scatter(model: LinearModel, fit: Fit) -> FloatArray:
    """Standard deviation of all unknowns by how much they change when parts of the data are left out, (n,).

    The jackknife over parts (Tukey 1958): what a model cannot say is other in every part, and its covariance does not
    know of it. Few parts tell their own scatter badly: it is as much larger as Student's 95 % are than the normal's.
    """
    from scipy.special import stdtrit

    parts = model.solved_without(fit, blocks(model.phase))
    free = len(parts) - 1
    scatter: FloatArray = np.sqrt(free * np.var(parts, axis=0)) * (stdtrit(free, 0.975) / NORMAL_95)
    return scatter


def _coefficients(
    effect: PlacedEffect, values: FloatArray, std: FloatArray, scale: FloatArray, shown: FloatArray
) -> list[Estimate]:
    """`scale` (n_joints,): what a joint's channel shows per unit of the load that the coefficients multiply.

    `shown` (n_joints,): what it shows per unit of what is told as a torque.
    """
    entry = CATALOGUE[effect.kind]["coefficients"]
    found = []
    for k, (value, half) in enumerate(zip(values, NORMAL_95 * std, strict=True)):
        c, j = entry[k % len(entry)], effect.joints[k // len(entry)]
        per = scale[j] / (shown[j] if c["unit"] == "{torque}" else 1.0)
        own, half = float(value / per), float(half / per)
        interval = None if j in effect.silent else _interval(own, half, c["lower"], c["upper"])
        found.append(Estimate(c["name"], j, own, interval, c["unit"]))
    return found


def _interval(value: float, half: float, lower: float, upper: float) -> tuple[float, float]:
    """Of a coefficient; one that has a sign and is known to have it is a scale, known in its logarithm.

    Where the model has one that physics does not allow, this is its interval all the same.
    """
    if not lower <= value <= upper:
        return value - half, value + half
    if 0.0 in (lower, upper) and half < abs(value):
        low, high = sorted(value * np.exp([-half / abs(value), half / abs(value)]))
    else:
        low, high = np.clip([value - half, value + half], lower, upper)
    return float(low), float(high)


def _chosen(effect: PlacedEffect) -> list[Estimate]:
    """Shapes that are one of a few, as cycles per turn and a neighbour are: known, or not at all."""
    held = [p for p in CATALOGUE[effect.kind]["shape"] if p not in searched(effect.kind)]
    few = [p for p in held if p["unit"] == CYCLES or p["relative_to"] == "chain"]
    j = effect.joints[0]
    return [Estimate(p["name"], _only(effect.joints), effect.shape_at(j)[p["name"]], None, p["unit"]) for p in few]


def _shape(effect: PlacedEffect, name: str, std: float, shown: FloatArray) -> Estimate:
    parameter = next(p for p in CATALOGUE[effect.kind]["shape"] if p["name"] == name)
    j = effect.joints[0]
    value, half = effect.shape_at(j)[name], NORMAL_95 * std
    interval: tuple[float, float] | None = None
    if not is_logarithmic(effect.kind, name):
        interval = (value - half, value + half)
    elif half < UNKNOWN:
        ends = sorted(value * np.exp([-half, half]))
        interval = (float(ends[0]), float(ends[1]))
    if parameter["unit"] == "{torque}":
        value, interval = (
            value * shown[j],
            None if interval is None else (interval[0] * shown[j], interval[1] * shown[j]),
        )
    return Estimate(name, _only(effect.joints), float(value), interval, parameter["unit"])


def _only(joints: Sequence[int]) -> int | None:
    """The joint of a number that an effect has once; none where it acts on several."""
    return joints[0] if len(joints) == 1 else None


def _gain(fit: ThreeLoopIdentifier, j: int, std: FloatArray) -> Estimate:
    """A gain that is fitted in every round."""
    scale, spread = float(fit.links_.torque_scale_[j]), gain_spread(fit, j, std)
    value, half = scale - 1, NORMAL_95 * scale * (spread or 0.0)
    return Estimate("gain", j, value, (value - half, value + half), "1")
