"""Columns of an effect over all its shapes at once, along a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.excitation.named import TILT, NamedEffect
from dynid_rs.model.placed import CATALOGUE
from dynid_rs.runs.preprocessing import is_of_load

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel
    from dynid_rs.excitation.constraints import Motion

FloatArray = NDArray[np.float64]
Shape = dict[str, float]

TILT_STEP = 1e-3
"""Angle [rad] of the tilt's columns; the torque is linear in gravity, so that any small one will do."""


@dataclass(frozen=True, eq=False)
class ShapedEffect:
    """A named effect with every shape that it may have; the first one stands for the effect itself.

    Parameters
    ----------
    robot : RobotModel
        The arm.
    effect : NamedEffect
        Kind, joints and given shape parameters.
    shapes : list of dict
        Shape parameters by name; a kind without any has one empty shape.
    """

    robot: RobotModel
    effect: NamedEffect
    shapes: list[Shape]

    @classmethod
    def of(cls, effect: NamedEffect, robot: RobotModel) -> ShapedEffect:
        """All shapes of the catalogue's grid, the given one (its gaps filled from the middle of the grid) first.

        Raises
        ------
        ValueError
            The effect needs the links' inertials, which the robot file does not declare; or a given shape is out of
            its range.
        """
        signals = [] if effect.kind == TILT else CATALOGUE[effect.kind]["signals"]
        if (effect.kind == TILT or is_of_load(signals)) and not np.any(robot.phi):
            raise ValueError(
                f"--separate {effect.kind}: acts through the links' load, and {robot.name} declares no inertials; "
                "add them to the robot file"
            )
        if effect.kind == TILT:
            return cls(robot, effect, [{}])
        grids = _grids(effect, robot)
        middle = {name: effect.shape.get(name, grid[len(grid) // 2]) for name, grid in grids.items()}
        every = [dict(zip(grids, values, strict=True)) for values in product(*grids.values())]
        shaped = cls(robot, effect, [middle])
        try:
            shaped._core_effect([middle], effect.joints[0])
        except ValueError as error:
            text = str(error).replace(" of joint 0", "")  # the core counts shapes as joints here
            raise ValueError(f"--separate {effect.text(robot.joint_names)}: {text}") from None
        others = (shape for shape in every if shape != middle)
        return cls(robot, effect, [middle, *(shape for shape in others if shaped._exists(shape))])

    def columns(self, motion: Motion, chosen: Sequence[int], step: float) -> dict[int, FloatArray]:
        """Per joint (n_samples, len(chosen), n_columns): torque per unit coefficient under the `chosen` shapes.

        Those of a pair are the first joint's; the second feels them as its partner (`Effect.reaction`).
        """
        if self.effect.kind == TILT:
            return self._tilt(motion)
        predicted = self._predicted(motion) if is_of_load(CATALOGUE[self.effect.kind]["signals"]) else {}
        shapes = [self.shapes[k] for k in chosen]
        n_pairs = len(self.effect.joints)
        if "side" in shapes[0]:
            return self._of_neighbours(motion, shapes, predicted["tau_link"], step)
        found = {}
        for place, joint in enumerate(self.effect.joints):
            signals = [np.repeat(x[:, [joint]], len(shapes), axis=1) for x in motion]
            loads = {name: np.repeat(tau[:, [joint]], len(shapes), axis=1) for name, tau in predicted.items()}
            if n_pairs == 2:  # the partner stands behind the copies
                partner = self.effect.joints[1 - place]
                signals = [np.column_stack([s, x[:, partner]]) for s, x in zip(signals, motion, strict=True)]
                loads = {name: np.column_stack([tau, predicted[name][:, partner]]) for name, tau in loads.items()}
            effect = self._core_effect(shapes, joint)
            q, dq, ddq = signals
            tau_link, tau_motor = loads.get("tau_link"), loads.get("tau_motor")
            columns = _core.effect_columns(effect, q, dq, ddq, tau_link=tau_link, tau_motor=tau_motor, step=step)
            found[joint] = columns[:, : len(shapes)]
            if place == 1:
                found[joint] = found[joint] * self._felt(shapes)
        return found

    def _of_neighbours(
        self, motion: Motion, shapes: Sequence[Shape], tau_link: FloatArray, step: float
    ) -> dict[int, FloatArray]:
        """Columns that read the load of the joints beside: each copy of the joint stands between copies of them."""
        (joint,) = self.effect.joints
        around = np.pad(tau_link, [(0, 0), (1, 1)])[:, joint : joint + 3]
        q, dq, ddq = (np.repeat(x[:, [joint]], 3 * len(shapes), axis=1) for x in motion)
        effect = self._core_effect([shape for shape in shapes for _ in range(3)], joint)
        loads = np.tile(around, (1, len(shapes)))
        return {joint: _core.effect_columns(effect, q, dq, ddq, tau_link=loads, step=step)[:, 1::3]}

    def _felt(self, shapes: Sequence[Shape]) -> FloatArray:
        """Coefficients (n_shapes, n_columns) on the second joint of a pair over those on the first."""
        first = self._core_effect(shapes, self.effect.joints[0])
        return np.array([reaction[1] for k in range(len(shapes)) if (reaction := first.reaction(k))])

    def _predicted(self, motion: Motion) -> dict[str, FloatArray]:
        """Torques that effects of the load are made of, as far as the robot file tells them: friction it does not."""
        terms = [(_core.Effect.rotor_inertia(), self.robot.rotor_inertia[:, None])]
        tau_link = self.robot.inverse_dynamics(*motion)
        return {
            "tau_link": tau_link,
            "tau_motor": _core.motor_torque(terms, np.ones(len(terms[0][1])), *motion, tau_link=tau_link),
        }

    def _exists(self, shape: Shape) -> bool:
        """Whether the parameters fit each other."""
        try:
            self._core_effect([shape], self.effect.joints[0])
        except ValueError:
            return False
        return True

    def _core_effect(self, shapes: Sequence[Shape], joint: int) -> _core.Effect:
        """One effect whose "joints" are the shapes; for a pair, one more for the partner's signals."""
        paired = len(self.effect.joints) == 2
        values = {}
        for name in shapes[0]:
            mirrored = paired and joint == self.effect.joints[1]
            row = [_mirrored(name, shape) if mirrored else shape[name] for shape in shapes]
            values[name] = np.array([*row, row[0]] if paired else row)
        if paired:
            values["partner"] = np.array([float(len(shapes))] * len(shapes) + [-1.0])
        return _core.Effect.of(self.effect.kind, **values)

    def _tilt(self, motion: Motion) -> dict[int, FloatArray]:
        """Torque per radian of roll and pitch of the base, on every joint."""
        gravity, level = self.robot.gravity, self.robot.inverse_dynamics(*motion)
        turned = [
            self.robot.with_gravity((gravity + TILT_STEP * np.cross(axis, gravity)).tolist())
            for axis in np.eye(3)[_across(gravity)]
        ]
        columns = np.stack([(robot.inverse_dynamics(*motion) - level) / TILT_STEP for robot in turned], axis=2)
        return {j: columns[:, j, None, :] for j in range(self.robot.n_joints)}


def _across(gravity: FloatArray) -> list[int]:
    """Two of the base's axes about which it can be tilted: those least along gravity."""
    return sorted(np.argsort(np.abs(gravity))[:2].tolist())


def _grids(effect: NamedEffect, robot: RobotModel) -> dict[str, list[float]]:
    """Values of every shape parameter: those of the catalogue, and the given one."""
    grids = {}
    for parameter in CATALOGUE[effect.kind]["shape"]:
        name = parameter["name"]
        if name == "partner":
            continue
        values = [float(value) for value in parameter["grid"]]
        if parameter["relative_to"] == "chain":
            values = _sides(effect, values, robot)
        if name in effect.shape and effect.shape[name] not in values:
            values.append(effect.shape[name])
        grids[name] = values
    return grids


def _sides(effect: NamedEffect, sides: list[float], robot: RobotModel) -> list[float]:
    """Those of the sides on which there is a joint; one that is asked for and has none is refused, and so is none."""
    (joint,), given = effect.joints, effect.shape.get("side")
    there = [side for side in sides if 0 <= joint + side < robot.n_joints]
    if not there or (given in sides and given not in there):
        where = {-1.0: "before", 1.0: "behind"}.get(given or 0.0, "beside")
        names = robot.joint_names
        raise ValueError(f"--separate {effect.text(names)}: there is no joint {where} {names[joint]}")
    return there


def _mirrored(name: str, shape: Shape) -> float:
    """Shape parameter of a pair's second joint: what moves with v_j + r v_k moves with v_k + v_j / r."""
    ratio = shape.get("ratio")
    if ratio is None or ratio == 0:
        return shape[name]
    return {"ratio": 1 / ratio, "transition_width": shape.get("transition_width", 0.0) / abs(ratio)}.get(
        name, shape[name]
    )
