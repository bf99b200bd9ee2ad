"""Search for the motion that tells most about what is open, within an arm's limits.

    worth(motion)   =  nats about what leads the search (`led_by`)  +  nats about a row within the limits   (`worth.py`)
    motions         =  Fourier series that start and end at rest (Eqs. 15 to 18), and slow ones of them

The worth has no gradient, so motions are drawn, and the best of them are walked from by random steps.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.along import Along, Told, is_designable
from dynid_rs.diagnosis.open_questions import OpenQuestions, Question
from dynid_rs.excitation.fourier import FourierExcitation
from dynid_rs.excitation.problem import Problem
from dynid_rs.experiment.worth import Chance, Worth, entropy

if TYPE_CHECKING:
    from dynid_rs.simulation import FourierTrajectory

FloatArray = NDArray[np.float64]

N_DRAWS = 96
"""Random motions from which the walks start, beside the one that excites the parameters."""
LED_BY = 0.9
"""Part of what is not known of all answers: the search looks at the least certain questions that hold so much of it."""
SLOWEST = 0.03
"""Least part of its limits that a joint of a drawn motion uses: slow motion shows what friction does near rest."""
STEEPEST = 2.0
"""Greatest power of its number by which a harmonic of a drawn motion is slower than the first: it sweeps wide then."""
N_WALKS = 3
FIRST_STEP = 0.4
"""Of a random motion that uses its limits."""
SHORTER, LONGER = 0.85, 1.6
"""A step that failed makes the next ones shorter, one that succeeded longer."""
N_DOMAIN = 6
"""Random motions whose rows stand for all that the limits allow; as many show what random motion is worth."""
LEAST_PERIODS = 20.0
"""Periods of the band's cutoff that a motion has to last: fewer leave no rows between its ends."""
LIKELY = 0.5
"""A question that a motion settles less likely than this is one that it leaves open."""
ONLY_NOISE = 0.05
"""Errors that exceed the noise by less are the noise's: as much as the user would call the same."""
LONGEST = 64.0
"""Multiples of the length up to which random motion is compared."""


@dataclass(frozen=True, eq=False)
class Compared:
    """What a motion is worth: chances per question, and nats about those that lead (`led_by`) and about a row."""

    chances: tuple[Chance, ...]
    nats: float


@dataclass(frozen=True, eq=False)
class Excess:
    """By how much the error anywhere within the limits exceeds the noise at most, as a share of it, (n_joints,).

    That holds 19 times of 20. After the runs so far; after the designed motion, random motion and the exciting one.
    """

    now: FloatArray
    designed: FloatArray
    random: FloatArray
    exciting: FloatArray


@dataclass(frozen=True, eq=False)
class NextExperiment:
    """One designed motion and what it is expected to decide.

    Parameters
    ----------
    design : FourierExcitation
        The motion within its limits, as `dynid excite` writes it.
    asked : OpenQuestions
        What was open.
    questions : tuple of Question
        Those that a motion can decide, in the order of `expected.chances`.
    others : tuple of Question
        Those that it cannot.
    expected, random, exciting : Compared
        Of the designed motion; on average of random motions of the same length; of the motion that excites the
        parameters best (`design`'s criterion).
    random_times : float or None
        How many times as long random motion has to be to tell as much (median); None where 64 times are too few.
    excess : Excess
        How sure the torque within the limits is.
    n_evaluations : int
        Motions that were tried.
    """

    design: FourierExcitation
    asked: OpenQuestions
    questions: tuple[Question, ...]
    others: tuple[Question, ...]
    expected: Compared
    random: Compared
    exciting: Compared
    random_times: float | None
    excess: Excess
    n_evaluations: int

    @property
    def is_wanted(self) -> bool:
        """Whether a motion has something to decide, or the torque within the limits is less sure than the noise asks.

        A question is decided that is open and would rather be settled than not; errors of `ONLY_NOISE` more than the
        noise nobody sees.
        """
        decides = any(
            question.is_open and chance.right >= LIKELY
            for question, chance in zip(self.questions, self.expected.chances, strict=True)
        )
        return decides or bool(np.max(self.excess.now) > ONLY_NOISE)

    @property
    def trajectory(self) -> FourierTrajectory:
        """The motion."""
        return self.design.trajectory_


class _Search:
    """Draws, then walks from the best of them; every motion's information is found once."""

    def __init__(self, problem: Problem, along: Along, seed: int, deadline: float | None) -> None:
        self.problem, self.along = problem, along
        self.rng = np.random.default_rng(seed)
        self.t = np.arange(round(problem.series.duration * along.rate)) / along.rate
        self._deadline = deadline
        self.n_evaluations = 0

    def told(self, x: FloatArray) -> Told:
        """Information of a motion of free coefficients `x` (n_free, n_joints)."""
        self.n_evaluations += 1
        return self.along.information(self.problem.series.trajectory(x, self.problem.start).evaluate(self.t))

    def domain(self, motions: Sequence[FloatArray]) -> FloatArray:
        """Mean square of each joint's row over its noise along motions, and with every joint as fast as it may be.

        A Fourier series of few harmonics in a long period is slower than what the arm will be used for.
        """
        squares = []
        for x in motions:
            trajectory = self.problem.series.trajectory(x, self.problem.start)
            _, velocity, acceleration = self.problem.bounds.usage(x)
            for times in (np.ones_like(velocity), np.maximum(1.0, np.minimum(1 / velocity, acceleration**-0.5))):
                each = [trajectory.evaluate(k * self.t % self.problem.series.duration) for k in times]
                q, dq, ddq = (np.column_stack([one[m][:, j] for j, one in enumerate(each)]) for m in range(3))
                squares.append(self.along.squares((q, times * dq, times**2 * ddq)))
        mean: FloatArray = np.mean(squares, axis=0)
        return mean

    def drawn(self, n: int, *, slow: bool) -> list[FloatArray]:
        """Random motions within the limits; `slow`: joints that use a part of them, wide or quick."""
        found = []
        for _ in range(n):
            x = self.problem.drawn(self.rng)
            if x is not None and slow:
                steepness, share = self.rng.uniform(0.0, 1.0, (2, x.shape[1]))
                x = self.problem.bounds.roughly_scaled(self.problem.series.falling(x, STEEPEST * steepness))
                x = x * SLOWEST**share
            if x is not None and (inside := self.problem.inside(x)) is not None:
                found.append(inside)
        return found

    def best(
        self, known: Sequence[tuple[float, FloatArray]], worth: Worth, n_steps: int, say: Callable[[str], None]
    ) -> tuple[float, FloatArray]:
        """The motion of greatest worth that keeps everything exactly: of those `known`, of draws, and of walks."""
        scored = list(known)
        for x in self.drawn(N_DRAWS, slow=True):
            if self.is_late():
                break
            scored.append((worth.nats(self.told(x)), x))
        scored.sort(key=lambda pair: -pair[0])
        ends = [*scored]
        for k, (value, x) in enumerate(scored[:N_WALKS]):
            say(f"walk {k + 1} of {N_WALKS}, {max(pair[0] for pair in ends):.3g} nats so far")
            ends.append(self.walked(x, value, n_steps, worth))
        _, x = max(ends, key=lambda pair: pair[0])
        valid = self.problem.repaired(x)
        return (-np.inf, x) if valid is None else (worth.nats(self.told(valid)), valid)

    def walked(self, x: FloatArray, value: float, n_steps: int, worth: Worth) -> tuple[float, FloatArray]:
        """Random steps that are kept where they help: some joints move otherwise, and more or less."""
        step = FIRST_STEP
        for _ in range(n_steps):
            if self.is_late():
                break
            tried = self.problem.inside(self._beside(x, step))
            found = -np.inf if tried is None else worth.nats(self.told(tried))
            step = min(step * (LONGER if found > value else SHORTER), 1.0)
            if tried is not None and found > value:
                value, x = found, tried
        return value, x

    def _beside(self, x: FloatArray, step: float) -> FloatArray:
        """A motion beside `x`: of some joints other coefficients, and another size."""
        n = x.shape[1]
        moved = (self.rng.random(n) < 0.5) | (np.arange(n) == self.rng.integers(n))
        direction = self.problem.bounds.roughly_scaled(self.rng.standard_normal(x.shape))
        size, whole = (np.abs(y).max(axis=0) for y in (x, direction))
        factor = SLOWEST ** (step * self.rng.uniform(-1.0, 1.0, n))
        turned: FloatArray = factor * (x + step * direction * size / np.maximum(whole, 1e-300))
        return np.where(moved, turned, x)

    def is_late(self) -> bool:
        """Whether the time is over."""
        return self._deadline is not None and time.monotonic() > self._deadline


def design_next(
    asked: OpenQuestions,
    design: FourierExcitation,
    *,
    load: float = 0.0,
    max_iter: int = 100,
    time_limit: float | None = None,
    on_progress: Callable[[str], None] = lambda words: None,
) -> NextExperiment:
    """Design the motion that decides most of what a diagnosis left open.

    Parameters
    ----------
    asked : OpenQuestions
        What is open, and what is known (`Diagnosis.asked`).
    design : FourierExcitation
        Fitted to the same robot: limits, start, constraints, length, and the motion to compare with.
    load : float
        Known mass at the origin of the last link during the motion [kg].
    max_iter : int
        Random steps of each of three walks.
    time_limit : float, optional
        Stop after this many seconds; the answer then depends on the machine.
    on_progress : callable
        Called with a few words.

    Raises
    ------
    ValueError
        The design is of another robot, or too short for the band of the runs.
    """
    from threadpoolctl import threadpool_limits

    check_fits(asked, design)
    questions = tuple(q for q in asked.questions if all(is_designable(asked.candidates[k]) for k in q.candidates))
    others = tuple(q for q in asked.questions if q not in questions)
    leading = led_by(questions)
    of_all, of_leading = (
        Along(asked, sorted({k for q in some for k in q.candidates}), load) for some in (questions, leading)
    )
    deadline = None if time_limit is None else time.monotonic() + time_limit
    search = _Search(design.problem(), of_leading, design.seed_, deadline)
    with threadpool_limits(limits=1, user_api="blas"):
        on_progress("drawing motions")
        first = np.array(design.x_)
        random = search.drawn(N_DOMAIN, slow=False)
        if not random:
            raise ValueError(f"none of {N_DOMAIN} random motions keeps the constraints; widen them, or choose a start")
        domain = search.domain(random)
        led, worth = Worth(asked, leading, domain), Worth(asked, questions, domain)
        of_first, *of_random = (search.told(x) for x in (first, *random))
        known = [(led.nats(own), x) for own, x in zip((of_first, *of_random), (first, *random), strict=True)]
        nats, best = max(search.best(known, led, max_iter, on_progress), known[0], key=lambda pair: pair[0])
        search.along = of_all
        told, exciting, *each = (search.told(x) for x in (best, first, *random))
        excess = Excess(*(worth.excess(after) for after in (None, told, Told.mean(each), exciting)))
    return NextExperiment(
        design.with_motion(best),
        asked,
        questions,
        others,
        Compared(tuple(worth.chances(told)), nats),
        Compared(_mean_of([worth.chances(one) for one in each]), float(np.mean([value for value, _ in known[1:]]))),
        Compared(tuple(worth.chances(exciting)), known[0][0]),
        _times(led, of_random, nats),
        excess,
        search.n_evaluations,
    )


def led_by(questions: Sequence[Question]) -> tuple[Question, ...]:
    """The least certain questions, which hold `LED_BY` of what is not known of all answers.

    What is sure already waits as long as something is open: a dozen kinds of 2 % each are more nats than one tie.
    """
    asked = [question for question in questions if question.is_open] or list(questions)
    doubts = np.array([entropy(np.array(question.log_odds)) for question in asked])
    order = np.argsort(-doubts, kind="stable")
    before = np.cumsum(doubts[order]) - doubts[order]
    chosen = set(order[before < LED_BY * doubts.sum()].tolist())
    return tuple(question for k, question in enumerate(asked) if k in chosen)


def check_fits(asked: OpenQuestions, design: FourierExcitation) -> None:
    """Refuse a design of another robot, or one too short for the band.

    Raises
    ------
    ValueError
        One sentence with the mend.
    """
    theirs, ours = list(asked.plan.robot.joint_names), list(design.robot_.joint_names)
    if theirs != ours:
        raise ValueError(
            f"the diagnosis is of a robot with the joints {', '.join(theirs)}, and {design.robot_.name} has "
            f"{', '.join(ours)}; give the robot file that was diagnosed"
        )
    check_length(asked, design.duration)


def check_length(asked: OpenQuestions, seconds: float, name: str = "duration") -> None:
    """Refuse a motion that is too short for the band, best before it is searched for.

    Raises
    ------
    ValueError
        One sentence with the mend.
    """
    least = least_duration(asked)
    if seconds < least:
        raise ValueError(f"{name} must be at least {least:.3g} s for the band of the runs, got {seconds:g}")


def least_duration(asked: OpenQuestions) -> float:
    """A motion shorter than this [s] holds too little of the runs' band."""
    return LEAST_PERIODS / asked.cutoff


def _mean_of(chances: Sequence[Sequence[Chance]]) -> tuple[Chance, ...]:
    """Chances of every question, their mean over motions of the same length."""
    return tuple(
        Chance(*(float(np.mean(x)) for x in zip(*map(astuple, own), strict=True))) for own in zip(*chances, strict=True)
    )


def _times(worth: Worth, each: Sequence[Told], nats: float) -> float | None:
    """How many times as long a random motion has to go on to tell so many nats: the median; None beyond `LONGEST`.

    It tells as much in every further length as in the first. (The mean of several shows more poses than any of them.)
    """
    middle = float(np.median([_multiple(worth, told, nats) for told in each]))
    return None if middle > LONGEST else middle


def _multiple(worth: Worth, told: Told, nats: float) -> float:
    """How many times what a motion tells is worth so many nats, infinite beyond `LONGEST`."""
    from scipy.optimize import brentq

    if worth.nats(told * LONGEST) < nats:
        return np.inf
    if worth.nats(told * (1 / LONGEST)) > nats:
        return 0.0
    most = float(np.log2(LONGEST))
    return float(2.0 ** brentq(lambda k: worth.nats(told * float(2.0**k)) - nats, -most, most))
