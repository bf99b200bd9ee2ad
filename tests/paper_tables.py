"""The source paper's limits and trajectory (Tables 1 and 3) as this package's objects."""

import importlib.util

import numpy as np
from data import ROOT

from dynid_rs.excitation import ExcitationLimits
from dynid_rs.simulation import FourierTrajectory

_SPEC = importlib.util.spec_from_file_location("tables_of_the_paper", ROOT / "examples" / "paper" / "tables.py")
TABLES = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(TABLES)

FUNDAMENTAL, SIN_COEF, COS_COEF, OFFSET = TABLES.FUNDAMENTAL, TABLES.SIN_COEF, TABLES.COS_COEF, TABLES.OFFSET
DURATION = 20.0
"""[s]."""
RATE = 10.0
"""200 samples, every 0.1 s."""


def table_1() -> ExcitationLimits:
    """Limits of the experiment."""
    limits = TABLES.LIMITS
    return ExcitationLimits.symmetric(limits["position"], limits["velocity"], limits["acceleration"])


def table_3() -> FourierTrajectory:
    """The winning trajectory, with 5 harmonics."""
    return FourierTrajectory(OFFSET, SIN_COEF, COS_COEF, FUNDAMENTAL, rest=0.0)


def sampling_times() -> np.ndarray:
    """The 200 instants of the criterion [s]."""
    return np.arange(int(DURATION * RATE)) / RATE
