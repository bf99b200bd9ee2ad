"""The highest place of a function of one number: on a grid, then between the neighbours of the best."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np


def highest(
    height: Callable[[float], float], grid: Sequence[float], evaluations: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """The best of the grid and the best found between its neighbours, each with its height.

    Parameters
    ----------
    height : callable
        Of one number.
    grid : sequence of float
        Places to begin with, in rising order.
    evaluations : int
        Most evaluations of the refined search, a bounded one (Brent 1973) that never takes the neighbours themselves.
    """
    from scipy.optimize import minimize_scalar

    heights = [height(place) for place in grid]
    at = int(np.argmax(heights))
    bounds = (grid[max(at - 1, 0)], grid[min(at + 1, len(grid) - 1)])
    found = minimize_scalar(
        lambda x: -height(float(x)), bounds=bounds, method="bounded", options={"maxiter": evaluations}
    )
    return (grid[at], heights[at]), (float(found.x), -float(found.fun))
