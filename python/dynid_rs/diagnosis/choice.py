"""Which candidate, if any: weighed by what it takes off, tested against chance and on blocks it has not seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import Beside, Gain, independent_rows
from dynid_rs.diagnosis.candidate import Candidate, stacked
from dynid_rs.diagnosis.null import p_value

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Weighed:
    """A candidate and what speaks for it.

    Attributes
    ----------
    gain : Gain
        What it takes off the weighted residual power, and its coefficients.
    evidence : float
        Logarithm of the likelihood ratio less what its parameters cost (half the logarithm of the number of
        independent samples each, as in the Bayesian information criterion; a shape that is believed, its doubt).
    after : ndarray (n_rows, n_joints)
        What is left with it.
    p_value : float
        Of its score under chance, by itself; NaN before it was tested.
    left_out_ratio : float
        Least ratio over the joints of the error with it over without on left-out blocks; NaN before it was tested.
    pays : float
        How many standard errors the left-out power falls by; NaN before it was tested.
    mean_log_ratio : float
        Mean over left-out blocks of the logarithm of the power on its joints with it over without.
    median_log_ratio : float
        Median over left-out blocks of the same.
    """

    candidate: Candidate
    gain: Gain
    evidence: float
    after: FloatArray
    p_value: float = float("nan")
    left_out_ratio: float = float("nan")
    pays: float = float("nan")
    mean_log_ratio: float = float("nan")
    median_log_ratio: float = float("nan")


def weigh(beside: Beside, candidate: Candidate) -> Weighed:
    """Weigh one candidate beside the whole model."""
    columns = stacked(candidate.columns)
    gain = beside.gains(columns, [slice(None)], [candidate.bounds])[0]
    after = beside.with_columns(columns, gain.coefficients)
    free = int(np.sum(gain.coefficients != 0))
    independent = independent_rows(after, beside.blocks)
    before_power, after_power = np.sum(beside.residual**2, axis=0), np.sum(after**2, axis=0)
    ratio = np.log(np.maximum(before_power, 1e-300) / np.maximum(after_power, 1e-300))
    priced = free + (candidate.n_searched if candidate.doubt is None else 0)
    cost = 0.5 * priced * np.log(max(float(np.mean(independent)), 2.0)) + (candidate.doubt or 0.0)
    return Weighed(candidate, gain, float(0.5 * independent @ ratio - cost), after)


def tested(beside: Beside, weighed: Weighed, without: FloatArray) -> Weighed:
    """`weighed` with its tests; `without` is `beside.left_out(None)`.

    The thirds of a lone run are asked in two ways, and the worse answer counts: with everything fitted to the others,
    and with the candidate alone. The first is mostly about base parameters, the second does not see what they cost;
    what has to fall clearly is the power in the second.
    """
    candidate = weighed.candidate
    columns = stacked(candidate.columns)
    free = weighed.gain.coefficients != 0
    p = p_value(beside, columns, weighed.after, free, n_searched=candidate.n_searched)
    ratio, pays, logs = _predicted(beside, candidate, without, beside.left_out(columns, candidate.bounds))
    mean_log, median_log = float(np.mean(logs)), float(np.median(logs))
    if beside.n_runs == 1:
        elsewhere = beside.with_coefficients_of_others(columns, candidate.bounds)
        own_ratio, own_pays, own_logs = _predicted(beside, candidate, beside.residual, elsewhere)
        ratio, mean_log = max(ratio, own_ratio), max(mean_log, float(np.mean(own_logs)))
        median_log = max(median_log, float(np.median(own_logs)))
        pays = own_pays if pays > 0 else min(pays, own_pays)
    return replace(
        weighed,
        p_value=p,
        left_out_ratio=ratio,
        pays=pays,
        mean_log_ratio=mean_log,
        median_log_ratio=median_log,
    )


def _predicted(
    beside: Beside, candidate: Candidate, without: FloatArray, left: FloatArray
) -> tuple[float, float, FloatArray]:
    """`left_out_ratio`, `pays`, and the logarithm of the power's ratio on the candidate's joints by block (n_blocks,).

    Of residuals (n_rows, n_joints) without and with a candidate.
    """
    ratio = float(np.sqrt(np.min(np.sum(left**2, axis=0) / np.maximum(np.sum(without**2, axis=0), 1e-300))))
    joints = list(candidate.joints)
    powers = [[np.sum(x[block][:, joints] ** 2, axis=0) + 1e-300 for x in (left, without)] for block in beside.blocks]
    logs = np.array([np.mean(np.log(first / second)) for first, second in powers])
    return ratio, falls_by(beside, without, left), logs


def falls_by(beside: Beside, first: FloatArray, second: FloatArray) -> float:
    """By how many of its standard errors the weighted power of `second` lies below that of `first` (Vuong 1989).

    Both (n_rows, n_joints); the error of the difference respects its memory.
    """
    from dynid_rs.memory import flat_top

    difference = ((first**2 - second**2) * beside.weights**2).sum(axis=1)
    mean = float(difference.mean())
    parts = [difference[block] - mean for block in beside.blocks]
    longest = max(map(len, parts))
    sums, counts = np.zeros(longest), np.zeros(longest)
    for part in parts:
        full = np.correlate(part, part, "full")[len(part) - 1 :]
        sums[: len(part)] += full
        counts[: len(part)] += len(part) - np.arange(len(part))
    covariances = sums / np.maximum(counts, 1.0)
    if covariances[0] <= 0:
        return 0.0
    taper = flat_top(covariances, float(counts[0]))
    variance = float(2 * (taper * covariances[: len(taper)]).sum() - covariances[0])
    variance = max(variance, covariances[0] / 4)
    return mean * float(np.sqrt(len(difference) / variance))
