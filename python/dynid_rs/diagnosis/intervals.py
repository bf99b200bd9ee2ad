"""How well the numbers of an effect are known, beside all else that is fitted and under correlated residuals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.kinds import REFINED, Hypothesis, Kinds, is_valid, joined, stacked
from dynid_rs.diagnosis.null import noise_copies
from dynid_rs.placed import CATALOGUE
from dynid_rs.uncertainty import WIDTH_STEP

FloatArray = NDArray[np.float64]

STEP = 1e-3
"""Relative step of a shape parameter's derivative."""


@dataclass(frozen=True)
class Estimate:
    """One number of an effect: value and standard error; `joint` where it belongs to one of several."""

    name: str
    joint: int
    value: float
    std_error: float
    unit: str


def estimates(
    beside: Beside, kinds: Kinds, hypothesis: Hypothesis, coefficients: FloatArray, friction: FloatArray
) -> list[Estimate]:
    """Coefficients and searched shape parameters of an effect with their standard errors.

    The sandwich ``S^-1 V S^-1``: S what of the columns (and of their derivatives by the shape) is the effect's own
    beside the model, V the spread of its score over copies of the residual that keep its memory.

    Parameters
    ----------
    beside : Beside
        The fitted model without this effect's columns.
    coefficients : ndarray (k,)
        Of the effect, in the order of its columns.
    friction : ndarray (n_joints, 8)
        Coefficients of friction: the width of its transition was fitted too, and is one more unknown.
    """
    columns = stacked(kinds.columns([hypothesis])[0])
    shape = [name for name in REFINED.get(hypothesis.kind, {}) if name in dict(hypothesis.shape)]
    slopes = [_slope(kinds, hypothesis, name, coefficients) for name in shape]
    widths = [_width_slope(kinds, hypothesis, j, coefficients, friction[j]) for j in hypothesis.joints]
    wide = joined([columns, *slopes, *widths])
    active = np.concatenate([coefficients != 0, np.ones(len(shape) + len(widths), dtype=bool)])
    own = beside.own_part(wide)
    after = beside.with_columns(columns, coefficients)
    weights = beside.weights**2
    S = sum(weights[j] * (own[j].T @ own[j]) for j in range(beside.n_joints))
    copies = noise_copies(beside, after, random_state=2)
    scores = sum(weights[j] * (own[j].T @ copies[j]) for j in range(beside.n_joints))
    std = _sandwich(np.asarray(S), np.asarray(scores), active)
    entry = CATALOGUE[hypothesis.kind]
    width = len(entry["coefficients"])
    units = {p["name"]: p["unit"] for p in entry["shape"]}
    found = []
    for k, value in enumerate(coefficients):
        coefficient = entry["coefficients"][k % width]
        found.append(
            Estimate(coefficient["name"], hypothesis.joints[k // width], float(value), std[k], coefficient["unit"])
        )
    for k, name in enumerate(shape):
        value = dict(hypothesis.shape)[name]
        found.append(Estimate(name, hypothesis.joints[0], value, std[len(coefficients) + k], units[name]))
    return found


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


def _sandwich(S: FloatArray, scores: FloatArray, active: NDArray[np.bool_]) -> list[float]:
    scale = 1 / np.sqrt(np.maximum(np.diag(S), 1e-300))
    used = np.flatnonzero(active & (np.diag(S) > 0))
    bread = np.linalg.pinv(S[np.ix_(used, used)] * np.outer(scale[used], scale[used]), rcond=1e-10)
    meat = scores[used] * scale[used][:, None]
    covariance = bread @ (meat @ meat.T / meat.shape[1]) @ bread
    std = np.full(len(S), np.nan)
    std[used] = scale[used] * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return [float(x) for x in std]
