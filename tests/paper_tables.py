"""Tables of the source paper (Liu et al.): limits, and the coefficients of its winning trajectory."""

import numpy as np

from dynid_rs.excitation import ExcitationLimits
from dynid_rs.simulation import FourierTrajectory

FUNDAMENTAL = 2 * np.pi * 0.05
"""[rad/s]. The text says 0.02 Hz; the table satisfies Eq. 18 with 0.05 Hz only."""
DURATION = 20.0
RATE = 10.0
"""200 samples, every 0.1 s."""

POSITION_LIMIT = np.radians([120, 90, 60, 120, 120, 120])
VELOCITY_LIMIT = np.radians([100, 60, 60, 80, 80, 80])
ACCELERATION_LIMIT = np.radians([120, 120, 120, 120, 120, 120])

SIN_COEF = np.array(
    [
        [0.0046, -0.0406, -0.1772, -0.1704, -0.0210, 0.0673],
        [-0.0074, 0.0597, 0.0661, 0.1161, -0.1317, 0.2685],
        [0.4845, 0.2492, 0.1019, -0.1703, 0.3614, 0.1682],
        [-0.5103, 0.0678, 0.0189, 0.1426, -0.1994, -0.4241],
        [0.0286, -0.3361, -0.0097, 0.0820, -0.0094, -0.0763],
    ]
)
COS_COEF = np.array(
    [
        [-0.0053, -0.0234, -0.0001, 0.0088, 0.1460, 0.1335],
        [-0.0182, -0.2122, -0.0583, -0.3357, -0.3491, 0.0677],
        [0.6963, 0.1619, 0.0450, 0.1996, 0.3639, 0.0942],
        [-0.3354, -0.1082, 0.1273, 0.1731, -0.1008, -0.2907],
        [-0.1411, 0.0789, -0.1056, -0.1257, -0.0273, 0.1227],
    ]
)
OFFSET = np.array([0.3361, -0.2762, -0.0112, -0.2369, 0.1976, 0.4777])


def table_1() -> ExcitationLimits:
    """Limits of the experiment."""
    return ExcitationLimits.symmetric(POSITION_LIMIT, VELOCITY_LIMIT, ACCELERATION_LIMIT)


def table_3() -> FourierTrajectory:
    """The winning trajectory, with 5 harmonics."""
    return FourierTrajectory(OFFSET, SIN_COEF, COS_COEF, FUNDAMENTAL, rest=0.0)


def sampling_times() -> np.ndarray:
    """The 200 instants of the criterion [s]."""
    return np.arange(int(DURATION * RATE)) / RATE
