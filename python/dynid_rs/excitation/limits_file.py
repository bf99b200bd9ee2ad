"""`limits.toml`: what an arm may do while it is excited.

```toml
[units]
angle = "deg"                       # or "rad" (default); also length = "mm", torque = "kN*m"

[position]                          # left out: the robot's own limits
lower = [-120, -90, -60]            # a list in chain order, ...
upper = 120                         # ... one number for all joints, ...

[velocity]                          # left out: the robot's own limits
limit = {shoulder = 100, elbow = 60} # ... or by joint name; joints not named keep the robot's own

[acceleration]                      # no URDF says it (a robot.toml may), so this one must be there for every joint
limit = 120                         # limit: the same in both directions; or lower and upper

[torque]                            # left out, joints too: the robot's effort limits, where they hold the arm
limit = [150, 150, 60]              # N*m (N for sliding joints) of the links, friction not counted

[start]
position = [0, 0, 0]                # left out: zero, or the middle of the limits where zero is outside

[workspace]                         # box in the base frame for the origins of the link frames
lower = [-1.5, -1.5, 0.05]
upper = [1.5, 1.5, 2.0]
links = ["wrist_3_link"]            # only these; left out: all that move
tool = [0, 0, 0.15]                 # one more point, in the frame of the last link

[collision]                         # links keep away from each other; needs the extra [collision]
margin = 0.02
ignored = [["base_link", "forearm_link"]]
package_dirs = []
```

Angles per second and per second squared follow `angle`; positions of sliding joints follow `length`.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import file_name, shown, shown_value
from dynid_rs.base.toml import read_toml
from dynid_rs.excitation.collision import SelfCollision
from dynid_rs.excitation.constraints import PhysicalLimits
from dynid_rs.excitation.limits import MOTIONS, ExcitationLimits, fault
from dynid_rs.excitation.workspace import WorkspaceBox
from dynid_rs.runs.readers.config import UNITS

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel

FloatArray = NDArray[np.float64]

BEYOND = 0.05
"""Limits may exceed the robot file's by this part of its span: degrees are rounded."""
QUANTITIES = ("angle", "length", "torque")
TABLES: Mapping[str, tuple[str, ...]] = {
    "units": QUANTITIES,
    "position": ("limit", "lower", "upper"),
    "velocity": ("limit", "lower", "upper"),
    "acceleration": ("limit", "lower", "upper"),
    "torque": ("limit", "lower", "upper"),
    "start": ("position",),
    "workspace": ("lower", "upper", "links", "tool"),
    "collision": ("margin", "ignored", "package_dirs"),
}


@dataclass(frozen=True, eq=False)
class LimitsFile:
    """What a `limits.toml` says.

    Parameters
    ----------
    limits : ExcitationLimits
        In SI units.
    start : ndarray (n_joints,), optional
        [rad, m].
    constraints : tuple
        Workspace and self-collision, where the file has them.
    """

    limits: ExcitationLimits
    start: FloatArray | None
    constraints: tuple[PhysicalLimits, ...]


def read_limits(path: str | Path, robot: RobotModel, urdf: str | Path | None = None) -> LimitsFile:
    """Read a `limits.toml` for `robot`; `urdf` is where its collision shapes are.

    Raises
    ------
    DataError
        Not TOML, a key, joint or unit that is not known, a value of the wrong kind, a limit that is missing or turned
        round; names file and key.
    OSError
        The file cannot be opened.
    """
    return _Parser(file_name(path), robot, read_toml(path, "bad_limits")).parse(urdf)


@dataclass(frozen=True)
class _Parser:
    file: str
    robot: RobotModel
    content: dict[str, Any]

    def fault(self, key: str, text: str) -> DataError:
        return DataError(
            f"{self.file}, {shown(key, 60)}: {text}", code="bad_limits", file=self.file, column=shown(key, 60)
        )

    def known(self, key: str, name: str, names: Iterable[str], what: str) -> None:
        names = list(names)
        if name not in names:
            close = difflib.get_close_matches(name, names, n=1)
            hint = f"did you mean {close[0]}?" if close else f"expected one of {', '.join(names)}"
            raise self.fault(key, f"this {what} is not known; {hint}")

    def parse(self, urdf: str | Path | None) -> LimitsFile:
        for name, table in self.content.items():
            self.known(f"[{name}]", name, TABLES, "table")
            if not isinstance(table, dict):
                raise self.fault(name, f"expected a table [{name}], got {_kind(table)}")
            for key in table:
                self.known(f"{name}.{key}", key, TABLES[name], "key")
        for quantity, unit in self.content.get("units", {}).items():
            if not isinstance(unit, str) or unit not in UNITS[quantity]:
                choices = ", ".join(UNITS[quantity])
                raise self.fault(
                    f"units.{quantity}", f"the unit {shown_value(unit)} is not known; choose one of {choices}"
                )
        position, velocity, acceleration = (self.motion(name) for name in MOTIONS)
        torque = self.sides("torque", np.full((2, self.n), np.nan))
        if torque is not None:
            self.check("torque", torque)
        limits = ExcitationLimits(position, velocity, acceleration, torque)
        return LimitsFile(limits, self.start(limits), tuple(self.constraints(urdf)))

    @property
    def n(self) -> int:
        return self.robot.n_joints

    def motion(self, name: str) -> FloatArray:
        """Limits (2, n) of one quantity; the robot's own where the file says nothing."""
        if name == "position":
            own = np.stack([np.asarray(self.robot.lower), np.asarray(self.robot.upper)])
        else:
            size = np.asarray(getattr(self.robot, f"{name}_limits"))
            size = np.where(size > 0, size, np.nan)  # else a placeholder
            own = np.stack([-size, size])
        own = np.where(np.isfinite(own), own, np.nan)
        found = self.sides(name, own)
        limits = own if found is None else found
        self.within_robot(name, limits, own)
        missing = np.flatnonzero(np.isnan(limits).any(axis=0))
        if missing.size:
            joint = shown(self.robot.joint_names[missing[0]])
            raise self.fault(
                f"[{name}]",
                f"no limit for joint {joint}, and the robot file gives none either; "
                f"add limit, or lower and upper, to [{name}]",
            )
        self.check(name, limits)
        return limits

    def check(self, name: str, limits: FloatArray) -> None:
        """Refuse limits (2, n) that are turned round, or leave no room for rest."""
        wrong = fault(name, limits, self.robot.joint_names)
        if wrong is not None:
            raise self.fault(f"[{name}]", wrong)

    def start(self, limits: ExcitationLimits) -> FloatArray | None:
        """Where the motion starts, if the file says so; refuses limits that hold no start."""
        said = self.content.get("start", {}).get("position")
        start = None if said is None else self.per_joint("start.position", said, np.zeros(self.n), "position")
        for key, wanted in (("[position]", None), ("start.position", start)):
            try:
                limits.start(wanted, self.robot.joint_names)
            except ValueError as error:
                raise self.fault(key, str(error)) from None
        return start

    def within_robot(self, name: str, limits: FloatArray, own: FloatArray) -> None:
        """Refuse limits (2, n) beyond the robot file's own: a slip of the unit, or a motion that breaks something."""
        room = BEYOND * (own[1] - own[0])
        beyond = (limits[0] < own[0] - room) | (limits[1] > own[1] + room)  # false where the file gives none
        for j in np.flatnonzero(beyond):
            raise self.fault(
                f"[{name}]",
                f"joint {shown(self.robot.joint_names[j])} may go from {limits[0, j]:.4g} to {limits[1, j]:.4g} here "
                f"and from {own[0, j]:.4g} to {own[1, j]:.4g} in the robot file (rad, m, s); is the unit degrees "
                '([units] angle = "deg")? Else keep within the robot file, or correct it',
            )

    def sides(self, name: str, own: FloatArray) -> FloatArray | None:
        """Lower and upper limits (2, n) of a table; None where the file has none."""
        table = self.content.get(name)
        if table is None:
            return None
        if "limit" in table:
            if len(table) > 1:
                raise self.fault(name, "limit is for both directions; give it alone, or lower and upper")
            size = self.per_joint(f"{name}.limit", table["limit"], np.full(self.n, np.nan), name)
            for j in np.flatnonzero(size <= 0):  # false where the file says nothing
                raise self.fault(
                    f"{name}.limit",
                    f"expected numbers above 0, for both directions, got {size[j] / self.factors(name)[j]:g} for joint "
                    f"{shown(self.robot.joint_names[j])}",
                )
            return np.where(np.isnan(size), own, np.stack([-size, size]))
        for key in ("lower", "upper"):
            if key not in table:
                raise self.fault(f"{name}.{key}", "is missing; give lower and upper, or limit for both directions")
        return np.stack(
            [self.per_joint(f"{name}.{side}", table[side], own[k], name) for k, side in enumerate(("lower", "upper"))]
        )

    def per_joint(self, key: str, value: Any, own: FloatArray, quantity: str) -> FloatArray:
        """Values (n,) in SI from one number, a list in chain order or a table by joint name."""
        names = self.robot.joint_names
        if isinstance(value, dict):
            for name in value:
                self.known(f"{key}.{name}", name, names, "joint")
            numbers = [value.get(name) for name in names]
        elif isinstance(value, list):
            if len(value) != self.n:
                raise self.fault(key, f"holds {len(value)} numbers, and the robot has {self.n} joints")
            numbers = value
        else:
            numbers = [value] * self.n
        for number in numbers:
            if number is not None and not _is_number(number):
                raise self.fault(key, f"expected numbers, got {_kind(number)}")
        factors = self.factors(quantity)
        return np.array([own[j] if x is None else x * factors[j] for j, x in enumerate(numbers)], dtype=np.float64)

    def factors(self, quantity: str) -> list[float]:
        """Factor to SI of every joint."""
        units = self.content.get("units", {})
        scale = {name: UNITS[name].get(units.get(name, ""), 1.0) for name in QUANTITIES}
        turning, sliding = ("torque", None) if quantity == "torque" else ("angle", "length")
        return [
            scale[turning] if kind == "revolute" else 1.0 if sliding is None else scale[sliding]
            for kind in self.robot.joint_kinds
        ]

    def constraints(self, urdf: str | Path | None) -> Iterable[PhysicalLimits]:
        box = self.content.get("workspace")
        if box is not None:
            length = UNITS["length"].get(self.content.get("units", {}).get("length", ""), 1.0)
            for key in ("lower", "upper"):
                if key not in box:
                    raise self.fault(f"workspace.{key}", "is missing; give lower and upper, x, y, z each")
            links = box.get("links")
            if links is not None:
                links = tuple(self.texts("workspace.links", links))
                for link in links:
                    self.known(f"workspace.links {link}", link, self.robot.link_names, "link")
            yield WorkspaceBox(
                lower=self.place("workspace.lower", box["lower"], length),
                upper=self.place("workspace.upper", box["upper"], length),
                links=links,
                tool=self.place("workspace.tool", box["tool"], length) if "tool" in box else None,
            )
        shapes = self.content.get("collision")
        if shapes is not None:
            if urdf is None:
                raise self.fault("[collision]", "needs the URDF with the collision shapes; leave this table out")
            margin = shapes.get("margin", SelfCollision.margin)
            if not _is_number(margin):
                raise self.fault("collision.margin", f"expected a distance, got {_kind(margin)}")
            length = UNITS["length"].get(self.content.get("units", {}).get("length", ""), 1.0)
            ignored, pairs = [], shapes.get("ignored", [])
            for pair in pairs if isinstance(pairs, list) else [pairs]:
                one_other = self.texts("collision.ignored", pair)
                if len(one_other) != 2:
                    raise self.fault("collision.ignored", 'expected pairs of links, [["link_a", "link_b"]]')
                ignored.append((one_other[0], one_other[1]))
            yield SelfCollision(
                urdf=urdf,
                margin=margin * (length if "margin" in shapes else 1.0),
                ignored=tuple(ignored),
                package_dirs=tuple(self.texts("collision.package_dirs", shapes.get("package_dirs", []))),
            )

    def texts(self, key: str, value: Any) -> list[str]:
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise self.fault(key, f"expected a list of names, got {_kind(value)}")
        return value

    def place(self, key: str, value: Any, length: float) -> tuple[float, float, float]:
        if not isinstance(value, list) or len(value) != 3 or not all(_is_number(x, infinite=True) for x in value):
            raise self.fault(key, "expected three numbers, x, y, z")
        x, y, z = (length * float(number) for number in value)
        return x, y, z


def _is_number(value: Any, *, infinite: bool = False) -> bool:
    good = isinstance(value, int | float) and not isinstance(value, bool) and not math.isnan(value)
    return good and (infinite or math.isfinite(value))


def _kind(value: Any) -> str:
    """Name what stands in a file."""
    return f"the text {shown(value)!r}" if isinstance(value, str) else shown(str(value))
