"""Effects that were found, as `result.json` and the report tell them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.odds import p_value
from dynid_rs.diagnosis.belief import Belief, Named
from dynid_rs.diagnosis.estimates import Estimate, estimates
from dynid_rs.diagnosis.hypotheses import Place
from dynid_rs.diagnosis.rivals import is_one_cause
from dynid_rs.diagnosis.waves import Argument
from dynid_rs.identification.loads import with_load
from dynid_rs.model.placed import CATALOGUE, PlacedEffect
from dynid_rs.regression.columns import run_rows
from dynid_rs.regression.evaluation import rmse
from dynid_rs.regression.linear_model import LinearModel
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]

N_POINTS, N_BINS = 400, 60
"""Most points of a plot, and points of a fitted curve."""


def effect_entries(
    found: Belief, test: Sequence[Recording], nameless: Mapping[Place, Argument]
) -> list[dict[str, Any]]:
    """One entry per name, the most certain first.

    Errors are on the runs of `test`, their torque on the encoders' clock. Places that are `nameless` have no name that
    holds (`misfit.py`).
    """
    errors = _Errors(found, test)
    known = estimates(found)
    names = found.setup.robot.joint_names
    entries = []
    for place, named in sorted(found.named.items(), key=lambda item: -item[1].log_odds):
        kind, joints = place
        effect = next((e for e in found.setup.effects if (e.kind, e.joints) == place), None)
        entry: dict[str, Any] = {
            "kind": kind,
            "joints": [names[j] for j in joints],
            "parameters": [_parameter(estimate, found) for estimate in known[place]],
            "p_value": p_value(named.log_odds),
            "evidence": named.log_odds,
            **errors.without(effect),
            "ties": [_tie(other, odds, named, names) for other, odds in named.ties],
            "told_apart_from": [{**_where(other, names), "log_evidence": odds} for other, odds in named.refuted],
        }
        if kind == "gravity_tilt":  # a first joint whose frame is turned stands on a tilted base: no data tell those
            entry["ties"].append({"kind": "kinematic_error", "joints": [names[0]]})
        if effect is not None:
            entry["plot"] = _plot(found, effect, errors)
        if place in nameless:
            entry |= untold(kind, nameless[place], names)
        elif not all(is_one_cause(kind, other) for (other, _), _ in named.ties):  # one or the other
            entry |= {"kind": "unknown", "told_as": kind}
        entries.append(entry)
    return entries


def untold(kind: str, argument: Argument, names: Sequence[str]) -> dict[str, Any]:
    """What an entry of `kind` says where the name does not hold, but a function of `argument` is there."""
    signals = [
        {"signal": f"{name}_{names[j]}", "strength": abs(factor), "direct": True}
        for factor, (name, j) in argument.terms
    ]
    return {"kind": "unknown", "told_as": kind, "depends_on": signals}


def unscored(p: float) -> dict[str, Any]:
    """Return the entries of an effect whose share of the band's error is not asked for, and that nothing ties with."""
    return {"p_value": p, "rmse_test_before": [], "rmse_test_after": [], "ties": []}


def _tie(other: Place, odds: float, named: Named, names: Sequence[str]) -> dict[str, Any]:
    return {**_where(other, names), "evidence": named.log_odds + odds}


def _where(place: Place, names: Sequence[str]) -> dict[str, Any]:
    return {"kind": place[0], "joints": [names[j] for j in place[1]]}


def _parameter(estimate: Estimate, found: Belief) -> dict[str, Any]:
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


class _Errors:
    """Errors of the final model with each effect left out in turn and all else fitted again."""

    def __init__(self, found: Belief, test: Sequence[Recording]) -> None:
        fit, posterior = found.fit, found.fit.links_.posterior_
        assert posterior is not None  # every fit that is diagnosed has the weak prior
        self._found, observations = found, fit.observations_
        self._posterior, self._plan = posterior, observations.plan
        self.model = posterior.model(self._plan, observations.joint_rows())
        self.test = self._test_rows(test) if test else None
        self.places = dict(zip(found.setup.effects, found.places(), strict=True))
        self.x = self._solved(self.model)

    def without(self, effect: PlacedEffect | None) -> dict[str, Any]:
        """Errors before and after it; of a change of structure, whose fit cannot be undone column by column, after."""
        x = self.x
        if effect is not None:
            x = self._solved(self.model.without(self.places[effect]))
        said: dict[str, Any] = {
            "rmse_train_before": _error(self.model, x),
            "rmse_train_after": _error(self.model, self.x),
        }
        tests = {"rmse_test_before": x, "rmse_test_after": self.x}
        return said | {key: [] if self.test is None else _error(self.test, value) for key, value in tests.items()}

    def _solved(self, model: LinearModel) -> FloatArray:
        p = self._posterior
        x = model.fit(p.choice, p.noise_std).x
        kept = np.zeros(len(x), dtype=bool)
        kept[np.concatenate(model.places)] = True
        return np.where(kept, x, 0.0)

    def _test_rows(self, test: Sequence[Recording]) -> LinearModel:
        fit = self._found.fit
        loaded = with_load(self._plan, fit.links_, fit.links_.own_)
        parts = []
        for recording in test:
            states = fit.states(recording.less_torque_delay(self._found.setup.torque_delay))
            states = states.aligned(fit.model_.encoder_delay, fit.model_.encoder_error)
            parts.append(run_rows(self._plan, loaded(states), states.tau))
        rows = [np.concatenate([part[j] for part in parts]) for j in range(len(parts[0]))]
        return self._posterior.model(self._plan, rows)


def _error(model: LinearModel, x: FloatArray) -> list[float]:
    left = [part[:, -1] - part[:, :-1] @ x[at] for part, at in zip(model.rows, model.places, strict=True)]
    return [float(value) for value in rmse([np.stack(left, axis=1)], [np.stack(model.counted, axis=1)])]


def _plot(found: Belief, effect: PlacedEffect, errors: _Errors) -> dict[str, Any]:
    """Partial residual (what is left and the effect's own torque) against the effect's signal, and the fitted curve."""
    j, robot = effect.joints[0], found.setup.robot
    at = [place for joint, place in errors.places[effect] if joint == j]
    where = np.searchsorted(errors.model.places[j], at)
    columns = errors.model.rows[j][:, where]
    torque = columns @ errors.x[at]
    left = errors.model.rows[j][:, -1] - errors.model.rows[j][:, :-1] @ errors.x[errors.model.places[j]]
    signal, unit = CATALOGUE[effect.kind]["drawn_against"] or ("", "1")
    x = _signal(found, effect, signal) if signal else columns[:, 0]
    order = np.argsort(x, kind="stable")
    bins = [b for b in np.array_split(order, min(N_BINS, len(order))) if len(b)]
    thin = order[:: max(1, len(order) // N_POINTS)]
    return {
        "signal": f"{signal}_{robot.joint_names[j]}" if signal and signal != "t" else signal or "column",
        "unit": unit.replace("{torque}", found.fit.torque_unit_),
        "joint": robot.joint_names[j],
        "x": x[thin].tolist(),
        "partial": (left + torque)[thin].tolist(),
        "curve_x": [float(x[b].mean()) for b in bins],
        "curve": [float(torque[b].mean()) for b in bins],
    }


def _signal(found: Belief, effect: PlacedEffect, signal: str) -> FloatArray:
    """The signal that an effect is drawn against, at the rows of the fit."""
    at = effect.joints[-1] if signal.startswith("ddq") else effect.joints[0]
    parts = []
    for states in found.catalogue.runs:
        values = states.t - states.t[0] if signal == "t" else getattr(states, signal)[:, at]
        parts.append(values[states.rows])
    return np.concatenate(parts)
