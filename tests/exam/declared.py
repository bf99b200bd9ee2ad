"""What the declared model can imitate, in a low band: links, rotors, offsets, friction that turns round as it does.

Whatever a world contains is projected on the columns that a perfect declared model would have: the file's geometry, the
true motion, Coulomb's sign rounded as it is, wider, or by another law. What is left of a thing can be found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.signal import firwin, upfirdn

from exam.draw import SIGN_LAWS
from exam.world import States, World, inverse_dynamics, rounded

FloatArray = NDArray[np.float64]

CUTOFF, WINDOW = 6.0, 0.2
"""Band [Hz], and half the length of the filter [s]."""
COARSE, ROWS = 60.0, 20.0
"""Links' columns are computed this often, and rows are kept this often, about [Hz]."""
AT_REST = 2e-3
"""A joint slower than this stands still: those rows say nothing of it [rad/s]."""
RIDGE = 1e-11
"""Directions of the columns weaker than this, in power and of the strongest, are none."""


@dataclass(frozen=True)
class Band:
    """Low-pass and decimation of one run: whatever is linear stays so, since every column passes the same way."""

    rate: float

    @property
    def step(self) -> int:
        """Samples from one coarse instant to the next."""
        return max(1, int(self.rate / COARSE))

    @property
    def rows_step(self) -> int:
        """Coarse instants from one row to the next."""
        return max(1, round(self.rate / self.step / ROWS))

    @property
    def half(self) -> int:
        """Coarse instants that the filter reaches to either side."""
        return max(2, round(WINDOW * self.rate / self.step))

    def rows(self, x: FloatArray) -> FloatArray:
        """Rows of samples (n, ...)."""
        return self._filtered(x, self.half * self.step, self.step * self.rows_step, self.rate)

    def coarse(self, x: FloatArray) -> FloatArray:
        """Low-passed samples at coarse instants, the filter's length cut off at both ends."""
        return self._filtered(x, self.half * self.step, self.step, self.rate)

    def rows_of_coarse(self, x: FloatArray) -> FloatArray:
        """Rows of what was computed at coarse instants only."""
        return self._filtered(x, self.half, self.rows_step, self.rate / self.step)

    def instants(self, n: int) -> NDArray[np.intp]:
        """Which of `n` samples the rows stand at."""
        reach = self.half * self.step
        return np.arange(reach, n - reach, self.step * self.rows_step)

    @staticmethod
    def _filtered(x: FloatArray, half: int, step: int, rate: float) -> FloatArray:
        taps = firwin(2 * half + 1, CUTOFF, fs=rate, window="blackman")  # alike at every rate, to 1e-4
        n = -(-(len(x) - 2 * half) // step)
        # The first full overlap is output 2 half; leading zeros put it on a multiple of the step.
        lead = -2 * half % step
        padded = np.concatenate([np.zeros((lead, *x.shape[1:])), x])
        first = (2 * half + lead) // step
        return upfirdn(taps, padded, down=step, axis=0)[first : first + n]


@dataclass(frozen=True, eq=False)
class Declared:
    """Columns of the declared model on the rows of the training runs, weighted by one over the noise."""

    columns: FloatArray
    weights: FloatArray
    groups: NDArray[np.intp]

    @cached_property
    def _factor(self) -> FloatArray:
        """Inverse square root of the columns' power, over the directions that there are."""
        power, directions = np.linalg.eigh(self.columns.T @ self.columns)
        there = power > RIDGE * power[-1]
        return directions[:, there] / np.sqrt(power[there])

    @property
    def rank(self) -> int:
        """Directions that the columns span."""
        return self._factor.shape[1]

    def weighted(self, part: FloatArray) -> FloatArray:
        """Rows (n_rows * n_joints,) over the noise."""
        return (part * self.weights).ravel()

    def own(self, part: FloatArray) -> FloatArray:
        """What the columns cannot imitate of rows (n_rows, n_joints), over the noise; the same shape."""
        rest = self.weighted(part)
        for _ in range(2):  # the second time takes what rounding has left
            rest = rest - self.columns @ (self._factor @ (self._factor.T @ (self.columns.T @ rest)))
        return rest.reshape(part.shape)

    def ratio(self, part: FloatArray) -> FloatArray:
        """RMS per joint (n_joints,) of what cannot be imitated, over the noise."""
        own = self.own(part)
        counted = np.maximum(np.count_nonzero(self.weights, axis=0), 1)
        return np.sqrt(np.sum(own**2, axis=0) / counted)


def declare(world: World, noise: FloatArray) -> Declared:
    """Return the columns of the training runs; `noise` (n_joints,) [N m] is its RMS in the band."""
    band = Band(world.case.rate)
    blocks, weights, groups = [], [], []
    for run, dense in enumerate(world.train):
        s = dense.recorded
        n = len(s.t)
        links = band.rows_of_coarse(_links(world, s.at(slice(None, None, band.step))))
        own = band.rows(_own(world, s))
        rows = band.instants(n)[: min(len(links), len(own))]
        links, own = links[: len(rows)], own[: len(rows)]
        moving = np.abs(s.dq_motor[rows]) > AT_REST
        weight = moving / noise
        block = np.zeros((len(rows), world.case.n_joints, links.shape[2] + world.case.n_joints * own.shape[2]))
        block[:, :, : links.shape[2]] = links
        for j in range(world.case.n_joints):
            first = links.shape[2] + j * own.shape[2]
            block[:, j, first : first + own.shape[2]] = own[:, j]
        blocks.append((block * weight[:, :, None]).reshape(-1, block.shape[2]))
        weights.append(weight)
        groups.append(np.full(len(rows), run))
    columns = np.vstack(blocks)
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return Declared(columns, np.vstack(weights), np.concatenate(groups))


def rows_of(world: World, parts: list[FloatArray]) -> FloatArray:
    """Rows of the training runs of what was computed at every recorded sample, (n, n_joints) per run."""
    band = Band(world.case.rate)
    return np.vstack([band.rows(part)[: len(band.instants(len(part)))] for part in parts[: world.case.n_train]])


def at_rows(world: World, states: States) -> States:
    """The instants of a run at which its rows stand."""
    s = states.recorded
    return s.at(Band(world.case.rate).instants(len(s.t)))


def rows_of_smooth(world: World, part: Callable[[States], FloatArray]) -> FloatArray:
    """Rows of the training runs of what follows from the links' motion: computed at coarse instants only."""
    band, rows = Band(world.case.rate), []
    for dense in world.train:
        s = dense.recorded
        rows.append(band.rows_of_coarse(part(s.at(slice(None, None, band.step))))[: len(band.instants(len(s.t)))])
    return np.vstack(rows)


def _links(world: World, s: States) -> FloatArray:
    """Columns (n, n_joints, 10 n_joints) of the links' parameters; in amperes each joint's gain is free besides."""
    data = world.model.createData()
    columns = np.array(
        [
            pin.computeJointTorqueRegressor(world.model, data, *state).copy()
            for state in zip(s.q, s.dq, s.ddq, strict=True)
        ]
    )
    if not world.case.current:
        return columns
    rigid = inverse_dynamics(world.model, s.q, s.dq, s.ddq)
    return np.concatenate([columns, rigid[:, :, None] * np.eye(world.case.n_joints)], axis=2)


def _own(world: World, s: States) -> FloatArray:
    """Columns (n, n_joints, 13) of a joint's own terms: friction of two directions, its rounding, rotor, offset."""
    sign, v = world.sign(s.dq_motor), s.dq_motor
    wider = replace(world, width=1.1 * world.width).sign(v) - sign
    laws = [rounded(law, v / world.width) - sign for law in SIGN_LAWS if law != world.case.sign_law]
    forward, backward = v > 0, v < 0
    terms = (sign, v, v * np.abs(v), v**3)
    sided = [term * side for term in terms for side in (forward, backward)]
    return np.stack([*sided, wider, *laws, s.ddq_motor, np.ones_like(v)], axis=2)
