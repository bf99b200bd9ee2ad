"""What has changed since a trusted model was made: payload, tilt, gains, friction, offsets."""

from __future__ import annotations

from dynid_rs.reference.compare import Changes, compare
from dynid_rs.reference.load import Load, weigh_load

__all__ = ["Changes", "Load", "compare", "weigh_load"]
