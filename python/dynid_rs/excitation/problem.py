"""What is searched: an objective with its exact gradient, and what must be kept, as functions of free coefficients."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.excitation.bounds import GRID, MotionBounds
from dynid_rs.excitation.constraints import Constraint, Motion
from dynid_rs.excitation.limits import ExcitationLimits
from dynid_rs.excitation.series import FourierSeries

if TYPE_CHECKING:
    from dynid_rs._core import BaseParameters, RobotModel

FloatArray = NDArray[np.float64]

CRITERIA = ("block", "condition", "D", "A")
N_REFERENCE = 8
"""Random trajectories that the weights of Eq. 14 are taken from; always the same ones, so that all restarts agree."""
SHRINK_STEPS = 12
DRAW_STEPS = 5
"""Bisections for the largest share of a motion that keeps every constraint: of an answer, of a random motion."""
LEAST_SHARE = 0.05
"""A motion that keeps them only when it is made smaller than this is none."""


class Problem:
    """One excitation problem (Eq. 16); shared by all restarts, changed by none.

    The unknowns `x` (n_free, n_joints) are what Eq. 18 leaves free; any `x` starts and ends at rest in `start`.

    Parameters
    ----------
    robot : RobotModel
        The arm.
    base : BaseParameters
        Its base columns.
    series : FourierSeries
        The motions.
    t : ndarray (n_samples,)
        Sampling instants of the objective [s].
    limits, start : ExcitationLimits, ndarray (n_joints,)
        What every joint may do, and where it starts.
    criterion : str
        One of `CRITERIA`.
    whitening : ndarray (n_joints, n_joints), optional
        Omega^(-1/2) of Eq. 13.
    constraints : sequence of Constraint
        What else must be kept.
    """

    def __init__(
        self,
        robot: RobotModel,
        base: BaseParameters,
        series: FourierSeries,
        t: FloatArray,
        limits: ExcitationLimits,
        start: FloatArray,
        *,
        criterion: str,
        whitening: FloatArray | None,
        constraints: Sequence[Constraint],
    ) -> None:
        self.robot, self.series, self.start, self.limits = robot, series, start, limits
        self.criterion, self.constraints = criterion, tuple(constraints)
        self.bounds = MotionBounds(series, limits, start)
        self.excitation = _core.Excitation(robot, base.pivots.tolist(), whitening=whitening)
        self._n_base = base.n_base
        self._samples = series.matrices(t)
        grid = np.linspace(0.0, series.duration, GRID * series.n_harmonics, endpoint=False)
        self._grids = [series.matrices(grid[:: constraint.stride]) for constraint in self.constraints]
        self.weights = self._block_weights() if criterion == "block" else None
        self._identity = [t, start, whitening]

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of the unknowns: (n_free, n_joints)."""
        return self.series.n_free, self.start.size

    def motion(self, x: FloatArray) -> Motion:
        """Position, velocity and acceleration at the sampling instants."""
        return self._at(self._samples, x)

    def value(self, x: FloatArray) -> float:
        """Objective in its own units; smaller is better."""
        return self.excitation.value(*self.motion(x), criterion=self.criterion, weights=self.weights)

    def smooth(self, x: FloatArray) -> tuple[float, FloatArray]:
        """What the optimiser sees, and its slope in `x`: the logarithm, so that steps do not depend on the scale."""
        value, slopes = self.excitation.value_and_gradient(
            *self.motion(x), criterion=self.criterion, weights=self.weights
        )
        gradient = _pulled_back(self._samples, slopes)
        if self.criterion == "D":
            return value / self._n_base, gradient / self._n_base
        return float(np.log(value)), gradient / value

    def rooms(self, x: FloatArray) -> FloatArray:
        """Smooth room left by every bound and constraint; the search keeps it above zero."""
        extra = [
            c.smooth_room(self._at(m, x), slopes=False)[0] for c, m in zip(self.constraints, self._grids, strict=True)
        ]
        return np.concatenate([self.bounds.values(x), extra])

    def room_slopes(self, x: FloatArray) -> FloatArray:
        """Slopes of `rooms`: (n, n_free, n_joints)."""
        extra = [
            _pulled_back(m, c.smooth_room(self._at(m, x), slopes=True)[1])[None]
            for c, m in zip(self.constraints, self._grids, strict=True)
        ]
        return np.concatenate([self.bounds.jacobian(x), *extra])

    def repaired(self, x: FloatArray) -> FloatArray | None:
        """Return the largest share of the motion `x` that keeps everything exactly; None where hardly any does."""
        x = x / max(1.0, float(self.bounds.usage(x).max()) * (1 + 1e-9))
        return _shrunk(x, self._kept, SHRINK_STEPS)

    def drawn(self, rng: np.random.Generator) -> FloatArray | None:
        """Random motion that uses its limits and keeps the constraints, to the accuracy of the search."""
        x = self.bounds.roughly_scaled(rng.standard_normal(self.shape))
        return _shrunk(x, self.smoothly_kept, DRAW_STEPS)

    def identity(self) -> str:
        """Hash of everything that the answer of a restart depends on, but its number."""
        robot, numbers = self.robot, np.random.default_rng(0).uniform(-1, 1, (3, 2, self.start.size))
        parts = [
            robot.joint_names,
            self.criterion,
            self.series.n_harmonics,
            repr(self.series.duration),
            [constraint.describe() for constraint in self.constraints],
        ]
        digest = hashlib.sha256(json.dumps(parts).encode())
        limits = (self.limits.position, self.limits.velocity, self.limits.acceleration)
        # The regressor at some states says what the robot's geometry is.
        for array in (*self._identity, *limits, robot.joint_torque_regressor(*numbers), robot.phi):
            digest.update(b"none" if array is None else np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    def _at(self, matrices: Motion, x: FloatArray) -> Motion:
        position, velocity, acceleration = (matrix @ x for matrix in matrices)
        return position + self.start, velocity, acceleration

    def inside(self, x: FloatArray) -> FloatArray | None:
        """Every joint's motion made smaller until it keeps its limits; None where a constraint is still violated."""
        x = x / np.maximum(1.0, self.bounds.usage(x).max(axis=0) * (1 + 1e-9))
        return x if self.smoothly_kept(x) else None

    def smoothly_kept(self, x: FloatArray) -> bool:
        """Whether the constraints beside the limits are kept, to the accuracy of the search."""
        pairs = zip(self.constraints, self._grids, strict=True)
        return all(constraint.smooth_room(self._at(m, x), slopes=False)[0] >= 0 for constraint, m in pairs)

    def _kept(self, x: FloatArray) -> bool:
        trajectory = self.series.trajectory(x, self.start)
        return all(c.exact_room(trajectory.evaluate(self.series.grid(c.fine_step))) >= 0 for c in self.constraints)

    def _block_weights(self) -> tuple[float, float, float]:
        """Weights of Eq. 14: mean variance of the columns of each block, together one."""
        rng = np.random.default_rng(0)
        variances = np.zeros(3)
        for _ in range(N_REFERENCE):
            x = self.bounds.roughly_scaled(rng.standard_normal(self.shape))
            blocks = self.excitation.blocks(*self.motion(x))
            variances += [block.var(axis=0).mean() for block in blocks]
        a, b, g = (variances / variances.sum()).tolist()
        return a, b, g


def _shrunk(x: FloatArray, kept: Callable[[FloatArray], bool], n_steps: int) -> FloatArray | None:
    """Return the largest share of `x` that is kept, by bisection towards the start; None where that is nothing."""
    if kept(x):
        return x
    low, high = 0.0, 1.0
    for _ in range(n_steps):
        middle = (low + high) / 2
        low, high = (middle, high) if kept(middle * x) else (low, middle)
    return low * x if low > LEAST_SHARE else None


def _pulled_back(matrices: Motion, slopes: Motion) -> FloatArray:
    """Slope in the coefficients from slopes in q, dq, ddq: the series is linear."""
    return np.asarray(sum(matrix.T @ slope for matrix, slope in zip(matrices, slopes, strict=True)))
