"""Each effect as a curve that a person knows from textbooks: its torque over the signal that makes it.

A point is a row of the fit: what the model leaves there and the effect's own torque (a partial residual). Friction is
drawn in the direction of motion, ``sign(dq) tau``: over a load or an angle its two directions would cancel. What goes
round many times a turn is drawn over one cycle, and what remembers a reversal over the way since then.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.units import angle_units, torque_of
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.estimates import Estimate
from dynid_rs.model.curves import binned
from dynid_rs.model.placed import CATALOGUE, PlacedEffect
from dynid_rs.regression.linear_model import Fit, LinearModel
from dynid_rs.regression.uncertainty import NORMAL_95
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]

ALONG_THE_MOTION = frozenset(
    {
        *("load_dependent_friction", "load_hysteresis", "position_dependent_friction"),
        *("bearing_friction", "friction_hysteresis", "thermal_friction", "temperature_friction"),
    }
)
"""Kinds that are friction: drawn in the direction of motion."""
ONE_CURVE = 1.5
"""Cycles per turn up to which an effect is drawn over the joint's whole angle."""
REACH = 6.0
"""Presliding distances after a reversal that are drawn: the torque has settled by then."""


def effect_plot(
    found: Belief,
    effect: PlacedEffect,
    model: LinearModel,
    fit: Fit,
    x: FloatArray,
    places: Sequence[tuple[int, int]],
    known: Sequence[Estimate],
) -> dict[str, Any]:
    """Points, their means and the fitted curve of one effect on the first joint that feels it.

    `x` (n,) are the unknowns of `model`, `fit` its covariance; `places` of the effect's columns, by joint; `known` its
    estimates, coefficients first, whose intervals also hold what the covariance does not know.
    """
    j = effect.acting[0]
    at = [place for joint, place in places if joint == j]
    column_of = {place: k for k, place in enumerate(model.places[j].tolist())}  # own unknowns come first: not in order
    columns = model.rows[j][:, [column_of[place] for place in at]]
    torque = columns @ x[at]
    left = model.rows[j][:, -1] - model.rows[j][:, :-1] @ x[model.places[j]]
    signal, unit, values = _signal(found, effect, columns[:, 0])
    used = model.counted[j] & np.isfinite(values)
    if signal == "way":
        used &= values <= REACH * effect.shape_at(j)["presliding_distance"]
    sign = np.ones(len(torque))
    if effect.kind in ALONG_THE_MOTION:
        sign = np.sign(_joined(found, "dq", j))
        used &= sign != 0
    spread = _covariance(fit, at, x, [estimate for estimate in known if estimate.joint == j])
    over, robot, torque_unit = _drawn_over(effect), found.setup.robot, found.fit.torque_unit_
    unit = unit.replace("rad", angle_units(robot.joint_kinds)[over])
    return {
        "signal": signal if signal in ("t", "column") else f"{signal}_{robot.joint_names[over]}",
        "quantity": "friction_torque" if effect.kind in ALONG_THE_MOTION else "torque",
        "unit": unit.replace("{torque}", torque_of(torque_unit, robot.joint_kinds[over])),
        "value_unit": torque_of(torque_unit, robot.joint_kinds[j]),
        "joint": robot.joint_names[j],
        **binned(values[used], (sign * (left + torque))[used], (sign[:, None] * columns)[used], x[at], spread),
    }


def _covariance(fit: Fit, at: Sequence[int], x: FloatArray, known: Sequence[Estimate]) -> FloatArray:
    """Of an effect's coefficients on one joint, each as well known as its interval says."""
    covariance = fit.covariance[np.ix_(at, at)]
    stretch = np.ones(len(at))
    for k, (estimate, value) in enumerate(zip(known, x[list(at)], strict=False)):
        if estimate.interval is None or estimate.value == 0.0 or covariance[k, k] <= 0.0:
            continue
        relative = (estimate.interval[1] - estimate.interval[0]) / (2 * NORMAL_95 * abs(estimate.value))
        stretch[k] = max(1.0, relative * abs(value) / np.sqrt(covariance[k, k]))
    wide: FloatArray = stretch[:, None] * covariance * stretch
    return wide


def _signal(found: Belief, effect: PlacedEffect, column: FloatArray) -> tuple[str, str, FloatArray]:
    """Name, unit and values, at the rows of the fit, of what an effect is drawn over."""
    j, shape = effect.acting[0], effect.shape_at(effect.acting[0])
    angle = angle_units(found.setup.robot.joint_kinds)[j]
    if effect.kind == "friction_hysteresis":
        return "way", angle, np.concatenate([_way(states, j) for states in found.catalogue.runs])
    if shape.get("cycles", 0.0) > ONE_CURVE:
        cycle = 2 * np.pi / shape["cycles"]
        return "angle_in_cycle", angle, np.mod(_joined(found, "q_motor", j), cycle)
    if effect.kind == "coupled_friction" and len(effect.joints) > 1:
        (partner,) = set(effect.joints) - {j}
        stage = _joined(found, "dq_motor", j) + shape["ratio"] * _joined(found, "dq_motor", partner)
        return "stage_speed", f"{angle}/s", stage
    if effect.kind == "gear_hysteresis":
        return "tau_link", "{torque}", _joined(found, "tau_link", j)
    drawn = CATALOGUE[effect.kind]["drawn_against"]
    if not drawn:
        return "column", "1", column
    signal, unit = drawn
    if signal == "t":
        times = [(states.t - states.t[0])[states.rows] for states in found.catalogue.runs]
        return signal, unit, np.concatenate(times)
    return signal, unit, _joined(found, signal, _drawn_over(effect))


def _drawn_over(effect: PlacedEffect) -> int:
    """The joint whose signal an effect is drawn over: another one's acceleration, a neighbour's load, else its own."""
    j = effect.acting[0]
    if effect.kind == "inertial_coupling":
        return next((other for other in effect.joints if other != j), j)
    return j + int(effect.shape_at(j).get("side", 0.0))


def _joined(found: Belief, signal: str, j: int) -> FloatArray:
    """A signal of joint j at the rows of the fit."""
    parts = [np.asarray(getattr(states, signal))[states.rows, j] for states in found.catalogue.runs]
    # The rigid body is in the unit of the first joint's channel where currents were learned from.
    scale = found.fit.links_.torque_scale_[j] if signal == "tau_link" else 1.0
    return np.asarray(scale * np.concatenate(parts))


def _way(states: States, j: int) -> FloatArray:
    """How far joint j has come since it last turned round, at the rows; NaN before it first did."""
    q = states.q_motor[:, j]
    turned = np.flatnonzero(np.diff(np.sign(np.diff(q))) != 0) + 1
    last = np.searchsorted(turned, np.arange(len(q)), side="right") - 1
    way = np.full(len(q), np.nan)
    since = last >= 0
    way[since] = np.abs(q[since] - q[turned[last[since]]])
    return way[states.rows]
