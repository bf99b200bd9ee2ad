"""Which signals a leftover depends on: the fewest whose products predict it on rows left out.

Signals on one trajectory are alike, so almost any of them explains something of what another one does. Sets of signals
are therefore compared, all pairs of them, and a signal stays in a set only if the set is worse without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.products import LeftOutRows, Score
from dynid_rs.diagnosis.signals import Signal

FloatArray = NDArray[np.float64]

BEAM = 3
"""Best pairs that are tried with a third signal."""
ENOUGH = 0.06
"""A smaller set is enough if it leaves at most this part more of what the best one explains."""
RIVALS = 20
"""Best other sets that are compared with the chosen one."""
NEEDED = 0.04
"""A signal without which a set explains less by a smaller part is not direct."""
NEEDED_THIRD = 0.15
"""The same for a third signal: products of three are flexible enough to follow what they do not depend on."""
NULL_BEAMS = 2
"""Surrogates whose best pair is tried with a third signal too."""
THIRD = 0.25
"""A third signal is looked for where pairs leave this part of what exceeds the noise."""


@dataclass(frozen=True, eq=False)
class Dependence:
    """What a leftover depends on.

    Parameters
    ----------
    signals : tuple of Signal
        The set, strongest first.
    strengths : tuple of float
        Part of the explained power that is lost without each signal, 0 to 1.
    explained : float
        Part of the power that the set predicts on rows left out.
    ties : tuple of tuple of Signal
        Other sets of that size or less that predict about as well, or no worse than chance could have it.
    score : Score
        Of the set.
    """

    signals: tuple[Signal, ...]
    strengths: tuple[float, ...]
    explained: float
    ties: tuple[tuple[Signal, ...], ...]
    score: Score


@dataclass(frozen=True, eq=False)
class Search:
    """Every single signal and pair, and some of three, scored; the first target is the residual, the others surrogates.

    `scores` the best first; `without` the residual's power on rows left out; `gain` (n_targets,) the logarithm of the
    power over the least that any of them leaves.
    """

    scores: tuple[Score, ...]
    without: float
    gain: FloatArray


def search(rows: LeftOutRows, signals: Sequence[Signal], noise: float) -> Search:
    """Score singles and pairs, and where pairs leave much more than `noise`, the best of them with a third signal.

    `noise` is the power that nothing can explain, summed over the rows.
    """
    sets = [(signal,) for signal in signals] + list(combinations(signals, 2))
    scores = [rows.score(chosen) for chosen in sets]
    gain = np.log(rows.without / np.min([score.power for score in scores], axis=0))
    without, best = float(rows.without[0]), min(map(_power, scores))
    if best - noise > THIRD * (without - noise):
        more = _with_a_third(rows, scores, signals, 0, BEAM)
        # Surrogates would gain from a third signal of their own as well; a few of them tell how much.
        targets = range(1, min(1 + NULL_BEAMS, len(gain)))
        own = [min(float(s.power[k]) for s in _with_a_third(rows, scores, signals, k, 1)) for k in targets]
        extra = [max(float(np.log(rows.without[k] / p) - gain[k]), 0.0) for k, p in zip(targets, own, strict=True)]
        gain[1:] += np.mean(extra) if extra else 0.0
        scores += more
        gain[0] = np.log(without / min(map(_power, scores)))
    return Search(tuple(sorted(scores, key=_power)), without, gain)


def _with_a_third(
    rows: LeftOutRows, scores: Sequence[Score], signals: Sequence[Signal], target: int, n_pairs: int
) -> list[Score]:
    """Score the best pairs of one target with every third signal."""
    pairs = sorted((s for s in scores if len(s.signals) == 2), key=lambda s: float(s.power[target]))[:n_pairs]
    more = {tuple(sorted((*p.signals, signal))) for p in pairs for signal in signals if signal not in p.signals}
    return [rows.score(chosen) for chosen in sorted(more)]


def dependence(rows: LeftOutRows, found: Search) -> Dependence:
    """Name the signals."""
    scores, without = found.scores, found.without
    best = _power(scores[0])
    limit = best + ENOUGH * max(without - best, 0.0)
    enough = sorted((s for s in scores if _power(s) <= limit), key=lambda s: (len(s.signals), _power(s)))
    chosen = _pruned(rows, _identified(rows, enough))
    rivals = [s for s in scores if s is not chosen and len(s.signals) <= len(chosen.signals)][:RIVALS]
    alike = tuple(s.signals for s in rivals if _power(s) <= limit or not rows.worse(s, chosen))
    lost = {signal: _lost(rows, chosen, signal) for signal in chosen.signals}
    order = tuple(sorted(lost, key=lambda signal: -lost[signal]))
    explained = 1 - _power(chosen) / without
    return Dependence(order, tuple(lost[signal] for signal in order), explained, alike, chosen)


def _pruned(rows: LeftOutRows, chosen: Score) -> Score:
    while len(chosen.signals) > 1:
        weakest = min(chosen.signals, key=lambda signal: _lost(rows, chosen, signal))
        if _lost(rows, chosen, weakest) >= (NEEDED if len(chosen.signals) < 3 else NEEDED_THIRD):
            break
        chosen = rows.score([signal for signal in chosen.signals if signal != weakest])
    return chosen


def _identified(rows: LeftOutRows, enough: Sequence[Score]) -> Score:
    """Return the best set, less a third signal that others can stand in for."""
    best = enough[0]
    if len(best.signals) < 3:
        return best
    for pair in combinations(best.signals, 2):
        if any(set(pair) < set(other.signals) for other in enough[1:] if len(other.signals) == 3):
            return rows.score(pair)
    return best


def _lost(rows: LeftOutRows, chosen: Score, signal: Signal) -> float:
    """Part of what a set explains that is lost without one of its signals."""
    others = [other for other in chosen.signals if other != signal]
    without = float(rows.without[0])
    left = _power(rows.score(others)) if others else without
    return float(np.clip((left - _power(chosen)) / max(without - _power(chosen), 1e-300), 0.0, 1.0))


def _power(score: Score) -> float:
    return float(score.power[0])
