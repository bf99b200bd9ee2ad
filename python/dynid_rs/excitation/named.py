"""Effects by name: `KIND[:JOINT[,PARTNER][:SHAPE=VALUE...]]`, e.g. `stribeck:elbow_joint:stribeck_velocity=0.1`."""

from __future__ import annotations

import difflib
import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from dynid_rs.base.wording import ANOTHER_FUNCTION
from dynid_rs.model.placed import CATALOGUE

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel

TILT = "gravity_tilt"
"""Not a column of one joint, but a torque all the same: gravity from another side."""
COLUMN_KINDS = tuple(kind for kind, entry in CATALOGUE.items() if not entry["declared"])
OTHERS = (
    "thermal_friction",
    "temperature_friction",
    "gear_hysteresis",
    "joint_elasticity",
    "nonlinear_elasticity",
    "backlash",
    "payload",
    "torque_gain",
    "torque_delay",
    "encoder_delay",
    "encoder_eccentricity",
    "kinematic_error",
    "contact",
    "unknown",
)
"""Kinds that a diagnosis may name and that no trajectory is designed for here."""


@dataclass(frozen=True)
class NamedEffect:
    """A kind at its joints, with those of its shape parameters that are known.

    Parameters
    ----------
    kind : str
        One of `COLUMN_KINDS`, or `TILT`.
    joints : tuple of int
        Where it acts: one joint, two of a pair, all for `TILT`.
    shape : mapping of str to float
        Shape parameters that are given; the others are searched over their grid.
    """

    kind: str
    joints: tuple[int, ...]
    shape: Mapping[str, float] = field(default_factory=dict)

    def text(self, joint_names: Sequence[str]) -> str:
        """As the command line takes it."""
        parts = [self.kind]
        if self.kind != TILT:
            parts.append(",".join(joint_names[j] for j in self.joints))
        return ":".join([*parts, *(f"{name}={value:.6g}" for name, value in self.shape.items())])


def is_separable(kind: str) -> bool:
    """Whether `dynid excite --separate` can design for it."""
    return kind == TILT or (kind in COLUMN_KINDS and kind not in OTHERS)


def separate_command(a: NamedEffect, b: NamedEffect, joint_names: Sequence[str]) -> str:
    """Command that designs a trajectory to tell two effects apart; empty where there is none for them.

    It can be typed as it is: joints whose names `parse_effect` would cut are there by index.
    """
    if not (is_separable(a.kind) and is_separable(b.kind)):
        return ""
    named = [name if not {",", ":"} & set(name) else str(j) for j, name in enumerate(joint_names)]
    return f"dynid excite ROBOT -o separate.csv --separate {shlex.join([a.text(named), b.text(named)])}"


def parse_effect(text: str, robot: RobotModel) -> NamedEffect:
    """Read an effect by name.

    Raises
    ------
    ValueError
        The kind is not one that a trajectory can be designed for, the joint is not there, or a shape parameter is
        not known or not a number in its range; one sentence.
    """
    kind, *rest = text.split(":")
    _check_kind(kind, text)
    if kind == TILT:
        if rest:
            raise ValueError(f"--separate {text}: a tilted base acts on all joints; write {TILT} alone")
        return NamedEffect(kind, tuple(range(robot.n_joints)))
    if not rest or not rest[0]:
        raise ValueError(f"--separate {text}: name the joint, as in {kind}:{robot.joint_names[0]}")
    paired = any(parameter["name"] == "partner" for parameter in CATALOGUE[kind]["shape"])
    joints = tuple(_joint(name, text, robot) for name in rest[0].split(","))
    if len(joints) != (2 if paired else 1) or len(set(joints)) != len(joints):
        wanted = "two joints of a pair, as in 4,5" if paired else "one joint"
        raise ValueError(f"--separate {text}: {kind} acts on {wanted}, found {rest[0]}")
    shape = dict(_parameter(part, kind, text) for part in rest[1:])
    return NamedEffect(kind, joints, shape)


def _check_kind(kind: str, text: str) -> None:
    if is_separable(kind):
        return
    if kind == ANOTHER_FUNCTION:
        raise ValueError(
            f"--separate {text}: what is no law is not simulated; `dynid excite ROBOT -o next.csv --after RESULT` "
            "designs motion beyond the positions that the runs of that diagnosis have shown"
        )
    known = (*(k for k in COLUMN_KINDS if is_separable(k)), TILT)
    if kind in CATALOGUE and kind not in OTHERS:
        raise ValueError(f"--separate {text}: {kind} is part of every model; name one of {', '.join(known)}")
    if kind in OTHERS:
        raise ValueError(
            f"--separate {text}: no motion of some seconds is designed for {kind}, which takes other sensors, loads or "
            f"minutes to tell; name one of {', '.join(known)}"
        )
    close = difflib.get_close_matches(kind, known, n=1)
    hint = f"did you mean {close[0]}?" if close else f"name one of {', '.join(known)}"
    raise ValueError(f"--separate {text}: {kind!r} is not a kind of effect; {hint}")


def _joint(name: str, text: str, robot: RobotModel) -> int:
    names = list(robot.joint_names)
    if name in names:
        return names.index(name)
    if name.isdecimal() and int(name) < len(names):
        return int(name)
    raise ValueError(
        f"--separate {text}: {name!r} is no joint of {robot.name}; expected one of {', '.join(names)}, "
        f"or an index from 0 to {len(names) - 1}"
    )


def _parameter(part: str, kind: str, text: str) -> tuple[str, float]:
    names = [entry["name"] for entry in CATALOGUE[kind]["shape"] if entry["name"] != "partner"]
    name, sign, value = part.partition("=")
    if name not in names or not sign:
        expected = ", ".join(f"{known}=..." for known in names) or "none"
        raise ValueError(f"--separate {text}: {part!r} is no shape parameter of {kind}; expected {expected}")
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"--separate {text}: {name} must be a finite number, found {value!r}")
    return name, number
