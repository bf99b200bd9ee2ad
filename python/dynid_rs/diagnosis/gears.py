"""What two encoders show of the gears between them: compliance, lost motion, encoders that are not centred.

Motor minus link position is one more linear model under the same rule: columns of the predicted load beside the
acceleration (a rotor that no motion tells from the link is in the predicted load, and the gear does not carry it), what
is not known of the load, and what is left of the delay between the channels. Where a joint rests its gear keeps what it
had. Every run has an offset of its own: encoders are set to zero between runs. What samples are worth follows from what
is left with a hypothesis, as a gear yields as slowly as its load moves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.memory import residual_memory
from dynid_rs.base.odds import SURE, p_value
from dynid_rs.diagnosis.entries import unscored
from dynid_rs.diagnosis.sensors.messages import encoder_entries
from dynid_rs.identification.loops import link_load
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.regression.linear_model import Choice, Fit, LinearModel, sign_cost
from dynid_rs.regression.uncertainty import NORMAL_95

FloatArray = NDArray[np.float64]

TURNS = (0.02, 0.05, 0.1, 0.2)
"""Loads over which lost motion turns round, over the load's standard deviation."""


@dataclass(frozen=True)
class _Flat:
    """Prior of the columns that stand beside everything: standard normal in units of the deflection itself."""

    size: int

    def rows(self, choice: Choice) -> tuple[FloatArray, float]:
        return np.eye(self.size, self.size + 1), 0.0


@dataclass(frozen=True, eq=False)
class _Gear:
    """A hypothesis on one gear: columns whose coefficients are standard normal beforehand, names, units, signs."""

    kind: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: FloatArray
    unit: FloatArray
    bounds: FloatArray


def gear_entries(fit: ThreeLoopIdentifier) -> list[dict[str, Any]]:
    """Entries of `result.json`: the delay between the channels, then every joint's gear; none with one encoder."""
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
        }
        for clock in encoder_entries(fit.encoder_delay_)
        if clock["significant"]
    ]
    for j in range(fit.robot.n_joints):
        entries += _of_joint(fit, j)
    return entries


def _of_joint(fit: ThreeLoopIdentifier, j: int) -> list[dict[str, Any]]:
    """Names for one gear, one after the other, by posterior odds."""
    load = link_load(fit.observations_.plan, fit.links_)
    torque, deflection, speed, acceleration, angle, rate, moves = [], [], [], [], [], [], []
    for states in fit.runs_:
        tau, moving = load(states)[:, j], states.counted[:, j]
        torque.append(tau)
        deflection.append(states.in_band((states.q_motor - states.q)[:, j])[moving])
        speed.append(states.in_band(states.dq_motor[:, j])[moving])
        angle.append(states.q[:, j])
        rate.append(np.gradient(tau, 1 / states.rate))
        acceleration.append(states.in_band(states.ddq_motor[:, j])[moving])
        moves.append(moving)
    bent = np.concatenate(_centred(deflection))
    size = float(bent.std())
    if size == 0 or np.std(np.concatenate(torque)) == 0:
        return []
    moved = [np.concatenate(_centred(x)) for x in (speed, acceleration)]
    beside = [size * x / max(float(x.std()), 1e-300) for x in moved]
    carried_std = _load_roots(fit, j, moves)
    twist = np.concatenate(_centred([s.in_band(x)[m] for s, x, m in zip(fit.runs_, torque, moves, strict=True)]))
    compliance = float(bent @ twist) / max(float(twist @ twist), 1e-300)
    rows = np.concatenate([np.stack(beside, axis=1), compliance * carried_std, bent[:, None]], axis=1)
    n = rows.shape[1] - 1
    model = LinearModel(
        [rows], [np.arange(n)], _Flat(n), np.array([0.1 * len(bent)]), np.array([1e-6 * size]), len(bent)
    )
    fitted = model.fit(Choice(), np.array([0.3 * size]))
    edges = np.cumsum([len(x) for x in deflection])[:-1]
    hypotheses = _hypotheses(fit, torque, rate, angle, size, moves)
    named: list[tuple[_Gear, float]] = []
    need = SURE + float(np.log(len({h.kind for h in hypotheses}) * fit.robot.n_joints))
    while True:
        open_ = [h for h in hypotheses if h.kind not in {g.kind for g, _ in named} and _may_follow(h, named)]
        left = [model.beside({0: h.columns}).fit(Choice(), fitted.noise).residual[0] for h in open_]
        worth = [len(bent) / residual_memory(np.split(part, edges)) for part in left]
        passing = [(w, h) for w, h in zip(worth, open_, strict=True) if _evidence(model, fitted, h, w)[0] > need]
        if not passing:
            break
        # Those that pass on what they leave themselves are compared on what the best of them leaves.
        most = max(w for w, _ in passing)
        tries = [(*_evidence(model, fitted, h, most), h) for _, h in passing]
        value, model, fitted, best = max(tries, key=lambda t: t[0])
        named.append((best, value - need + SURE))
    std = np.sqrt(np.diag(fitted.covariance))
    entries, at = [], n
    for gear, odds in named:
        width = len(gear.unit)
        x, spread = fitted.x[at : at + width] * gear.unit, std[at : at + width] * gear.unit
        at += width
        entries.append(_entry(fit, j, gear, x, spread, odds))
    return entries


def _load_roots(fit: ThreeLoopIdentifier, j: int, moves: list[NDArray[np.bool_]]) -> FloatArray:
    """What is not known of joint j's load, one standard deviation a column, (n_rows, k), less the mean of every run."""
    observations, plan = fit.observations_, fit.observations_.plan
    posterior = fit.links_.posterior_
    assert posterior is not None  # every fit that is diagnosed has the weak prior
    best = posterior.model(plan, observations.joint_rows()).at(posterior.choice, posterior.noise_std)
    base = plan.unknowns(j)[plan.n_own :]
    values, vectors = np.linalg.eigh(best.covariance[np.ix_(base, base)])
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    scale = float(fit.links_.torque_scale_[j])
    runs = observations.by_run([block.rows[j][:, plan.n_own : -1] for block in observations.blocks])
    parts = _centred([run[moving] @ root / scale for run, moving in zip(runs, moves, strict=True)])
    return np.concatenate(parts)


def _may_follow(h: _Gear, named: list[tuple[_Gear, float]]) -> bool:
    """A curved spring is told as what a straight one leaves."""
    return h.kind != "nonlinear_elasticity" or any(g.kind == "joint_elasticity" for g, _ in named)


def _evidence(model: LinearModel, fitted: Fit, h: _Gear, worth: float) -> tuple[float, LinearModel, Fit]:
    """Logarithm of the Bayes factor of a hypothesis where all rows are worth so many samples, and the model with it."""
    model = replace(model, n_effective=np.array([worth]))
    after = model.beside({0: h.columns})
    best = after.fit(Choice(), fitted.noise)
    width = len(h.unit)
    std = np.sqrt(np.diag(best.covariance)[-width:])
    gain = best.evidence - model.fit(Choice(), fitted.noise).evidence
    return gain + sign_cost(best.x[-width:] / std, h.bounds), after, best


def _centred(parts: list[FloatArray]) -> list[FloatArray]:
    """Signals of every run less their mean: nothing that is constant over a run tells of a gear."""
    return [part - part.mean(axis=0) for part in parts]


def _hypotheses(
    fit: ThreeLoopIdentifier,
    torque: list[FloatArray],
    rate: list[FloatArray],
    angle: list[FloatArray],
    size: float,
    moves: list[NDArray[np.bool_]],
) -> list[_Gear]:
    """Compliance and damping, hardening, lost motion, an encoder that is not centred."""
    scatter = float(np.concatenate(torque).std())
    unit = "N*m" if fit.torque_unit_ == "N*m" else "A"

    def columns(*signals: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
        stacked = [np.stack(parts, axis=1) for parts in zip(*signals, strict=True)]
        parts = [s.in_band(x)[moving] for s, x, moving in zip(fit.runs_, stacked, moves, strict=True)]
        rows = np.concatenate(_centred(parts))
        norm = np.sqrt(np.mean(rows**2, axis=0))
        scale = size / np.where(norm > 0, norm, 1.0)
        return rows * scale, scale

    free, positive = (-np.inf, np.inf), (0.0, np.inf)
    found = []
    for kind, names, units, signals, bounds in (
        (
            "joint_elasticity",
            ("compliance", "damping"),
            (f"rad/({unit})", f"rad*s/({unit})"),
            (torque, rate),
            (positive, free),
        ),
        ("nonlinear_elasticity", ("cubic",), (f"rad/({unit})^3",), ([tau**3 for tau in torque],), (free,)),
        (
            "encoder_eccentricity",
            ("cosine", "sine"),
            ("rad", "rad"),
            ([np.cos(q) for q in angle], [np.sin(q) for q in angle]),
            (free, free),
        ),
    ):
        rows, scale = columns(*signals)
        found.append(_Gear(kind, names, units, rows, scale, np.array(bounds)))
    for turn in TURNS:
        rows, scale = columns([tau / np.hypot(tau, turn * scatter) for tau in torque])
        most = np.minimum(scale, size)  # no play is wider than the encoders differ, however seldom the load turns round
        rows, scale = rows * (most / scale), most
        found.append(_Gear("backlash", ("half_gap",), ("rad",), rows, scale, np.array([positive])))
    return found


def _entry(
    fit: ThreeLoopIdentifier, j: int, gear: _Gear, x: FloatArray, std: FloatArray, odds: float
) -> dict[str, Any]:
    half = NORMAL_95 * std
    return {
        "kind": gear.kind,
        "joints": [fit.robot.joint_names[j]],
        "parameters": [
            {"name": n, "value": float(v), "unit": u, "interval": [float(v - h), float(v + h)]}
            for n, v, u, h in zip(gear.names, x, gear.units, half, strict=True)
        ],
        **unscored(p_value(odds)),
        "evidence": odds,
        "note": "seen between the two encoders",
    }
