"""What two encoders show of the gears between them: compliance, lost motion, encoders that are not centred.

Motor minus link position is one more linear model (`gear_model.py`) under the same rule. What samples are worth follows
from what is left with a hypothesis, as a gear yields as slowly as its load moves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.memory import residual_memory, returning
from dynid_rs.base.odds import SURE, p_value
from dynid_rs.diagnosis.belief import SETTLING, fitted
from dynid_rs.diagnosis.entries import unscored, untold
from dynid_rs.diagnosis.gear_model import Gear, GearHypothesis
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.structure_plot import delay_plot
from dynid_rs.diagnosis.waves import Argument
from dynid_rs.identification.smooth_friction import SmoothFrictionIdentifier
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.curves import binned
from dynid_rs.regression.linear_model import Choice, Fit, LinearModel, sign_cost
from dynid_rs.regression.uncertainty import NORMAL_95
from dynid_rs.runs.recording import Recording
from dynid_rs.sensors.messages import encoder_entries

FloatArray = NDArray[np.float64]


def gear_entries(fit: ThreeLoopIdentifier, nameless: Mapping[int, Argument]) -> list[dict[str, Any]]:
    """Entries of `result.json`: the delay between the channels, then every joint's gear; none with one encoder.

    A joint whose torque is a `nameless` function of its angle winds its gear up by one too: what looks like an encoder
    off centre there has no name either.
    """
    if not all(states.two_encoders for states in fit.runs_):
        return []
    names = fit.robot.joint_names
    entries = [
        {
            "kind": "encoder_delay",
            "joints": [names[j] for j in clock["joints"]],
            "parameters": [
                {"name": "delay", "value": clock["value"], "unit": "s", "interval": list(clock["interval"])}
            ],
            **unscored(clock["p_value"]),
            "plot": delay_plot(fit, clock),
        }
        for clock in encoder_entries(fit.encoder_delay_)
        if clock["significant"]
    ]
    for seen in seen_between(fit):
        entries.append(_entry(seen, names))
        if seen.what.kind == "encoder_eccentricity" and seen.joint in nameless:
            entries[-1] |= untold(seen.what.kind, nameless[seen.joint], names)
    return entries


@dataclass(frozen=True, eq=False)
class Seen:
    """A name for a gear: its joint, what it says, its coefficients and how well they are known, its odds.

    `drawn`: the deflection that is left and its own, over the gear's load or, of an encoder off centre, the angle.
    """

    joint: int
    what: GearHypothesis
    value: FloatArray
    std: FloatArray
    log_odds: float
    drawn: dict[str, Any]


def seen_between(fit: ThreeLoopIdentifier) -> list[Seen]:
    """All names that the two encoders of a fit's runs show, joint by joint."""
    if not all(states.two_encoders for states in fit.runs_):
        return []
    posterior, observations = fit.links_.posterior_, fit.observations_
    assert posterior is not None  # every fit that is diagnosed has the weak prior
    model = posterior.model(observations.plan, observations.joint_rows())
    covariance = model.fit(posterior.choice, posterior.noise_std).covariance
    return [seen for gear in Gear.all_of(fit) for seen in _named(gear, covariance)]


def centred(
    setup: Setup, train: Sequence[Recording], fit: ThreeLoopIdentifier, declared: FloatArray
) -> tuple[Setup, ThreeLoopIdentifier]:
    """Take off link encoders what the gears show that they show too much, no more and no less; setup and its fit.

    A link that is not where it is read to be looks like frames and inertials that are not where the file has them.
    Where a gear shows nothing, the `declared` error (n_joints, 2) [rad] stays. Friction keeps its shapes: it is of the
    motors' speed, which the link encoders do not show.
    """
    if not all(states.two_encoders for states in fit.runs_):
        return setup, fit
    for _ in range(SETTLING):
        error, std = declared.copy(), np.zeros_like(declared)
        for seen in seen_between(fit):
            if seen.what.kind == "encoder_eccentricity":
                error[seen.joint], std[seen.joint] = seen.value, seen.std
        if np.all(np.abs(error - setup.encoder_error) <= std):
            break
        setup = replace(setup, encoder_error=error)
        shapes = fit.friction_.transition_width_, fit.friction_.sharpness_
        fit = fitted(setup, train, friction=SmoothFrictionIdentifier(shapes, held=True))
    return setup, fit


def _named(gear: Gear, covariance: FloatArray) -> list[Seen]:
    """Names for one gear, one after the other, by posterior odds."""
    model, noise = gear.model(covariance)
    at, fit = model.prior.size, model.fit(Choice(), noise)
    edges, phase = np.cumsum([len(part) for part in gear.deflection])[:-1], gear.phase
    hypotheses = gear.hypotheses()
    named: list[tuple[GearHypothesis, float]] = []
    need = SURE + float(np.log(len({h.kind for h in hypotheses}) * gear.fit.robot.n_joints))
    while True:
        open_ = [h for h in hypotheses if h.kind not in {g.kind for g, _ in named} and _may_follow(h, named)]
        left = [model.beside({0: h.columns}).fit(Choice(), fit.noise).residual[0] for h in open_]
        worth = [model.n_rows / (residual_memory(np.split(part, edges)) * returning(part, phase)) for part in left]
        passing = [(w, h) for w, h in zip(worth, open_, strict=True) if _passes(model, fit, h, w, need)]
        if not passing:
            break
        # Those that pass on what they leave themselves are compared on what the best of them leaves.
        most = max(w for w, _ in passing)
        tries = [(*_evidence(model, fit, h, most), h) for _, h in passing]
        value, model, fit, best = max(tries, key=lambda t: t[0])
        named.append((best, value - need + SURE))
    std = np.sqrt(np.diag(fit.covariance))
    found = []
    for h, odds in named:
        places = slice(at, at + len(h.unit))
        at += len(h.unit)
        if not _is_told(h, fit.x[places], std[places]):  # beside those that were named after it
            continue
        drawn = _drawn(gear, h, fit, places)
        found.append(Seen(gear.joint, h, fit.x[places] * h.unit, std[places] * h.unit, odds, drawn))
    return found


def _drawn(gear: Gear, h: GearHypothesis, fit: Fit, places: slice) -> dict[str, Any]:
    """One name as a curve; the encoders' constant difference over a run is in neither."""
    turning = h.kind == "encoder_eccentricity"
    over = np.concatenate(gear.angle if turning else gear.rows(gear.load))
    partial = fit.residual[0] + h.columns @ fit.x[places]
    return {
        "signal": "q" if turning else "tau_link",
        "unit": gear.angle_unit if turning else gear.load_unit,
        "quantity": "deflection",
        "value_unit": gear.angle_unit,
        **binned(over, partial, h.columns, fit.x[places], fit.covariance[places, places]),
    }


def _may_follow(h: GearHypothesis, named: Sequence[tuple[GearHypothesis, float]]) -> bool:
    """A curved spring is told as what a straight one leaves."""
    return h.kind != "nonlinear_elasticity" or any(g.kind == "joint_elasticity" for g, _ in named)


def _passes(model: LinearModel, fit: Fit, h: GearHypothesis, worth: float, need: float) -> bool:
    """Whether a hypothesis has more evidence than is needed, and its size is told."""
    value, _, best = _evidence(model, fit, h, worth)
    width = len(h.unit)
    return value > need and _is_told(h, best.x[-width:], np.sqrt(np.diag(best.covariance)[-width:]))


def _is_told(h: GearHypothesis, x: FloatArray, std: FloatArray) -> bool:
    """Whether what physics does not let be negative is told from zero."""
    signed = h.bounds[:, 0] == 0.0
    return bool(np.all(x[signed] > NORMAL_95 * std[signed]))


def _evidence(model: LinearModel, fit: Fit, h: GearHypothesis, worth: float) -> tuple[float, LinearModel, Fit]:
    """Logarithm of the Bayes factor of a hypothesis where all rows are worth so many samples, and the model with it."""
    model = replace(model, n_effective=np.array([worth]))
    after = model.beside({0: h.columns})
    best = after.fit(Choice(), fit.noise)
    width = len(h.unit)
    std = np.sqrt(np.diag(best.covariance)[-width:])
    gain = best.evidence - model.fit(Choice(), fit.noise).evidence
    return gain + float(sign_cost(best.x[-width:] / std, h.bounds)), after, best


def _entry(seen: Seen, names: Sequence[str]) -> dict[str, Any]:
    h = seen.what
    return {
        "kind": h.kind,
        "joints": [names[seen.joint]],
        "parameters": [
            {"name": name, "value": float(v), "unit": unit, "interval": [float(v - r), float(v + r)]}
            for name, v, unit, r in zip(h.names, seen.value, h.units, NORMAL_95 * seen.std, strict=True)
        ],
        **unscored(p_value(seen.log_odds)),
        "evidence": seen.log_odds,
        "plot": seen.drawn | {"signal": f"{seen.drawn['signal']}_{names[seen.joint]}", "joint": names[seen.joint]},
        "note": "seen between the two encoders",
    }
