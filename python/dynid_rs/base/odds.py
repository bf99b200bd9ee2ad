"""Odds that something is there, kept as their logarithm: where it is believed, and what that is as a probability."""

from __future__ import annotations

import numpy as np

SURE = float(np.log(19.0))
"""Logarithm of the posterior odds at which a hypothesis is believed: 95 %."""


def p_value(log_odds: float) -> float:
    """Probability that it is not there after all."""
    from scipy.special import expit

    return float(expit(-log_odds))
