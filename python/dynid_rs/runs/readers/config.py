"""What `dynid.toml` says: how the columns of somebody's files become signals in SI on the link side.

`config_file.py` reads it, `keys.py` has the list of its keys, and docs/reference/dynid_toml.md is made of that.

```toml
[columns]                          # any signal; names not given here keep their defaults
t = "timestamp"
q = "actual_q_{i}"                 # {i}: joint from 0, {n}: from 1, {joint}: its URDF name
tau = ["m_base", "m_elbow"]        # or one column per joint, in chain order
dq = false                         # do not read

[units]                            # of the file
time = "ms"
angle = "deg"

[drive]
gain = [14.9, 13.3]                # N m/A at the joint: currents become torques

[gear]
ratio = [101.0, 101.0]             # motor turns per joint turn; left out: those of the robot's file
apply_to = ["q_motor", "dq_motor"] # signals that the file gives on the motor side; also ddq_motor, tau, and q, dq, ddq
                                   # of an only encoder; left out where ratio is given: q_motor, dq_motor, ddq_motor

[motor]
rotor_inertia = [1.2, 0.9]         # kg m^2 on the link side: the rotor's own times the gear ratio squared

[signs]                            # +1 or -1 per joint
q = [1, -1]                        # also dq, ddq
q_motor = [1, -1]                  # also dq_motor, ddq_motor
tau = [1, -1]                      # also current
```
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from dynid_rs.base.errors import DataError
from dynid_rs.runs.cells import TIME_UNITS

ColumnRule = str | tuple[str, ...] | None
"""A template, one name per joint, or None: do not read."""

SIGNALS = ("t", "q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor", "tau", "current", "q_reference", "temperature")

_STANDARD_GRAVITY = 9.80665
_POUND_FORCE = 0.45359237 * _STANDARD_GRAVITY
_FOOT = 0.3048
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": TIME_UNITS,
    "angle": {"rad": 1.0, "deg": math.pi / 180.0, "mrad": 1e-3, "rev": 2.0 * math.pi},
    "velocity": {
        "rad/s": 1.0,
        "deg/s": math.pi / 180.0,
        "rpm": math.pi / 30.0,
        "mrad/s": 1e-3,
        "rev/s": 2.0 * math.pi,
    },
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2},
    "torque": {
        "N*m": 1.0,
        "mN*m": 1e-3,
        "kN*m": 1e3,
        "N*cm": 1e-2,
        "lbf*ft": _POUND_FORCE * _FOOT,
        "lbf*in": _POUND_FORCE * _FOOT / 12.0,
        "kgf*m": _STANDARD_GRAVITY,
        "kgf*cm": _STANDARD_GRAVITY * 1e-2,
    },
    "current": {"A": 1.0, "mA": 1e-3},
}
"""Factor to SI of every unit that a file may use. Velocity follows the angle when it is not given."""

MOTOR_SIDE = ("q_motor", "dq_motor", "ddq_motor")
"""Signals that a gear ratio alone is applied to."""
GEARED = ("q", "dq", "ddq", *MOTOR_SIDE, "tau")
"""Signals that may be of the motor side: positions called `q` are, where the motor's encoder is the only one."""
SIGNED = ("q", "q_motor", "tau")

PerJoint = tuple[float, ...]


@dataclass(frozen=True)
class Config:
    """What `dynid.toml` says; every field may be left out.

    Parameters
    ----------
    columns : mapping of str to str, tuple of str or None
        Rules that replace the default names of a signal.
    units : mapping of str to str
        Units of the file.
    drive_gain : tuple of float, optional
        Torque at the joint per ampere [N m/A]; one number for all joints or one per joint.
    gear_ratio : tuple of float, optional
        Motor turns per joint turn; one number for all joints or one per joint. None: the columns are on the link
        side already, unless `gear_of_robot` says otherwise.
    gear_apply_to : tuple of str
        Signals that the file gives on the motor side.
    rotor_inertia : tuple of float, optional
        Rotor inertia on the link side [kg m^2]; one number for all joints or one per joint.
    gear_of_robot : bool
        `gear_apply_to` stands in the file without a ratio: the robot's own gear ratios count.
    signs : mapping of str to tuple of float
        +1 or -1 per joint for ``"q"``, ``"q_motor"``, ``"tau"``.
    topic : str, optional
        Topic of a bag's `sensor_msgs/JointState`, where it holds several.
    sheet : str, optional
        Sheet of a workbook, where it is not the first with a run.
    base, tip : str, optional
        First and last link of the chain, where the robot's file leaves a choice.
    gravity : tuple of float, optional
        Free fall in the base frame [m/s^2].
    joints : tuple of str, optional
        Joints of the chain that the rules were written for, in its order; a robot with others is refused.
    source : str
        File name for messages.
    """

    columns: Mapping[str, ColumnRule] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    drive_gain: PerJoint | None = None
    gear_ratio: PerJoint | None = None
    gear_apply_to: tuple[str, ...] = MOTOR_SIDE
    rotor_inertia: PerJoint | None = None
    gear_of_robot: bool = False
    signs: Mapping[str, PerJoint] = field(default_factory=dict)
    topic: str | None = None
    sheet: str | None = None
    base: str | None = None
    tip: str | None = None
    gravity: PerJoint | None = None
    joints: tuple[str, ...] | None = None
    source: str = "dynid.toml"

    def factor(self, quantity: str) -> float:
        """Factor from the unit of the file to SI."""
        if quantity == "velocity" and "velocity" not in self.units:
            quantity = "angle"
        return UNITS[quantity][self.unit(quantity)]

    def unit(self, quantity: str) -> str:
        """Unit of the file."""
        return self.units.get(quantity, next(iter(UNITS[quantity])))

    def with_gears(self, ratios: Iterable[float] | None) -> Config:
        """Return these rules with the robot's gear ratios (NaN: unknown), if the file left them to the robot.

        Raises
        ------
        DataError
            The file left them to a robot that does not know them all.
        """
        if not self.gear_of_robot:
            return self
        known = () if ratios is None else tuple(float(ratio) for ratio in ratios)
        if not known or any(math.isnan(ratio) for ratio in known):
            raise DataError(
                f"{self.source}, [gear] apply_to: needs ratio beside it, because no robot is given whose file declares "
                "gear_ratio for every joint",
                code="bad_config",
                file=self.source,
                column="[gear] apply_to",
            )
        return replace(self, gear_ratio=known, gear_of_robot=False)
