"""Eqs. 27-28 to the letter on the deflection of the laboratory arm, beside the precision that is meant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from errors import Outcome

from dynid_rs import RbfRegressor
from dynid_rs.model.assembly import evaluate

N_CENTERS = 8
JOINT = 2
"""The third joint, the one whose gain in the paper's Table 4 is largest."""


@dataclass(frozen=True)
class PrintedBasis:
    """Spacing of the centres and the printed width of the deflection [rad], and the shares of variance explained."""

    joint: int
    spacing: float
    width: float
    explained_printed: float
    explained: float


def printed_basis(outcome: Outcome) -> PrintedBasis:
    """Fit both to what two loops leave on the training runs."""
    identifier = outcome.identifier
    inputs, left = [], []
    for run, raw in zip(identifier.runs_, identifier.raw_runs_, strict=True):
        deflection = np.stack([run.q_motor - run.q, run.dq_motor - run.dq], axis=-1)[run.rows, JOINT]
        error = raw.in_band(raw.tau - evaluate(identifier.two_loop_model_, raw)[0])[:, JOINT]
        n_rows = min(len(deflection), len(error))
        inputs.append(deflection[:n_rows])
        left.append(error[:n_rows])
    X, y = np.concatenate(inputs), np.concatenate(left)
    explained = []
    for as_printed in (True, False):
        fitted = RbfRegressor(N_CENTERS, as_printed=as_printed).fit(X, y)
        explained.append(float(1 - np.var(y - fitted.predict(X)) / np.var(y)))
    spacing = float(np.ptp(X[:, 0]) / (N_CENTERS - 1))
    return PrintedBasis(JOINT, spacing, (spacing / 2) ** -2, *explained)
