"""What a law says of the sign of its sizes holds in the fit that is reported too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs.model.placed import CATALOGUE, PlacedEffect


def beyond_bounds(
    effects: Sequence[PlacedEffect], places: Sequence[Sequence[tuple[int, int]]], x: NDArray[np.float64]
) -> set[int]:
    """Places among all unknowns `x` (n,) of sizes on two joints that have a sign which physics does not allow.

    `places` are joint and place of every coefficient of every effect. The search weighs sizes by the signs that they
    may have; the fit of all unknowns at once knows no bounds, and where a run hardly tells a joint's share it may come
    out as large as the torque, and negative. The least error within the bounds is then on them: at zero. A law of one
    joint predicts that joint as it is, and so does an effect of which nothing would be left.
    """
    beyond: set[int] = set()
    for effect, own in zip(effects, places, strict=True):
        entry = CATALOGUE[effect.kind]["coefficients"]
        ends = [(entry[k % len(entry)]["lower"], entry[k % len(entry)]["upper"]) for k in range(len(own))]
        wrong = {at for (_, at), (lower, upper) in zip(own, ends, strict=True) if not lower <= x[at] <= upper}
        if len(effect.joints) > 1 and any(x[at] != 0 for _, at in own if at not in wrong):
            beyond |= wrong
    return beyond
