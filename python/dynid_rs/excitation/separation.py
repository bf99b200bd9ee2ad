"""How well a motion tells two effects apart: the torque of one that neither the declared model nor the other imitates.

Everything is compared in the band of the fit, because that is where the data will be: columns run along the motion,
through the filter of `preprocessing`, and are decimated as rows of a fit are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.excitation.shapes import ShapedEffect
from dynid_rs.runs.preprocessing import ROW_RATE, Band
from dynid_rs.simulation.trajectory import FourierTrajectory

if TYPE_CHECKING:
    from dynid_rs._core import BaseParameters, RobotModel
    from dynid_rs.excitation.constraints import Motion

FloatArray = NDArray[np.float64]

CUTOFF = 5.0
"""Band [Hz] of the fit: what `choose_band` takes for motions this slow."""
RATE = 50.0
"""Samples per second along the motion; friction's corners live above the band."""
WIDTHS = (3e-3, 1e-2, 3e-2)
"""Transition widths [rad/s] of the declared friction, all at once: its own width is free in a fit."""
WEAK = 1e-3
"""Directions of a joint's own declared columns weaker than this (relative) imitate nothing: friction of three widths at
once could, with coefficients that no joint has."""
SINGULAR = 1e-9
"""Directions of the base columns weaker than this are rounding."""
SOFT = 4.0
"""Power of the mean that stands for the smallest."""
HOPELESS = 1e-8
"""Part of an effect's power that is left where nothing tells it: rounding, and what `SINGULAR` drops."""
WILD = 5
"""Harmonics of a motion that nothing is special about, of about 1 rad/s each."""
NOTHING = 1e-12
"""Power below this part of the column's own is rounding."""


@dataclass(frozen=True)
class Power:
    """What of an effect's torque nothing else imitates, per unit coefficient.

    Parameters
    ----------
    left : float
        Mean square per sample that neither the declared columns nor the other effect imitates.
    declared : float
        The same without the other effect.
    whole : float
        Of the effect itself.
    imitator : int
        Shape of the other effect that imitates best.
    """

    left: float
    declared: float
    whole: float
    imitator: int


@dataclass(frozen=True)
class _Rest:
    """What is left of one effect beside each shape of the other, and these by how well they imitate it."""

    power: Power
    left: FloatArray
    ranked: list[int]


class Separation:
    """Two effects beside the declared model of a robot.

    Parameters
    ----------
    robot, base : RobotModel, BaseParameters
        The arm and its base columns.
    a, b : ShapedEffect
        What is to be told apart; each stands by its first shape and imitates the other with all of them.
    duration : float
        Of the motions [s].

    Raises
    ------
    ValueError
        Both are the same kind at the same place, or the motions are too short for the band.
    """

    def __init__(
        self, robot: RobotModel, base: BaseParameters, a: ShapedEffect, b: ShapedEffect, duration: float
    ) -> None:
        if (a.effect.kind, set(a.effect.joints)) == (b.effect.kind, set(b.effect.joints)):
            raise ValueError(
                f"--separate: both are {a.effect.kind} at the same place, which only their shapes tell apart; "
                "name two kinds or two joints"
            )
        self.robot, self.pair = robot, (a, b)
        self._pivots = base.pivots.tolist()
        self._n_base = base.n_base
        self._band = Band(CUTOFF)
        self.t = np.arange(round(duration * RATE)) / RATE
        guard, step = int(RATE / CUTOFF), int(RATE / (ROW_RATE * CUTOFF))
        self._rows = np.arange(guard, len(self.t) - guard, step)
        if len(self._rows) < 20:
            raise ValueError(f"--separate needs a longer motion than {duration:g} s; raise --duration")

    @property
    def is_hopeless(self) -> bool:
        """Whether no motion tells the two: one that nothing is special about leaves no more of them than rounding."""
        rng, n = np.random.default_rng(0), self.robot.n_joints
        fundamental = 2 * np.pi / (len(self.t) / RATE)
        sines, cosines = rng.normal(size=(2, WILD, n))
        wild = FourierTrajectory(rng.uniform(-np.pi, np.pi, n), sines, cosines, fundamental, rest=0.0)
        return any(power.left <= HOPELESS * power.whole for power in self.powers(wild, ([0], [0])))

    def powers(
        self,
        trajectory: FourierTrajectory,
        imitators: tuple[Sequence[int], Sequence[int]] | None = None,
    ) -> tuple[Power, Power]:
        """What is left of the first effect, and of the second; `imitators` limits the shapes (all by default)."""
        first, second = self._rest(trajectory, imitators)
        return first.power, second.power

    def soft_score(self, trajectory: FourierTrajectory, imitators: tuple[Sequence[int], Sequence[int]]) -> float:
        """Logarithm of the geometric mean of what is left of both, smooth in the motion.

        The smallest over the imitators is replaced by a power mean, so that a search has slopes to follow.
        """
        rests = self._rest(trajectory, imitators)
        return float(np.mean([_soft_least(rest.left) for rest in rests]))

    def ranked_imitators(self, trajectory: FourierTrajectory) -> tuple[list[int], list[int]]:
        """Shapes of the first effect, then of the second, by how well they imitate the other one."""
        of_first, of_second = self._rest(trajectory, None)
        return of_second.ranked, of_first.ranked

    def _rest(
        self, trajectory: FourierTrajectory, imitators: tuple[Sequence[int], Sequence[int]] | None
    ) -> tuple[_Rest, _Rest]:
        shapes = [list(range(len(effect.shapes))) for effect in self.pair] if imitators is None else imitators
        chosen = [[0, *(k for k in some if k != 0)] for some in shapes]
        motion = trajectory.evaluate(self.t)
        columns = [
            {j: self._in_band(x) for j, x in effect.columns(motion, some, 1 / RATE).items()}
            for effect, some in zip(self.pair, chosen, strict=True)
        ]
        plain, left = self._gram(motion, columns)
        edges = np.cumsum([0, *(next(iter(x.values())).shape[1] for x in columns)])
        blocks = [np.arange(edges[i], edges[i + 1]).reshape(len(chosen[i]), -1) for i in range(2)]
        n = len(self._rows)
        return (
            _rest_of(plain, left, blocks[0][0], blocks[1], chosen[1], n),
            _rest_of(plain, left, blocks[1][0], blocks[0], chosen[0], n),
        )

    def _in_band(self, columns: FloatArray) -> FloatArray:
        return self._band.apply(columns, RATE)[self._rows].reshape(len(self._rows), -1)

    def _gram(self, motion: Motion, columns: Sequence[dict[int, FloatArray]]) -> tuple[FloatArray, FloatArray]:
        """Products of all effect columns over all joints: as they are, and beside the declared columns."""
        width = [next(iter(x.values())).shape[1] for x in columns]
        total = sum(width)
        plain, base_products = np.zeros((total, total)), np.zeros((self._n_base, total))
        base_gram, left = np.zeros((self._n_base, self._n_base)), np.zeros((total, total))
        for j, (own, base) in enumerate(self._declared(motion)):
            x = np.zeros((len(self._rows), total))
            for first, part in zip((0, width[0]), columns, strict=True):
                if j in part:
                    x[:, first : first + part[j].shape[1]] = part[j]
            plain += x.T @ x
            basis = _basis(own)
            base = base - basis @ (basis.T @ base)
            x = x - basis @ (basis.T @ x)
            base_gram += base.T @ base
            base_products += base.T @ x
            left += x.T @ x
        scale = np.sqrt(np.maximum(np.diag(base_gram), 1e-300))
        values, vectors = np.linalg.eigh(base_gram / np.outer(scale, scale))
        kept = values > SINGULAR * values[-1]
        part = (vectors[:, kept] / np.sqrt(values[kept])).T @ (base_products / scale[:, None])
        return plain, left - part.T @ part

    def _declared(self, motion: Motion) -> list[tuple[FloatArray, FloatArray]]:
        """Per joint own and base columns of the declared model, in the band, (n_rows, ...) each."""
        n = self.robot.n_joints
        rotor, offset = _core.Effect.rotor_inertia(), _core.Effect.torque_offset()
        friction = [_core.Effect.friction([0.0] * n, [width] * n) for width in WIDTHS]
        effects = [rotor, offset, *friction]
        q, dq, ddq = motion
        joints = _core.observe(
            self.robot,
            effects,
            self._pivots,
            q,
            dq,
            ddq,
            q,
            dq,
            ddq,
            np.zeros_like(q),
            filter=self._band.design(RATE),
            kept=self._rows.tolist(),
            step=1 / RATE,
        )
        n_own = sum(effect.n_columns for effect in effects)
        found = []
        for j, rows in enumerate(joints):
            base = np.zeros((len(rows), self._n_base))
            moved = np.flatnonzero(np.asarray(self._pivots) >= 10 * j)
            base[:, moved] = rows[:, n_own:-1]
            found.append((rows[:, :n_own], base))
        return found


def _rest_of(
    plain: FloatArray,
    left: FloatArray,
    own: NDArray[np.intp],
    others: NDArray[np.intp],
    shapes: Sequence[int],
    n_rows: int,
) -> _Rest:
    """Beside the declared columns and one shape of the other effect after the other (rows of `others`)."""
    declared, whole = (float(np.trace(gram[np.ix_(own, own)])) for gram in (left, plain))
    rest = np.array([declared - _imitated(left, plain, own, shape) for shape in others])
    n = n_rows * len(own)
    rest = np.maximum(rest, NOTHING * whole) / n
    order = np.argsort(rest, kind="stable")
    power = Power(float(rest[order[0]]), declared / n, whole / n, shapes[order[0]])
    return _Rest(power, rest, [shapes[k] for k in order])


def _soft_least(left: FloatArray) -> float:
    """Logarithm of a smooth minimum, no larger than the minimum itself."""
    least = np.maximum(left.min(), 1e-300)
    return float(np.log(least) - np.log(np.sum((np.maximum(left, 1e-300) / least) ** -SOFT)) / SOFT)


def _basis(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of the columns, without their weak directions."""
    norms = np.linalg.norm(columns, axis=0)
    scaled = columns[:, norms > 0] / norms[norms > 0]
    left, values, _ = np.linalg.svd(scaled, full_matrices=False)
    basis: FloatArray = left[:, values > WEAK * values[0]] if len(values) else left
    return basis


def _imitated(left: FloatArray, plain: FloatArray, own: NDArray[np.intp], other: NDArray[np.intp]) -> float:
    """Power of the columns `own` that the columns `other` take away, all of them beside the declared model."""
    gram = left[np.ix_(other, other)]
    size = np.sqrt(np.maximum(np.diag(plain)[other], 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    kept = values > NOTHING
    part = (vectors[:, kept] / np.sqrt(values[kept])).T @ (left[np.ix_(other, own)] / size[:, None])
    return float(np.sum(part**2))
