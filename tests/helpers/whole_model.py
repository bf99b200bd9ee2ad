"""A model with everything in it: every effect of the catalogue, each kind of residual, delays and encoder errors."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from dynid_rs import _core
from dynid_rs.simulation import bundled_robot, simulate, typical_arm

States = dict[str, np.ndarray]
SIGNALS = ("q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor", "temperature")
STEP = 0.004
"""Time between the samples of a run [s]."""
OF_ANGLE = ("torque_ripple", "joint_spring", "counterbalance")
ENDS = {"held_from": -0.3, "held_to": 0.2}
"""Kinds that are functions of the joint's angle, and angles within the run at which they end."""
RESIDUALS = ("joint_state", "deflection", "load_free_deflection", "signals")


def shape_value(name: str, j: int) -> float:
    """A valid shape parameter of joint `j`; every joint's partner is the one before, the first has none."""
    known = {
        "a": 0.8 + 0.1 * j,
        "b": 0.2 + 0.05 * j,
        "phase": 1.0 + j,
        "gas_length": 2.0 - 0.1 * j if j % 2 else -1.5,
        "partner": j - 1.0,
        "side": -1.0 if j % 2 else 1.0,
        "ratio": 0.5 - j,
        "cycles": 2.0 + 7.5 * j,
        "presliding_distance": 0.01,
        "hysteresis_load": 3.0,
        "carried_load": 2.0,
        "time_constant": 2.0,
        "reference_speed": 0.0 if j % 2 else 0.7,
        "reference_temperature": 25.0,
        "exponent": 1.0 + 0.3 * j,
        "velocity_threshold": 0.05 * j,
        "stribeck_velocity": 0.1 + 0.1 * j,
    }
    return known.get(name, 0.02 + 0.01 * j)


def every_effect(n: int, rng: np.random.Generator) -> list[tuple[_core.Effect, np.ndarray]]:
    """One of every kind of the catalogue with random sizes, one of them twice, functions of the angle with ends too."""
    effects = []
    kinds = [entry["kind"] for entry in _core.effect_catalogue()]
    for kind, ends in [(kind, {}) for kind in (*kinds, "friction_hysteresis")] + [(kind, ENDS) for kind in OF_ANGLE]:
        (entry,) = (entry for entry in _core.effect_catalogue() if entry["kind"] == kind)
        shape = {one["name"]: [shape_value(one["name"], j) for j in range(n)] for one in entry["shape"]}
        shape |= {name: [end + 0.05 * j for j in range(n)] for name, end in ends.items()}
        effect = _core.Effect.of(kind, **shape)
        size = 1e-4 if kind == "torque_saturation" else 1.0
        effects.append((effect, size * rng.normal(size=(n, effect.n_columns))))
    return effects


def regression(rng: np.random.Generator, centre: np.ndarray, size: np.ndarray, *, rbf: bool):
    """A mixture or radial basis functions over inputs of this size around this place."""
    d = len(size)
    if rbf:
        centers = centre + size * rng.normal(size=(8, d))
        return _core.NormalisedRbf(centers, 4 / size**2, rng.normal(size=8), rng.uniform(0.1, 1, 8))
    scale = np.append(size, 2.0)
    half = 0.3 * rng.normal(size=(5, d + 1, d + 1)) + 0.7 * np.eye(d + 1)
    covariances = (half @ half.transpose(0, 2, 1)) * np.outer(scale, scale)
    means = np.append(centre, 0.0) + scale * rng.normal(size=(5, d + 1))
    return _core.GaussianMixtureRegression(
        rng.dirichlet(np.ones(5)), means, 0.5 * (covariances + covariances.transpose(0, 2, 1))
    )


def true_states(states: States, delay: np.ndarray, error: np.ndarray, *, both_sides: bool) -> States:
    """What the estimator makes of what the channels show."""
    link = _core.true_motion(*(states[name] for name in ("q", "dq", "ddq")), error)
    motor = [states[f"{name}_motor"] for name in ("q", "dq", "ddq")]
    if both_sides:
        motor = list(_core.true_motion(*motor, error))
    q, dq = _core.align_link_side(*link, delay)
    return dict(zip(SIGNALS, [q, dq, link[2], *motor], strict=False))


def inputs_of(inputs: str, states: States, j: int, signals: list[tuple[str, int]]) -> np.ndarray:
    """Roughly what a regression of joint `j` sees, (n_samples, n_inputs)."""
    if inputs == "joint_state":
        return np.column_stack([states["q_motor"][:, j], states["dq_motor"][:, j]])
    if inputs == "signals":
        load = 20 * states["ddq"]  # about as large as the load
        return np.column_stack([(states | {"tau_link": load})[name][:, k] for name, k in signals])
    return np.column_stack([states[f"{name}_motor"][:, j] - states[name][:, j] for name in ("q", "dq")])


def whole_model(
    robot: _core.RobotModel,
    states: States,
    inputs: str | None,
    *,
    seed: int = 0,
    both_sides: bool = False,
    effects: list[tuple[_core.Effect, np.ndarray]] | None = None,
) -> _core.TorqueModel:
    """Every effect (or these), a residual on `inputs`, delays and encoder errors."""
    rng = np.random.default_rng(seed)
    n = robot.n_joints
    names = ("dq", "tau_link", "q_motor", "q", "ddq", "dq_motor")
    signals = [[(name, (j + k) % n) for k, name in enumerate(names[j % 6 :])] for j in range(n)]
    slides = np.array([kind == "prismatic" for kind in robot.joint_kinds])
    delay = rng.uniform(1e-3, 4e-3, n)
    error = np.where(slides[:, None], 0.0, rng.uniform(-5e-3, 5e-3, (n, 2)))
    residual = None
    if inputs is not None:
        true = true_states(states, delay, error, both_sides=both_sides)
        joints = []
        for j in range(n):
            u = inputs_of(inputs, true, j, signals[j])
            size = np.maximum(u.std(axis=0), 1e-6)
            # One joint without; on the last the data lies far away part of the time.
            centre = u.mean(axis=0) + (2.5 * size if j == n - 1 else 0.0)
            joints.append(None if j == 1 else regression(rng, centre, size, rbf=j % 3 == 2))
        residual = (inputs, joints)
    least, most = states["q"].min(axis=0), states["q"].max(axis=0)
    margin = 0.02 * (most - least)
    return _core.TorqueModel(
        robot,
        robot.phi.ravel() + 0.01 * rng.normal(size=10 * n),
        every_effect(n, rng) if effects is None else effects,
        residual=residual,
        residual_signals=signals if inputs == "signals" else None,
        compliance=rng.uniform(0, 1e-5, n).tolist() if inputs == "load_free_deflection" else None,
        torque_scale=rng.uniform(0.5, 2, n).tolist(),
        encoder_delay=delay.tolist(),
        encoder_error=error,
        encoder_error_sides="both" if both_sides else "link",
        noise_std=rng.uniform(0.1, 1, n).tolist(),
        domain=(
            np.column_stack([least + margin, most - margin]).tolist(),
            *(0.98 * np.abs(states[name]).max(axis=0) for name in ("dq", "ddq")),
        ),
        step=STEP,
    )


@cache
def _recorded() -> tuple[tuple[str, np.ndarray], ...]:
    arm = typical_arm(_core.RobotModel.from_urdf(bundled_robot()))
    recording = simulate(arm, n_runs=1, duration=8.0, rate=1 / STEP, derivatives=True).recordings[0]
    columns = {name: getattr(recording, name) for name in ("q", "dq", "ddq", "q_motor", "dq_motor")}
    columns["ddq_motor"] = np.gradient(columns["dq_motor"], STEP, axis=0)
    warmth = np.linspace(22.0, 41.0, len(columns["q"]))[:, None] + np.arange(6)
    warmth[100:120, 2] = np.nan
    return tuple((columns | {"temperature": warmth}).items())


def recorded_states() -> States:
    """The states of a recorded run of a simulated six-axis arm with two encoders, and temperatures, some not known."""
    return {name: values.copy() for name, values in _recorded()}


def spoiled(states: States) -> States:
    """The same with rows that are none: NaN, infinities, an overflow."""
    states = {name: values.copy() for name, values in states.items()}
    states["q"][0, 0] = np.nan
    states["dq_motor"][50, 3] = np.inf
    states["ddq"][60:62, 1] = -np.inf
    states["dq"][70, 2] = 1e200
    return states


def write_again(content: dict[str, Any], path: Path) -> _core.TorqueModel:
    """Write a model file with the checksum of what it holds, and load it."""
    content["checksum"] = "sha256:" + "0" * 64
    text = json.dumps(content, indent=2, ensure_ascii=False) + "\n"
    digest = hashlib.sha256(text.encode()).hexdigest()
    path.write_text(text.replace("0" * 64, digest, 1), encoding="utf-8")
    return _core.TorqueModel.load(path)
