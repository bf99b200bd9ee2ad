"""Chains of bodies that turn or slide, as text for tests that need other arms than the usual ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import dynid_rs as dyn


def chain(links: Sequence[tuple[Any, ...]], joints: Sequence[tuple[Any, ...]]) -> dyn.RobotModel:
    """The robot of a base and these bodies.

    `links`: name, mass [kg], how far out its centre is [m], inertia about it [kg m^2]; `joints`: name, type, parent,
    child, axis, how far out it is [m], and symmetric limits of position, effort and velocity.
    """
    text = "".join(
        f'<link name="{name}"><inertial><origin xyz="{x} 0 0"/><mass value="{kg}"/>'
        f'<inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial></link>'
        for name, kg, x, i in links
    ) + "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
        f'<origin xyz="{x} 0 0"/><limit lower="{-most}" upper="{most}" effort="{effort}" velocity="{speed}"/></joint>'
        for name, kind, parent, child, axis, x, most, effort, speed in joints
    )
    return dyn.RobotModel.from_urdf_string(f'<robot name="chain"><link name="base"/>{text}</robot>')
