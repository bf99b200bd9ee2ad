"""A hypothesis: an effect at a place with a shape, the columns it would add, and what accepting it means."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.setup import Setup

FloatArray = NDArray[np.float64]
RunColumns = dict[int, FloatArray]
"""Joint to its torque per unit coefficient in the band at the rows of a run, (n_rows, n_coefficients)."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """One hypothesis, ready to be weighed beside the whole declared model.

    Parameters
    ----------
    kind : str
        Name in the catalogue of effects.
    joints : tuple of int
        Where it acts, as a person would say it; its columns may reach other joints too.
    coefficient_names, units : tuple of str
        Of the linear coefficients.
    bounds : ndarray (n_coefficients, 2)
        What physics allows.
    columns : list of dict
        Per training run: joint to (n_rows, n_coefficients). Joints that are left out have zeros.
    accept : callable
        (setup, coefficients) to the setup with this effect in it.
    shape : tuple of (str, float)
        Shape parameters in use, where it has some.
    n_searched : int
        How many of them the search chose: each costs as much as a coefficient.
    doubt : float, optional
        What is believed against the shape (minus the logarithm of its probability); it is then the shape's whole cost.
    """

    kind: str
    joints: tuple[int, ...]
    coefficient_names: tuple[str, ...]
    units: tuple[str, ...]
    bounds: FloatArray
    columns: Sequence[RunColumns]
    accept: Callable[[Setup, FloatArray], Setup]
    shape: tuple[tuple[str, float], ...] = ()
    n_searched: int = 0
    doubt: float | None = None

    @property
    def place(self) -> tuple[str, tuple[int, ...]]:
        """Kind and joints: what a report names."""
        return self.kind, self.joints


def stacked(columns: Sequence[RunColumns]) -> RunColumns:
    """Columns of all runs under each other."""
    return {j: np.concatenate([run[j] for run in columns]) for j in columns[0]}


def joined(parts: Sequence[RunColumns]) -> RunColumns:
    """Columns side by side; joints that one of them does not reach get zeros there."""
    joints = sorted({j for part in parts for j in part})
    widths = [next(iter(part.values())).shape[1] for part in parts]
    n_rows = len(next(iter(parts[0].values())))
    return {
        j: np.concatenate(
            [part.get(j, np.zeros((n_rows, width))) for part, width in zip(parts, widths, strict=True)], axis=1
        )
        for j in joints
    }
