"""First loop: the friction of every joint (Eqs. 9-12).

For a given threshold lambda and transition width eps the eight coefficients are linear, so the search is one-dimensional
in each (variable projection): least squares inside, a scan and a refinement outside.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from dynid_rs import _core
from dynid_rs.columns import Plan
from dynid_rs.preprocessing import States

FloatArray = NDArray[np.float64]

WORTH = 0.01
"""A finer shape has to take this part off the residual's power; below it the difference is noise."""
WEAK = 1e-2
"""Directions of the links' columns weaker than this (relative singular value) are not taken out before the search:
one joint's equation alone hardly determines them, and they would swallow friction."""


class FrictionIdentifier(BaseEstimator):  # type: ignore[misc]
    """Shape of the paper's friction: threshold lambda and transition width eps per joint.

    Parameters
    ----------
    transition_widths : sequence of float
        Widths eps [rad/s] that are tried first. The paper prints 1e-4, which is below any encoder's velocity noise.
    velocity_thresholds : sequence of float
        Thresholds lambda [rad/s] that are tried first; 0 must be among them.
    refine : bool
        Refine the best width between its neighbours as long as it pays.

    Attributes
    ----------
    velocity_threshold_, transition_width_ : ndarray (n_joints,)
        Chosen shapes [rad/s].
    effect_ : Effect
        The same as an effect of the torque model.
    """

    def __init__(
        self,
        transition_widths: Sequence[float] = (1e-3, 2e-3, 4e-3, 8e-3, 1.6e-2, 3e-2),
        velocity_thresholds: Sequence[float] = (0.0, 0.02, 0.05),
        *,
        refine: bool = True,
    ) -> None:
        self.transition_widths = transition_widths
        self.velocity_thresholds = velocity_thresholds
        self.refine = refine

    def fit(
        self,
        plan: Plan,
        runs: Sequence[States],
        rows: Sequence[list[FloatArray]],
        joints: Sequence[int] | None = None,
    ) -> FrictionIdentifier:
        """Choose the shapes on training runs.

        Parameters
        ----------
        plan : Plan
            Columns of the rows; friction's own are the last eight own ones.
        runs : sequence of States
            Training runs.
        rows : sequence of list of ndarray
            Filtered rows of each run and joint, as `columns.run_rows` gives them; the torque is the last column.
        joints : sequence of int, optional
            Joints to search again; the others keep the shape of an earlier fit. All joints if None.
        """
        n = plan.robot.n_joints
        if joints is None:
            self.velocity_threshold_, self.transition_width_ = np.zeros(n), np.zeros(n)
        others = np.ones(plan.n_own, dtype=bool)
        others[-len(_core.FRICTION_NAMES) :] = False
        for j in range(n) if joints is None else joints:
            stacked = np.concatenate([run[j] for run in rows])
            keep = np.concatenate([others & plan.own[j], np.ones(stacked.shape[1] - plan.n_own - 1, dtype=bool)])
            power = _PowerLeft(stacked[:, :-1][:, keep], stacked[:, -1], runs, j)
            width = self._width(power)
            threshold = self._threshold(power, width)
            self.velocity_threshold_[j], self.transition_width_[j] = threshold, width
        self.effect_ = friction_effect(self.velocity_threshold_, self.transition_width_)
        return self

    def _width(self, power: _PowerLeft) -> float:
        """Eps at lambda = 0: scan, then golden section in the logarithm while it pays."""
        scan = sorted(self.transition_widths)
        powers = [power(0.0, width) for width in scan]
        best = int(np.argmin(powers))
        if not self.refine or power.exhausted(powers[best]):
            return float(scan[best])
        low, high = np.log(scan[max(best - 1, 0)]), np.log(scan[min(best + 1, len(scan) - 1)])
        return float(np.exp(_refine(lambda x: power(0.0, float(np.exp(x))), low, np.log(scan[best]), high, powers[best])))

    def _threshold(self, power: _PowerLeft, width: float) -> float:
        """Lambda at the chosen eps; zero unless another pays. The viscous torque jumps there, so it has to earn it."""
        without = power(0.0, width)
        if power.exhausted(without):
            return 0.0
        tried = [(power(threshold, width), threshold) for threshold in self.velocity_thresholds if threshold > 0]
        least, threshold = min(tried, default=(np.inf, 0.0))
        return float(threshold) if least < (1 - WORTH) * without else 0.0


def friction_effect(velocity_threshold: FloatArray, transition_width: FloatArray) -> _core.Effect:
    """Friction with these shapes (n_joints,) [rad/s]."""
    return _core.Effect.friction(velocity_threshold.tolist(), transition_width.tolist())


class _PowerLeft:
    """Residual power of joint j's torque as a function of friction's shape, links taken out."""

    def __init__(self, links: FloatArray, tau: FloatArray, runs: Sequence[States], j: int) -> None:
        norms = np.linalg.norm(links, axis=0)
        links = links[:, norms > 1e-9 * norms.max(initial=0.0)]
        left, strength, _ = np.linalg.svd(links / np.linalg.norm(links, axis=0), full_matrices=False)
        self._links = left[:, strength > WEAK * strength.max(initial=0.0)]
        self._tau = self._without_links(tau)
        self._total = float(tau @ tau)
        self._runs = runs
        self._speeds = [np.ascontiguousarray(states.dq_motor[:, j]) for states in runs]

    def __call__(self, threshold: float, width: float) -> float:
        columns = self._without_links(
            np.concatenate(
                [
                    _core.filtered_friction_basis(
                        speed, threshold, width, filter=states.filter, kept=states.rows.tolist()
                    )
                    for speed, states in zip(self._speeds, self._runs, strict=True)
                ]
            )
        )
        norms = np.linalg.norm(columns, axis=0)
        columns = columns[:, norms > 1e-9 * norms.max(initial=0.0)] / norms[norms > 1e-9 * norms.max(initial=0.0)]
        gram = columns.T @ columns
        # Eight unit columns: eigenvalues resolve what a search needs, at a fraction of an SVD of all rows.
        values, vectors = np.linalg.eigh(gram)
        good = values > 1e-10 * values.max(initial=0.0)
        part = (columns @ vectors[:, good]) / np.sqrt(values[good])
        left = self._tau - part @ (part.T @ self._tau)
        return float(left @ left)

    def exhausted(self, power: float) -> bool:
        """Nothing left to explain, as in a simulation without noise."""
        return power <= 1e-24 * self._total

    def _without_links(self, x: FloatArray) -> FloatArray:
        return x - self._links @ (self._links.T @ x)


def _refine(function: Callable[[float], float], low: float, best: float, high: float, at_best: float) -> float:
    """Golden-section steps inside (low, high) around `best`, as long as a round of them still pays."""
    ratio = (np.sqrt(5) - 1) / 2
    for _ in range(40):
        before = at_best
        for _ in range(4):
            step = best + (1 - ratio) * (high - best) if high - best > best - low else best - (1 - ratio) * (best - low)
            value = function(step)
            if value < at_best:
                low, high = (best, high) if step > best else (low, best)
                best, at_best = step, value
            else:
                low, high = (low, step) if step > best else (step, high)
        if at_best > (1 - WORTH) * before:
            break
    return best
