"""What a law of an angle has to be told from where any function of that angle does as well: that function, anywhere.

Within the angles that the runs have shown, a few waves imitate a law. What a motion beyond them would show, the law
says already, and a function does not: it is made of waves on a whole turn, as rough there as within the seen part.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.candidates import ALIVE, Candidate, size_of
from dynid_rs.diagnosis.hypotheses import Catalogue, Hypothesis
from dynid_rs.diagnosis.rivals import Contest, valued
from dynid_rs.diagnosis.trials import Value
from dynid_rs.diagnosis.waves import ALONE, FALLS, SMOOTHER, Argument, Window, of_signal, same_angles, smoother, waves
from dynid_rs.regression.linear_model import Columns

FloatArray = NDArray[np.float64]

UNKNOWN = "unknown"
"""Kind of a candidate that is a function without a name."""
TURN = 2 * math.pi
"""Angles [rad] that a turning joint may show."""
SLIDES = 3.0
"""Ways of a sliding joint, over the seen one, that it may show."""
MOST_WAVES = 60
"""Waves of a function at most: of a joint that has hardly moved, which ten of them within its way tell no better."""


def own_angle(j: int) -> Argument:
    """The joint's angle alone."""
    return of_signal(("q", j))


def rival_functions(
    catalogue: Catalogue, kind: str, j: int, against: Contest
) -> tuple[list[tuple[Candidate, Columns, float]], float]:
    """Functions that may stand in the place of a law on joint j, each with its columns and how probable it is.

    Three of them, of different roughness, less those that the runs refute; and the logarithmic odds of the law against
    all three.
    """
    from scipy.special import logsumexp, softmax

    turning = same_angles(kind, j, catalogue.fit.robot.n_joints)[1]
    window = _window(catalogue, j)
    seen = float(np.ptp(np.concatenate([own_angle(j).values(states) for states in catalogue.runs])))
    function = _as_rough(waves(catalogue, j, [own_angle(j)], turning=turning, within=window), seen / window.span)
    values = [valued(against.beside, catalogue, smoother(function, more)) for more in SMOOTHER]
    logs = np.array([value.value for value in values])
    odds = against.own.value - float(logsumexp(logs) - np.log(len(logs)))
    alive = np.flatnonzero(logs > logs.max() - ALIVE)
    alive = alive[np.argsort(-logs[alive], kind="stable")]
    weights = softmax(logs[alive]).tolist()
    found = [_candidate(values[k], window, turning, against) for k in alive.tolist()]
    return [(*own, weight) for own, weight in zip(found, weights, strict=True)], odds


def function_along(catalogue: Catalogue, candidate: Candidate) -> Hypothesis:
    """Columns of a function without a name along the runs of a fit."""
    shape, (j,) = dict(candidate.shape), candidate.joints
    window = Window(shape["low"], shape["span"], len(candidate.unit))
    return waves(catalogue, j, [own_angle(j)], turning=bool(shape["turning"]), within=window)


def _window(catalogue: Catalogue, j: int) -> Window:
    """A turn about the middle of the angles that were seen, with waves as short as `ALONE` of them within these."""
    q = np.concatenate([own_angle(j).values(states) for states in catalogue.runs])
    seen, middle = max(float(np.ptp(q)), 1e-9), float(q.min() + q.max()) / 2
    revolute = catalogue.fit.robot.joint_kinds[j] == "revolute"
    span = max(TURN, seen) if revolute else SLIDES * seen
    return Window(middle - span / 2, span, min(MOST_WAVES, math.ceil(ALONE * span / seen)))


def _as_rough(function: Hypothesis, seen: float) -> Hypothesis:
    """The function with waves that vary within the seen part of its window as those that are made for it would."""
    order = np.arange(1.0, len(function.unit) + 1)
    factor = np.sqrt(seen) * np.maximum(order * seen, 1.0) ** -FALLS * order**FALLS
    columns = {j: part * factor for j, part in function.columns.items()}
    return Hypothesis(**{**vars(function), "columns": columns, "unit": function.unit * factor})


def _candidate(value: Value, window: Window, turning: bool, against: Contest) -> tuple[Candidate, Columns]:
    h, size = value.hypothesis, size_of(value)
    plain = {j: size * part for j, part in h.columns.items()}
    mean = against.beside.with_columns(plain).best.x[-len(h.unit) :]
    shape = (("low", window.low), ("span", window.span), ("turning", float(turning)))
    return Candidate(UNKNOWN, h.joints, shape, size * h.unit, mean), plain
