"""How well the numbers of an effect are known, beside all else that is fitted and under correlated residuals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.candidate import joined, stacked
from dynid_rs.diagnosis.hypothesis import REFINED, Hypothesis, bounds_of, is_valid
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.null import noise_copies
from dynid_rs.diagnosis.valleys import mirrored
from dynid_rs.placed import CATALOGUE
from dynid_rs.uncertainty import NORMAL_95, WIDTH_STEP

FloatArray = NDArray[np.float64]

STEP = 1e-3
"""Relative step of a shape parameter's derivative."""
SIGNED = ("gas_length",)
"""Lengths that may be negative: searched in octaves, but no scales."""
ANGLES = ("phase",)
"""Shape parameters that come back after a turn: known to half a turn they are not known."""
UNKNOWN = 7.0
"""Octaves: a scale that may be a hundred times as large is not known."""
ROTOR_SHARE = 0.5
"""Rotor's part of a joint's inertia where nothing tells, and its standard deviation."""


@dataclass(frozen=True)
class Estimate:
    """One number of an effect: value and 95 % `interval`, None where it is not known; `joint` that it belongs to."""

    name: str
    joint: int
    value: float
    interval: tuple[float, float] | None
    unit: str


def estimates(
    beside: Beside, kinds: Kinds, hypothesis: Hypothesis, coefficients: FloatArray, friction: FloatArray
) -> list[Estimate]:
    """Coefficients and searched shape parameters of an effect with their intervals.

    The sandwich ``S^-1 V S^-1``: S what of the columns (and of their derivatives by the shape) is the effect's own
    beside the model, V the spread of its score over copies of the residual that keep its memory. An interval holds
    whatever the data leave open besides: how much of the joint's inertia is the rotor's, which the gear does not
    carry, and which of two shapes it is that explain the same.

    Parameters
    ----------
    beside : Beside
        The fitted model without this effect's columns.
    coefficients : ndarray (k,)
        Of the effect, in the order of its columns.
    friction : ndarray (n_joints, 8)
        Coefficients of friction: the width of its transition was fitted too, and is one more unknown.
    """
    numbers = _numbers(hypothesis, coefficients)
    low, high = _interval(beside, kinds, hypothesis, coefficients, friction)
    other = mirrored(beside, kinds, hypothesis)
    if other is not None:
        also = beside.gains(stacked(kinds.columns([other])[0]), [slice(None)], [bounds_of(other)])[0].coefficients
        low_also, high_also = _interval(beside, kinds, other, also, friction)
        low, high = np.minimum(low, low_also), np.maximum(high, high_also)
    allowed = bounds_of(hypothesis)
    low[: len(allowed)] = np.maximum(low[: len(allowed)], allowed[:, 0])
    high[: len(allowed)] = np.minimum(high[: len(allowed)], allowed[:, 1])
    known = np.isfinite(low) & np.isfinite(high)
    return [
        replace(number, interval=(float(low[k]), float(high[k])) if known[k] else None)
        for k, number in enumerate(numbers)
    ]


def _numbers(hypothesis: Hypothesis, coefficients: FloatArray) -> list[Estimate]:
    """Values alone: coefficients joint by joint, then the shape parameters that are searched."""
    entry = CATALOGUE[hypothesis.kind]
    width = len(entry["coefficients"])
    units = {p["name"]: p["unit"] for p in entry["shape"]}
    found = []
    for k, value in enumerate(coefficients):
        coefficient = entry["coefficients"][k % width]
        joint = hypothesis.joints[k // width]
        found.append(Estimate(coefficient["name"], joint, float(value), None, coefficient["unit"]))
    shape = dict(hypothesis.shape)
    return found + [Estimate(n, hypothesis.joints[0], shape[n], None, units[n]) for n in _searched(hypothesis)]


def _searched(hypothesis: Hypothesis) -> list[str]:
    return [name for name in REFINED.get(hypothesis.kind, {}) if name in dict(hypothesis.shape)]


def _interval(
    beside: Beside, kinds: Kinds, hypothesis: Hypothesis, coefficients: FloatArray, friction: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Lower and upper ends of 95 % intervals of coefficients and searched shape, NaN where nothing is known."""
    columns = stacked(kinds.columns([hypothesis])[0])
    shape = _searched(hypothesis)
    slopes = [_slope(kinds, hypothesis, name, coefficients) for name in shape]
    widths = [_width_slope(kinds, hypothesis, j, coefficients, friction[j]) for j in hypothesis.joints]
    rotors = [_rotor_slope(kinds, hypothesis, j, coefficients) for j in _hidden_rotors(kinds, hypothesis)]
    wide = joined([columns, *slopes, *widths, *rotors])
    active = np.concatenate([coefficients != 0, np.ones(len(shape) + len(widths) + len(rotors), dtype=bool)])
    own = beside.own_part(wide)
    after = beside.with_columns(columns, coefficients)
    weights = beside.weights**2
    S = np.asarray(sum(weights[j] * (own[j].T @ own[j]) for j in range(beside.n_joints)))
    copies = noise_copies(beside, after, random_state=2)
    scores = np.asarray(sum(weights[j] * (own[j].T @ copies[j]) for j in range(beside.n_joints)))
    n = len(coefficients) + len(shape)
    values = np.array([number.value for number in _numbers(hypothesis, coefficients)])
    known = len(S) - len(rotors)
    belief = np.zeros(known)
    belief[len(coefficients) : n] = [kinds.certainty(hypothesis, name) for name in shape]
    half = NORMAL_95 * _sandwich(S[:known, :known], scores[:known], active[:known], belief)[:n]
    scales = np.append(np.zeros(len(coefficients)), [_is_scale(hypothesis, name) for name in shape]).astype(bool)
    angles = np.append(np.zeros(len(coefficients)), [name in ANGLES for name in shape]).astype(bool)
    half = np.where(angles & (half >= np.pi), np.nan, half)
    # A length that may have either sign may be any: a column of gas that pulls, or one that pushes.
    signed = np.append(np.zeros(len(coefficients)), [name in SIGNED for name in shape]).astype(bool)
    half = np.where(signed & (half >= np.abs(values)), np.nan, half)
    low, high = _ends(values, -half, scales), _ends(values, half, scales)
    if rotors:
        # As a part of the joint's whole inertia the rotor's is anything from nothing to all: 0.5 and as much again.
        S[known:, known:] += np.eye(len(rotors)) / ROTOR_SHARE**2
        score = np.asarray(sum(weights[j] * (own[j].T @ after[:, j]) for j in range(beside.n_joints)))
        score[known:] += 1 / ROTOR_SHARE
        score[:known] = 0.0  # the fit is at its best in these
        step = _inverse(S, active) @ score
        half = NORMAL_95 * _sandwich(S, scores, active)[:n]
        low = np.minimum(low, _ends(values, step[:n] - half, scales))
        high = np.maximum(high, _ends(values, step[:n] + half, scales))
    return low, high


def _is_scale(hypothesis: Hypothesis, name: str) -> bool:
    """Whether a shape parameter is a scale: it is searched in octaves, and half as much is as far as twice as much."""
    how, _, _ = REFINED[hypothesis.kind][name]
    return how == "log" and name not in SIGNED


def _ends(values: FloatArray, change: FloatArray, scales: NDArray[np.bool_]) -> FloatArray:
    """Values after a change of so much; a scale by the factor that is as much to first order, so it keeps its sign."""
    octaves = np.where(scales, np.sign(values) * change / np.maximum(np.abs(values), 1e-300) / np.log(2.0), 0.0)
    known = np.abs(octaves) <= UNKNOWN
    ends = np.where(scales, values * np.exp2(np.where(known, octaves, 0.0)), values + change)
    return np.where(known, ends, np.nan)


def _hidden_rotors(kinds: Kinds, hypothesis: Hypothesis) -> list[int]:
    """Joints whose load the effect follows and whose rotor no motion tells from the link."""
    if "tau_link" not in CATALOGUE[hypothesis.kind]["signals"]:
        return []
    return [j for j in hypothesis.joints if kinds.hidden_rotor[j] > 0]


def _rotor_slope(kinds: Kinds, hypothesis: Hypothesis, j: int, coefficients: FloatArray) -> dict[int, FloatArray]:
    """Derivative of the effect's torque by the rotor's part of joint j's inertia, one column."""
    there = kinds.with_rotor(j, STEP * float(kinds.hidden_rotor[j])).once(hypothesis)
    here = kinds.once(hypothesis)
    return {k: ((there[k] - here[k]) @ coefficients / STEP)[:, None] for k in here}


def _slope(kinds: Kinds, hypothesis: Hypothesis, name: str, coefficients: FloatArray) -> dict[int, FloatArray]:
    """Derivative of the effect's torque by a shape parameter, one column."""
    value = dict(hypothesis.shape)[name]
    step = STEP * max(abs(value), 1e-3)
    moved = [
        replace(hypothesis, shape=tuple((n, v + d if n == name else v) for n, v in hypothesis.shape))
        for d in (-step, step)
    ]
    # At the edge of what there can be, to the one side only.
    low, high = (h if is_valid(h.kind, h.shape) else hypothesis for h in moved)
    columns = kinds.once(low), kinds.once(high)
    width = (step if high is not hypothesis else 0.0) + (step if low is not hypothesis else 0.0)
    return {j: ((columns[1][j] - columns[0][j]) @ coefficients / max(width, step))[:, None] for j in columns[0]}


def _width_slope(
    kinds: Kinds, hypothesis: Hypothesis, j: int, coefficients: FloatArray, friction: FloatArray
) -> dict[int, FloatArray]:
    """Derivative of joint j's friction and of the effect by the width of their common transition, one column."""
    width = float(kinds.widths[j])
    low, high = (kinds.friction(j, width * factor)[j] @ friction for factor in (1 - WIDTH_STEP, 1 + WIDTH_STEP))
    slope = {j: ((high - low) / (2 * WIDTH_STEP))[:, None]}
    if "transition_width" in dict(hypothesis.shape) and len(hypothesis.joints) == 1:
        own = _slope(kinds, hypothesis, "transition_width", coefficients)[j]
        slope[j] = slope[j] + width * own
    return slope


def _inverse(S: FloatArray, active: NDArray[np.bool_]) -> FloatArray:
    """Inverse of S over what is active and seen, zeros elsewhere."""
    scale = 1 / np.sqrt(np.maximum(np.diag(S), 1e-300))
    used = np.flatnonzero(active & (np.diag(S) > 0))
    inverse = np.zeros_like(S)
    bread = np.linalg.pinv(S[np.ix_(used, used)] * np.outer(scale[used], scale[used]), rcond=1e-10)
    inverse[np.ix_(used, used)] = bread * np.outer(scale[used], scale[used])
    return inverse


def _sandwich(
    S: FloatArray, scores: FloatArray, active: NDArray[np.bool_], belief: FloatArray | None = None
) -> FloatArray:
    """Standard errors, NaN of what is not active or not seen; `belief` is what is known besides, as one over variance.

    Without belief ``S^-1 V S^-1``, with it ``(S V^-1 S + B)^-1``.
    """
    seen = active & (np.diag(S) > 0)
    if belief is None or not np.any(belief):
        drawn = _inverse(S, active) @ scores
        return np.where(seen, np.sqrt(np.mean(drawn**2, axis=1)), np.nan)
    information = S @ _inverse(scores @ scores.T / scores.shape[1], active) @ S + np.diag(belief)
    std: FloatArray = np.sqrt(np.maximum(np.diag(_inverse(information, active)), 0.0))
    return np.where(seen, std, np.nan)
