"""The identified model for other programs: URDF, MuJoCo and Pinocchio with the bodies, or the whole model in C."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from dynid_rs import _core
from dynid_rs.base.errors import MissingLibraryError
from dynid_rs.base.files import check_readable, with_sentence
from dynid_rs.base.quoting import as_text


def urdf(model: _core.TorqueModel, robot: str | os.PathLike[str] | None = None) -> bytes:
    """URDF with the physical set of `model`: inertials, and friction as ``<dynamics>``.

    Parameters
    ----------
    model : TorqueModel
        With a physical set.
    robot : path-like, optional
        The URDF that the model was identified with. Its text is kept byte for byte but for ``<inertial>`` and
        ``<dynamics>``; a moving link gets the total of all that is fixed to it. Without it the result holds links and
        joints alone, with the rotor inertias as Drake writes them.

    Raises
    ------
    ValueError
        The model has no physical set.
    UrdfError
        The file is refused, or is another robot's.
    OSError
        The file cannot be read.
    """
    _physical_of(model)
    if robot is None:
        return _core.urdf_with_physical(model)
    path = check_readable(robot)
    return _core.urdf_with_physical(model, _bytes_of(path), source_name=as_text(str(path)))


def mjcf(model: _core.TorqueModel) -> str:
    """MuJoCo model (MJCF text) of the chain with the physical set of `model`, every number to its last digit.

    Rotor inertias become ``armature``, viscous friction ``damping``, Coulomb friction ``frictionloss``. Each joint has
    a motor whose ``gear`` is the torque per unit of the model's torque channel: its ``ctrl`` is a joint torque [N*m],
    a force [N], or a current [A] where currents were fitted. Declared efforts become ``actuatorfrcrange``, which limits
    joint torques. Gravity is that of the base frame. All other effects are left out.

    Raises
    ------
    ValueError
        The model has no physical set.
    """
    _physical_of(model)
    return _core.mjcf_with_physical(model)


def to_pinocchio(model: _core.TorqueModel) -> Any:
    """`pinocchio.Model` of the chain with the physical set of `model`, in the base frame's gravity.

    ``armature`` holds the rotor inertias, ``damping`` and ``friction`` those of the joints; `pinocchio.rnea` counts the
    first one. Joints without limits are stored as (cos, sin), as Pinocchio does for URDFs.

    Raises
    ------
    ValueError
        The model has no physical set.
    MissingLibraryError
        Pinocchio is not installed.
    """
    physical = _physical_of(model)
    try:
        import pinocchio
    except ImportError:
        raise MissingLibraryError("pinocchio", extra="collision", purpose="Pinocchio models") from None
    built = pinocchio.buildModelFromXML(urdf(model).decode())
    built.name = model.robot.name
    built.gravity.linear = model.robot.gravity
    built.velocityLimit, built.effortLimit = model.robot.velocity_limits, model.robot.effort_limits
    for joint, lower, upper in zip(list(built.joints)[1:], model.robot.lower, model.robot.upper, strict=True):
        if joint.nq == 1:
            built.lowerPositionLimit[joint.idx_q], built.upperPositionLimit[joint.idx_q] = lower, upper
    built.armature = physical.rotor_inertia
    built.damping = physical.damping
    built.friction = physical.friction
    return built


def _physical_of(model: _core.TorqueModel) -> _core.PhysicalSet:
    physical = model.physical
    if physical is None:
        raise ValueError(
            "the model has no masses and inertias that a body can have, only what the torque tells; identify it again "
            "with --physical, or model.with_physical(PhysicalIdentifier().fit(identifier.observations_, "
            "identifier.links_).physical_set(model))"
        )
    return physical


def c_header(model: _core.TorqueModel, prefix: str) -> str:
    """`model` as one self-contained C99 file: no allocation, no library but ``math.h``.

    Its numbers are those of the estimator within 1e-11 of each term's size.

    Parameters
    ----------
    model : TorqueModel
        Any.
    prefix : str
        What its names begin with: a letter, then letters, digits and underscores; `c_prefix` makes one of any text.

    Returns
    -------
    str
        ASCII text.

    Raises
    ------
    ValueError
        The prefix is no beginning of a C name, or an effect has no C form.
    """
    return _core.c_header(model, prefix)


def c_prefix(text: str) -> str:
    """Return a prefix for `c_header` made of any text, the name of a file say."""
    return _core.c_prefix(text)


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise with_sentence(error, path, "read") from None
