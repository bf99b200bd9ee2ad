"""The friction experiment of the double-encoder paper (Eqs. 3-8): planned, played, and read again from what was measured."""

from __future__ import annotations

from dynid_rs.friction_experiment.plan import plan_friction_experiment
from dynid_rs.friction_experiment.segments import FrictionExperiment, Leg, ReversedPair

__all__ = ["FrictionExperiment", "Leg", "ReversedPair", "plan_friction_experiment"]
