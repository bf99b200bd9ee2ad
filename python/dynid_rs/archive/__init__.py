"""Runs by the thousand: read, checked, reduced to factors and dropped one by one; memory does not grow with them.

`Archive` is the main path. What is exact and what is decided on a sample stands on the
documentation's page how_to/archive.
"""

from dynid_rs.archive.archive import Archive
from dynid_rs.archive.runs import RunFile, RunSource

__all__ = ["Archive", "RunFile", "RunSource"]
