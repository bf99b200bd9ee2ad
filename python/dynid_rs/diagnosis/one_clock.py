"""Torque channels that are late one by one, or together: drives that share a clock pay for one name."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.belief import Belief, Named
from dynid_rs.diagnosis.structural import structural_hypotheses, undone, value_of, with_value

FloatArray = NDArray[np.float64]

KIND = "torque_delay"


def share_a_clock(belief: Belief) -> bool:
    """Name one delay of all joints in the place of those that single joints have, where it is more probable.

    Both are the model in which every joint has a delay of its own, with conditions on those: joints without a name have
    that which was declared, or all differ from it alike. How much more probable a condition makes the data is its
    density afterwards over that beforehand (Dickey 1971, Annals of Mathematical Statistics 42).
    """
    together = KIND, tuple(range(belief.setup.robot.n_joints))
    single = [place for place in belief.named if place[0] == KIND and place != together]
    if len(single) < 2 or together in belief.named:
        return False
    every, *own = structural_hypotheses(belief.fit, belief.setup, [KIND])
    beside = belief.beside
    for h in own:
        beside = beside.with_columns({j: max(h.sizes) * part for j, part in h.columns.items()})
    unit = np.array([max(h.sizes) * h.unit[0] for h in own])
    now = np.array([belief.moved(h.place)[0] for h in own]) / unit + beside.best.x[-len(own) :]
    S = beside.best.covariance[-len(own) :, -len(own) :]
    none_else = np.eye(len(own))[[h.place not in belief.named for h in own]]
    all_alike = np.diff(np.eye(len(own)), axis=0)
    log_places = float(np.log(belief.catalogue.n_places))
    odds = _log_density(all_alike, now, S) - _log_density(none_else, now, S) + (len(single) - 1) * log_places
    if odds < 0:
        return False
    weights = np.linalg.solve(S, np.ones(len(own)))
    delay = float(weights @ now / weights.sum()) * unit[:1]
    sure = sum(belief.named[place].log_odds for place in single) + odds
    for place in single:
        belief.setup = undone(belief.setup, belief.declared, *place)
        belief.named.pop(place)
    belief.setup = with_value(belief.setup, *together, value_of(belief.setup, *together) + delay)
    belief.named[together] = Named(every, sure)
    belief.refit()
    belief.steps += [("dropped", place, belief.left) for place in single] + [("added", together, belief.left)]
    return True


def _log_density(condition: FloatArray, x: FloatArray, S: FloatArray) -> float:
    """Logarithm of the density of ``condition x = 0`` afterwards, over that of standard normal x beforehand."""
    if not len(condition):
        return 0.0
    left, after, before = condition @ x, condition @ S @ condition.T, condition @ condition.T
    spread = np.linalg.slogdet(before)[1] - np.linalg.slogdet(after)[1]
    return float(spread - left @ np.linalg.solve(after, left)) / 2
