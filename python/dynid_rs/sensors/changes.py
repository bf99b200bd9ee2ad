"""Changes of channels that might explain recordings: signs, orders, in all runs or in one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.runs.checks.excitation import TOGETHER
from dynid_rs.runs.checks.motion import correlation
from dynid_rs.sensors.arm import Arm
from dynid_rs.sensors.fit import ArmFit, ArmPrior, fit_arm, fit_arms
from dynid_rs.sensors.rows import ArmRows, Moments
from dynid_rs.sensors.weighed import Weighed

FloatArray = NDArray[np.float64]

QUARTERS = (1, 2, -1)
"""Quarter turns between two zeros of a joint: those are a matter of convention, and controllers differ in it."""
HARDLY = 1e-4
"""Power of the weight along one direction, over that along the one felt most, up to which it is not felt."""
MOST_ODD = 4
"""Runs of a set that are looked at one by one."""


@dataclass(frozen=True, eq=False)
class Bench:
    """Runs of one arm, and what they look like under its model as they stand."""

    arm: Arm
    rows: tuple[ArmRows, ...]
    given: tuple[Moments, ...] | None = None
    """Moments of the runs, where something else tells them."""

    @property
    def robot(self) -> _core.RobotModel:
        """As declared, under the bench's gravity."""
        return self.arm.robot

    @cached_property
    def prior(self) -> ArmPrior:
        """What the robot file says of the links."""
        return ArmPrior.of(self.arm)

    @cached_property
    def size(self) -> FloatArray:
        """Standard deviation of every torque channel over all runs, (n_joints,)."""
        tau = np.concatenate([rows.tau for rows in self.rows])
        size: FloatArray = np.maximum(tau.std(axis=0), 1e-12 * max(float(np.abs(tau).max()), 1e-300))
        return size

    @cached_property
    def moments(self) -> tuple[Moments, ...]:
        """Moments of the runs, all channels."""
        return self.given or tuple(Moments.of(self.arm, rows) for rows in self.rows)

    def turned(self, gravity: FloatArray) -> Bench:
        """The runs under another gravity (3,) [m/s^2], without another pass over them."""
        moments = tuple(run.moments(gravity) for run in self._weighed)
        return Bench(self.arm.with_gravity(gravity), self.rows, moments)

    @cached_property
    def felt(self) -> FloatArray:
        """Directions of gravity that some torque shows, whatever the links weigh, (at most 3, 3); orthonormal."""
        power = np.sum([np.einsum("jakbk->ab", run.weight) for run in self._weighed], axis=0)
        values, vectors = np.linalg.eigh(power)
        felt: FloatArray = vectors.T[values > HARDLY * values[-1]]
        return felt

    @cached_property
    def _weighed(self) -> tuple[Weighed, ...]:
        return tuple(Weighed.of(self.arm, rows) for rows in self.rows)

    @cached_property
    def plain(self) -> tuple[Moments, ...]:
        """The runs as they stand: every joint with its own channel."""
        return tuple(moments.picked(range(self.robot.n_joints)) for moments in self.moments)

    @cached_property
    def fit(self) -> ArmFit:
        """The model as it stands."""
        return self.fitted(self.plain)

    def fitted(self, runs: Sequence[Moments], size: FloatArray | None = None) -> ArmFit:
        """Fit changed runs."""
        return fit_arm(self.prior, runs, self.size if size is None else size)

    @property
    def places(self) -> list[tuple[int, ...]]:
        """Where a change may be: all runs, or one of those that are explained worst."""
        whole = tuple(range(len(self.rows)))
        return [whole] if len(whole) == 1 else [whole, *((k,) for k in self.odd)]

    @cached_property
    def odd(self) -> tuple[int, ...]:
        """The runs that the common model explains worst, (at most `MOST_ODD`,): a lone bad run is one of them."""
        worst = np.argsort(-np.max(self.fit.run_shares, axis=1), kind="stable")
        return tuple(sorted(worst[:MOST_ODD].tolist()))

    def moves_alone(self, j: int) -> bool:
        """Whether no other joint moves as joint j does on all runs, and would explain what it does."""
        others = (k for k in range(self.robot.n_joints) if k != j)
        return not any(
            all(abs(correlation(rows.dq[:, j], rows.dq[:, k])) > TOGETHER for rows in self.rows) for k in others
        )


@dataclass(frozen=True, eq=False)
class Trial:
    """A change that was tried: its code, the joints it concerns, the runs, and the fit with it."""

    code: str
    joints: tuple[int, ...]
    runs: tuple[int, ...]
    fit: ArmFit
    shift: float = 0.0
    """What was added to the position of the joint [rad]."""


def wiring_trials(bench: Bench) -> Iterator[Trial]:
    """Every sign, every exchange of two joints' torques, positions, or both, other zeros, and positions in degrees."""
    n = bench.robot.n_joints
    alone = [bench.moves_alone(j) for j in range(n)]
    positions, elsewhere = None, bench.moments
    for layout in _layouts(bench.robot.joint_kinds):
        if layout.code.endswith(("_swapped", "_shifted")) and not all(alone[j] for j in layout.joints):
            continue
        if layout.positions not in (None, positions):  # several layouts have the same positions
            positions = layout.positions
            elsewhere = tuple(Moments.of(bench.arm, layout.positions(rows)) for rows in bench.rows)
        moments = bench.moments if layout.positions is None else elsewhere
        changed = [run.picked(layout.channels, layout.sign) for run in moments]
        tried = [[changed[k] if k in runs else plain for k, plain in enumerate(bench.plain)] for runs in bench.places]
        for runs, fit in zip(bench.places, fit_arms(bench.prior, tried, bench.size), strict=True):
            yield Trial(layout.code, layout.joints, runs, fit, layout.shift)


class Layout(NamedTuple):
    """Channels otherwise: the torque channel of every joint and its sign, and what is done to the positions."""

    code: str
    joints: tuple[int, ...]
    channels: list[int]
    sign: FloatArray
    positions: Callable[[ArmRows], ArmRows] | None = None
    shift: float = 0.0


def _layouts(kinds: Sequence[str]) -> Iterator[Layout]:
    n = len(kinds)
    as_it_is, ones, whole = list(range(n)), np.ones(n), tuple(range(n))
    yield Layout("units_degrees", whole, as_it_is, ones, partial(ArmRows.scaled, factor=np.pi / 180))
    yield Layout("torque_flipped", whole, as_it_is, -ones)
    for j in range(n):
        sign = np.where(np.arange(n) == j, -1.0, 1.0)
        turned = partial(ArmRows.turned, factors=sign)
        yield Layout("torque_flipped", (j,), as_it_is, sign)
        yield Layout("position_flipped", (j,), as_it_is, ones, turned)
        yield Layout("joint_flipped", (j,), as_it_is, sign, turned)
        # Another zero of the first joint is another mounting of the base, or nothing that a torque could show.
        for shift in (quarters * np.pi / 2 for quarters in QUARTERS if j and kinds[j] != "prismatic"):
            yield Layout("zero_shifted", (j,), as_it_is, ones, partial(ArmRows.shifted, j=j, by=shift), shift)
    for a, b in combinations(range(n), 2):
        order = list(range(n))
        order[a], order[b] = b, a
        exchanged = partial(ArmRows.ordered, order=order)
        yield Layout("torque_swapped", (a, b), order, ones)
        yield Layout("position_swapped", (a, b), as_it_is, ones, exchanged)
        yield Layout("joints_swapped", (a, b), order, ones, exchanged)
