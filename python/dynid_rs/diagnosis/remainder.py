"""What is left when the search has ended: the floor, structure that no name explains, and a term on its signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.assembly import with_residual
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.data_term import WORTH, DataTerm, fit_data_term
from dynid_rs.diagnosis.floor import Floor, floor
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.leftovers import run_residuals, search_leftovers
from dynid_rs.diagnosis.picture import Picture
from dynid_rs.diagnosis.rows_beside import Beside as Rows
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.signals import candidate_signals
from dynid_rs.diagnosis.state import Search, columns_in, fitted
from dynid_rs.diagnosis.unknown import Unexplained, find_unknown, names
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.loops import link_load
from dynid_rs.placed import PlacedEffect
from dynid_rs.recording import Recording
from dynid_rs.results import score

FloatArray = NDArray[np.float64]

FORCED = 0.8
"""Named effects that explain less than this of what could be explained on a joint, while structure is left there that
its signals predict, are the nearest names and not the cause: they are taken back."""


AS_WELL = 1.4
"""Times the power that is left with names, and a term beside them: a term alone that leaves no more replaces them."""
SHARP = 12.0
"""Cycles per turn from which a ripple is a line, and no approximation of anything slower."""


@dataclass(frozen=True, eq=False)
class Remainder:
    """The floor of every joint, what is unexplained, and the data-driven terms that are worth keeping."""

    floor: Floor
    unexplained: list[Unexplained]
    terms: list[DataTerm]


def what_is_left(found: Search, train: Sequence[Recording]) -> Remainder:
    """Look at what the search leaves; names that were forced on a joint are taken out of `found`.

    Without something better to put in its place, the nearest name stays and what it leaves is said beside it.
    """
    named = _look(found)
    forced = _forced(found, *named)
    if not forced:
        return Remainder(*named, _terms(found, named[1], train))
    kept = found.setup, found.fit, found.kinds
    taken_back = [found.setup.effects[k] for k in sorted(forced)]
    with_names = _left_with(found, _terms(found, named[1], train))
    effects = tuple(effect for k, effect in enumerate(found.setup.effects) if k not in forced)
    found.setup = replace(found.setup, effects=effects)
    found.fit = fitted(found.setup, train)
    found.kinds = Kinds(found.fit, found.kinds)
    bare_floor, bare_left = _look(found)
    terms = _terms(found, bare_left, train)
    bare = Remainder(bare_floor, bare_left, terms)
    as_well = _left_with(found, terms) <= AS_WELL * with_names
    replaced = {term.joint for term in terms}
    if all(as_well[list(effect.joints)].all() and replaced & set(effect.joints) for effect in taken_back):
        return bare
    found.setup, found.fit, found.kinds = kept
    return Remainder(*named, _terms(found, named[1], train))


def _look(found: Search) -> tuple[Floor, list[Unexplained]]:
    leftovers = search_leftovers(found.fit)
    measured = floor(found.fit, found.fit.runs_, run_residuals(found.fit), leftovers)
    return measured, find_unknown(found.fit, measured, leftovers)


def _forced(found: Search, measured: Floor, unexplained: Sequence[Unexplained]) -> set[int]:
    """Places among the effects of those that explain too little on a joint where structure is left."""
    columns = columns_in(found)
    after = np.mean(Beside(found.fit).residual ** 2, axis=0)
    forced: set[int] = set()
    for j in (u.joint for u in unexplained if u.depends_on):
        there = [k for k, effect in enumerate(found.setup.effects) if j in effect.joints and not _is_line(effect)]
        if not there:
            continue
        without = Beside(found.fit, [c for k in there for c in columns[k]])
        before = float(np.mean(without.residual[:, j] ** 2))
        if before - after[j] < FORCED * (before - measured.value[j] ** 2):
            forced |= set(there)
    return forced


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
        again = fit_data_term(j, term.signals, term.ridge, rows, candidate_signals(bare), bare.runs_, scored=False)
        if again is None:
            return False
        whole = _with_terms(found.setup, bare, [again], others)
        states = bare.states(left_out)
        power[:, k] = [score(fit.model_, [states]).rmse[j] ** 2 for fit in (bare, whole)]
    return bool(np.all(power[1] < power[0]) and power[1].sum() < (1 - WORTH) * power[0].sum())


def with_terms(found: Search, terms: Sequence[DataTerm], train: Sequence[Recording]) -> ThreeLoopIdentifier:
    """Fit everything beside the data-driven terms and put them into the model, in the place of a third loop."""
    return _with_terms(found.setup, found.fit, terms, train)


def _with_terms(
    setup: Setup, bare: ThreeLoopIdentifier, terms: Sequence[DataTerm], train: Sequence[Recording]
) -> ThreeLoopIdentifier:
    load = link_load(bare.observations_.plan, bare.links_)
    lessened = []
    for recording, states in zip(train, bare.runs_, strict=True):
        tau = np.array(recording.tau)
        for term in terms:
            tau[:, term.joint] -= np.interp(recording.t, states.t, term.torque(states, load(states)))
        lessened.append(replace(recording, tau=tau))
    fit = setup.identifier(residual=None).fit(lessened)
    n = setup.robot.n_joints
    signals: list[list[tuple[str, int]]] = [[] for _ in range(n)]
    regressions: list[Any] = [None] * n
    for term in terms:
        signals[term.joint], regressions[term.joint] = list(term.signals), term.mixture
    fit.model_ = with_residual(fit.model_, signals, regressions)
    return fit


def remainder_entries(remainder: Remainder, joint_names: Sequence[str]) -> list[dict[str, Any]]:
    """Entries of `unexplained` in `result.json`."""
    return [
        {
            "joint": joint_names[u.joint],
            "share": u.share,
            "p_value": u.p_value,
            "depends_on": _depends_on(u, joint_names),
            **({} if u.term is None else {"term": {"kind": "gmr", "kept": u.term in remainder.terms}}),
            **({} if u.picture is None else {"plot": _plot(u.picture, joint_names, u.joint)}),
        }
        for u in remainder.unexplained
    ]


def unknown_entries(remainder: Remainder, joint_names: Sequence[str]) -> list[dict[str, Any]]:
    """Effects that have no name but a term in the model."""
    return [
        {
            "kind": "unknown",
            "joints": [joint_names[u.joint]],
            "parameters": [],
            "p_value": u.p_value,
            "ties": [],
            "depends_on": _depends_on(u, joint_names),
            "note": "nothing in the catalogue explains it; "
            + (
                "a regression on these signals is in the model"
                if u.term in remainder.terms
                else "a regression on these signals does not carry over to runs left out, so it is not in the model"
            ),
        }
        for u in remainder.unexplained
        if u.term is not None and u.depends_on
    ]


def _depends_on(u: Unexplained, joint_names: Sequence[str]) -> list[dict[str, Any]]:
    return [{"signal": name, "strength": strength, "direct": True} for name, strength in names(u, joint_names)]


def _plot(picture: Picture, joint_names: Sequence[str], joint: int) -> dict[str, Any] | None:
    """Mean partial residual over the strongest signal."""
    name, j = picture.signals[0]
    centres = (picture.edges[0][1:] + picture.edges[0][:-1]) / 2
    count, partial, curve = picture.count, picture.partial, picture.fitted
    if partial.ndim == 2:
        count = np.where(np.isfinite(partial), count, 0.0)
        total = np.maximum(count.sum(axis=1), 1.0)
        partial, curve = ((np.nan_to_num(x) * count).sum(axis=1) / total for x in (partial, curve))
        count = count.sum(axis=1)
    seen = (count > 0) & np.isfinite(partial) & np.isfinite(curve)
    if not seen.any():
        return None
    unit = {"q": "rad", "dq": "rad/s", "ddq": "rad/s^2", "tau_link": "N*m"}.get(name.replace("_motor", ""), "1")
    return {
        "joint": joint_names[joint],
        "signal": name if j < 0 else f"{name}_{joint_names[j]}",
        "unit": unit,
        "x": centres[seen].tolist(),
        "partial": partial[seen].tolist(),
        "curve_x": centres[seen].tolist(),
        "curve": curve[seen].tolist(),
    }
