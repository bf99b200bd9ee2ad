"""Kinds of effects that are columns of the compiled core: default shapes and coefficients."""

from __future__ import annotations

import numpy as np

from dynid_rs.simulation.effects.base import LabEffect, at_joints
from dynid_rs.simulation.effects.columns import column_effect
from dynid_rs.simulation.effects.site import Site

Joints = tuple[int, ...]

STRIBECK = 0.03
STRIBECK_SPEED = 0.05
COUNTERBALANCE = 0.3


def stribeck(site: Site, joints: Joints, size: float) -> LabEffect:
    """Friction that falls with speed."""
    height = at_joints(joints, site.n_joints, STRIBECK * size * site.effort)
    shape = {
        "stribeck_velocity": STRIBECK_SPEED * site.limits.velocity,
        "exponent": np.ones(site.n_joints),
        "transition_width": site.arm.transition_width,
    }
    return column_effect("stribeck", joints, size, shape, {"stribeck_pos": height, "stribeck_neg": height})


def counterbalance(site: Site, joints: Joints, size: float) -> LabEffect:
    """A gas cylinder that carries a part of gravity's load."""
    n = site.n_joints
    shape = {"a": np.full(n, 1.0), "b": np.full(n, 0.25), "phase": np.full(n, 0.5), "gas_length": np.full(n, 1.25)}
    unit = column_effect("counterbalance", joints, 1.0, shape, {"counterbalance": at_joints(joints, n, 1.0)})
    q = site.poses
    torque = unit.link_torque(site.arm, np.zeros(len(q)), q)
    assert torque is not None
    most = np.maximum(np.abs(torque).max(axis=0), 1e-12)
    coefficient = at_joints(joints, n, COUNTERBALANCE * size * site.effort / most)
    return column_effect("counterbalance", joints, size, shape, {"counterbalance": coefficient})
