"""An arm that warms up: friction of all joints follows their thermometers, which shows long before one joint does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.candidate import Candidate, stacked
from dynid_rs.diagnosis.choice import Weighed
from dynid_rs.diagnosis.hypothesis import bounds_of
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.placed import CATALOGUE

FloatArray = NDArray[np.float64]

WARMTH = "temperature_friction"
WARMING = "thermal_friction"
DRIVES = 0.1
"""Part of the rows on which a warm joint's friction may drive it, where it turns round or the fit is unsure."""


def warm_arm(kinds: Kinds, setup: Setup) -> list[Candidate]:
    """Friction of all joints with a thermometer, times one and the same ``1 + c (T - T_0)``: one candidate or none.

    Once it is accepted every joint has a coefficient of its own.
    """
    if any(effect.kind == WARMTH for effect in setup.effects):
        return []
    hypotheses = kinds.grid([WARMTH])
    if len(hypotheses) < 2:
        return []
    columns = kinds.columns(hypotheses)
    (coefficient,) = CATALOGUE[WARMTH]["coefficients"]
    placed = tuple(hypothesis.placed() for hypothesis in hypotheses)

    def accept(setup: Setup, coefficients: FloatArray) -> Setup:
        return replace(setup, effects=(*setup.effects, *placed))

    return [
        Candidate(
            kind=WARMTH,
            joints=tuple(hypothesis.joints[0] for hypothesis in hypotheses),
            coefficient_names=(coefficient["name"],),
            units=(coefficient["unit"],),
            bounds=bounds_of(hypotheses[0]),
            columns=[
                {j: column for own in columns for j, column in own[run].items()} for run in range(len(kinds.runs))
            ],
            accept=accept,
        )
    ]


def takes_too_much(beside: Beside, kinds: Kinds, weighed: Weighed) -> bool:
    """Whether a warm-up takes more friction than there is, so that what is left drives the joint: then it is none."""
    candidate = weighed.candidate
    if candidate.kind != WARMING:
        return False
    (j,) = candidate.joints
    columns, coefficients = stacked(candidate.columns), weighed.gain.coefficients
    friction = beside.friction_with(j, columns, coefficients) + columns[j] @ coefficients
    dq = np.concatenate([states.dq_motor[states.rows, j] for states in kinds.runs])
    return bool(np.mean(dq * friction < 0) > DRIVES)
