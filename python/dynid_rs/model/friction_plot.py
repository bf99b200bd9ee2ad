"""Friction over speed as a model has it, and measured torque less everything else of the model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.drawing import chosen_joints, grid
from dynid_rs.base.units import labelled
from dynid_rs.base.wording import kind_words
from dynid_rs.model.along import states_of
from dynid_rs.model.assembly import evaluate
from dynid_rs.model.units import torque_of
from dynid_rs.runs.given import Runs, as_recordings

FloatArray = NDArray[np.float64]

N_SPEEDS, N_POSES = 401, 24
"""Speeds of a curve, and poses over which load and position vary."""
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
    if len(drawn) and len(drawn[0].get_legend_handles_labels()[0]) > 1:
        drawn[0].legend(fontsize="small", frameon=False)
    left_out = _remembering(model)
    if axes is None and left_out:
        drawn[0].figure.suptitle(
            f"Not drawn, because it remembers the motion before: {', '.join(left_out)}", fontsize="small"
        )
    return drawn


def friction_curves(model: _core.TorqueModel, joint: int, terms: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Torque of some effects over the speed of one joint, the others at rest, in poses the model was trained in.

    Returns
    -------
    speed : ndarray (n_speeds,)
        As far as the training data [rad/s, m/s].
    torque : ndarray (n_poses, n_speeds)
        Sum of the effects `terms` (indices among the model's effects) [torque unit].
    """
    positions, speeds, _ = model.domain
    n = model.robot.n_joints
    speed = np.linspace(-speeds[joint], speeds[joint], N_SPEEDS)
    low, high = np.asarray(positions).T
    poses = low + (high - low) * np.random.default_rng(0).random((N_POSES, n))
    q = np.repeat(poses, N_SPEEDS, axis=0)
    dq = np.zeros_like(q)
    dq[:, joint] = np.tile(speed, N_POSES)
    still = model.with_torque_delay(0.0)
    _, parts, _ = still.evaluate(q, dq, np.zeros_like(q), step=model.step or 1e-3, temperature=_temperature(model, q))
    torque: FloatArray = parts[:, [1 + k for k in terms], joint].sum(axis=1)  # the first term is the rigid body
    return speed, torque.reshape(N_POSES, N_SPEEDS)


def is_curve(effect: _core.Effect) -> bool:
    """Whether an effect is friction that the state alone tells: a curve over speed."""
    return _is_friction(effect) and not effect.has_memory


def _is_friction(effect: _core.Effect) -> bool:
    return effect.kind == "stribeck" or any(word in effect.kind for word in ("friction", "hysteresis"))


def _remembering(model: _core.TorqueModel) -> list[str]:
    kinds = [e.kind for e, own in model.effects if _is_friction(e) and e.has_memory and np.any(own)]
    return [kind_words(kind) for kind in dict.fromkeys(kinds)]


def _effects(model: _core.TorqueModel) -> list[_core.Effect]:
    return [effect for effect, _ in model.effects]


def _temperature(model: _core.TorqueModel, q: FloatArray) -> FloatArray | None:
    """The temperature that friction is declared at, where it follows one."""
    for effect in _effects(model):
        if "temperature" in effect.signals:
            reference: FloatArray = np.broadcast_to(np.asarray(dict(effect.shape)["reference_temperature"]), q.shape)
            return reference.copy()
    return None


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
