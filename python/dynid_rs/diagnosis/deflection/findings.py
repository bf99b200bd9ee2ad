"""What is reported of a gear: a kind of the catalogue, its parameters, errors before and after, a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.deflection.parameters import Parameter

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DeflectionFinding:
    """Something that `q_motor - q` reveals.

    Parameters
    ----------
    kind : str
        Of the catalogue; `gear_kinematic_error` where a gear does not yield but turns unevenly.
    joints : tuple of int
        Where.
    parameters : tuple of Parameter
        Of the first joint's gear; of all, where they share them.
    p_value : float
        Of its leading term beside all others.
    rms_test_before, rms_test_after : tuple of float
        Deflection that is left on the test runs without and with it, per joint of `joints` [rad]; everything that was
        ranked before it is in both.
    ties : tuple of str
        Kinds that would explain as much in its place.
    plot : (x, partial, curve)
        Signal, deflection without everything else, and the fitted part, on the test runs of the first joint.
    signal : str
        What x is.
    """

    kind: str
    joints: tuple[int, ...]
    parameters: tuple[Parameter, ...]
    p_value: float
    rms_test_before: tuple[float, ...]
    rms_test_after: tuple[float, ...]
    ties: tuple[str, ...]
    plot: tuple[FloatArray, FloatArray, FloatArray]
    signal: str

    def to_json(self, joint_names: Sequence[str], rank: int) -> dict[str, Any]:
        """Return an entry of `result.json`'s effects; its errors are deflections, as `unit` says."""
        return {
            "rank": rank,
            "kind": self.kind,
            "joints": [joint_names[j] for j in self.joints],
            "parameters": [
                {"name": p.name, "value": p.value, "unit": p.unit, "interval": list(p.interval)}
                for p in self.parameters
            ],
            "rmse_test_before": list(self.rms_test_before),
            "rmse_test_after": list(self.rms_test_after),
            "unit": "rad",
            "p_value": self.p_value,
            "ties": [{"kind": kind, "joints": [joint_names[j] for j in self.joints]} for kind in self.ties],
        }
