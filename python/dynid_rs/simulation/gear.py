"""An elastic gear: how far it winds up under the torque it transmits, with memory."""

from __future__ import annotations

from math import isinf, sqrt

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def wind_up(
    tau: FloatArray,
    step: float,
    *,
    stiffness: float,
    damping: float,
    hysteresis: float,
    hysteresis_distance: float,
) -> FloatArray:
    """Deflection of one gear (motor minus link) that starts at rest without memory.

    Solves, at every instant of a uniform grid::

        tau = K delta + D ddelta + z
        dz  = sigma (1 - z / z_max sign(ddelta)) ddelta,      sigma = z_max / d      (Dahl, 1968)

    with the second-order backward difference for ddelta and the midpoint rule for z. Both are algebraic in
    the new deflection: one quadratic per step, without iteration, and D = 0 is no special case.

    Parameters
    ----------
    tau : ndarray (n,)
        Transmitted torque [N m].
    step : float
        Step of the grid [s].
    stiffness : float
        K [N m/rad]; infinite for a rigid gear.
    damping : float
        D [N m s/rad].
    hysteresis : float
        z_max [N m], the hysteretic torque after a long way in one direction.
    hysteresis_distance : float
        d [rad], the way over which z turns round.

    Returns
    -------
    ndarray (n,)
        Deflection [rad].
    """
    deflection = np.zeros(len(tau))
    if isinf(stiffness):
        return deflection
    # Twice the change of z per way, as a share of z_max: dz = 2 b (z_max - s z_mid) du.
    b = 0.5 / hysteresis_distance if hysteresis > 0 else 0.0
    sigma = 2 * b * hysteresis
    slope = stiffness + 1.5 * damping / step
    memory = 0.5 * damping / step
    delta, change, z = float(tau[0]) / stiffness, 0.0, 0.0
    deflection[0] = delta
    for index, load in enumerate(tau[1:].tolist(), start=1):
        # slope * change + z_new(change) = rest, and the left side grows with the change.
        rest = load - stiffness * delta + memory * change
        excess = rest - z
        way = 1.0 if excess >= 0 else -1.0
        linear = slope + sigma - b * way * (z + rest)
        root = sqrt(linear * linear + 4 * slope * b * abs(excess))
        u = 2 * abs(excess) / (linear + root)
        z = (z * (1 - b * u) + sigma * way * u) / (1 + b * u)
        change = way * u
        delta += change
        deflection[index] = delta
    return deflection
