"""A diagnosis whose search is made up: real fits before and after, invented words about how it got there."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dynid_rs.base.findings import Finding
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.identification.results import score
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.placed import PlacedEffect

FLOOR_SHARE = 0.8
SHAPE = {"stribeck_velocity": 0.1, "exponent": 1.0, "transition_width": 0.01}


@dataclass(frozen=True, eq=False)
class MadeDiagnosis:
    setup: Setup
    before: ThreeLoopIdentifier
    after: ThreeLoopIdentifier
    floor: dict[str, Any]
    findings: list[Finding] = field(default_factory=list)
    entries: list[dict[str, Any]] = field(default_factory=list)
    left: list[dict[str, Any]] = field(default_factory=list)
    steps: list[dict[str, Any]] = field(default_factory=list)
    asked: Any = None
    against_reference: bool = False


def error_of(identifier, runs):
    """Per joint in the band, (n_joints,)."""
    return score(identifier.model_, [identifier.states(run) for run in runs]).rmse


def plot(signal, seed=0, n=200):
    rng = np.random.default_rng(seed)
    x = np.sort(rng.uniform(-1, 1, n))
    curve_x = np.linspace(-1, 1, 60)

    def curve(v):
        return np.sign(v) * 2.0 / (1 + 20 * v**2)

    return {
        "signal": signal,
        "unit": "rad/s",
        "x": x.tolist(),
        "partial": (curve(x) + rng.normal(0, 0.3, n)).tolist(),
        "curve_x": curve_x.tolist(),
        "curve": curve(curve_x).tolist(),
        "curve_low": (curve(curve_x) - 0.1).tolist(),
        "curve_high": (curve(curve_x) + 0.1).tolist(),
        "mean": (curve(curve_x) + rng.normal(0, 0.05, len(curve_x))).tolist(),
    }


def entry(kind, joints, before, after, **more):
    return {
        "rank": 1,
        "kind": kind,
        "joints": joints,
        "parameters": [
            {"name": "stribeck_pos", "value": 1.9, "unit": "N*m", "interval": [1.7, 2.1]},
            {"name": "stribeck_velocity", "value": 0.1, "unit": "rad/s", "interval": [0.08, 0.13]},
        ],
        "rmse_train_before": before,
        "rmse_train_after": after,
        "rmse_test_before": before,
        "rmse_test_after": after,
        "rmse_test_after_interval": [[0.95 * x, 1.05 * x] for x in after],
        "p_value": 1e-4,
        "share_explained": 0.6,
        "ties": [],
        "told_apart_from": [{"kind": "torque_ripple", "joints": joints, "log_evidence": -41.0, "p": 1e-6}],
        "plot": plot(f"dq_{joints[0]}"),
        "note": "",
    } | more


def tie(kind, joint, error):
    return {
        "kind": kind,
        "joints": [joint],
        "rmse_test_after": error,
        "separate": f"dynid excite ROBOT -o separate.csv --separate stribeck:{joint} {kind}:{joint}",
    }


def leftover(joint, share=0.12, **more):
    return {
        "joint": joint,
        "share": share,
        "p_value": 0.002,
        "depends_on": [
            {"signal": f"q_{joint}", "strength": 0.41, "direct": True},
            {"signal": f"dq_{joint}", "strength": 0.12, "direct": False},
        ],
        "term": {"kind": "gmr", "kept": False, "rmse_test_with": None},
        "plot": plot(f"q_{joint}", seed=3) | {"unit": "rad"},
    } | more


def make(setup, train, test, *, placed=(), **parts) -> MadeDiagnosis:
    """Fit before and after for real; `parts` are the rest of the fields."""
    before = setup.identifier(residual=None).fit(train)
    after = before
    if placed:
        setup = replace(setup, effects=tuple(placed))
        after = setup.identifier(residual=None).fit(train)
    left = FLOOR_SHARE * error_of(after, test)
    floor = {"value": left, "interval": np.column_stack([0.9 * left, 1.1 * left]), "method": ["repeats"] * len(left)}
    return MadeDiagnosis(setup, before, after, floor, **parts)


def clean(setup, train, test) -> MadeDiagnosis:
    """Nothing found."""
    return make(setup, train, test)


def with_effects(setup, train, test) -> MadeDiagnosis:
    """One effect with a tie, one finding on the torque channel, one leftover."""
    names = list(setup.robot.joint_names)
    where = names[1]
    placed = (PlacedEffect.at("stribeck", 1, **SHAPE),)
    made = make(setup, train, test, placed=placed)
    old, new = error_of(made.before, test).tolist(), error_of(made.after, test).tolist()
    steps = [
        {"action": "added", "kind": "stribeck", "joints": [where], "rmse_train": new},
        {"action": "dropped", "kind": "joint_spring", "joints": [names[0]], "rmse_train": new},
    ]
    found = Finding("torque_delay", "warning", "the torque comes 2.0 ms late; corrected", value=0.002, unit="s")
    return replace(
        made,
        entries=[entry("stribeck", [where], old, new, ties=[tie("friction_hysteresis", where, new)])],
        left=[leftover(names[0])],
        findings=[found],
        steps=steps,
    )
