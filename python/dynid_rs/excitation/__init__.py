"""Exciting trajectories: designed so that the torque tells the parameters apart (Eqs. 13-18)."""

from __future__ import annotations

from dynid_rs.excitation.collision import SelfCollision
from dynid_rs.excitation.fourier import FourierExcitation
from dynid_rs.excitation.limits import ExcitationLimits
from dynid_rs.excitation.merit import Merit
from dynid_rs.excitation.search import Restart
from dynid_rs.excitation.series import sufficient_bounds
from dynid_rs.excitation.workspace import WorkspaceBox

__all__ = [
    "ExcitationLimits",
    "FourierExcitation",
    "Merit",
    "Restart",
    "SelfCollision",
    "WorkspaceBox",
    "sufficient_bounds",
]
