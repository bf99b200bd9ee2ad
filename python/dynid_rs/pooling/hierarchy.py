"""One quantity of many arms: what the type shares, how far arms deviate, and how odd each of them is.

Arm i has the value ``theta_i = mu + delta_i``, ``delta_i ~ N(0, T)``, and the estimate ``y_i ~ N(theta_i, s_i^2)``, so
that ``y_i ~ N(mu, v_i)`` with ``v_i = T + s_i^2``. mu and T come from the arms that are not odd, by restricted maximum
likelihood, whose equations are (Patterson and Thompson 1971, Biometrika 58; the last term gives back the degree of
freedom that mu takes)::

    mu = sum y_i / v_i / sum 1 / v_i
    sum ((y_i - mu)^2 / v_i^2 - 1 / v_i) + (sum 1 / v_i^2) / (sum 1 / v_i) = 0      or T = 0

An odd arm must not hide behind the deviation that it causes, nor may a usual one be left out, which would make T too
small and the others odd. So it goes in two steps. **In**: a mixture in which an arm is odd, ``y_i ~ N(mu, k^2 v_i)``,
with probability e; the equations above weighted by the probability ``r_i`` of not being odd. Each has the mean zero at
the truth, for under the mixture ``E[r g(y)] = (1 - e) E[g(y) | not odd]``, and far arms have no say. **Out**: arms that
the mixture has left out come back, the nearest first, until one is less likely than `COMES_BACK` over the number of
arms by Student's test against those inside; it and those farther out stay outside. In a fleet without odd arms all are
inside with a probability of 95 % or more, and tests on the rest are the textbook's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

WIDE = 10.0
"""k: an odd arm is about ten deviations off. Between 3 and 30 it moves the border of what counts, where both densities
are alike, by half a deviation: ``d^2 = 2 log(k (1 - e) / e)``, 3.6 to 4.2 at e = 0.005."""
EXPECTED_ODD, WORTH = 0.05, 10.0
"""Share of odd arms that a fleet is expected to have, and how many arms this expectation counts as."""
COMES_BACK = 0.05
"""Probability that a fleet without odd arms has one left outside, in one quantity."""
MOST_ROUNDS = 200
TIGHT = 1e-9
"""Relative change of the deviation at which the rounds end."""
MOST_LEFT_OUT = 60
"""In fleets up to this size every arm is judged by a fit without it. In larger ones only arms beyond
`FAR`: an arm of such a fleet moves mu and T by less than a sixtieth, and none within `FAR` is ever named."""
FAR = 2.5


@dataclass(frozen=True, eq=False)
class Shared:
    """What the arms of a type share in one quantity.

    Parameters
    ----------
    mean, deviation : float
        mu and the root of T.
    mean_std_error : float
        Of `mean`.
    usual : ndarray (n_arms,) of bool
        Arms that are not odd in this quantity, from which mu and T come.
    """

    mean: float
    deviation: float
    mean_std_error: float
    usual: NDArray[np.bool_]

    @property
    def n_usual(self) -> int:
        """Number of arms that determine it."""
        return int(self.usual.sum())


def share(y: FloatArray, s: FloatArray) -> Shared:
    """Fit mu and T to estimates `y` (n,) with standard errors `s` (n,), which may be zero."""
    from scipy.special import stdtr

    y, square = np.asarray(y, dtype=float), np.asarray(s, dtype=float) ** 2
    n = len(y)
    if n == 0 or np.all(y == y[0]):  # a lone arm, or nothing that differs, such as zeros of what no arm has
        error = float(1 / np.sqrt(np.sum(1 / square))) if n and square.all() else 0.0
        return Shared(float(y[0]) if n else 0.0, 0.0, error, np.ones(n, dtype=bool))
    mean, power, usual = _mixture(y, square)
    inside = usual > 0.5
    if inside.sum() < 2:
        inside[:] = True
    outside = np.flatnonzero(~inside)
    for i in outside[np.argsort((y[outside] - mean) ** 2 / (power + square[outside]))]:
        mean, power = _restricted(y[inside], square[inside], mean, power)
        v = power + square[inside]
        spread = np.sqrt(power + square[i] + 1 / np.sum(1 / v))
        if 2 * stdtr(inside.sum() - 1, -abs(y[i] - mean) / spread) < COMES_BACK / n:
            break
        inside[i] = True
    mean, power = _restricted(y[inside], square[inside], mean, power)
    v = np.maximum(power + square[inside], _least(y))
    return Shared(mean, float(np.sqrt(power)), float(1 / np.sqrt(np.sum(1 / v))), inside)


def _restricted(y: FloatArray, square: FloatArray, mean: float, power: float) -> tuple[float, float]:
    """Mu and T by restricted maximum likelihood, Fisher's scoring from a start."""
    return _rounds(y, square, mean, power, np.ones_like)[:2]


def _mixture(y: FloatArray, square: FloatArray) -> tuple[float, float, FloatArray]:
    """mu, T and r of the mixture, from the median and the median deviation on."""
    from scipy.special import expit

    n, mean = len(y), float(np.median(y))
    spread = 1.4826 * float(np.median(np.abs(y - mean)))
    odd = EXPECTED_ODD

    def usual(distance: FloatArray) -> FloatArray:
        """One over one plus the ratio of both densities."""
        nonlocal odd
        log_ratio = math.log((1 - odd) * WIDE / odd) - 0.5 * (1 - WIDE**-2) * distance
        found: FloatArray = expit(log_ratio)
        odd = min(max((n - float(found.sum()) + EXPECTED_ODD * WORTH) / (n + WORTH), 1e-6), 0.5)
        return found

    return _rounds(y, square, mean, max(spread**2 - float(np.median(square)), 0.0), usual)


def _rounds(
    y: FloatArray, square: FloatArray, mean: float, power: float, usual: Callable[[FloatArray], FloatArray]
) -> tuple[float, float, FloatArray]:
    """Solve the equations weighted by `usual`, a function of the squared distances in deviations."""
    least, typical = _least(y), float(square.mean())
    for _ in range(MOST_ROUNDS):
        v = np.maximum(power + square, least)
        r = usual((y - mean) ** 2 / v)
        weight = r / v
        total, slopes = float(weight.sum()), weight / v
        mean = float(weight @ y) / total
        curvature = float(slopes.sum())
        slope = float(slopes @ (y - mean) ** 2) - total + curvature / total
        before, power = power, max(power + slope / curvature, 0.0)
        if abs(power - before) <= TIGHT * (power + typical) or power < least:
            break
    return mean, power, usual((y - mean) ** 2 / np.maximum(power + square, least))


def _least(y: FloatArray) -> float:
    """Variance that is rounding."""
    return float((1e-12 * np.abs(y).max()) ** 2)


@dataclass(frozen=True, eq=False)
class Judged:
    """Every arm against the others.

    `deviations` (n_arms,): distance from the type's mean without the arm, in deviations that are expected of an arm
    that is not odd: ``(y_i - mu) / sqrt(T + s_i^2 + var mu)``. `p_value` (n_arms,): of such a distance or a greater
    one, by Student's distribution with as many degrees of freedom as determine T. It is exact where standard errors are
    zero and all arms are normal, and too large, so on the safe side, where standard errors, which are known, dominate.
    """

    shared: Shared
    deviations: FloatArray
    p_value: FloatArray


def judge(y: FloatArray, s: FloatArray) -> Judged:
    """Judge every arm by a fit without it."""
    from scipy.special import stdtr

    y, s = np.asarray(y, dtype=float), np.asarray(s, dtype=float)
    whole = share(y, s)
    n = len(y)
    deviations = _distance(y, s, whole)
    freedom = np.full(n, float(max(whole.n_usual - 2, 1)))
    for i in range(n):
        if n <= 2 or (n > MOST_LEFT_OUT and abs(deviations[i]) < FAR):
            continue
        others = np.arange(n) != i
        without = share(y[others], s[others])
        deviations[i] = _distance(y[i : i + 1], s[i : i + 1], without)[0]
        freedom[i] = float(max(without.n_usual - 1, 1))
    chance = np.asarray(2 * stdtr(freedom, -np.abs(deviations)), dtype=np.float64)
    return Judged(whole, deviations, chance)


def _distance(y: FloatArray, s: FloatArray, shared: Shared) -> FloatArray:
    spread = np.sqrt(shared.deviation**2 + s**2 + shared.mean_std_error**2)
    distance: FloatArray = (y - shared.mean) / np.where(spread > 0, spread, 1.0)
    return distance


def least_arms(limit: float) -> int:
    """Fewest arms of a type of which one that is `WIDE` deviations off is named by a test at the probability `limit`.

    With n arms T has n - 2 degrees of freedom for each of them.
    """
    from scipy.special import stdtr

    n = 3
    while 2 * stdtr(n - 2, -WIDE) > limit:
        n += 1
    return n


def likely_power(y: FloatArray, s: FloatArray, shared: Shared) -> tuple[float, float]:
    """T to draw estimates to the mean with, and its standard error.

    The T that is likeliest is often zero where arms differ by less than their standard errors, and then every arm would
    be called the same, for sure. Instead T maximises T times its restricted likelihood, which is never zero and stands
    for the mean of what T may be (Morris and Tang 2011, Statistical Science 26). Its error is Fisher's,
    ``sqrt(2 / sum 1 / v_i^2)``. Fewer than five usual arms say nothing better than the likeliest T.
    """
    from scipy.optimize import brentq

    y, square = y[shared.usual], s[shared.usual] ** 2
    likeliest = shared.deviation**2
    most = float(np.var(y) + square.mean()) if len(y) else 0.0
    if len(y) < 5 or not square.max() > 0 or most <= 0:
        return likeliest, float(np.sqrt(2 / max(len(y), 1)) * (likeliest + square.mean()))

    def score(power: float) -> float:
        v = power + square
        mean = np.sum(y / v) / np.sum(1 / v)
        likelihood = np.sum((y - mean) ** 2 / v**2 - 1 / v) + np.sum(1 / v**2) / np.sum(1 / v)
        return float(power * likelihood + 2)

    high = most
    while score(high) > 0:
        high *= 4.0
    power = float(brentq(score, 1e-12 * most, high, rtol=1e-9))
    return power, float(np.sqrt(2 / np.sum(1 / (power + square) ** 2)))


def shrunken(y: FloatArray, s: FloatArray, shared: Shared) -> tuple[FloatArray, FloatArray]:
    """Best guess of every arm's value (n,), and its standard error (n,).

    Between the arm's estimate and the type's mean, by what is known of both: ``mu + k (y - mu)``, ``k = T / (T +
    s^2)``. An arm that is odd is not drawn to the mean: its own deviation is then taken to be as wide as that of odd
    ones. The variance is ``k s^2``, and what the errors of mu and of T add, ``(1 - k)^2 var mu`` and ``((y - mu)
    dk/dT)^2 var T`` with ``dk/dT = s^2 / (T + s^2)^2`` (Morris 1983, Journal of the American Statistical Association
    78).
    """
    power, power_error = likely_power(y, s, shared)
    width = prior_power(s, power, shared.usual)
    whole = width + s**2
    keep = np.divide(width, whole, out=np.ones_like(y), where=whole > 0)
    slope = np.divide(s**2, whole**2, out=np.zeros_like(y), where=(whole > 0) & shared.usual)
    variance = keep * s**2 + ((1 - keep) * shared.mean_std_error) ** 2
    error = np.sqrt(variance + ((y - shared.mean) * slope * power_error) ** 2)
    return shared.mean + keep * (y - shared.mean), error


def prior_power(s: FloatArray, power: float | FloatArray, usual: NDArray[np.bool_]) -> FloatArray:
    """Variance (n,) of every arm's deviation from the type: T, or for an odd arm ``k^2 (T + s^2) - s^2``."""
    result: FloatArray = np.where(usual, power, WIDE**2 * (power + s**2) - s**2)
    return result
