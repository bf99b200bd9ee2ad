"""What a name has to stand: evidence at its place, and parts of the data that were left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.odds import SURE
from dynid_rs.base.threads import side_by_side
from dynid_rs.diagnosis.beside import Beside, places_of
from dynid_rs.diagnosis.hypotheses import Hypothesis
from dynid_rs.diagnosis.shaped import Place
from dynid_rs.regression.linear_model import Columns

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

N_BLOCKS = 8
"""Parts of the motion, each with its returns, that are left out one by one."""
N_SMALL = 32
"""Parts in which a name has to show: of about a second, as long as a move is."""
THIRDS = 3
"""Parts of a lone motion that stand for runs: a third is what is kept aside of a lone run for the test."""
CHANCE = 0.16
"""That parts which are worse by chance alone are taken for worse: of one standard error, were there many parts."""
LEAST_GAIN = 0.03
"""Part of some joint's left-out error that a name has to take off: an effect of a quarter of the noise does.

``1 - 1 / sqrt(1 + 0.25^2)``; a person could neither see a smaller one nor use it.
"""
SHORTLIST, HOPED_FOR = 12, 4
"""Places whose evidence is computed with the noise estimated anew in a step: those that screening puts first, and those
that it would if rows were independent."""
HOPELESS = -2.0
"""Evidence, were its rows independent, below which a place is not looked at again in a round."""


@dataclass(frozen=True, eq=False)
class Value:
    """Evidence of a place: its best hypothesis, the columns in their likeliest size."""

    value: float
    hypothesis: Hypothesis
    columns: Columns


@dataclass(frozen=True, eq=False)
class Asked:
    """What was asked beside one model: evidence by place, what may yet pass, and of how many places' logarithm."""

    values: dict[Place, Value]
    open_: list[Hypothesis]
    log_places: float

    @property
    def need(self) -> float:
        """Evidence of a name at posterior odds of 19 to 1."""
        return SURE + self.log_places


def evidence(beside: Beside, hypotheses: Sequence[Hypothesis]) -> tuple[dict[Place, Value], list[Hypothesis]]:
    """Logarithm of the Bayes factor of the places that screening puts first, averaged over their shapes.

    Those alone that screening finds more probable than nothing. Also the hypotheses of all places that are not
    hopeless: those that may yet pass beside what is named next.
    """
    scores, hopes = beside.screened_and_hoped_for(hypotheses) if hypotheses else ([], [])
    screened, hoped = np.array([score.value for score in scores]), np.array(hopes)
    places = places_of(hypotheses)
    asked: dict[Place, list[FloatArray]] = {}
    for scored, n_places in ((screened, SHORTLIST), (hoped, HOPED_FOR)):
        best = {place: float(scored[at].max()) for place, at in places.items()}
        for place in sorted(places, key=lambda place: -best[place])[:n_places]:
            if best[place] > 0:
                asked.setdefault(place, []).append(scored)

    def likeliest(place: Place) -> Value:
        found = [_averaged(beside, hypotheses, scored, places[place]) for scored in asked[place]]
        return max(found, key=lambda value: value.value)

    values = dict(zip(asked, side_by_side(likeliest, asked), strict=True))
    kept = {place for place, at in places.items() if hoped[at].max() > HOPELESS}
    return values, [h for h in hypotheses if h.place in kept]


def _averaged(beside: Beside, hypotheses: Sequence[Hypothesis], scores: FloatArray, at: Sequence[int]) -> Value:
    """Evidence of the place with the hypotheses `at`, averaged over its shapes, the best of which `scores` tell."""
    from scipy.special import logsumexp

    best = at[int(np.argmax(scores[at]))]
    value, columns = beside.evidence_for(hypotheses[best])
    return Value(value + float(logsumexp(scores[at] - scores[best]) - np.log(len(at))), hypotheses[best], columns)


def blocks(phase: IntArray, n: int = N_BLOCKS) -> list[BoolArray]:
    """Parts of the rows in order of their motion, (n_rows,) each: what returns is in one of them."""
    edges = np.sort(phase)[np.linspace(0, len(phase), n + 1).astype(int)[:-1]]
    part = np.searchsorted(edges, phase, side="right") - 1
    return [part == k for k in np.unique(part)]


def whole_runs(phase: IntArray, lengths: Sequence[int]) -> list[BoolArray]:
    """The rows of each run, (n_rows,) each, or the thirds of a lone one: as far from the rest as what comes next is.

    Runs that show each other's motion are one.
    """
    of_run = _motions(phase, lengths)
    several = np.unique(of_run)
    return [of_run == run for run in several] if len(several) > 1 else blocks(phase, THIRDS)


def _motions(phase: IntArray, lengths: Sequence[int]) -> IntArray:
    """Run whose motion every row shows, (n_rows,): the first of those that show each other's."""
    of_run = np.repeat(np.arange(len(lengths)), lengths)
    for run in range(len(lengths)):
        alike = np.unique(of_run[np.isin(phase, phase[of_run == run])])
        of_run[np.isin(of_run, alike)] = min(alike, default=run)
    return of_run


def worse(lost: FloatArray, n_tests: int = 1) -> FloatArray:
    """Whether what is lost in parts (n_parts, ...) is more than chance: one in six, by Student's t over the parts.

    That of `n_tests` together, where one of them is enough (Bonferroni).
    """
    from scipy.special import stdtrit

    need = -float(stdtrit(len(lost) - 1, CHANCE / n_tests))
    clearly: FloatArray = lost.sum(axis=0) > need * np.sqrt(len(lost)) * lost.std(axis=0, ddof=1)
    return clearly


def helps(
    before: Beside, after: Beside, joints: Sequence[int], parts: Sequence[BoolArray], runs: Sequence[BoolArray]
) -> bool:
    """Whether parts that were left out are not predicted worse on the joints it acts on, by more than chance.

    Chance: one standard error of the difference over the parts; nor whole runs, which move elsewhere. At the prior that
    suits it some joint's error has to fall by `LEAST_GAIN`: less is of no use, however certain. What it does to other
    joints through the links that they share is judged when all names are in.
    """
    own = list(joints)
    powers = []
    for left_out in (parts, runs):
        if not left_out:
            continue
        with_it = after.model.left_out(after.best, left_out)[:, own]
        without = before.model.left_out(before.best, left_out)[:, own]
        if worse((with_it - without) @ before.best.weights[own] ** 2):
            return False
        powers.append((with_it, without))
    alike = next(fit for fit in before.fits if fit.choice == after.best.choice)
    with_it, without = powers[0]
    if alike is not before.best:
        without = before.model.left_out(alike, parts)[:, own]
    left, lost = with_it.sum(axis=0), without.sum(axis=0)
    gain = 1 - np.sqrt(left / np.maximum(lost, 1e-300))
    return bool(gain.max() > LEAST_GAIN)


def shows_everywhere(before: Beside, after: Beside, joints: Sequence[int], parts: Sequence[BoolArray]) -> bool:
    """Whether small parts that were left out are predicted better on these joints, by Wilcoxon's signed ranks.

    The evidence takes what is left for a noise of one strength. Where torque jumps between two samples, or friction
    turns round, it is no such noise, and a few such places may ask for a name that is of no use at all others: ranks
    let few parts count as few, however much they gain or lose. More than chance of one in six is asked for, no more: of
    a right name beside much that is not yet explained hardly more parts gain than lose.
    """
    own = list(joints)
    lost = (after.model.left_out(after.best, parts) - before.model.left_out(before.best, parts))[:, own]
    gain = -lost @ after.best.weights[own] ** 2
    return chance_of(gain) < CHANCE


def chance_of(gain: FloatArray) -> float:
    """Chance of such gains (n_parts,) or greater ones if none were to be expected, by Wilcoxon's signed ranks.

    Their sum over the gains that are positive is nearly normal for twenty and more. (`scipy.stats.wilcoxon` is the
    same, and brings 18 MB along.)
    """
    from scipy.special import ndtr

    n, ranks = len(gain), 1 + np.argsort(np.argsort(np.abs(gain)))
    sum_of_ranks = float(ranks[gain > 0].sum() + ranks[gain == 0].sum() / 2)
    return float(ndtr((n * (n + 1) / 4 - sum_of_ranks) / np.sqrt(n * (n + 1) * (2 * n + 1) / 24)))
