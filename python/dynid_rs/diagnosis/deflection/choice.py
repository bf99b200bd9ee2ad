"""Which terms a gear's deflection needs: conditional tests beside all others, signs, left-out runs, ties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.deflection.system import System, inverse
from dynid_rs.diagnosis.deflection.terms import TERMS, term

FloatArray = NDArray[np.float64]

FAMILY_WISE = 0.01
"""Chance of one false term or more, over all joints and kinds."""
SHAPES_TRIED, ORDERS_TRIED = 10, 1000
"""Shapes that a search tries for each term, and orders for a kinematic error, counted as tests of their own."""
AS_GOOD = 0.1
"""Two terms are tied where exchanging them costs less than this part of the first one's gain, in the logarithm."""
DETERMINED = 2.5
"""A stiffness is one if it stands so many standard errors, the load's included, above zero compliance; twice as many
where a lone run is all there is, because its load and its deflection err alike."""
LEAST_GAIN = {"compliance": 0.05, "backlash": 0.1, "eccentricity": 0.1, "cubic": 0.01}
"""Part of the power on runs left out that a term has to take off. With encoders a thousand times as fine as the
deflection, what the columns of other terms get slightly wrong is significant too, but it is no effect."""
LEAST_BEND = 0.005
"""Part of the linear wind-up that the curved part has to reach somewhere; a gear as straight as that is a spring."""
BENT_BESIDE_PLAY = 0.05
"""The same beside play, whose teeth come into contact by some law of their own."""
LEADING = ("delay", "compliance", "cubic", "backlash", "eccentricity")
"""Terms that name a kind."""
BASIC = ("delay",)
"""Always fitted: two channels are never exactly on one clock."""
MOST_CHANGES = 40


@dataclass(frozen=True, eq=False)
class Choice:
    """Terms that a gear needs, with the p-value of each beside the others, and which others would do as well."""

    names: tuple[str, ...]
    p_values: dict[str, float]
    ties: dict[str, tuple[str, ...]]


def choose(system: System, n_joints: int) -> Choice:
    """Take out what is not needed, the least needed first, from a system of all terms.

    Significance comes from a Wald test beside all other terms under the residual's own spectrum (what phase-randomised
    residuals would give, without drawing them), at a level for all joints, terms and shapes together. A term of the
    wrong sign, or one that does not help to predict runs left out, is none.
    """
    level = FAMILY_WISE / (n_joints * len(TERMS))
    names = list(system.columns)
    for _ in range(MOST_CHANGES):
        worst = _worst(system, names, level)
        if worst is not None:
            names = _without(names, worst)
            continue
        missed = _missed(system, names, level)
        if missed is None:
            break
        names = [name for name in system.columns if name in names or name == missed]
    p_values = {name: wald(system, names, name) for name in names}
    return Choice(tuple(names), p_values, {name: _ties(system, names, name) for name in names if name in LEADING})


def wald(system: System, names: Sequence[str], name: str) -> float:
    """Probability of a coefficient as large as that of `name` where there is nothing, beside all other `names`."""
    # Without compliance the load's error is nothing either: it does not speak against the gear's yielding.
    covariance = system.covariance(names, load_known=name == "compliance")
    return _probability(system.coefficients(names)[1], covariance, system.among(names, name))


def _probability(x: FloatArray, covariance: FloatArray, places: Sequence[int]) -> float:
    from scipy.stats import chi2

    own = covariance[np.ix_(places, places)]
    return float(chi2.sf(x[places] @ inverse(own) @ x[places], len(places)))


def tried(name: str) -> int:
    """How many tests a term stands for."""
    return ORDERS_TRIED if name.startswith("ripple") else SHAPES_TRIED


def _worst(system: System, names: Sequence[str], level: float) -> str | None:
    """Term that has to go first; None if all are needed."""
    x, covariance = system.coefficients(names)[1], system.covariance(names)
    wrong, p_values = {}, {}
    for name in names:
        if name in BASIC:
            continue
        places = system.among(names, name)
        size = float(np.linalg.norm(x[places]))
        std = float(np.sqrt(max(covariance[places[0], places[0]], 1e-300)))
        sign = term(name).sign
        if (sign and sign * x[places[0]] <= 0) or size > term(name).most or _straight(system, names, x, name):
            wrong[name] = size / std
        if name == "compliance":
            p = wald(system, names, name)
            if size < DETERMINED * (1 if len(system.runs) > 1 else 2) * std:
                wrong[name] = size / std
        else:
            p = _probability(x, covariance, places)
        p_values[name] = min(1.0, p * tried(name))
    leaves = [name for name in p_values if not any(term(other).parent == name for other in names)]
    doubtful = [name for name in leaves if p_values[name] > level]
    if doubtful:
        return max(doubtful, key=lambda name: p_values[name])
    if wrong:
        return min(wrong, key=lambda name: wrong[name])
    parents = [name for name in p_values if p_values[name] > level]
    if parents:
        return parents[0]
    useless = {name: _gain(system, names, name) - LEAST_GAIN.get(name, 0.0) for name in p_values}
    least = min(useless, key=lambda name: useless[name], default=None)
    return least if least is not None and useless[least] <= 0 else None


def _straight(system: System, names: Sequence[str], x: FloatArray, name: str) -> bool:
    """Whether `name` is a curved part that no one would see beside the linear one."""
    if name != "cubic" or "compliance" not in names:
        return False
    curved, linear = (
        abs(float(x[system.among(names, part)[0]])) * max(float(np.abs(c).max()) for c in system.columns[part])
        for part in ("cubic", "compliance")
    )
    return curved < (BENT_BESIDE_PLAY if "backlash" in names else LEAST_BEND) * linear


def _gain(system: System, names: Sequence[str], name: str) -> float:
    """Relative power that a term takes off runs left out; not above zero where most runs are worse with it."""
    from scipy.stats import gmean

    others = _without(names, name)
    runs = range(system.n_blocks)
    with_it = np.array([system.power(names, k) for k in runs])
    without = np.array([system.power(others, k) for k in runs])
    if np.mean(with_it < without) <= 0.5:
        return 0.0
    # In the logarithm: the run that goes worst with and without it must not decide alone.
    gain = float(1 - gmean(with_it / np.maximum(without, 1e-300)))
    if len(system.runs) < system.n_blocks:
        # Parts of one run resemble each other: here it must.
        gain = min(gain, float(1 - with_it.sum() / without.sum()))
    return gain


def _missed(system: System, names: Sequence[str], level: float) -> str | None:
    """Term that went too early, beside others that went later."""
    best, found = 1.0, None
    before = system.power(names)
    for name in system.columns:
        if name in names or (term(name).parent and term(name).parent not in names):
            continue
        more = [other for other in system.columns if other in names or other == name]
        sign = term(name).sign
        x = system.coefficients(more)[1][system.among(more, name)]
        if (
            (sign and sign * x[0] <= 0)
            or wald(system, more, name) * tried(name) > level
            or _gain(system, more, name) <= LEAST_GAIN.get(name, 0.0)
        ):
            continue
        if _worst(system, more, level) is not None:
            continue
        power = system.power(more) / before
        if power < best:
            best, found = power, name
    return found


def _without(names: Sequence[str], gone: str) -> list[str]:
    """`names` without a term and what presupposes it."""
    return [name for name in names if name != gone and term(name).parent != gone]


def _ties(system: System, names: Sequence[str], name: str) -> tuple[str, ...]:
    """Terms that would explain as much as `name` on runs left out, in its place."""
    back = system.runs[0].delay if name == "delay" else 0.0
    others = _without(names, name)

    def left(terms: Sequence[str]) -> float:
        return float(np.mean([np.log(system.power(terms, k, late=back)) for k in range(system.n_blocks)]))

    without = left(others)
    gain = without - left(names)
    tied = []
    for other in LEADING:
        if other not in system.columns or other in names or term(other).parent not in ("", *others):
            continue
        swapped = [*others, other]
        sign = term(other).sign
        right = not sign or sign * system.coefficients(swapped, late=back)[1][-1] > 0
        if right and without - left(swapped) >= (1 - AS_GOOD) * gain > 0:
            tied.append(other)
    return tuple(tied)
