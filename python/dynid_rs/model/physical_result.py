"""What `result.json` says of a physically consistent set, beside the free one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.units import torque_of
from dynid_rs.model.physical import PhysicalIdentifier

FloatArray = NDArray[np.float64]

WORTH_SAYING = 0.02
"""Growth of a joint's error from which the set is called worse than the torque model."""


def physical_section(
    physical: PhysicalIdentifier, model: _core.TorqueModel, rmse_free: FloatArray, rmse_physical: FloatArray
) -> dict[str, Any]:
    """Bodies, rotors and errors of the set; `rmse_...` (n_joints,) on the test runs [torque unit]."""
    robot = model.robot
    pseudo = _core.pseudo_inertia(physical.phi_)
    masses = pseudo[:, 3, 3]
    declared = _core.pseudo_inertia(robot.phi)[:, 3, 3]
    friction = physical.physical_set(model)
    growth = rmse_physical / np.maximum(rmse_free, 1e-300) - 1
    section: dict[str, Any] = {
        "rmse_test": rmse_physical,
        "rmse_test_free": rmse_free,
        "links": [
            {
                "link": name,
                "mass": masses[k],
                "mass_declared": declared[k],
                "centre": pseudo[k, :3, 3] / masses[k],
                "inertia": _inertia(physical.phi_[10 * k : 10 * k + 10]),
                "least_eigenvalue": float(np.linalg.eigvalsh(pseudo[k])[0]),
            }
            for k, name in enumerate(robot.link_names)
        ],
        "rotor_inertia": physical.rotor_inertia_,
        "damping": friction.damping,
        "friction": friction.friction,
        "drive_gain": physical.drive_gain_ if model.torque_unit == "A" else None,
    }
    section["reason"] = _reason(robot, growth, section["drive_gain"])
    return section


def _inertia(phi: FloatArray) -> dict[str, float]:
    """Inertia of one link about its frame's origin [kg*m^2] by name."""
    return {name: float(x) for name, x in zip(_core.LINK_PARAMETER_NAMES, phi, strict=True) if name.startswith("I")}


def _reason(robot: _core.RobotModel, growth: FloatArray, drive_gain: FloatArray | None) -> str:
    """One or two sentences: what the set costs, and where its scale comes from."""
    worst = int(np.argmax(growth))
    change = f"{100 * growth[worst]:+.1f} % on {robot.joint_names[worst]}"
    if growth[worst] > WORTH_SAYING:
        words = (
            f"Bodies that could be built do not explain the torque as well as the free model (error on the test runs: "
            f"up to {change}); the data holds something that no inertia is."
        )
    else:
        words = f"Bodies that could be built explain the torque as well as the free model (at most {change})."
    if drive_gain is not None:
        told = zip(drive_gain, robot.joint_kinds, strict=True)
        gains = ", ".join(f"{gain:.3g} {torque_of('N*m', kind)}/A" for gain, kind in told)
        words += (
            f" The runs hold currents: the common factor of the drive gains ({gains}) is the one with which the "
            "robot file's inertials explain them best, and all masses are as right as it."
        )
    return words
