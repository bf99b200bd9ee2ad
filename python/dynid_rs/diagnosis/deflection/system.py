"""The deflection of one gear as a linear system: terms, the load's own error beside them, and honest covariances.

The load is predicted from parameters that are known up to their covariance, and a deflection is a far better torque
sensor than a motor current. So the load's error is fitted beside the terms, as random as its covariance says:
``w = X x + E u + e`` with u of unit variance (a ridge, or a random effect).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.deflection.signals import GearSignals
from dynid_rs.uncertainty import NoiseSpectrum, toeplitz_product

FloatArray = NDArray[np.float64]

MEMORY = 0.3
"""Longest memory of the noise [s]; the spectrum is as smooth as that, so that the terms cannot take all of a band."""
LEAST_BLOCKS = 3
"""Fewer runs than this are cut in as many parts each, so that something can be left out."""
WEAK = 1e-13
"""Power of a direction, in the columns' own units, that is as good as none."""
SLOW = 2.0
"""Noise below this frequency [Hz] is what the load's error is weighed against; motion lives there."""


@dataclass(frozen=True, eq=False)
class System:
    """Runs of one gear, columns about their mean in every run, zero where nothing is fitted.

    Parameters
    ----------
    runs : sequence of GearSignals
        The signals.
    columns : mapping
        Term to its columns, (n, n_columns) per run.
    errors : list of ndarray (n, n_u)
        Deflection from the load's error, one standard deviation each.
    noise_power : float
        Of the slow noise per sample [rad^2]: the variance that `errors` compete with.
    """

    runs: Sequence[GearSignals]
    columns: Mapping[str, list[FloatArray]]
    errors: list[FloatArray]
    noise_power: float

    @cached_property
    def deflection(self) -> list[FloatArray]:
        """What is explained, (n,) per run: without the part of the delay that is known."""
        return [centred(run, run.deflection - run.shift) for run in self.runs]

    @property
    def n_errors(self) -> int:
        """Directions of the load's error."""
        return int(self.errors[0].shape[1])

    @property
    def n_used(self) -> int:
        """Samples that are fitted, all runs together."""
        return sum(int(run.used.sum()) for run in self.runs)

    @cached_property
    def places(self) -> dict[str, list[int]]:
        """Places of every term among all columns [errors | terms]."""
        places, first = {}, self.n_errors
        for name, columns in self.columns.items():
            places[name] = list(range(first, first + columns[0].shape[1]))
            first += columns[0].shape[1]
        return places

    def chosen(self, names: Sequence[str], errors: bool = True) -> list[int]:
        """Places of the load's errors, if the gear yields to it, and of the terms `names`, in this order."""
        n_errors = self.n_errors if errors and "compliance" in names else 0
        return [*range(n_errors), *(place for name in names for place in self.places[name])]

    def among(self, names: Sequence[str], name: str) -> list[int]:
        """Places of one term among the coefficients of `names`."""
        first = sum(len(self.places[other]) for other in names[: list(names).index(name)])
        return list(range(first, first + len(self.places[name])))

    @cached_property
    def _rows(self) -> list[FloatArray]:
        return [
            np.column_stack([self.errors[k], *(columns[k] for columns in self.columns.values()), self.deflection[k]])
            for k in range(len(self.runs))
        ]

    @cached_property
    def _factors(self) -> list[FloatArray]:
        """Triangular factor of [errors | all columns | deflection] per block: data is read once."""
        n_parts = 1 if len(self.runs) >= LEAST_BLOCKS else LEAST_BLOCKS
        return [
            _core.triangular_factor(np.ascontiguousarray(part))
            for rows, run in zip(self._rows, self.runs, strict=True)
            for part in np.array_split(rows[run.used], n_parts)
        ]

    @property
    def n_blocks(self) -> int:
        """What can be left out: whole runs, or thirds of them where there are few."""
        return len(self._factors)

    def _blocks(self, late: float) -> list[FloatArray]:
        """The factors, with a delay [s] that was taken off already put back."""
        if not late:
            return self._factors
        blocks = [factor.copy() for factor in self._factors]
        for block in blocks:
            block[:, -1] += late * block[:, self.places["delay"][0]]
        return blocks

    def coefficients(
        self, names: Sequence[str], without: int | None = None, *, late: float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Coefficients u (n_u,) and x (n_x,) fitted to all blocks, or to all but one."""
        factors = [factor for k, factor in enumerate(self._blocks(late)) if k != without]
        chosen = self.chosen(names)
        n_x = sum(len(self.places[name]) for name in names)
        rows = np.concatenate([factor[:, [*chosen, -1]] for factor in factors])
        ridge = np.zeros((len(chosen) - n_x, rows.shape[1]))
        np.fill_diagonal(ridge, np.sqrt(self.noise_power))
        rows = np.concatenate([rows, ridge])
        norms = np.maximum(np.linalg.norm(rows[:, :-1], axis=0), 1e-300)
        solution = np.linalg.lstsq(rows[:, :-1] / norms, rows[:, -1], rcond=1e-12)[0] / norms
        u = np.zeros(self.n_errors)
        u[: len(ridge)] = solution[: len(ridge)]
        return u, solution[len(ridge) :]

    def power(self, names: Sequence[str], without: int | None = None, *, late: float = 0.0) -> float:
        """Power left [rad^2]: of all blocks by a fit to all, or of one block by a fit to the others."""
        solution = self._full(names, *self.coefficients(names, without, late=late))
        blocks = self._blocks(late) if without is None else [self._blocks(late)[without]]
        return float(sum(np.sum((factor[:, -1] - factor[:, :-1] @ solution) ** 2) for factor in blocks))

    def _full(self, names: Sequence[str], u: FloatArray, x: FloatArray) -> FloatArray:
        """Coefficients of all columns."""
        solution = np.zeros(self.n_errors + sum(map(len, self.places.values())))
        solution[: self.n_errors] = u
        solution[self.chosen(names, errors=False)] = x
        return solution

    def fitted(self, names: Sequence[str], u: FloatArray, x: FloatArray) -> list[FloatArray]:
        """What the terms explain, (n,) per run."""
        solution = self._full(names, u, x)
        return [rows[:, :-1] @ solution for rows in self._rows]

    def left(self, names: Sequence[str]) -> list[FloatArray]:
        """What a fit of the terms to all runs leaves, (n,) per run."""
        fitted = self.fitted(names, *self.coefficients(names))
        return [w - part for w, part in zip(self.deflection, fitted, strict=True)]

    @cached_property
    def _normal(self) -> FloatArray:
        normal: FloatArray = np.sum([factor[:, :-1].T @ factor[:, :-1] for factor in self._factors], axis=0)
        normal[: self.n_errors, : self.n_errors] += self.noise_power * np.eye(self.n_errors)
        return normal

    @cached_property
    def noise(self) -> NoiseSpectrum:
        """Noise of the deflection: from what all terms together leave, and what they took away with it."""
        masks = [run.used.astype(float) for run in self.runs]
        grids = [rows[:, :-1] for rows in self._rows]
        max_lag = max(2, int(MEMORY * self.runs[0].rate))
        return NoiseSpectrum(self.left(list(self.columns)), masks, grids, inverse(self._normal), max_lag=max_lag)

    @cached_property
    def slow_noise(self) -> float:
        """Power of the noise below `SLOW` as if it were white [rad^2]."""
        size = 2 * max(len(run.load) for run in self.runs)
        lines = self.noise.spectrum(size)
        return float(lines[: max(2, int(SLOW / self.runs[0].rate * size))].mean())

    @cached_property
    def _products(self) -> FloatArray:
        """``A' Gamma A`` of all columns."""
        return np.asarray(sum(toeplitz_product(rows[:, :-1], self.noise.spectrum) for rows in self._rows))

    def covariance(self, names: Sequence[str], *, load_known: bool = False) -> FloatArray:
        """Covariance of x (n_x, n_x): of correlated noise, and of a load that is as far off as its own says."""
        chosen = self.chosen(names, errors=not load_known)
        n_errors = len(chosen) - sum(len(self.places[name]) for name in names)
        bread = inverse(self._normal[np.ix_(chosen, chosen)])[n_errors:]
        meat = self._products[np.ix_(chosen, chosen)].copy()
        meat[:n_errors, :n_errors] += self.noise_power**2 * np.eye(n_errors)
        result: FloatArray = bread @ meat @ bread.T
        return result


def inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of a positive semidefinite matrix in its own units; what has no power has no part."""
    power = np.diag(matrix)
    norms = np.where(power > 0, np.sqrt(np.maximum(power, 1e-300)), np.inf)
    scaled = np.linalg.inv(matrix / np.outer(norms, norms) + WEAK * np.eye(len(matrix)))
    result: FloatArray = scaled / np.outer(norms, norms)
    return result


def centred(run: GearSignals, x: FloatArray) -> FloatArray:
    """`x` (n, ...) about its mean in use (an encoder's zero is its own in every run), zero elsewhere."""
    about = x - x[run.used].mean(axis=0)
    about[~run.used] = 0.0
    return np.asarray(about)
