"""Effects that were found, as `result.json` and the report tell them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.columns import Observations, observe
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.candidate import Candidate, stacked
from dynid_rs.diagnosis.dropping import standing
from dynid_rs.diagnosis.hypothesis import Hypothesis
from dynid_rs.diagnosis.intervals import Estimate, estimates
from dynid_rs.diagnosis.search import once_each
from dynid_rs.diagnosis.state import Choice, Search, columns_in, hypothesis_of
from dynid_rs.diagnosis.warmth import sharing_clocks
from dynid_rs.evaluation import rmse
from dynid_rs.loops import link_load
from dynid_rs.placed import PlacedEffect
from dynid_rs.recording import Recording

FloatArray = NDArray[np.float64]

N_POINTS = 400
"""Most points of a plot."""
N_BINS = 60
"""Points of a fitted curve."""


def effect_entries(found: Search, test: Sequence[Recording]) -> list[tuple[PlacedEffect, dict[str, Any]]]:
    """Every effect of the final setup with its entry, the one that takes off most first."""
    if not found.setup.effects:
        return []
    columns = columns_in(found)
    told, rows = _choices(found), _test_rows(found, test)
    order = sorted((standing(found, k) for k in range(len(columns))), key=lambda pair: -pair[0].evidence)
    # One model more than effects: without any of them, with the first, with the first two, ...
    places = [k for _, k in order]
    models = [Beside(found.fit, [c for k in places[n:] for c in columns[k]]) for n in range(len(places) + 1)]
    trained = [rmse([model.residual]).tolist() for model in models]
    tested = [[] if rows is None else model.error_on(rows).tolist() for model in models]
    plan = found.fit.observations_.plan
    friction = found.fit.links_.own_[:, plan.friction[1]]
    entries, clocks = [], sharing_clocks(found.setup.effects)
    for rank, (weighed, k) in enumerate(order):
        effect = found.setup.effects[k]
        hypothesis = hypothesis_of(effect, found.kinds)
        beside = Beside(found.fit, columns[k])
        choice = told.get((effect.kind, effect.joints[:1]))
        entry: dict[str, Any] = {
            "rank": rank + 1,
            "kind": effect.kind,
            "joints": [found.setup.robot.joint_names[j] for j in effect.joints],
            "parameters": [
                _parameter(e, found)
                for e in estimates(beside, found.kinds, hypothesis, weighed.gain.coefficients, friction)
            ],
            "p_value": 1.0 if choice is None else choice.p_value,
            "evidence": weighed.evidence,
            "rmse_train_before": trained[rank],
            "rmse_train_after": trained[rank + 1],
            "rmse_test_before": tested[rank],
            "rmse_test_after": tested[rank + 1],
            "ties": tie_entries(found, choice),
            "told_apart_from": refuted_entries(found, choice),
            "plot": _plot(found, beside, hypothesis, weighed.gain.coefficients),
        }
        alike = next((group for group in clocks if k in group), [])
        if alike:
            others = ", ".join(found.setup.robot.joint_names[j] for m in alike for j in found.setup.effects[m].joints)
            entry["note"] = f"one time constant for {others}: by itself a joint may tell too little of it"
        entries.append((effect, entry))
    return entries


def ranked(entries: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Entries with their ranks: sensors and clocks first, then by what they take off."""
    return [{**entry, "rank": rank + 1} for rank, entry in enumerate(entries)]


def _choices(found: Search) -> dict[tuple[str, tuple[int, ...]], Choice]:
    """By kind and joint: what acts on several joints was chosen once for all of them."""
    candidates = [(s.choice.weighed.candidate, s.choice) for s in found.steps if s.action == "added"]
    return {(candidate.kind, (j,)): choice for candidate, choice in candidates for j in candidate.joints}


def _test_rows(found: Search, test: Sequence[Recording]) -> Observations | None:
    if not test:
        return None
    fit = found.fit
    load = link_load(fit.observations_.plan, fit.links_)
    runs = [fit.states(recording).aligned(fit.model_.encoder_delay, fit.model_.encoder_error) for recording in test]
    return observe(fit.observations_.plan, [replace(states, tau_link=load(states)) for states in runs])


def _parameter(estimate: Estimate, found: Search) -> dict[str, Any]:
    robot = found.setup.robot
    angle = "m" if robot.joint_kinds[estimate.joint] == "prismatic" else "rad"
    unit = estimate.unit.replace("{torque}", found.fit.torque_unit_).replace("{angle}", angle)
    return {
        "name": estimate.name,
        "joint": robot.joint_names[estimate.joint],
        "value": estimate.value,
        "unit": unit,
        "interval": None if estimate.interval is None else list(estimate.interval),
    }


def tie_entries(found: Search, choice: Choice | None) -> list[dict[str, Any]]:
    """What explains the same as well as what was chosen, each name once."""
    ties = () if choice is None else choice.ties
    return [
        {
            **_where(found, tie.weighed.candidate),
            "evidence": tie.weighed.evidence,
            "p_value": tie.p_value,
        }
        for tie in once_each(ties, lambda tie: tie.weighed.candidate.place)
    ]


def refuted_entries(found: Search, choice: Choice | None) -> list[dict[str, Any]]:
    """What explains the same worse than what was chosen, with its evidence against that."""
    if choice is None:
        return []
    return [
        {**_where(found, other.candidate), "log_evidence": other.evidence - choice.weighed.evidence}
        for other in choice.refuted
    ]


def _where(found: Search, candidate: Candidate) -> dict[str, Any]:
    return {"kind": candidate.kind, "joints": [found.setup.robot.joint_names[j] for j in candidate.joints]}


SIGNALS = {
    "stribeck": ("dq", "rad/s"),
    "load_dependent_friction": ("tau_link", "N*m"),
    "position_dependent_friction": ("q", "rad"),
    "torque_ripple": ("q", "rad"),
    "joint_spring": ("q", "rad"),
    "counterbalance": ("q", "rad"),
    "torque_saturation": ("tau_link", "N*m"),
    "inertial_coupling": ("ddq", "rad/s^2"),
    "thermal_friction": ("t", "s"),
    "temperature_friction": ("temperature", "degC"),
    "load_hysteresis": ("tau_link", "N*m"),
}
"""What an effect is drawn against, and its unit; others against their own column."""


def _plot(found: Search, beside: Beside, hypothesis: Hypothesis, coefficients: FloatArray) -> dict[str, Any]:
    """Partial residual (what is left and the effect's own torque) against the effect's signal, and the fitted curve."""
    j = hypothesis.joints[0]
    columns = stacked(found.kinds.columns([hypothesis])[0])
    torque = columns[j] @ coefficients
    partial = beside.with_columns(columns, coefficients)[:, j] + torque
    signal, unit = SIGNALS.get(hypothesis.kind, ("", ""))
    x = _signal(found, hypothesis, signal, columns[j][:, 0])
    order = np.argsort(x, kind="stable")
    bins = [b for b in np.array_split(order, min(N_BINS, len(order))) if len(b)]
    thin = order[:: max(1, len(order) // N_POINTS)]
    name = f"{signal}_{found.setup.robot.joint_names[j]}" if signal and signal != "t" else signal or "column"
    return {
        "signal": name,
        "unit": unit or "1",
        "joint": found.setup.robot.joint_names[j],
        "x": x[thin].tolist(),
        "partial": partial[thin].tolist(),
        "curve_x": [float(x[b].mean()) for b in bins],
        "curve": [float(torque[b].mean()) for b in bins],
    }


def _signal(found: Search, hypothesis: Hypothesis, signal: str, column: FloatArray) -> FloatArray:
    j = hypothesis.joints[0]
    at = hypothesis.joints[1] if signal == "ddq" and len(hypothesis.joints) > 1 else j
    if not signal:
        return column
    parts = []
    for states in found.kinds.runs:
        if signal == "t":
            parts.append(states.t[states.rows] - states.t[0])
        elif signal == "tau_link":
            assert states.tau_link is not None  # `Kinds` puts it in
            parts.append(states.tau_link[states.rows, at])
        elif signal == "temperature":
            assert states.temperature is not None  # or the effect would not have been looked for
            parts.append(states.temperature[states.rows, at])
        else:
            parts.append(getattr(states, f"{signal}_motor")[states.rows, at])
    return np.concatenate(parts)
