"""Losses that gears may have, by the way that their load takes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core

FloatArray = NDArray[np.float64]

KIND = "gear_hysteresis"
LEAST_LOAD = 1e-9
"""Spread of a load [N m] below which a joint bears none."""


def gear_losses(loads: Sequence[FloatArray]) -> Iterator[_core.Effect]:
    """Every gear's hysteresis over the ways of the catalogue's grid, one after another, the same on all joints.

    Parameters
    ----------
    loads : per run (n_samples, n_joints)
        Torque of the links: its standard deviation is what the grid counts in.
    """
    spread = np.maximum(np.concatenate(loads).std(axis=0), LEAST_LOAD)
    way, carried = next(entry for entry in _core.effect_catalogue() if entry["kind"] == KIND)["shape"]
    held = {carried["name"]: (carried["grid"][0] * spread).tolist()}
    for share in way["grid"]:
        yield _core.Effect.of(KIND, **{way["name"]: (share * spread).tolist()}, **held)
