"""The friction experiment (Eqs. 3-8), read again from what was measured; `excitation` plans it."""

from __future__ import annotations

from dynid_rs.identification.friction_experiment.odd import OddFriction, odd_friction

__all__ = ["OddFriction", "odd_friction"]
