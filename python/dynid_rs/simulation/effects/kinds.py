"""Kinds of effects that are not columns: what each does at its default size, and how it is built."""

from __future__ import annotations

import numpy as np

from dynid_rs.simulation.effects.base import LabEffect, Value, at_joints
from dynid_rs.simulation.effects.gears import Backlash, JointElasticity, NonlinearElasticity
from dynid_rs.simulation.effects.outside import Contact
from dynid_rs.simulation.effects.sensors import EncoderDelay, EncoderEccentricity, TorqueDelay, TorqueGain
from dynid_rs.simulation.effects.site import Site
from dynid_rs.simulation.effects.structure import GravityTilt, KinematicError, Payload, box_parameters
from dynid_rs.simulation.effects.thermal import ThermalDrift

Joints = tuple[int, ...]

CUBIC_SHARE = 0.2
GAP = 3e-4
BACKLASH_WIDTH = 0.01
ROLL, PITCH = np.radians(2.0), np.radians(-1.5)
PAYLOAD_SHARE = 0.15
PAYLOAD_CENTRE = (0.02, -0.03, 0.08)
PAYLOAD_SIDES = (0.10, 0.16, 0.12)
OFFSET = (0.003, -0.002, 0.003)
TURN = (0.006, 0.006, -0.004)
GAIN = 0.05
TORQUE_DELAY = 0.005
ENCODER_DELAY = 0.0028
ECCENTRICITY = 1e-3
CONTACT_SHARE = 0.3
DRIFT, DRIFT_TIME = 0.3, 120.0

_MAX_DELAY = 0.1
_GRAVITY = 9.81


def joint_elasticity(site: Site, joints: Joints, size: float) -> LabEffect:
    """Gears of the typical arm, `size` times as soft."""
    from dataclasses import replace

    gears = replace(site.arm, stiffness=site.arm.stiffness / size)
    values = _of_gears(site, joints, size)
    return JointElasticity("joint_elasticity", joints, size, values, gears=gears)


def nonlinear_elasticity(site: Site, joints: Joints, size: float) -> LabEffect:
    """Elastic gears that grow stiffer with load (size > 0) or softer (size < 0)."""
    if size > 1.3:
        raise ValueError(
            f"nonlinear_elasticity of size {size:g} would let gears give way backwards below their effort limit; "
            "take at most 1.3"
        )
    elastic = np.isin(np.arange(site.n_joints), joints)
    linear = np.where(elastic, 1 / site.arm.stiffness, 0.0)
    cubic = -size * CUBIC_SHARE * linear / site.effort**2
    values = (*_of_gears(site, joints, 1.0), Value("cubic", cubic[list(joints)].tolist(), "rad/(N*m)^3"))
    return NonlinearElasticity("nonlinear_elasticity", joints, size, values, gears=site.arm, cubic=cubic)


def _of_gears(site: Site, joints: Joints, softness: float) -> tuple[Value, ...]:
    stiffness = site.arm.stiffness[list(joints)] / softness
    return (
        Value("stiffness", stiffness.tolist(), "N*m/rad"),
        Value("damping", site.arm.damping[list(joints)].tolist(), "N*m*s/rad"),
    )


def backlash(site: Site, joints: Joints, size: float) -> LabEffect:
    """A gap of one arc minute."""
    gap, width = at_joints(joints, site.n_joints, GAP * size), BACKLASH_WIDTH * site.effort
    values = (
        Value("gap", gap[list(joints)].tolist(), "rad"),
        Value("transition_torque", width[list(joints)].tolist(), "N*m"),
    )
    return Backlash("backlash", joints, size, values, gap=gap, width=width)


def gravity_tilt(site: Site, joints: Joints, size: float) -> LabEffect:
    """The base is not level."""
    if not np.any(site.arm.robot.gravity):
        raise ValueError("gravity_tilt needs gravity, and this robot has none")
    roll, pitch = float(ROLL * size), float(PITCH * size)
    values = (Value("roll", roll, "rad"), Value("pitch", pitch, "rad"))
    return GravityTilt("gravity_tilt", joints, size, values, roll=roll, pitch=pitch)


def payload(site: Site, joints: Joints, size: float) -> LabEffect:
    """A homogeneous box on the last link, whose weight takes a share of the effort limits."""
    mass = size * site.force_for(PAYLOAD_SHARE) / _GRAVITY
    parameters = box_parameters(mass, np.array(PAYLOAD_CENTRE), np.array(PAYLOAD_SIDES))
    values = (Value("parameters", parameters.tolist(), "kg, kg*m, kg*m^2"),)
    return Payload("payload", joints, size, values, parameters=parameters)


def kinematic_error(site: Site, joints: Joints, size: float) -> LabEffect:
    """The joint's frame is not where the file says."""
    x, y, z = (size * value for value in OFFSET)
    rx, ry, rz = (size * value for value in TURN)
    values = (Value("offset", [x, y, z], "m"), Value("turn", [rx, ry, rz], "rad"))
    return KinematicError("kinematic_error", joints, size, values, offset=(x, y, z), turn=(rx, ry, rz))


def torque_gain(site: Site, joints: Joints, size: float) -> LabEffect:
    """The torque channel shows too much."""
    if GAIN * size <= -1:
        raise ValueError(f"torque_gain of size {size:g} would turn the torque's sign; take more than {-1 / GAIN:g}")
    gain = at_joints(joints, site.n_joints, GAIN * size)
    values = (Value("gain", gain[list(joints)].tolist(), "1"),)
    return TorqueGain("torque_gain", joints, size, values, gain=gain)


def torque_delay(site: Site, joints: Joints, size: float) -> LabEffect:
    """The torque channel is late."""
    delay = _delay("torque_delay", TORQUE_DELAY, size)
    values = (Value("delay", delay, "s"),)
    return TorqueDelay("torque_delay", joints, size, values, delays=at_joints(joints, site.n_joints, delay))


def encoder_delay(site: Site, joints: Joints, size: float) -> LabEffect:
    """The link channel is later than the motor channel; a negative size makes it earlier."""
    delay = _delay("encoder_delay", ENCODER_DELAY, size)
    return EncoderDelay("encoder_delay", joints, size, (Value("delay", delay, "s"),), delay=delay)


def _delay(kind: str, default: float, size: float) -> float:
    delay = default * size
    if abs(delay) > _MAX_DELAY:
        raise ValueError(
            f"{kind} of size {size:g} is {delay:g} s; take at most {_MAX_DELAY:g} s, a size of {_MAX_DELAY / default:g}"
        )
    return delay


def encoder_eccentricity(site: Site, joints: Joints, size: float) -> LabEffect:
    """The disc of the link encoder is not centred."""
    amplitude = at_joints(joints, site.n_joints, ECCENTRICITY * size)
    if np.abs(amplitude).max() >= 1:
        raise ValueError(
            f"encoder_eccentricity of size {size:g} would turn the encoder back; take less than {1 / ECCENTRICITY:g}"
        )
    phase = at_joints(joints, site.n_joints, 0.7 + np.arange(site.n_joints))
    values = (
        Value("amplitude", amplitude[list(joints)].tolist(), "rad"),
        Value("phase", phase[list(joints)].tolist(), "rad"),
    )
    return EncoderEccentricity("encoder_eccentricity", joints, size, values, amplitude=amplitude, phase=phase)


def contact(site: Site, joints: Joints, size: float) -> LabEffect:
    """Something touches the last link now and then."""
    force = size * site.force_for(CONTACT_SHARE)
    return Contact("contact", joints, size, (Value("force", force, "N"),), force=force)


def thermal_drift(site: Site, joints: Joints, size: float) -> LabEffect:
    """The arm warms up over the session."""
    if DRIFT * size >= 1:
        raise ValueError(f"thermal_drift of size {size:g} would leave no friction; take less than {1 / DRIFT:.3g}")
    change = np.full(site.n_joints, -DRIFT * size)
    values = (Value("change", -DRIFT * size, "1"), Value("time_constant", DRIFT_TIME, "s"))
    return ThermalDrift("thermal_drift", joints, size, values, change=change, time_constant=DRIFT_TIME)
