"""What `dynid fleet` said of simulated arms against what was put into them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import dynid_rs as dyn
from campaigns.fleet_arms import N_TEST, N_TRAIN, DrawnArm, robot_of
from dynid_rs import _core
from dynid_rs.pooling.arm import ArmEstimate
from dynid_rs.pooling.fleet import Fleet
from dynid_rs.pooling.type_pool import TypePool
from dynid_rs.regression.columns import make_plan

FloatArray = NDArray[np.float64]
Figures = dict[str, Any]

FAR = 3.0
"""Deviations beyond which a normal distribution has 0.27 %."""
FLEETS, ARMS = 60, 30
"""Fleets without odd arms that are drawn from a pooled type, and arms of each."""


def judge_arm(drawn: DrawnArm, row: Mapping[str, Any]) -> Figures:
    """One arm: what was put in, what was said."""
    causes = [{key: cause[key] for key in ("kind", "place", "change", "size", "std_error")} for cause in row["causes"]]
    first = causes[0] if causes else None
    right = (
        drawn.odd is not None
        and first is not None
        and (first["kind"], first["place"]) == (drawn.odd.kind, drawn.odd.place)
    )
    return {
        "name": drawn.name,
        "type": drawn.type,
        "odd": None if drawn.odd is None else asdict(drawn.odd),
        "said": row["odd"] == "yes",
        "right": right,
        "more": max(len(causes) - 1, 0),
        "causes": causes,
    }


def true_quantities(drawn: DrawnArm) -> dict[tuple[str, str, str], float]:
    """Truth of the base parameters and constant torques of an arm, by kind, place and name (base: by their number)."""
    robot, arm = robot_of(drawn.type), drawn.arm
    n = robot.n_joints
    effects = [
        _core.Effect.rotor_inertia(),
        _core.Effect.torque_offset(),
        _core.Effect.friction([0.01] * n, [0.01] * n),
    ]
    plan = make_plan(robot, effects)
    phi_base = np.array(robot.base_parameters().project(np.asarray(arm.phi)))
    for (joint, column), share in plan.absorbed.items():
        if column == 0:
            phi_base = phi_base + arm.rotor_inertia[joint] * share
    return {("base", str(k), ""): float(value) for k, value in enumerate(phi_base)}


def true_friction(drawn: DrawnArm, joint: int, speed: float) -> tuple[float, float]:
    """Friction at a speed and the constant torque beside it, as `ArmEstimate.friction_at` means them."""
    arm = drawn.arm
    basis = _core.friction_basis(
        [speed, -speed], float(arm.velocity_threshold[joint]), float(arm.transition_width[joint])
    )
    forth, back = np.asarray(basis) @ arm.friction[joint]
    return 0.5 * (forth - back), 0.5 * (forth + back) + float(arm.torque_offset[joint])


def coverage(arms: Mapping[str, DrawnArm], table: Mapping[str, NDArray[Any]]) -> Figures:
    """Of the arms without anything odd: intervals that hold the truth, and squared errors alone and pooled, by kind."""
    found: dict[str, dict[str, list[float]]] = {}
    truths = {name: true_quantities(drawn) for name, drawn in arms.items() if drawn.odd is None}
    numbers: dict[tuple[str, str], int] = {}
    for k in range(len(table["arm"])):
        name, kind = table["arm"][k], table["kind"][k]
        if name not in truths or kind not in ("base", "friction", "offset"):
            continue
        drawn = arms[name]
        if kind == "base":
            number = numbers[name, kind] = numbers.get((name, kind), -1) + 1
            truth = truths[name]["base", str(number), ""]
        else:
            joint = list(robot_of(drawn.type).joint_names).index(table["place"][k])
            truth = true_friction(drawn, joint, float(table["at"][k]))[("friction", "offset").index(kind)]
        alone, spread, pooled = table["estimate"][k], table["std_error"][k], table["pooled"][k]
        own = found.setdefault(kind, {key: [] for key in ("alone", "pooled", "gain")})
        own["alone"].append(float(abs(alone - truth) < 1.959963984540054 * spread))
        own["pooled"].append(float(table["pooled_low"][k] <= truth <= table["pooled_high"][k]))
        scale = max(spread, 1e-300) ** 2
        own["gain"].append(float(((alone - truth) ** 2) / scale))
        own.setdefault("left", []).append(float(((pooled - truth) ** 2) / scale))
    return {
        kind: {
            "n": len(own["alone"]),
            "alone": float(np.mean(own["alone"])),
            "pooled": float(np.mean(own["pooled"])),
            "error": float(np.sqrt(np.mean(own["left"]) / np.mean(own["gain"]))),
        }
        for kind, own in found.items()
    }


def tails(clean: set[str], table: Mapping[str, NDArray[Any]]) -> Figures:
    """Share of the clean arms' distances beyond `FAR` deviations."""
    far = [
        abs(float(value)) > FAR for name, value in zip(table["arm"], table["deviations"], strict=True) if name in clean
    ]
    return {"n": len(far), "beyond": int(np.sum(far))}


def unseen(fleet: Fleet, arms: Sequence[DrawnArm], folder: Path, output: Path) -> Figures:
    """Error on a run that nobody saw, by an arm's own model and by the one with pooled estimates; over the torque's."""
    errors = []
    for drawn in arms:
        own = dyn.TorqueModel.load(output / drawn.name / "model.json")
        run = dyn.read_recording(folder / drawn.name / f"run_{N_TRAIN + N_TEST}.parquet", own.robot)
        pooled = fleet.model(drawn.name, own)
        pair = [np.sqrt(np.maximum(1 - np.asarray(model.score(run, per_joint=True)), 0)) for model in (own, pooled)]
        errors.append(pair)
    values = np.array(errors)
    return {
        "n": len(arms),
        "alone": float(np.mean(values[:, 0])),
        "pooled": float(np.mean(values[:, 1])),
        "better": float(np.mean(values[:, 1].mean(axis=1) < values[:, 0].mean(axis=1))),
    }


def clean_fleets(one: TypePool, rng: np.random.Generator, false_alarms: float, n_fleets: int = FLEETS) -> Figures:
    """Fleets without odd arms, drawn from a pooled type: in how many any arm is named.

    ``x_i = mu + delta_i + e_i`` with ``delta_i ~ N(0, diag T)``, ``e_i ~ N(0, S_i)``, S_i of an arm of the type.
    """
    named = 0
    for _ in range(n_fleets):
        drawn: list[ArmEstimate] = []
        for k in range(ARMS):
            arm = one.arms[int(rng.integers(one.n_arms))]
            noise = rng.multivariate_normal(np.zeros(len(arm.x)), arm.covariance, method="eigh", check_valid="ignore")
            x = np.where(arm.estimable, one.mean + np.sqrt(one.power) * rng.standard_normal(len(arm.x)) + noise, 0.0)
            usual, seen = rng.standard_normal((2, arm.n_joints))
            error = arm.torque_std * np.exp(-3.5 + 0.2 * usual + arm.error_spread * seen)
            drawn.append(replace(arm, name=f"arm_{k}", x=x, error=error))
        named += bool(Fleet(false_alarms).fit(drawn).odd())
    return {"fleets": n_fleets, "arms": ARMS, "named": named, "false_alarms": false_alarms}
