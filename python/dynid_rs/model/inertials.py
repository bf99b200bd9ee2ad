"""Inertials of a robot file that no body can have."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.findings import Finding

FloatArray = NDArray[np.float64]

ROUNDED = 0.1
"""Excess of one principal moment over the other two, over the greatest, that rounding explains: files give two digits
and more, every moment is off by a twentieth at most, three of them count, and their errors add up as squares."""

MOVED = 1e-9
"""What moving the moments to the link's frame and back leaves of them: a point of mass has none about its centre."""


def inertial_findings(robot: _core.RobotModel, file: str | None = None) -> list[Finding]:
    """Links whose mass or inertia is that of no body, by name.

    A link stands for all that is fixed to it; what is fixed to the base moves nothing and is not looked at.

    Parameters
    ----------
    robot : RobotModel
        As its file declares it.
    file : str, optional
        Name of the file.

    Returns
    -------
    list of Finding
        At most one warning ``inertial_not_physical``: a prior may be wrong, and a fit does not need it.
    """
    reasons = [_reason(P) for P in _core.pseudo_inertia(robot.phi)]
    # The base is the first link, and does not move.
    links = list(robot.link_names)[-len(reasons) :]
    wrong = [(name, reason) for name, reason in zip(links, reasons, strict=True) if reason]
    if not wrong:
        return []
    more = f" (so it is with {', '.join(name for name, _ in wrong[1:])})" if len(wrong) > 1 else ""
    message = (
        f"the inertial of link {wrong[0][0]} is that of no body: {wrong[0][1]}{more}; correct it in the robot file, or "
        "identify with --prior none, which leaves the file's inertials out"
    )
    return [Finding("inertial_not_physical", "warning", message, file)]


def _reason(pseudo: FloatArray) -> str:
    """Why a pseudo-inertia (4, 4) is that of no body; empty where it may be one."""
    mass, first = pseudo[3, 3], pseudo[:3, 3]
    if not np.any(pseudo):
        return ""  # nothing is declared
    if mass <= 0:
        return f"it has inertia and a mass of {mass:g} kg"
    # Second moments about the centre: twice a principal value is what two moments of inertia exceed the third by.
    second = np.linalg.eigvalsh(pseudo[:3, :3] - np.outer(first, first) / mass)
    moments = np.sort(second.sum() - second)
    if second[0] >= -ROUNDED / 2 * abs(moments[-1]) - MOVED * abs(np.trace(pseudo[:3, :3])):
        return ""
    if moments[0] < 0:
        return (
            f"its principal moments of inertia about its centre are {_listed(moments)} kg m^2, and none can be negative"
        )
    return (
        f"of its principal moments of inertia about its centre, {_listed(moments)} kg m^2, the greatest exceeds the "
        "other two together"
    )


def _listed(values: FloatArray) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
