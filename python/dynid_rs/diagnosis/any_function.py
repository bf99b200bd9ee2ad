"""What a law of an angle has to be told from where any function of that angle does as well: that function, anywhere.

Within the angles that the runs have shown, a few waves imitate a law. What a motion beyond them would show, the law
says already, and a function does not: it is made of waves on a whole turn, as rough there as within the seen part.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.candidates import ALIVE, Candidate, size_of
from dynid_rs.diagnosis.hypotheses import Catalogue, Hypothesis
from dynid_rs.diagnosis.rivals import Contest, valued
from dynid_rs.diagnosis.trials import Value
from dynid_rs.diagnosis.waves import ALONE, FALLS, SMOOTHER, UNKNOWN, Argument, Window, of_signal, same_angles, waves
from dynid_rs.regression.linear_model import Columns

FloatArray = NDArray[np.float64]

TURN = 2 * math.pi
"""Angles [rad] that a turning joint may show at least; up to twice as many where its limits are wider."""
SLIDES = 3.0
"""The same of a sliding joint, over the way that was seen."""
MOST_WAVES = 60
"""Waves of a function at most: where a joint went no further than a sixth of its window they are longer."""
ROUGHNESSES = 2
"""Of a function that are kept, the likeliest."""


def own_angle(j: int) -> Argument:
    """The joint's angle alone."""
    return of_signal(("q", j))


def rival_functions(
    catalogue: Catalogue, kind: str, j: int, against: Contest
) -> tuple[list[tuple[Candidate, Columns, float]], float]:
    """Functions that may stand in the place of a law on joint j, each with its columns and how probable it is.

    Of different roughness, less what the runs refute; and the logarithmic odds of the law against all of them.
    """
    from scipy.special import logsumexp, softmax

    turning = same_angles(kind, j, catalogue.fit.robot.n_joints)[1]
    window, seen = _window(catalogue, j)
    function = waves(catalogue, j, [own_angle(j)], turning=turning, within=window)
    values = [valued(against.beside, catalogue, _as_rough(function, seen, FALLS + more)) for more in SMOOTHER]
    logs = np.array([value.value for value in values])
    odds = against.own.value - float(logsumexp(logs) - np.log(len(logs)))
    alive = [k for k in np.argsort(-logs, kind="stable").tolist() if logs[k] > logs.max() - ALIVE][:ROUGHNESSES]
    weights = softmax(logs[alive]).tolist()
    found = [_candidate(values[k], window, turning, against) for k in alive]
    return [(*own, weight) for own, weight in zip(found, weights, strict=True)], odds


def function_along(catalogue: Catalogue, candidate: Candidate) -> Hypothesis:
    """Columns of a function without a name along the runs of a fit."""
    shape, (j,) = dict(candidate.shape), candidate.joints
    window = Window(shape["low"], shape["span"], len(candidate.unit))
    return waves(catalogue, j, [own_angle(j)], turning=bool(shape["turning"]), within=window)


def _window(catalogue: Catalogue, j: int) -> tuple[Window, float]:
    """Where the joint may go: a turn about the middle of what was seen, and its limits; and the part that was seen.

    Its waves are as short as `ALONE` of them within that part, or as `MOST_WAVES` let them be.
    """
    robot = catalogue.fit.robot
    q = np.concatenate([own_angle(j).values(states) for states in catalogue.runs])
    way, middle = max(float(np.ptp(q)), 1e-9), float(q.min() + q.max()) / 2
    span = max(TURN if robot.joint_kinds[j] == "revolute" else SLIDES * way, way)
    limits = np.array([robot.lower[j], robot.upper[j]])
    # Some files say a thousand turns.
    within = np.clip(limits[np.isfinite(limits)], middle - span, middle + span)
    ends = np.array([middle - span / 2, middle + span / 2, *within])
    low, span = float(ends.min()), float(np.ptp(ends))
    return Window(low, span, min(MOST_WAVES, math.ceil(ALONE * span / way))), way / span


def _as_rough(function: Hypothesis, seen: float, falls: float) -> Hypothesis:
    """The function with waves that vary within the `seen` part of its window as those that are made for it would."""
    order = np.arange(1.0, len(function.unit) + 1)
    factor = np.sqrt(seen) * np.maximum(order * seen, 1.0) ** -falls * order**FALLS
    columns = {j: part * factor for j, part in function.columns.items()}
    return replace(function, columns=columns, unit=function.unit * factor)


def _candidate(value: Value, window: Window, turning: bool, against: Contest) -> tuple[Candidate, Columns]:
    h, size = value.hypothesis, size_of(value.hypothesis, value.columns)
    plain = {j: size * part for j, part in h.columns.items()}
    mean = against.beside.with_columns(plain).best.x[-len(h.unit) :]
    shape = (("low", window.low), ("span", window.span), ("turning", float(turning)))
    return Candidate(UNKNOWN, h.joints, shape, size * h.unit, mean), plain
