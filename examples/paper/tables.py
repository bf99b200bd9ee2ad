"""Figures printed in the paper: limits (Table 1), condition numbers (2), coefficients (3), errors (4), run times."""

from __future__ import annotations

import numpy as np

from dynid_rs.excitation import ExcitationLimits
from dynid_rs.simulation import FourierTrajectory, MotionLimits

LIMITS = {
    "position": np.radians([120.0, 90.0, 60.0, 120.0, 120.0, 120.0]),
    "velocity": np.radians([100.0, 60.0, 60.0, 80.0, 80.0, 80.0]),
    "acceleration": np.radians([120.0] * 6),
}
"""Table 1 [rad, rad/s, rad/s^2], symmetric."""

CONDITION_NUMBERS = {"condition": 189.4012, "block": 162.2440}
"""Table 2: plain (weighted least squares) and block objective. The robot's geometry is not given."""

FUNDAMENTAL = 2 * np.pi * 0.05
"""[rad/s]. The text says 0.02 Hz; Table 3 satisfies Eq. 18 only with 0.05 Hz, which is also the 20 s cycle."""

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
"""Table 3: a_l,i and b_l,i of Eq. 15 [rad/s], (5 harmonics, 6 joints), and theta_i0 [rad]."""

RMSE = {
    "wls": np.array([2.3376, 2.1278, 1.5395, 0.3361, 0.7101, 0.2578]),
    "three loops": np.array([1.9594, 1.7345, 1.1609, 0.3027, 0.5852, 0.2096]),
}
"""Table 4 [N m]; no validation trajectory is named."""

SECONDS = {"friction": 1.0, "trajectory (with its 20 s of motion)": 30.0, "identification": 5.0, "mixture": 2.0}
"""Run times in MATLAB on an i7-11800H; one cycle of the online estimate is given 1 ms."""

DURATION = 20.0
"""Of the exciting trajectory [s]."""
RATE = 10.0
"""200 samples, every 0.1 s."""
CLAIMED_GAIN = 0.20
""""The RMSE of the residual torque is reduced by more than 20 %"."""
PRINTED_FREQUENCY = 0.02
"""Exciting frequency of the text [Hz]."""


def table_1() -> ExcitationLimits:
    """Limits of the experiment."""
    return ExcitationLimits.symmetric(LIMITS["position"], LIMITS["velocity"], LIMITS["acceleration"])


def table_1_of_motion() -> MotionLimits:
    """The same for the friction experiment."""
    return MotionLimits(-LIMITS["position"], LIMITS["position"], LIMITS["velocity"], LIMITS["acceleration"])


def table_3(rest: float = 0.0) -> FourierTrajectory:
    """The winning trajectory, with `rest` [s] before and after it."""
    return FourierTrajectory(OFFSET, SIN_COEF, COS_COEF, FUNDAMENTAL, rest=rest)


def sampling_times() -> np.ndarray:
    """The 200 instants of the criterion [s]."""
    return np.arange(int(DURATION * RATE)) / RATE


def table_4_change() -> np.ndarray:
    """Change of the RMSE by the paper's method, (6,)."""
    return RMSE["three loops"] / RMSE["wls"] - 1


def eq_18(frequency: float) -> np.ndarray:
    """What Table 3 leaves of Eq. 18 at this frequency [Hz]: start, start velocity, start acceleration, (3, 6)."""
    order = np.arange(1.0, len(SIN_COEF) + 1)[:, None]
    omega = 2 * np.pi * frequency
    start = OFFSET - (COS_COEF / (omega * order)).sum(axis=0)
    return np.stack([start, SIN_COEF.sum(axis=0), omega * (order * COS_COEF).sum(axis=0)])
