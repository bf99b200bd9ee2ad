"""The friction experiment (Eqs. 3-8): planned, played, and read again from what was measured."""

from __future__ import annotations

from dynid_rs.friction_experiment.odd import OddFriction, odd_friction
from dynid_rs.friction_experiment.plan import plan_friction_experiment
from dynid_rs.friction_experiment.segments import FrictionExperiment, Leg, ReversedPair

__all__ = ["FrictionExperiment", "Leg", "OddFriction", "ReversedPair", "odd_friction", "plan_friction_experiment"]
