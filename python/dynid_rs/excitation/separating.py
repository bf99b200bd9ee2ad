"""Search for a motion that tells two effects apart, around the motion that excites the parameters best."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.excitation.named import NamedEffect
from dynid_rs.excitation.separation import Power, Separation
from dynid_rs.excitation.shapes import ShapedEffect

if TYPE_CHECKING:
    from dynid_rs.excitation.fourier import FourierExcitation
    from dynid_rs.excitation.problem import Problem
    from dynid_rs.simulation import FourierTrajectory

FloatArray = NDArray[np.float64]
Powers = tuple[Power, Power]

N_DRAWS = 24
"""Random motions from which the local searches start, beside the exciting one."""
N_SEARCHES = 3
STEPS_PER_ROUND = 25
"""Of `max_iter`; a round is judged by the imitators that are known, and its answer by all of them."""
N_PROPOSALS = 40
"""Random steps in a round."""
N_CLIMBS = 6
"""Steps along the slope in a round."""
N_IMITATORS = 12
"""Shapes of each effect that a motion adds to the known imitators."""
FIRST_STEP = 0.3
"""Of a random motion that uses its limits."""
SHORTER, LONGER = 0.85, 1.6
"""A step that failed makes the next ones shorter, one that succeeded longer."""
NEARLY = 0.05
"""Share of a limit that is left where it counts as reached."""
DIFFERENCE = 1e-4
"""Step of the slopes, of the largest coefficient."""
CLIMB_STEPS = (0.6, 0.3, 0.1, 0.03, 0.01, 0.003)
"""Lengths that are tried along the slope, of the motion itself."""


class _Stopped(Exception):
    """Time is over."""


@dataclass(frozen=True, eq=False)
class Separated:
    """Two effects and two motions: what was designed, and what it is compared with.

    Parameters
    ----------
    effects : tuple of NamedEffect
        What is told apart.
    separation : Separation
        Its measure.
    before, after : (Power, Power)
        Of the exciting trajectory and of the separating one.
    reference : FourierExcitation
        The exciting one.
    n_evaluations : int
        Motions that were tried.
    """

    effects: tuple[NamedEffect, NamedEffect]
    separation: Separation
    before: Powers
    after: Powers
    reference: FourierExcitation
    n_evaluations: int

    @property
    def gain(self) -> float:
        """Power by which the two are told apart, after over before: the geometric mean of both directions."""
        return float(np.sqrt(np.prod([a.left / b.left for a, b in zip(self.after, self.before, strict=True)])))

    def to_json(self) -> dict[str, Any]:
        """Figures of both motions, per effect: what is left of its torque, and who imitates the rest."""
        names = self.separation.robot.joint_names
        entries = []
        for k, effect in enumerate(self.effects):
            other = self.separation.pair[1 - k]
            entries.append(
                {
                    "effect": effect.text(names),
                    "kind": effect.kind,
                    "joints": [names[j] for j in effect.joints],
                    "shape": dict(self.separation.pair[k].shapes[0]),
                    "before": _figures(self.before[k], self.before[k], other),
                    "after": _figures(self.after[k], self.before[k], other),
                }
            )
        return {"effects": entries, "gain": self.gain, "n_evaluations": self.n_evaluations}


def _figures(power: Power, first: Power, other: ShapedEffect) -> dict[str, Any]:
    """Amplitudes relative to the effect's own on the exciting motion, so that motions can be compared."""
    own = max(first.whole, 1e-300)
    return {
        "left": float(np.sqrt(power.left / own)),
        "left_by_declared": float(np.sqrt(power.declared / own)),
        "whole": float(np.sqrt(power.whole / own)),
        "best_imitator": dict(other.shapes[power.imitator]),
    }


def separate(
    design: FourierExcitation,
    a: NamedEffect,
    b: NamedEffect,
    *,
    max_iter: int = 100,
    time_limit: float | None = None,
    on_progress: Callable[[str], None] = lambda words: None,
) -> tuple[FourierExcitation, Separated]:
    """Design a motion within the limits of `design` that tells `a` from `b` best.

    The criterion is the power of each effect's torque per unit coefficient that neither the declared model nor any
    shape of the other imitates: the geometric mean of both directions. It has no gradient (an imitator may change from
    one motion to the next), so random motions are followed by local searches with random steps.

    Parameters
    ----------
    design : FourierExcitation
        Fitted: limits, start, constraints, series, and the motion to compare with.
    a, b : NamedEffect
        What is to be told apart.
    max_iter : int
        Length of every local search; a quarter is done in rounds of random steps or of steps along the slope.
    time_limit : float, optional
        Stop after this many seconds; the answer then depends on the machine.
    on_progress : callable
        Called with a few words.

    Returns
    -------
    design, separated : FourierExcitation, Separated
        The same design with the new motion, and how the two motions compare.

    Raises
    ------
    ValueError
        The effects are one and the same, or need what the robot file does not declare.
    """
    from threadpoolctl import threadpool_limits

    robot = design.robot_
    pair = ShapedEffect.of(a, robot), ShapedEffect.of(b, robot)
    separation = Separation(robot, design.base_, *pair, design.duration)
    problem, first = design.problem(), np.array(design.x_)
    search = _Search(problem, separation, np.random.default_rng(design.seed_), time_limit, on_progress)
    with threadpool_limits(limits=1, user_api="blas"):
        before = search.powers(first)
        x = search.run(first, max_iter)
        after = search.powers(x)
    found = design.with_motion(x)
    return found, Separated((a, b), separation, before, after, design, search.n_evaluations)


class _Search:
    """Random motions, local searches from the best of them by random steps, then along the slope."""

    def __init__(
        self,
        problem: Problem,
        separation: Separation,
        rng: np.random.Generator,
        time_limit: float | None,
        say: Callable[[str], None],
    ) -> None:
        self.problem, self.separation, self.rng, self.say = problem, separation, rng, say
        self.n_evaluations = 0
        self._imitators: tuple[set[int], set[int]] = (set(), set())
        self._deadline = None if time_limit is None else time.monotonic() + time_limit

    def powers(self, x: FloatArray) -> Powers:
        """Exact figures of a motion, all imitators asked."""
        self.n_evaluations += 1
        return self.separation.powers(self._trajectory(x))

    def run(self, first: FloatArray, max_iter: int) -> FloatArray:
        """Return the best motion, valid in every detail; `first` where nothing is better."""
        drawn = [x for x in (self.problem.drawn(self.rng) for _ in range(N_DRAWS)) if x is not None]
        starts = [first, *(x for x in map(self.problem.inside, drawn) if x is not None)]
        scored = [(_score(self.powers(first)), first)]
        scored += [(_score(self.powers(x)), x) for x in starts[1:] if not self._stop()]
        self._reference = scored[0][0]
        best = max(scored, key=lambda pair: pair[0])
        rounds = max(1, max_iter // STEPS_PER_ROUND)
        for k, (score, x) in enumerate(sorted(scored, key=lambda pair: -pair[0])[:N_SEARCHES]):
            for _ in range(rounds):
                score, x = self._better(score, x, self._wander)
                best = max(best, (score, x), key=lambda pair: pair[0])
                self._told(f"search {k + 1} of {N_SEARCHES}", best[0])
        for _ in range(rounds):
            best = self._better(*best, self._climb)
            self._told("along the slope", best[0])
        valid = self.problem.repaired(best[1])
        return first if valid is None or _score(self.powers(valid)) < self._reference else valid

    def _better(
        self, score: float, x: FloatArray, move: Callable[[FloatArray], FloatArray]
    ) -> tuple[float, FloatArray]:
        """Move from `x`; what comes out counts only if all imitators agree, and those that do not are remembered."""
        if self._stop():
            return score, x
        self._remember(x)
        try:
            moved = move(x)
        except _Stopped:
            return score, x
        inside = self.problem.inside(moved)
        if inside is None:
            return score, x
        self._remember(inside)
        whole = _score(self.powers(inside))
        return (whole, inside) if whole > score else (score, x)

    def _wander(self, x: FloatArray) -> FloatArray:
        """Random steps that are kept where they help."""
        step, here = FIRST_STEP, self._soft(x)
        for _ in range(N_PROPOSALS):
            tried = self._proposal(x, step)
            value = -np.inf if tried is None else self._soft(tried)
            step = min(step * (LONGER if value > here else SHORTER), 1.0)
            if tried is not None and value > here:
                here, x = value, tried
        return x

    def _climb(self, x: FloatArray) -> FloatArray:
        """Steps along the slope, by differences; what leaves the limits is made smaller, joint by joint."""
        here = self._soft(x)
        for _ in range(N_CLIMBS):
            size = DIFFERENCE * max(float(np.abs(x).max()), 1e-3)
            units = np.eye(x.size).reshape(-1, *x.shape)
            slope = np.array([self._soft(x + size * unit) - here for unit in units]).reshape(x.shape)
            slope = self._along_limits(x, slope)
            direction = slope * np.linalg.norm(x) / max(float(np.linalg.norm(slope)), 1e-300)
            tried = [y for y in (self.problem.inside(x + step * direction) for step in CLIMB_STEPS) if y is not None]
            values = [self._soft(y) for y in tried]
            if not values or max(values) <= here:
                break
            here, x = max(values), tried[int(np.argmax(values))]
        return x

    def _along_limits(self, x: FloatArray, slope: FloatArray) -> FloatArray:
        """Part of a direction that leaves no limit which is (nearly) reached."""
        rooms = self.problem.room_slopes(x).reshape(-1, x.size)[self.problem.rooms(x) < NEARLY]
        for _ in range(len(rooms)):  # one limit after the other, until none is left behind
            lost = rooms @ slope.ravel() < -1e-9 * np.linalg.norm(slope)
            if not lost.any():
                break
            basis, _ = np.linalg.qr(rooms[lost].T)
            slope = slope - (basis @ (basis.T @ slope.ravel())).reshape(x.shape)
        return slope

    def _soft(self, x: FloatArray) -> float:
        if self._stop():
            raise _Stopped
        self.n_evaluations += 1
        imitators = sorted(self._imitators[0]), sorted(self._imitators[1])
        return self.separation.soft_score(self._trajectory(x), imitators)

    def _remember(self, x: FloatArray) -> None:
        """Keep the shapes of each effect that imitate the other best on this motion."""
        self.n_evaluations += 1
        for kept, ranked in zip(self._imitators, self.separation.ranked_imitators(self._trajectory(x)), strict=True):
            kept.update(ranked[:N_IMITATORS])

    def _proposal(self, x: FloatArray, step: float) -> FloatArray | None:
        """Return another motion near `x`, within the limits: the joints in question always move, the others half."""
        direction = self.problem.bounds.roughly_scaled(self.rng.standard_normal(x.shape))
        asked = {j for effect in self.separation.pair for j in effect.effect.joints}
        chosen = [j in asked or self.rng.random() < 0.5 for j in range(x.shape[1])]
        return self.problem.inside(x + step * direction * np.array(chosen))

    def _trajectory(self, x: FloatArray) -> FourierTrajectory:
        return self.problem.series.trajectory(x, self.problem.start)

    def _told(self, what: str, score: float) -> None:
        self.say(f"separating, {what}: {math.exp(score - self._reference):.3g} times the power")

    def _stop(self) -> bool:
        return self._deadline is not None and time.monotonic() > self._deadline


def _score(powers: Powers) -> float:
    """Logarithm of the geometric mean of what is left of both."""
    return float(np.mean([np.log(max(power.left, 1e-300)) for power in powers]))
