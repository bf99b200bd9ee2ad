"""An arm that warms up: friction of all joints follows their thermometers, which shows long before one joint does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.candidate import Candidate
from dynid_rs.diagnosis.hypothesis import bounds_of
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.placed import CATALOGUE

FloatArray = NDArray[np.float64]

WARMTH = "temperature_friction"


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
