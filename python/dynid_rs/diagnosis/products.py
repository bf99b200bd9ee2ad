"""Products of functions of several signals, and how well they predict rows that were left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.rows_beside import JointRows, Split, spread_of_sum
from dynid_rs.diagnosis.signals import Candidates, Signal, further_functions

FloatArray = NDArray[np.float64]

RIDGES = (1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)
"""Ridges that are tried, relative to the mean power of a row."""
ABSORBED = 1e-3
"""Part of the columns' power that always counts for the ridge, however little the declared model leaves of them."""
FEW, ALL, FURTHER = range(3)
"""Products of the tamest functions of each signal, of all of them, and with `further_functions` of the whole set."""
FULL = 2
"""Products of more signals than this use only the tamest functions of each."""


def product_columns(
    signals: Sequence[Signal], candidates: Candidates, rows: NDArray[np.intp], *, reach: int = ALL
) -> FloatArray:
    """All products of functions of different signals, alone too, (n_rows, n_columns); see `FEW`."""
    return _products(signals, candidates, reach, lambda s: candidates.functions[s][rows], lambda every: every[0][rows])


def raw_columns(signals: Sequence[Signal], candidates: Candidates, u: FloatArray, *, reach: int = ALL) -> FloatArray:
    """The same at states `u` (n, n_signals), before any band, (n, n_columns)."""
    at = {signal: np.ascontiguousarray(column) for signal, column in zip(signals, u.T, strict=True)}
    return _products(
        signals,
        candidates,
        reach,
        lambda s: candidates.bases[s](at[s]) / candidates.scales[s],
        lambda every: further_functions(signals, candidates.bases, u) / every[1],
    )


def _products(
    signals: Sequence[Signal],
    candidates: Candidates,
    reach: int,
    functions: Callable[[Signal], FloatArray],
    further_ones: Callable[[tuple[FloatArray, FloatArray]], FloatArray],
) -> FloatArray:
    """Products of `functions` of each signal (n, k), and what `further_ones` makes of the set's own."""
    reach = FEW if len(signals) > FULL else reach
    columns = np.ones((1, 1))
    for signal in signals:
        own = functions(signal)
        own = own[:, candidates.few(signal)] if reach == FEW else own
        own = np.column_stack([np.ones(len(own)), own])
        columns = (columns[:, :, None] * own[:, None, :]).reshape(len(own), -1)
    every = candidates.further.get(tuple(signals)) if reach == FURTHER else None
    if every is not None:
        columns = np.column_stack([columns, further_ones(every)])
    return columns[:, 1:]


@dataclass(frozen=True, eq=False)
class Score:
    """Squares that products of some signals leave on the rows left out.

    `power` (n_targets,) sum of squares, at the best ridge for each target; `ridge` the first target's; `squares`
    (n_rows,) of the first target row by row; `reach` which functions predict best.
    """

    signals: tuple[Signal, ...]
    power: FloatArray
    ridge: float
    squares: FloatArray
    reach: int = ALL


class LeftOutRows:
    """Scores sets of signals on rows left out; the first target is the residual, others are surrogates of it.

    Parameters
    ----------
    rows : JointRows
        Of the joint.
    candidates : Candidates
        Functions of the signals.
    surrogates : ndarray (n_rows, n_surrogates), optional
        Scored in the same breath as the residual.
    """

    def __init__(self, rows: JointRows, candidates: Candidates, surrogates: FloatArray | None = None) -> None:
        self._rows, self._candidates = rows, candidates
        self._targets = [_targets(split, surrogates) for split in rows.splits]
        self.without = np.asarray(sum(np.sum(left**2, axis=0) for _, left in self._targets))
        """What the declared model alone leaves, (n_targets,)."""
        self._known: dict[tuple[Signal, ...], Score] = {}

    def score(self, signals: Sequence[Signal]) -> Score:
        """Score a set of signals."""
        key = tuple(sorted(signals))
        if key not in self._known:
            reaches = [FEW]
            if len(key) <= FULL:
                reaches += [ALL, FURTHER] if key in self._candidates.further else [ALL]
            self._known[key] = _best([self._score(key, reach) for reach in reaches])
        return self._known[key]

    def worse(self, score: Score, than: Score) -> bool:
        """Whether a set of signals leaves more than another by over two standard errors of the difference."""
        difference = score.squares - than.squares
        return bool(difference.sum() > 2 * spread_of_sum(difference, self._rows.block))

    def _score(self, signals: tuple[Signal, ...], reach: int) -> Score:
        columns = product_columns(signals, self._candidates, self._rows.rows, reach=reach)
        power = np.zeros((len(RIDGES), len(self.without)))
        paths = []
        for split, (fitted, left) in zip(self._rows.splits, self._targets, strict=True):
            b = columns[split.fitted]
            taken = split.taken.T @ b
            path = RidgePath(b, taken, fitted)
            shown = split.weighed(columns[split.left]) - split.elsewhere @ taken
            moment, cross, power_left = shown.T @ shown, shown.T @ left, np.sum(left**2, axis=0)
            beta = [path.at(ridge) for ridge in RIDGES]
            power += [power_left + np.sum(x * (moment @ x - 2 * cross), axis=0) for x in beta]
            paths.append((left[:, 0], shown, beta))
        best = int(np.argmin(power[:, 0]))
        squares = [(left - shown @ beta[best][:, 0]) ** 2 for left, shown, beta in paths]
        return Score(signals, power.min(axis=0), RIDGES[best], self._in_order(squares), reach)

    def _in_order(self, parts: Sequence[FloatArray]) -> FloatArray:
        out = np.zeros(len(self._rows.rows))
        for split, part in zip(self._rows.splits, parts, strict=True):
            out[split.left] = part
        return out


def _best(scores: Sequence[Score]) -> Score:
    """The one that predicts the first target best; every surrogate had the same choice."""
    best = min(scores, key=lambda score: float(score.power[0]))
    return replace(best, power=np.min([score.power for score in scores], axis=0))


MOST_PADS = 6
"""Times that a ridge is raised tenfold where rounding has made the moments indefinite."""


class RidgePath:
    """Ridge solutions of columns B (n, p) beside the declared model, which takes `taken` (rank, p) of them.

    ``targets`` (n, n_targets) are residuals of the declared model, so they are not projected again.
    """

    def __init__(self, columns: FloatArray, taken: FloatArray, targets: FloatArray) -> None:
        self._gram = columns.T @ columns - taken.T @ taken
        self._moment = columns.T @ targets
        # Columns that the declared model takes whole leave rounding, which must not be fitted.
        power = max(float(np.trace(self._gram)), ABSORBED * float(np.sum(columns**2)))
        self._unit = max(power / len(columns), 1e-300)

    def at(self, ridge: float) -> FloatArray:
        """Coefficients (p, n_targets)."""
        from scipy.linalg.lapack import dposv  # thousands of small systems: checks would cost more than they

        for _ in range(MOST_PADS):
            padded = self._gram.copy()
            padded.flat[:: len(padded) + 1] += ridge * self._unit
            _, beta, failed = dposv(padded, self._moment)
            if not failed:
                return np.asarray(beta)
            ridge *= 10  # the difference of two moments may be rounding where the declared model takes nearly all
        raise np.linalg.LinAlgError("the products' moments are not positive definite")


def _targets(split: Split, surrogates: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Residuals of the fitted rows and of those left out, (n, n_targets) each, the declared model taken off."""
    fitted, left = split.e_fitted[:, None], split.e_left[:, None]
    if surrogates is None:
        return fitted, left
    taken = split.taken.T @ surrogates[split.fitted]
    return (
        np.column_stack([fitted, surrogates[split.fitted] - split.taken @ taken]),
        np.column_stack([left, split.weighed(surrogates[split.left]) - split.elsewhere @ taken]),
    )
