"""Kinds of effects that are columns of the compiled core: shapes and coefficients at size 1."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid_rs.simulation.effects.base import LabEffect, at_joints
from dynid_rs.simulation.effects.columns import column_effect
from dynid_rs.simulation.effects.site import Site

FloatArray = NDArray[np.float64]
Joints = tuple[int, ...]

STRIBECK, STRIBECK_SPEED = 0.03, 0.05
LOAD_FRICTION, LOAD_FRICTION_SPEED = 0.06, 0.02
BEARING_FRICTION = 0.04
POSITION_FRICTION = (0.02, 0.01)
POSITION_CYCLES = 1.0
HYSTERESIS, PRESLIDING, LOAD_HYSTERESIS = 0.03, 1e-2, 0.06
COUPLED, RATIO = 0.03, 1.0
RIPPLE = (0.010, 0.005, 0.003, 0.002)
RIPPLE_CYCLES = 16.0
INERTIAL_COUPLING = 0.3
SPRING = 0.1
COUNTERBALANCE = 0.3
SATURATION = 0.05
WARMING, WARM_UP = 0.3, 60.0

_PHASES = np.linspace(-np.pi, np.pi, 24, endpoint=False)
_NO_PARTNER = -1.0


def stribeck(site: Site, joints: Joints, size: float) -> LabEffect:
    """Friction that falls with speed."""
    height = at_joints(joints, site.n_joints, STRIBECK * size * site.effort)
    shape = {
        "stribeck_velocity": STRIBECK_SPEED * site.limits.velocity,
        "exponent": np.ones(site.n_joints),
        "transition_width": site.arm.transition_width,
    }
    return column_effect("stribeck", joints, size, shape, {"stribeck_pos": height, "stribeck_neg": height})


def load_dependent_friction(site: Site, joints: Joints, size: float) -> LabEffect:
    """Friction that grows with what the gear carries."""
    coefficients = {
        "load_friction": at_joints(joints, site.n_joints, LOAD_FRICTION * size),
        "load_friction_speed": at_joints(joints, site.n_joints, LOAD_FRICTION_SPEED * size / site.limits.velocity),
    }
    shape = {"transition_width": site.arm.transition_width}
    return column_effect("load_dependent_friction", joints, size, shape, coefficients)


def bearing_friction(site: Site, joints: Joints, size: float) -> LabEffect:
    """Friction that grows with what the joint behind carries, of the last joint the one before it."""
    coefficients = {"bearing_friction": at_joints(joints, site.n_joints, BEARING_FRICTION * size)}
    side = np.ones(site.n_joints)
    side[-1] = -1.0
    shape = {"side": side, "transition_width": site.arm.transition_width}
    return column_effect("bearing_friction", joints, size, shape, coefficients)


def position_dependent_friction(site: Site, joints: Joints, size: float) -> LabEffect:
    """Friction that changes around the turn."""
    cosine, sine = (at_joints(joints, site.n_joints, share * size * site.effort) for share in POSITION_FRICTION)
    shape = {
        "cycles": np.full(site.n_joints, POSITION_CYCLES),
        "transition_width": site.arm.transition_width,
    }
    coefficients = {"position_friction_cos": cosine, "position_friction_sin": sine}
    return column_effect("position_dependent_friction", joints, size, shape, coefficients)


def friction_hysteresis(site: Site, joints: Joints, size: float) -> LabEffect:
    """Friction that turns round over a way, not at once."""
    shape = {"presliding_distance": np.full(site.n_joints, PRESLIDING)}
    coefficients = {"hysteresis": at_joints(joints, site.n_joints, HYSTERESIS * size * site.effort)}
    return column_effect("friction_hysteresis", joints, size, shape, coefficients)


def load_hysteresis(site: Site, joints: Joints, size: float) -> LabEffect:
    """Friction that turns round over a way and grows with the load."""
    shape = {"presliding_distance": np.full(site.n_joints, PRESLIDING)}
    coefficients = {"load_hysteresis": at_joints(joints, site.n_joints, LOAD_HYSTERESIS * size)}
    return column_effect("load_hysteresis", joints, size, shape, coefficients)


def coupled_friction(site: Site, joints: Joints, size: float) -> LabEffect:
    """A gear stage that two joints turn."""
    level = COUPLED * size * float(site.effort[list(joints)].min())
    shape = {
        "partner": _partners(site, joints),
        "ratio": np.full(site.n_joints, RATIO),
        "transition_width": np.full(site.n_joints, float(site.arm.transition_width[list(joints)].max())),
    }
    coefficients = {
        "coupled_friction": at_joints(joints, site.n_joints, level),
        "coupled_viscous": np.zeros(site.n_joints),
    }
    return column_effect("coupled_friction", joints, size, shape, coefficients)


def torque_ripple(site: Site, joints: Joints, size: float) -> LabEffect:
    """Ripple of gear teeth."""
    names = ("ripple_cos1", "ripple_sin1", "ripple_cos2", "ripple_sin2")
    coefficients = {
        name: at_joints(joints, site.n_joints, share * size * site.effort)
        for name, share in zip(names, RIPPLE, strict=True)
    }
    shape = {"cycles": np.full(site.n_joints, RIPPLE_CYCLES)}
    return column_effect("torque_ripple", joints, size, shape, coefficients)


def inertial_coupling(site: Site, joints: Joints, size: float) -> LabEffect:
    """Two motors that feel each other; their kinetic energy stays positive below a size of 3."""
    one, other = joints
    level = INERTIAL_COUPLING * size * float(np.sqrt(site.arm.rotor_inertia[one] * site.arm.rotor_inertia[other]))
    if abs(INERTIAL_COUPLING * size) >= 1:
        raise ValueError(
            f"inertial_coupling of size {size:g} would give two rotors a negative energy; "
            f"take less than {1 / INERTIAL_COUPLING:.3g}"
        )
    coefficients = {"inertial_coupling": at_joints(joints, site.n_joints, level)}
    return column_effect("inertial_coupling", joints, size, {"partner": _partners(site, joints)}, coefficients)


def joint_spring(site: Site, joints: Joints, size: float) -> LabEffect:
    """A spring about the middle of the range."""
    shape = {"rest_position": (site.limits.lower + site.limits.upper) / 2}
    coefficients = {"spring_stiffness": at_joints(joints, site.n_joints, SPRING * size * site.effort)}
    return column_effect("joint_spring", joints, size, shape, coefficients)


def counterbalance(site: Site, joints: Joints, size: float) -> LabEffect:
    """A gas cylinder, mounted so that it carries as much of gravity's load as it can."""
    n, q = site.n_joints, site.poses
    still = np.zeros_like(q)
    load = site.arm.robot.inverse_dynamics(q, still, still, site.arm.phi)

    def built(phase: FloatArray, level: FloatArray) -> LabEffect:
        shape = {"a": np.ones(n), "b": np.full(n, 0.25), "phase": phase, "gas_length": np.full(n, 1.25)}
        coefficients = {"counterbalance": at_joints(joints, n, level)}
        return column_effect("counterbalance", joints, size, shape, coefficients)

    def torque(phase: FloatArray) -> FloatArray:
        unit = built(phase, np.ones(n)).link_torque(site.arm, np.zeros(len(q)), q)
        return np.zeros_like(q) if unit is None else unit

    carried = [-np.mean(torque(np.full(n, phase)) * load, axis=0) for phase in _PHASES]
    phase = _PHASES[np.argmax(carried, axis=0)]
    most = np.maximum(np.abs(torque(phase)).max(axis=0), 1e-12)
    return built(phase, COUNTERBALANCE * size * site.effort / most)


def torque_saturation(site: Site, joints: Joints, size: float) -> LabEffect:
    """A torque constant that droops."""
    coefficients = {"saturation": at_joints(joints, site.n_joints, SATURATION * size / site.effort**2)}
    return column_effect("torque_saturation", joints, size, {}, coefficients)


def thermal_friction(site: Site, joints: Joints, size: float) -> LabEffect:
    """Friction that falls while a run goes on; every run starts cold."""
    friction = site.arm.friction
    coefficients = {
        "warm_coulomb": at_joints(joints, site.n_joints, -WARMING * size * friction[:, :2].mean(axis=1)),
        "warm_viscous": at_joints(joints, site.n_joints, -WARMING * size * friction[:, 2:4].mean(axis=1)),
    }
    shape = {
        "time_constant": np.full(site.n_joints, WARM_UP),
        "reference_speed": np.zeros(site.n_joints),
        "transition_width": site.arm.transition_width,
    }
    return column_effect("thermal_friction", joints, size, shape, coefficients)


def _partners(site: Site, joints: Joints) -> FloatArray:
    partners = np.full(site.n_joints, _NO_PARTNER)
    one, other = joints
    partners[one], partners[other] = other, one
    return partners
