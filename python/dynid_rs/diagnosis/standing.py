"""Which names stand beside all others: those that are unlikely go, and those that do harm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.estimates import Estimate, estimates, may_be_nothing
from dynid_rs.diagnosis.hypotheses import Hypothesis
from dynid_rs.diagnosis.shaped import Place, shaped_as
from dynid_rs.diagnosis.structural import value_of
from dynid_rs.diagnosis.structural.torque_gain import USUAL, gain_spread
from dynid_rs.diagnosis.trials import blocks, whole_runs, worse
from dynid_rs.regression.linear_model import Columns

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]

HARM = 1.02
"""No joint's left-out error may grow by this factor."""


def backward(belief: Belief, need: float = 0.0) -> set[Place]:
    """Take out names whose logarithmic odds beside all others have fallen below `need`; which those were.

    Odds of one to one while names still come and go, those at which a name is believed in the end.
    """
    dropped: set[Place] = set()
    while True:
        odds = standing(belief)
        weakest = min(odds, key=lambda place: odds[place], default=None)
        if weakest is None or odds[weakest] > need:
            return dropped
        belief.remove(weakest)
        dropped.add(weakest)


def standing(belief: Belief, unnamed: Sequence[Columns] = ()) -> dict[Place, float]:
    """Logarithmic odds of every name of the setup beside all others, and beside `unnamed` torques if there are some."""
    beside = belief.beside
    for columns in unnamed:
        beside = beside.with_columns(columns)
    log_places = float(np.log(belief.catalogue.n_places))
    odds = {place: value - log_places for place, value in _structure(belief, beside).items()}
    for effect, places in zip(belief.setup.effects, belief.places(), strict=True):
        (h,) = belief.catalogue.of([shaped_as(effect)])
        odds[h.place] = beside.without(places).evidence_for(h)[0] - log_places
    return odds


def _structure(belief: Belief, beside: Beside) -> dict[Place, float]:
    """Logarithm of the Bayes factor of the changes of structure, by their posterior's density at what was declared.

    ``ln BF = v' S^-1 v / 2 + ln(det S / det S_0) / 2``: value v, its covariance S beside everything, its prior's S_0
    (Dickey 1971, Annals of Mathematical Statistics 42).
    """
    factors = {}
    for h in belief.structure():
        if h.place == belief.mounting:
            continue
        size = max(h.sizes)
        after = beside.with_columns({j: size * part for j, part in h.columns.items()})
        value = belief.moved(h.place)
        width, unit = len(value), size * h.unit[: len(value)]
        at = slice(len(after.best.x) - len(h.unit), len(after.best.x) - len(h.unit) + width)
        S = after.best.covariance[at, at]
        z = (value + after.best.x[at] * unit) / unit
        factors[h.place] = 0.5 * float(z @ np.linalg.solve(S, z)) + 0.5 * float(np.linalg.slogdet(S)[1])
    return factors | _gains(belief, beside)


def _gains(belief: Belief, beside: Beside) -> dict[Place, float]:
    """The same of gains, which stand in the fit's model already, by their logarithms."""
    scale, usual = belief.fit.links_.torque_scale_, float(USUAL[0])
    spread_of_all = np.sqrt(np.diag(beside.best.covariance))
    factors: dict[Place, float] = {}
    for kind, joints in belief.named:
        spread = gain_spread(belief.fit, joints[0], spread_of_all) if kind == "torque_gain" else None
        if spread is not None:
            z = float(np.log(scale[joints[0]])) / spread
            factors[kind, joints] = 0.5 * z**2 + float(np.log(spread / usual))
    return factors


def sized(belief: Belief) -> None:
    """Take out changes of structure that have no size, the least certain first: all they say may as well be zero.

    Evidence is that of the likeliest shapes. With those of all names and of friction unknown together, and other in
    every part of the data, what is likely may turn out to be what they can be as well. (A torque that has no size stays
    for what it predicts, without a name, `entries.py`, unless the last fit says that it may be nothing.)
    """
    while True:
        known = estimates(belief)
        structure = [h.place for h in belief.structure() if h.place != belief.mounting]
        at = [place for place in structure if _may_be_declared(belief, place, known[place])]
        if not at:
            return
        belief.remove(min(at, key=lambda place: belief.named[place].log_odds))


def without_nothing(belief: Belief) -> bool:
    """Take out the least certain torque of those that may be nothing at all, if there is one; whether there was.

    Asked of the last fit, under whose weights and beside all whose names a torque may be less than it was when it was
    found. One that is there, though no number of it has a size, stays for what it predicts (`entries.py`).
    """
    nothing = {(effect.kind, effect.joints) for effect in may_be_nothing(belief)} & belief.named.keys()
    if nothing:
        belief.remove(min(nothing, key=lambda place: belief.named[place].log_odds))
    return bool(nothing)


def _may_be_declared(belief: Belief, place: Place, known: Sequence[Estimate]) -> bool:
    """Whether every number of a change of structure may be the one that was declared."""
    declared = value_of(belief.declared, *place)
    return all(may_be(value, number.interval) for value, number in zip(declared, known, strict=True))


def may_be(value: float, interval: tuple[float, float] | None) -> bool:
    """Whether a value is within an interval; what has none is not known at all."""
    return interval is None or interval[0] <= value <= interval[1]


def harmless(belief: Belief) -> None:
    """Take out names until no joint is predicted worse than by the declared model, on parts that were left out.

    Worse: by more than `HARM`, and by more than chance over the parts, of all joints that a name reaches together. Of
    the names that do it the least certain goes first.
    """
    declared = belief.at_first
    ways = [parts for parts in (blocks(belief.phase), whole_runs(belief.phase, belief.run_lengths)) if parts]
    before = [declared.model.left_out(declared.best, parts) for parts in ways]
    while belief.named.keys() - {belief.mounting}:
        after = [belief.beside.model.left_out(belief.beside.best, parts) for parts in ways]
        trials = list(zip(ways, after, before, strict=True))
        names = [named for place, named in belief.named.items() if place != belief.mounting]
        guilty = [named for named in names if _is_guilty(belief, named.hypothesis, trials)]
        if not guilty:
            return
        belief.remove(min(guilty, key=lambda named: named.log_odds).hypothesis.place)


def _is_guilty(belief: Belief, h: Hypothesis, trials: Sequence[tuple[list[BoolArray], FloatArray, FloatArray]]) -> bool:
    """Whether joints that a name reaches are predicted worse, for it; parts, and power left out with names and without.

    A change of structure has no columns to take out again: it is guilty of what happens where it reaches.
    """
    at = belief.reach(h)
    torques = belief.by_place()
    places = torques.get(h.place)
    for parts, lost, declared in trials:
        harmed = np.array(at)[harms(lost[:, at], declared[:, at], len(trials))]
        if len(harmed) and (places is None or _spares(belief.beside.without(places), parts, lost, harmed)):
            return True
    return False


def _spares(without: Beside, parts: list[BoolArray], lost: FloatArray, harmed: IntArray) -> bool:
    """Whether joints are predicted better without a torque: one that makes no difference to them harms them not."""
    spared: FloatArray = without.model.left_out(without.best, parts)[:, harmed]
    return bool(spared.sum() < lost[:, harmed].sum())


def harms(after: FloatArray, before: FloatArray, n_ways: int) -> BoolArray:
    """Which joints are predicted worse; power left out of parts and joints, (n_parts, n_joints) each."""
    ratio = np.sqrt(after.sum(axis=0) / np.maximum(before.sum(axis=0), 1e-300))
    harms: BoolArray = (ratio > HARM) & worse(after - before, n_ways * after.shape[1])
    return harms
