"""What is left when the search has ended: the floor, structure that no name explains, and a term on its signals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.assembly import with_residual
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.data_term import WORTH, DataTerm, fit_data_term
from dynid_rs.diagnosis.floor import Floor, floor
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.leftovers import run_residuals, search_leftovers
from dynid_rs.diagnosis.patchwork import patchworks
from dynid_rs.diagnosis.ripple import RippleCandidate
from dynid_rs.diagnosis.rows_beside import Beside as Rows
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.signals import STATE, Signal, candidate_signals
from dynid_rs.diagnosis.state import Search, columns_in, fitted, hypothesis_of, rms, trusted
from dynid_rs.diagnosis.unknown import Unexplained, find_unknown
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.loops import link_load
from dynid_rs.placed import CATALOGUE, PlacedEffect
from dynid_rs.recording import Recording
from dynid_rs.results import score

FloatArray = NDArray[np.float64]

FORCED = 0.8
"""Named effects that explain less than this of what could be explained on a joint, while structure is left there that
its signals predict, are the nearest names and not the cause: they are taken back."""


OTHER_FORM = 0.3
"""A name that leaves so much of a residual's power as a function of its own signals has not their form."""
AS_WELL = 1.4
"""Times the power that is left with names, and a term beside them: a term alone that leaves no more replaces them."""
NEEDLESS, AT_ONCE = 1.01, 1.1
"""The same for a name that is not suspect by itself but stands on a joint that has a term, and for several of them: one
function of its signals is simpler than it and two names beside it."""
DISSIPATIVE = ("stribeck", "friction_hysteresis", "load_hysteresis", "load_dependent_friction")
"""Kinds that only take power; others, such as friction that varies with the position, are told apart from a mean."""
SHARP = 12.0
"""Cycles per turn from which a ripple is a line, and no approximation of anything slower."""


@dataclass(frozen=True, eq=False)
class Remainder:
    """The floor of every joint, what is unexplained, and the data-driven terms that are worth keeping.

    `nearest`: effects by joint that stay in the model and explain a part, but are only the names that come nearest.
    """

    floor: Floor
    unexplained: list[Unexplained]
    terms: list[DataTerm]
    nearest: dict[int, list[PlacedEffect]] = field(default_factory=dict)


def what_is_left(found: Search, train: Sequence[Recording]) -> Remainder:
    """Look at what the search leaves; names that were forced on a joint are taken out of `found`.

    Without something better to put in its place, the nearest name stays and what it leaves is said beside it.
    """
    floor_, unexplained = _look(found)
    best = Remainder(floor_, unexplained, _terms(found, unexplained, train))
    for forced in _forced(found, floor_, unexplained):
        bare = _without(found, forced, best, train, AS_WELL)
        best = best if bare is None else bare
    for group in _beside_terms(found, best.terms):
        there = [effect for effect in group if any(effect is other for other in found.setup.effects)]
        bare = _without(found, there, best, train, _most(found, there)) if there else None
        best = best if bare is None else bare
    return replace(best, nearest=nearest_effects(found, best))


def _beside_terms(found: Search, terms: Sequence[DataTerm]) -> list[list[PlacedEffect]]:
    """Names on joints that have a term as well, which may leave them nothing to say: together, then one by one.

    Ripple has been weighed in the angle, where it is sharper than anything that a term can be.
    """
    groups = []
    for j in sorted({term.joint for term in terms}):
        there = [e for e in found.setup.effects if e.joints == (j,) and e.kind != "torque_ripple"]
        groups += [there] if len(there) > 1 else []
        groups += [[effect] for effect in there]
    return groups


def _most(found: Search, names: Sequence[PlacedEffect]) -> float:
    """Times the power with names that a term alone may leave to replace them."""
    if len(names) > 1:
        return AT_ONCE
    return AS_WELL if _drives(found, names[0]) else NEEDLESS


def _drives(found: Search, effect: PlacedEffect) -> bool:
    """Whether a friction, as fitted, gives more power to its joint than it takes: then it is none."""
    if effect.kind not in DISSIPATIVE:
        return False
    k = next(k for k, other in enumerate(found.setup.effects) if other is effect)
    coefficients = np.array([found.fit.links_.own_[place] for place in columns_in(found)[k]])
    columns = found.kinds.columns([hypothesis_of(effect, found.kinds)])[0]
    (j,) = effect.joints
    speeds = [states.dq_motor[states.rows, j] for states in found.kinds.runs]
    taken = [dq @ (own[j] @ coefficients) for dq, own in zip(speeds, columns, strict=True)]
    return float(sum(taken)) < 0.0


def _without(
    found: Search, forced: Sequence[PlacedEffect], named: Remainder, train: Sequence[Recording], most: float
) -> Remainder | None:
    """What is left without names, taken out of `found`; None, and `found` as it was, where that is more.

    `most`: times the power that is left with them.
    """
    kept = found.setup, found.fit, found.kinds
    with_names = _left_with(found, named.terms)
    effects = tuple(effect for effect in found.setup.effects if not any(effect is other for other in forced))
    found.setup = replace(found.setup, effects=effects)
    found.fit = fitted(found.setup, train)
    found.kinds = Kinds(found.fit, found.kinds)
    floor_, unexplained = _look(found)
    bare = Remainder(floor_, unexplained, _terms(found, unexplained, train))
    as_well = _left_with(found, bare.terms) <= most * with_names
    replaced = {term.joint for term in bare.terms}
    if all(as_well[list(effect.joints)].all() and replaced & set(effect.joints) for effect in forced):
        return bare
    found.setup, found.fit, found.kinds = kept
    return None


def _look(found: Search) -> tuple[Floor, list[Unexplained]]:
    leftovers = search_leftovers(found.fit)
    measured = floor(found.fit, found.fit.runs_, run_residuals(found.fit), leftovers)
    return measured, find_unknown(found.fit, measured, leftovers)


def _forced(found: Search, measured: Floor, unexplained: Sequence[Unexplained]) -> list[list[PlacedEffect]]:
    """Names that may be the nearest ones and not the cause, joint by joint.

    They explain too little where structure is left, or leave much that depends on the very signals they are made of,
    or are several approximations of one function of the joint's position.
    """
    columns, effects = columns_in(found), found.setup.effects
    after = np.mean(Beside(found.fit).residual ** 2, axis=0)
    forced = []
    for j in range(found.setup.robot.n_joints):
        there = [k for k, effect in enumerate(effects) if j in effect.joints and not _is_line(effect)]
        left = next((u for u in unexplained if u.joint == j and u.depends_on), None)
        doubtful: set[int] = set()
        if there and left is not None:
            without = Beside(found.fit, [c for k in there for c in columns[k]])
            before = float(np.mean(without.residual[:, j] ** 2))
            if before - after[j] < FORCED * (before - measured.value[j] ** 2):
                doubtful |= set(there)
            doubtful |= {k for k in there if _of_its_signals(effects[k], left)}
        patches = next((group for group in patchworks(effects) if group[0].joints[0] == j), [])
        doubtful |= {k for k, effect in enumerate(effects) if any(effect is other for other in patches)}
        if doubtful:
            forced.append([effects[k] for k in sorted(doubtful)])
    return forced


def _of_its_signals(effect: PlacedEffect, left: Unexplained) -> bool:
    """Whether much is left that depends on the very signals that an effect is a function of."""
    own = signals_of(effect)
    return left.share > OTHER_FORM and bool(own) and own <= {signal for signal, _ in left.depends_on}


def nearest_effects(found: Search, left: Remainder) -> dict[int, list[PlacedEffect]]:
    """Names on a joint that explain too little of what depends on their own signals, and have no better replacement."""
    columns, effects = columns_in(found), found.setup.effects
    after = np.mean(Beside(found.fit).residual ** 2, axis=0)
    nearest = {}
    for u in (u for u in left.unexplained if u.term is not None):
        j = u.joint
        own = [k for k, e in enumerate(effects) if e.joints == (j,) and not _is_line(e) and _of_its_signals(e, u)]
        if not own:
            continue
        without = Beside(found.fit, [c for k in own for c in columns[k]])
        before = float(np.mean(without.residual[:, j] ** 2))
        if before - after[j] < FORCED * (before - left.floor.value[j] ** 2):
            nearest[j] = [effects[k] for k in own]
    return nearest


def lines_told(lines: Sequence[RippleCandidate], found: Search, left: Remainder) -> list[RippleCandidate]:
    """Lines in the angle that are a name: a slow one beside more that depends on the same position only comes near."""
    power = rms(found.fit) ** 2
    beside = {
        u.joint: u.share * power[u.joint]
        for u in left.unexplained
        if u.term is not None and u.share > OTHER_FORM and ("q", u.joint) in dict(u.depends_on)
    }

    def only_near(line: RippleCandidate) -> bool:
        (j,), (first, *_) = line.joints, line.lines
        own = 0.5 * first.amplitude**2
        return first.order < SHARP and j in beside and own < FORCED * (own + beside[j])

    return [line for line in lines if not only_near(line)]


def signals_of(effect: PlacedEffect) -> set[Signal]:
    """Signals that an effect's torque is a function of; none where it has a memory or is of other signals."""
    entry = CATALOGUE[effect.kind]
    names = {signal.removesuffix("_motor") for signal in entry["signals"]}
    if entry["memory"] or len(effect.joints) > 1 or not names <= set(STATE):
        return set()
    return {(name, effect.joints[0]) for name in names}


def _is_line(effect: PlacedEffect) -> bool:
    return effect.kind == "torque_ripple" and dict(effect.shape)["cycles"][0] >= SHARP


def _left_with(found: Search, terms: Sequence[DataTerm]) -> FloatArray:
    """Power that every joint has left, by rows left out where it has a term, (n_joints,)."""
    power: FloatArray = np.mean(Beside(found.fit).residual ** 2, axis=0)
    for term in terms:
        power[term.joint] *= term.power[1] / term.power[0]
    return power


def _terms(found: Search, unexplained: Sequence[Unexplained], train: Sequence[Recording]) -> list[DataTerm]:
    """Data-driven terms that pay: on rows left out, and as part of a whole model on every run left out."""
    terms = [u.term for u in unexplained if u.term is not None and u.term.pays]
    return [term for term in terms if len(train) < 2 or _carries_over(found, term, train)]


def _carries_over(found: Search, term: DataTerm, train: Sequence[Recording]) -> bool:
    """Whether models with the term, made without one run each, predict every one of those runs better with it."""
    j, power = term.joint, np.zeros((2, len(train)))
    corrected = [found.setup.corrected(recording) for recording in train]
    for k, left_out in enumerate(corrected):
        others = [recording for i, recording in enumerate(corrected) if i != k]
        bare = found.setup.identifier(residual=None).fit(others)
        rows = Rows(bare).of_joint(j)
        signals = candidate_signals(bare)
        again = fit_data_term(j, term.signals, term.ridge, term.reach, rows, signals, bare.runs_, scored=False)
        if again is None:
            return False
        whole = _with_terms(found.setup, bare, [again], others, trusted(found.setup))
        states = bare.states(left_out)
        power[:, k] = [score(fit.model_, [states]).rmse[j] ** 2 for fit in (bare, whole)]
    return bool(np.all(power[1] < power[0]) and power[1].sum() < (1 - WORTH) * power[0].sum())


def with_terms(
    found: Search, terms: Sequence[DataTerm], train: Sequence[Recording], options: Mapping[str, Any]
) -> ThreeLoopIdentifier:
    """Fit everything beside the data-driven terms and put them into the model, in the place of a third loop.

    `options` of the identifier, over those of the setup.
    """
    return _with_terms(found.setup, found.fit, terms, train, options)


def _with_terms(
    setup: Setup,
    bare: ThreeLoopIdentifier,
    terms: Sequence[DataTerm],
    train: Sequence[Recording],
    options: Mapping[str, Any],
) -> ThreeLoopIdentifier:
    load = link_load(bare.observations_.plan, bare.links_)
    lessened = []
    for recording, states in zip(train, bare.runs_, strict=True):
        tau = np.array(recording.tau)
        for term in terms:
            tau[:, term.joint] -= np.interp(recording.t, states.t, term.torque(states, load(states)))
        lessened.append(replace(recording, tau=tau))
    fit = setup.identifier(residual=None, **options).fit(lessened)
    n = setup.robot.n_joints
    signals: list[list[tuple[str, int]]] = [[] for _ in range(n)]
    regressions: list[Any] = [None] * n
    for term in terms:
        signals[term.joint], regressions[term.joint] = list(term.signals), term.mixture
    fit.model_ = with_residual(fit.model_, signals, regressions)
    return fit
