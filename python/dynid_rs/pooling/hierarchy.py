"""One quantity of many arms: what the type shares, how far arms deviate, and how odd each of them is.

Arm i has the value ``theta_i = mu + delta_i``, ``delta_i ~ N(0, T)``, and the estimate ``y_i ~ N(theta_i, s_i^2)``, so that
``y_i ~ N(mu, v_i)`` with ``v_i = T + s_i^2``. Some arms are odd: ``y_i ~ N(mu, k^2 v_i)`` with probability e. With
``r_i`` the probability that arm i is not odd (Bayes), mu and T solve the equations of restricted maximum likelihood of
the arms that are not::

    mu = sum r_i y_i / v_i / sum r_i / v_i
    sum r_i ((y_i - mu)^2 / v_i^2 - 1 / v_i) + (sum r_i / v_i^2) / (sum r_i / v_i) = 0      or T = 0

Each equation has the mean zero at the truth: under the mixture ``E[r g(y)] = (1 - e) E[g(y) | not odd]``, which is zero
for the scores g of a normal distribution. An odd arm far away has ``r_i = 0`` and widens nothing, so it cannot hide
behind the deviation that it causes. The last term gives back the degree of freedom that mu takes (Patterson and
Thompson 1971, Biometrika 58).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

WIDE = 10.0
"""k: an odd arm is about ten deviations off. Between 3 and 30 it moves the border of what counts, where both densities are
alike, by half a deviation: ``d^2 = 2 log(k (1 - e) / e)``, 3.6 to 4.2 at e = 0.005."""
EXPECTED_ODD, WORTH = 0.05, 10.0
"""Share of odd arms that a fleet is expected to have, and how many arms this expectation counts as."""
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
    usual : ndarray (n_arms,)
        r: probability of each arm not to be odd in this quantity.
    n_effective : float
        Sum of `usual`: as many arms determine it.
    """

    mean: float
    deviation: float
    mean_std_error: float
    usual: FloatArray
    n_effective: float


def share(y: FloatArray, s: FloatArray, start: Shared | None = None) -> Shared:
    """Fit mu and T to estimates `y` (n,) with standard errors `s` (n,), which may be zero.

    `start`: a fit of almost the same arms, from which the rounds go on.
    """
    y, square = np.asarray(y, dtype=float), np.asarray(s, dtype=float) ** 2
    n = len(y)
    if start is None:
        mean = float(np.median(y))
        spread = 1.4826 * float(np.median(np.abs(y - mean)))
        power = max(spread**2 - float(np.median(square)), 0.0)
        odd = EXPECTED_ODD
    else:
        mean, power = start.mean, start.deviation**2
        odd = 1 - start.n_effective / max(len(start.usual), 1)
    if n == 0 or np.all(y == y[0]):  # nothing to share, or nothing that differs: zeros of what no arm has
        return Shared(float(y[0]) if n else 0.0, 0.0, 0.0, np.ones(n), float(n))
    tiny = (1e-12 * float(np.abs(y).max())) ** 2
    usual = np.ones(n)
    for _ in range(MOST_ROUNDS):
        v = np.maximum(power + square, tiny)
        odd = min(max(odd, 1e-6), 0.5)
        usual = _not_odd((y - mean) ** 2 / v, odd)
        odd = (float(np.sum(1 - usual)) + EXPECTED_ODD * WORTH) / (n + WORTH)
        weight = usual / v
        mean = float(np.sum(weight * y) / np.sum(weight))
        slope = np.sum(usual * ((y - mean) ** 2 / v - 1) / v) + np.sum(weight / v) / np.sum(weight)
        step = float(slope / np.sum(weight / v))
        before, power = power, max(power + step, 0.0)
        if abs(power - before) <= TIGHT * (power + float(square.mean())) or power < tiny:
            break
    v = np.maximum(power + square, tiny)
    usual = _not_odd((y - mean) ** 2 / v, min(max(odd, 1e-6), 0.5))
    return Shared(mean, float(np.sqrt(power)), float(1 / np.sqrt(np.sum(usual / v))), usual, float(usual.sum()))


def _not_odd(square: FloatArray, odd: float) -> FloatArray:
    """r from squared distances in deviations: one over one plus the ratio of both densities."""
    from scipy.special import expit

    log_ratio = np.log((1 - odd) * WIDE / odd) - 0.5 * square * (1 - WIDE**-2)
    usual: FloatArray = expit(log_ratio)
    return usual


@dataclass(frozen=True, eq=False)
class Judged:
    """Every arm against the others.

    `deviations` (n_arms,): distance from the type's mean without the arm, in deviations that are expected of an arm that
    is not odd: ``(y_i - mu) / sqrt(T + s_i^2 + var mu)``. `p_value` (n_arms,): of such a distance or a greater one, by
    Student's distribution with as many degrees of freedom as determine T. It is exact where standard errors are zero
    and all arms are normal, and too large, so on the safe side, where standard errors, which are known, dominate.
    """

    shared: Shared
    deviations: FloatArray
    p_value: FloatArray


def judge(y: FloatArray, s: FloatArray) -> Judged:
    """Judge every arm by a fit without it."""
    from scipy.stats import t as student

    y, s = np.asarray(y, dtype=float), np.asarray(s, dtype=float)
    whole = share(y, s)
    n = len(y)
    deviations = _distance(y, s, whole)
    freedom = np.full(n, max(whole.n_effective - 1, 1.0))
    for i in range(n):
        if n <= 2 or (n > MOST_LEFT_OUT and abs(deviations[i]) < FAR):
            continue
        others = np.arange(n) != i
        without = share(y[others], s[others], whole if n > MOST_LEFT_OUT else None)
        deviations[i] = _distance(y[i : i + 1], s[i : i + 1], without)[0]
        freedom[i] = max(without.n_effective - 1, 1.0)
    return Judged(whole, deviations, 2 * student.sf(np.abs(deviations), freedom))


def _distance(y: FloatArray, s: FloatArray, shared: Shared) -> FloatArray:
    spread = np.sqrt(shared.deviation**2 + s**2 + shared.mean_std_error**2)
    distance: FloatArray = (y - shared.mean) / np.where(spread > 0, spread, 1.0)
    return distance


def least_arms(limit: float) -> int:
    """Fewest arms of a type of which one that is `WIDE` deviations off is named by a test at the probability `limit`.

    With n arms T has n - 2 degrees of freedom for each of them.
    """
    from scipy.stats import t as student

    n = 3
    while 2 * student.sf(WIDE, n - 2) > limit:
        n += 1
    return n


def shrunken(y: FloatArray, s: FloatArray, shared: Shared) -> tuple[FloatArray, FloatArray]:
    """Best guess of every arm's value (n,), and its standard error (n,).

    Between the arm's estimate and the type's mean, by what is known of both: ``mu + k (y - mu)``, ``k = T / (T + s^2)``. An
    arm that is odd is not drawn to the mean: its own deviation is then taken to be as wide as that of odd ones.
    """
    width = prior_power(s, shared)
    keep = np.divide(width, width + s**2, out=np.ones_like(y), where=width + s**2 > 0)
    error = np.sqrt(keep * s**2 + ((1 - keep) * shared.mean_std_error) ** 2)
    return shared.mean + keep * (y - shared.mean), error


def prior_power(s: FloatArray, shared: Shared) -> FloatArray:
    """Variance (n,) of every arm's deviation from the type: T, or for an odd arm ``k^2 (T + s^2) - s^2``."""
    power = shared.deviation**2
    wide = WIDE**2 * (power + s**2) - s**2
    result: FloatArray = shared.usual * power + (1 - shared.usual) * wide
    return result
