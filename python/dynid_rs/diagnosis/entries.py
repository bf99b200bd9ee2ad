"""Effects that were found, as `result.json` and the report tell them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.odds import p_value
from dynid_rs.base.wording import ANOTHER_FUNCTION
from dynid_rs.diagnosis.belief import Belief, Named
from dynid_rs.diagnosis.curves import effect_plot
from dynid_rs.diagnosis.estimates import Estimate, estimates, sized_torques
from dynid_rs.diagnosis.rivals import is_one_or_another
from dynid_rs.diagnosis.shaped import Place
from dynid_rs.diagnosis.structure_plot import structure_plot
from dynid_rs.diagnosis.waves import Argument
from dynid_rs.identification.loads import with_load
from dynid_rs.model.placed import CATALOGUE, PlacedEffect
from dynid_rs.model.units import filled
from dynid_rs.regression.columns import run_rows
from dynid_rs.regression.error_interval import interval_of_change
from dynid_rs.regression.evaluation import rmse
from dynid_rs.regression.linear_model import Fit, LinearModel
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]


def effect_entries(
    found: Belief, test: Sequence[Recording], nameless: Mapping[Place, Argument]
) -> list[dict[str, Any]]:
    """One entry per name, the most certain first.

    Errors are on the runs of `test`, their torque on the encoders' clock. Places that are `nameless` have no name that
    holds (`misfit.py`).
    """
    errors = _Errors(found, test)
    known, sized = estimates(found), sized_torques(found)
    names = found.setup.robot.joint_names
    entries = []
    for place, named in sorted(found.named.items(), key=lambda item: -item[1].log_odds):
        kind, joints = place
        effect = next((e for e in found.setup.effects if (e.kind, e.joints) == place), None)
        entry: dict[str, Any] = {
            "kind": kind,
            "joints": [names[j] for j in joints],
            "parameters": [_parameter(estimate, place, found) for estimate in known[place]],
            "p_value": p_value(named.log_odds),
            "evidence": named.log_odds,
            **errors.without(effect),
            "ties": [_tie(other, odds, named, names) for other, odds in named.ties],
            "told_apart_from": [{**_where(other, names), "log_evidence": odds} for other, odds in named.refuted],
        }
        if kind == "gravity_tilt":  # a first joint whose frame is turned stands on a tilted base: no data tell those
            entry["ties"].append({"kind": "kinematic_error", "joints": [names[0]], "same_torque": True})
        if effect is not None:
            entry["plot"] = effect_plot(
                found, effect, errors.model, errors.fit, errors.x, errors.places[effect], known[place]
            )
        elif (plot := structure_plot(found, place, known[place], errors.model, errors.x)) is not None:
            entry["plot"] = plot
        another_function = named.another_function if effect in sized else None
        if another_function is not None:
            entry |= {"kind": "unknown", "told_as": kind}
            entry["ties"].append(_tie((ANOTHER_FUNCTION, joints), another_function, named, names))
        may_be_none = effect is not None and effect not in sized  # it predicts, but its size may be none
        if place in nameless:
            entry |= untold(kind, nameless[place], names)
        elif may_be_none:
            signal = CATALOGUE[kind]["signals"][0]
            entry |= untold(kind, Argument(tuple((1.0, (signal, j)) for j in joints)), names)
        elif is_one_or_another(place, named):
            entry |= {"kind": "unknown", "told_as": kind}
        if may_be_none or (place in nameless and another_function is None):
            entry["ties"] = []  # where a name does not hold, what explains no more than it does is none either
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
    same = {"same_torque": True} if other in named.same else {}
    return {**_where(other, names), "evidence": named.log_odds + odds, **same}


def _where(place: Place, names: Sequence[str]) -> dict[str, Any]:
    return {"kind": place[0], "joints": [names[j] for j in place[1]]}


def _parameter(estimate: Estimate, place: Place, found: Belief) -> dict[str, Any]:
    robot, j = found.setup.robot, estimate.joint
    own = {} if j is None else {"joint": robot.joint_names[j]}
    return {
        "name": estimate.name,
        **own,
        "value": estimate.value,
        "unit": filled(estimate.unit, found.fit.torque_unit_, robot.joint_kinds[place[1][0] if j is None else j]),
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
        self.fit = self.model.fit(posterior.choice, posterior.noise_std)
        if fit.links_.known is not None:
            self.fit = self.fit.given(fit.links_.known)
        self.x = _told(self.model, self.fit)
        self._left_after = None if self.test is None else _left(self.test, self.x)

    def without(self, effect: PlacedEffect | None) -> dict[str, Any]:
        """Errors before and after it; of a change of structure, whose fit cannot be undone column by column, after."""
        x = self.x
        if effect is not None:
            x = self._solved(self.model.without(self.places[effect]))
        said: dict[str, Any] = {
            "rmse_train_before": _error(self.model, x),
            "rmse_train_after": _error(self.model, self.x),
        }
        if self.test is None or self._left_after is None:
            return said | {"rmse_test_before": [], "rmse_test_after": []}
        said |= {"rmse_test_before": _error(self.test, x), "rmse_test_after": _error(self.test, self.x)}
        if effect is not None:
            changes = interval_of_change(self._left_after, _left(self.test, x))
            said["rmse_test_change_interval"] = [None if change is None else list(change) for change in changes]
        return said

    def _solved(self, model: LinearModel) -> FloatArray:
        """Unknowns of another model, beside those that are known."""
        fit = model.fit(self._posterior.choice, self._posterior.noise_std)
        known = self._found.fit.links_.known
        return _told(model, fit if known is None else fit.given(known))

    def _test_rows(self, test: Sequence[Recording]) -> LinearModel:
        fit = self._found.fit
        loaded = with_load(self._plan, fit.links_, fit.links_.own_)
        parts = []
        for recording in test:
            states = fit.states(recording.less_torque_delay(self._found.setup.delays))
            states = states.aligned(fit.model_.encoder_delay, fit.model_.encoder_error)
            parts.append(run_rows(self._plan, loaded(states), states.tau))
        rows = [np.concatenate([part[j] for part in parts]) for j in range(len(parts[0]))]
        return self._posterior.model(self._plan, rows)


def _told(model: LinearModel, fit: Fit) -> FloatArray:
    """Unknowns of the columns that a model has; what only its prior knows is none of its torque."""
    kept = np.zeros(len(fit.x), dtype=bool)
    kept[np.concatenate(model.places)] = True
    return np.where(kept, fit.x, 0.0)


def _left(model: LinearModel, x: FloatArray) -> list[FloatArray]:
    """What is left of every joint at the rows that count."""
    rows = zip(model.rows, model.places, model.counted, strict=True)
    return [(part[:, -1] - part[:, :-1] @ x[at])[counted] for part, at, counted in rows]


def _error(model: LinearModel, x: FloatArray) -> list[float]:
    left = [part[:, -1] - part[:, :-1] @ x[at] for part, at in zip(model.rows, model.places, strict=True)]
    return [float(value) for value in rmse([np.stack(left, axis=1)], [np.stack(model.counted, axis=1)])]
