"""Friction over speed as a model has it, and measured torque less everything else of the model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.drawing import chosen_joints, grid
from dynid_rs.base.units import labelled, torque_of
from dynid_rs.base.wording import is_friction, kind_words
from dynid_rs.model.along import states_of
from dynid_rs.model.assembly import declared_temperature, evaluate
from dynid_rs.runs.given import Runs, as_recordings

FloatArray = NDArray[np.float64]

N_SPEEDS, N_POSES = 400, 24
"""Speeds of a curve, and poses over which load and position vary."""
LEAD_IN = 25
"""Presliding distances that a joint has moved before its friction counts as that of steady sliding."""
SPREAD = 0.02
"""Friction that differs less than this part of its size between poses is drawn as one line."""
MOST_DOTS = 3000


def plot_friction(
    model: _core.TorqueModel, runs: Runs | None = None, *, joints: Sequence[str | int] | None = None, axes: Any = None
) -> NDArray[Any]:
    """`TorqueModel.plot_friction`; `_core.pyi` says what is drawn."""
    robot = model.robot
    chosen = chosen_joints(joints, robot.joint_names)
    drawn = grid(len(chosen), axes)
    told = [term for term, effect in enumerate(_effects(model)) if is_curve(effect)]
    dots = None if runs is None else _measured(model, runs, told)
    for panel, j in zip(drawn, chosen, strict=True):
        speed, torque = friction_curves(model, j, told)
        middle, low, high = np.median(torque, axis=0), torque.min(axis=0), torque.max(axis=0)
        if dots is not None:
            x, y = dots[0][j], dots[1][j]
            step = max(1, len(x) // MOST_DOTS)
            panel.plot(x[::step], y[::step], ".", color="0.6", markersize=2, zorder=1, label="measured, less all else")
        if np.any(high - low > SPREAD * max(float(np.abs(middle).max()), 1e-300)):
            panel.fill_between(speed, low, high, alpha=0.25, linewidth=0, color="C0", label="over poses and loads")
        panel.plot(speed, middle, color="C0", label="model")
        kind = robot.joint_kinds[j]
        panel.set_title(robot.joint_names[j], loc="left", fontsize="medium")
        panel.set_xlabel(labelled("speed", "m/s" if kind == "prismatic" else "rad/s"))
        panel.set_ylabel(labelled("friction", torque_of(model.torque_unit, kind)))
        panel.grid(visible=True, alpha=0.3, linewidth=0.6)
    most = max(drawn, key=lambda panel: len(panel.get_legend_handles_labels()[0]))  # a band is on some joints only
    if len(most.get_legend_handles_labels()[0]) > 1:
        most.legend(fontsize="small", frameon=False)
    left_out = _not_drawn(model)
    if axes is None and left_out:
        drawn[0].figure.suptitle(
            f"Not drawn, because speed alone does not tell it: {', '.join(left_out)}", fontsize="small"
        )
    return drawn


def friction_curves(model: _core.TorqueModel, joint: int, terms: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Torque of some effects in steady sliding over the speed of one joint, the others at rest, in many poses.

    Friction with hysteresis is what it becomes once the joint has moved on for a while: before every half of the curve
    it slides in that direction, many times the distance that presliding takes.

    Returns
    -------
    speed : ndarray (n_speeds,)
        As far as the training data [rad/s, m/s].
    torque : ndarray (n_poses, n_speeds)
        Sum of the effects `terms` (indices among the model's effects) [torque unit].
    """
    positions, speeds, _ = model.domain
    n = model.robot.n_joints
    half = np.linspace(0.0, speeds[joint], N_SPEEDS // 2 + 1)[1:]
    sliding = np.concatenate([np.full(LEAD_IN, half[0]), half])
    told = np.concatenate([np.full(LEAD_IN, False), np.full(len(half), True)])
    # Once it has turned round it stays: no more way than needed, for a model has limits of position too.
    path = _presliding(model, joint) * np.minimum(np.arange(len(sliding)), LEAD_IN)
    speed, way, told = (np.concatenate(parts) for parts in ((sliding, -sliding), (path, path[-1] - path), (told, told)))
    low, high = np.asarray(positions).T
    poses = low + (high - low) * np.random.default_rng(0).random((N_POSES, n))
    q = np.repeat(poses, len(speed), axis=0)
    dq, q_motor = np.zeros_like(q), q.copy()
    dq[:, joint] = np.tile(speed, N_POSES)
    q_motor[:, joint] += np.tile(way, N_POSES)
    still, zero = model.with_torque_delay(0.0), np.zeros_like(q)
    step, temperature = model.step or 1e-3, declared_temperature([effect for effect, _ in model.effects], q)
    _, parts, _ = still.evaluate(q, dq, zero, q_motor, dq, zero, step=step, temperature=temperature)
    torque: FloatArray = parts[:, [1 + k for k in terms], joint].sum(axis=1)  # the first term is the rigid body
    order = np.argsort(speed[told])
    return speed[told][order], torque.reshape(N_POSES, -1)[:, told][:, order]


def is_curve(effect: _core.Effect) -> bool:
    """Whether an effect is friction that has one size at each speed, in steady sliding."""
    return (
        is_friction(effect.kind)
        and bool({"dq_motor", "q_motor"} & set(effect.signals))
        and "step" not in effect.signals
    )


def _presliding(model: _core.TorqueModel, joint: int) -> float:
    """The longest way [rad, m] that friction with hysteresis takes to turn round on a joint."""
    shapes = [dict(effect.shape) for effect in _effects(model)]
    return max(
        [float(shape["presliding_distance"][joint]) for shape in shapes if "presliding_distance" in shape] + [1e-4]
    )


def _not_drawn(model: _core.TorqueModel) -> list[str]:
    kinds = [e.kind for e, own in model.effects if is_friction(e.kind) and not is_curve(e) and np.any(own)]
    return [kind_words(kind) for kind in dict.fromkeys(kinds)]


def _effects(model: _core.TorqueModel) -> list[_core.Effect]:
    return [effect for effect, _ in model.effects]


def _measured(model: _core.TorqueModel, runs: Runs, terms: Sequence[int]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Speed, and measured torque less all other terms in the band, per joint where it moves."""
    speeds, left = [], []
    for states in states_of(model, as_recordings(runs, model.robot)):
        total, parts, _ = evaluate(model, states)
        others = total - parts[:, [1 + k for k in terms]].sum(axis=1)
        rows = states.in_band(states.tau - others)
        speeds.append(np.where(states.counted, states.dq_motor[states.rows], np.nan))
        left.append(np.where(states.counted, rows, np.nan))
    x, y = np.concatenate(speeds), np.concatenate(left)
    return list(x.T), list(y.T)
