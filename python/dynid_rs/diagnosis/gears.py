"""What two encoders show of the gears between them: compliance, lost motion, encoders that are not centred.

Motor minus link position is one more linear model (`gear_model.py`) under the same rule. What samples are worth follows
from what is left with a hypothesis, as a gear yields as slowly as its load moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.memory import residual_memory
from dynid_rs.base.odds import SURE, p_value
from dynid_rs.diagnosis.entries import unscored
from dynid_rs.diagnosis.gear_model import Gear, GearHypothesis
from dynid_rs.diagnosis.sensors.messages import encoder_entries
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.regression.linear_model import Choice, Fit, LinearModel, sign_cost
from dynid_rs.regression.uncertainty import NORMAL_95

FloatArray = NDArray[np.float64]


def gear_entries(fit: ThreeLoopIdentifier) -> list[dict[str, Any]]:
    """Entries of `result.json`: the delay between the channels, then every joint's gear; none with one encoder."""
    if not all(states.two_encoders for states in fit.runs_):
        return []
    names, posterior = fit.robot.joint_names, fit.links_.posterior_
    assert posterior is not None  # every fit that is diagnosed has the weak prior
    entries = [
        {
            "kind": "encoder_delay",
            "joints": [names[j] for j in clock["joints"]],
            "parameters": [
                {"name": "delay", "value": clock["value"], "unit": "s", "interval": list(clock["interval"])}
            ],
            **unscored(clock["p_value"]),
        }
        for clock in encoder_entries(fit.encoder_delay_)
        if clock["significant"]
    ]
    observations = fit.observations_
    model = posterior.model(observations.plan, observations.joint_rows())
    covariance = model.at(posterior.choice, posterior.noise_std).covariance
    for j in range(fit.robot.n_joints):
        gear = Gear(fit, j)
        if any(np.ptp(part) > 0 for part in gear.deflection if len(part)) and any(np.ptp(tau) > 0 for tau in gear.load):
            entries += _entries(gear, covariance)
    return entries


def _entries(gear: Gear, covariance: FloatArray) -> list[dict[str, Any]]:
    """Names for one gear, one after the other, by posterior odds."""
    model, noise = gear.model(covariance)
    at, fitted = model.prior.size, model.fit(Choice(), noise)
    edges = np.cumsum([len(part) for part in gear.deflection])[:-1]
    hypotheses = gear.hypotheses()
    named: list[tuple[GearHypothesis, float]] = []
    need = SURE + float(np.log(len({h.kind for h in hypotheses}) * gear.fit.robot.n_joints))
    while True:
        open_ = [h for h in hypotheses if h.kind not in {g.kind for g, _ in named} and _may_follow(h, named)]
        left = [model.beside({0: h.columns}).fit(Choice(), fitted.noise).residual[0] for h in open_]
        worth = [model.n_rows / residual_memory(np.split(part, edges)) for part in left]
        passing = [(w, h) for w, h in zip(worth, open_, strict=True) if _evidence(model, fitted, h, w)[0] > need]
        if not passing:
            break
        # Those that pass on what they leave themselves are compared on what the best of them leaves.
        most = max(w for w, _ in passing)
        tries = [(*_evidence(model, fitted, h, most), h) for _, h in passing]
        value, model, fitted, best = max(tries, key=lambda t: t[0])
        named.append((best, value - need + SURE))
    std = np.sqrt(np.diag(fitted.covariance))
    entries = []
    for h, odds in named:
        places = slice(at, at + len(h.unit))
        at += len(h.unit)
        entries.append(_entry(gear, h, fitted.x[places] * h.unit, std[places] * h.unit, odds))
    return entries


def _may_follow(h: GearHypothesis, named: Sequence[tuple[GearHypothesis, float]]) -> bool:
    """A curved spring is told as what a straight one leaves."""
    return h.kind != "nonlinear_elasticity" or any(g.kind == "joint_elasticity" for g, _ in named)


def _evidence(model: LinearModel, fitted: Fit, h: GearHypothesis, worth: float) -> tuple[float, LinearModel, Fit]:
    """Logarithm of the Bayes factor of a hypothesis where all rows are worth so many samples, and the model with it."""
    model = replace(model, n_effective=np.array([worth]))
    after = model.beside({0: h.columns})
    best = after.fit(Choice(), fitted.noise)
    width = len(h.unit)
    std = np.sqrt(np.diag(best.covariance)[-width:])
    gain = best.evidence - model.fit(Choice(), fitted.noise).evidence
    return gain + float(sign_cost(best.x[-width:] / std, h.bounds)), after, best


def _entry(gear: Gear, h: GearHypothesis, x: FloatArray, std: FloatArray, odds: float) -> dict[str, Any]:
    half = NORMAL_95 * std
    return {
        "kind": h.kind,
        "joints": [gear.fit.robot.joint_names[gear.joint]],
        "parameters": [
            {"name": name, "value": float(v), "unit": unit, "interval": [float(v - r), float(v + r)]}
            for name, v, unit, r in zip(h.names, x, h.units, half, strict=True)
        ],
        **unscored(p_value(odds)),
        "evidence": odds,
        "note": "seen between the two encoders",
    }
