"""First loop: the friction of every joint (Eqs. 9-12).

For a given threshold lambda and transition width eps the eight coefficients are linear, so the search is
one-dimensional in each (variable projection): least squares inside, a scan and a refinement outside.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.estimator import Estimator
from dynid_rs.base.threads import side_by_side
from dynid_rs.regression.columns import Plan
from dynid_rs.runs.preprocessing import Filter, States

if TYPE_CHECKING:
    from dynid_rs.identification.friction_experiment.rows import OddTorque

FloatArray = NDArray[np.float64]

AS_PRINTED = 1e-4
"""The paper's transition width [rad/s]."""
PAIRS_WORTH = 8.0
"""On pairs a finer shape has to lower twice the log likelihood by this much (as BIC asks for 3000 rows)."""
WORTH = 0.01
"""A finer shape has to take this part off the residual's power; below it the difference is noise."""
THRESHOLD_WORTH = 0.05
"""The first threshold has to take this part off: on real data smaller gains do not carry over to other runs."""
WEAK = 1e-2
"""Directions of the links' columns weaker than this (relative singular value) are not taken out before the search:
one joint's equation alone hardly determines them, and they would swallow friction."""
NEGLIGIBLE = 1e-9
"""Relative sizes below this are rounding."""
LARGEST_THRESHOLD = 0.1
"""Largest threshold that is tried, over the joint's greatest speed."""
NOISE_WIDTHS = 1.0
"""Least transition width over the velocity's noise: a narrower one turns noise at rest into chatter of full size."""
CLOSE = 0.1
"""A bracket of the logarithm that is narrower than this need not be narrowed unless that still pays."""
ROUGH = 3e-3
"""Relative error of eps that does not matter while valleys are compared: power changes with its square."""
ZOOM = (0.1, 0.02, 4e-3, 8e-4, 1.6e-4)
"""Half widths of the scans of log lambda on pairs, each a little more than a step of the one before."""
NEAR_JUMP = 12.0
"""Samples up to this many times lambda or eps place the jump and the turn; beyond it both columns are full."""
MOST_TURNS = 30
"""A search that still pays after so many turns is stopped."""


class FrictionIdentifier(Estimator):
    """Shape of the paper's friction: threshold lambda and transition width eps per joint.

    Parameters
    ----------
    transition_widths : sequence of float
        Widths eps [rad/s] that are tried first; the least of them is a bound, and so is the velocity's noise. The
        paper prints 1e-4, which is below any encoder's velocity noise.
    n_thresholds : int
        Thresholds lambda that are tried at a time, beside none.
    refine : bool
        Refine eps and look for a threshold, as long as it pays; else lambda is 0.
    as_printed : bool
        Take eps = 1e-4 as the paper prints it, and of all lambda that are tried the one that leaves least (Eq. 12).

    Attributes
    ----------
    velocity_threshold_, transition_width_ : ndarray (n_joints,)
        Chosen shapes [rad/s].
    effect_ : Effect
        The same as an effect of the torque model.
    """

    def __init__(
        self,
        transition_widths: Sequence[float] = (1e-3, 2e-3, 4e-3, 8e-3, 1.6e-2, 3e-2, 6e-2),
        n_thresholds: int = 6,
        *,
        refine: bool = True,
        as_printed: bool = False,
    ) -> None:
        self.transition_widths = transition_widths
        self.n_thresholds = n_thresholds
        self.refine = refine
        self.as_printed = as_printed

    def fit(
        self,
        plan: Plan,
        runs: Sequence[States],
        rows: Sequence[list[FloatArray]],
        joints: Sequence[int] | None = None,
        *,
        pairs: Sequence[OddTorque | None] | None = None,
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
        pairs : sequence of OddTorque or None, optional
            Torque of every joint at the pairs of a friction experiment. Where a joint has some they decide alone:
            links have no part in them.
        """
        n = plan.robot.n_joints
        if joints is None:
            self.velocity_threshold_, self.transition_width_ = np.zeros(n), np.zeros(n)
        others = np.ones(plan.n_own, dtype=bool)
        others[plan.friction[1]] = False
        wanted = list(range(n)) if joints is None else list(joints)

        def search(j: int) -> tuple[float, float]:
            n_orders = int(plan.own[j, plan.friction[1]].sum() - 2) // 2
            if pairs is not None and (odd := pairs[j]) is not None:
                power = _PowerLeft(odd.runs, odd.beside, odd.tau, odd.noise, n_orders, of_pairs=True)
                return self._sharpen(power, odd, *self._search(power))
            moves = [states.counted[:, j] for states in runs]
            stacked = np.concatenate([run[j][counted] for run, counted in zip(rows, moves, strict=True)])
            keep = np.concatenate([others & plan.own[j], np.ones(stacked.shape[1] - plan.n_own - 1, dtype=bool)])
            parts: list[SearchRun] = [
                (np.ascontiguousarray(states.dq_motor[:, j]), states.filter, states.rows[counted].tolist(), None)
                for states, counted in zip(runs, moves, strict=True)
            ]
            noise = max(states.velocity_noise(j) for states in runs)
            return self._search(_PowerLeft(parts, stacked[:, :-1][:, keep], stacked[:, -1], noise, n_orders))

        # Joints are independent, and the compiled module lets go of the interpreter.
        for j, shape in zip(wanted, side_by_side(search, wanted), strict=True):
            self.velocity_threshold_[j], self.transition_width_[j] = shape
        self.effect_ = friction_effect(self.velocity_threshold_, self.transition_width_)
        return self

    def _search(self, power: _PowerLeft) -> tuple[float, float]:
        """Lambda and eps of one joint: eps by a scan, then both in turn, as long as a turn still pays.

        On a simulation without noise that ends at the truth.
        """
        if self.as_printed:
            return self._best_threshold(power, AS_PRINTED), AS_PRINTED
        widths = [max(float(width), power.least_width) for width in self.transition_widths]
        power.least_width = min(widths)
        at_best, width = min((power(0.0, width), width) for width in widths)
        threshold, span = 0.0, np.log(2.0)
        if not self.refine:
            return threshold, width
        width, at_best = power.best_width(threshold, width, at_best, span)
        if power.of_pairs or power.is_clean(threshold, width):
            power.look_closely()
            width, at_best = power.best_width(threshold, width, power(threshold, width), span)
            if power.n_orders > 1:
                threshold, width, at_best = self._start(power, width, at_best)
        for _ in range(MOST_TURNS):
            before = at_best
            if power.n_orders > 1:  # what jumps at a threshold is the paper's law alone
                threshold, at_best = self._threshold(power, threshold, width, at_best, span)
            width, at_best = power.best_width(threshold, width, at_best, span)
            if at_best > (1 - power.worth) * before or power.exhausted(at_best):
                break
            span *= 0.8
        return threshold, width

    def _sharpen(self, power: _PowerLeft, odd: OddTorque, threshold: float, width: float) -> tuple[float, float]:
        """Place the jump at lambda and the turn at rest once more, by slow samples that no low-pass has blurred."""
        if threshold == 0 or self.as_printed:
            return threshold, width
        near = np.abs(odd.sides).min(axis=0) <= NEAR_JUMP * max(threshold, width)
        slow = np.flatnonzero(near)
        # What is faster knows nothing of the shape, but all about the coefficients: a small factor stands for it.
        fast = [_core.friction_basis(side[~near], threshold, width) for side in odd.sides]
        factor = _core.triangular_factor(np.column_stack([(fast[0] - fast[1]) / 2, odd.raw[~near]]))
        speeds = np.ascontiguousarray(odd.sides[:, slow].ravel())
        first = np.arange(len(slow))
        run: SearchRun = (speeds, None, first.tolist(), (first + len(slow)).tolist())
        tau = np.concatenate([odd.raw[slow], factor[:, -1]])
        sharp = _PowerLeft(
            [run], np.zeros((len(tau), 0)), tau, odd.noise, power.n_orders, of_pairs=True, fixed=factor[:, :-1]
        )
        sharp.look_closely()
        for spans in (ZOOM[1:], ZOOM[2:]):
            threshold, at_best = sharp.zoom(threshold, width, sharp(threshold, width), spans)
            width, _ = sharp.best_width(threshold, width, at_best, CLOSE)
        return threshold, width

    def _best_threshold(self, power: _PowerLeft, width: float) -> float:
        """Lambda that leaves least at this eps (Eq. 12), none included."""
        if power.n_orders < 2:
            return 0.0
        tries = self._thresholds(power, max(width, power.least_width), finer=4)
        least, best = min((power(x, width), x) for x in tries)
        span = float(np.log(tries[1] / tries[0]))
        best, least = power.best_threshold(best, width, least, span)
        return best if least < power(0.0, width) else 0.0

    def _start(self, power: _PowerLeft, width: float, at_best: float) -> tuple[float, float, float]:
        """Best of a scan over lambda with an eps of its own for each.

        Eps makes up for a missing threshold so well that only clean data shows the way from one valley to the other.
        """
        valleys = [(at_best, 0.0)]
        thresholds = self._thresholds(power, width, finer=4)
        for threshold in thresholds:
            valleys.append((power.near_best_width(threshold, width), threshold))
        value, threshold = min(valleys)
        if threshold == 0:
            return threshold, width, value
        value = power.at_best_width(threshold, width, ROUGH)[0]
        span = float(np.log(thresholds[1] / thresholds[0]))
        threshold, _ = _golden(lambda x: power.at_best_width(x, width, ROUGH)[0], threshold, value, span, CLOSE / 100)
        value, width = power.at_best_width(threshold, width)
        return threshold, width, value

    def _thresholds(self, power: _PowerLeft, width: float, finer: int = 1) -> list[float]:
        largest = max(width, LARGEST_THRESHOLD * power.top_speed)
        return [float(x) for x in np.geomspace(0.5 * width, largest, finer * self.n_thresholds)]

    def _threshold(
        self, power: _PowerLeft, threshold: float, width: float, at_best: float, span: float
    ) -> tuple[float, float]:
        """Best lambda at this eps. The viscous torque jumps there, so it has to pay well against none at all."""
        tries = self._thresholds(power, width)
        if power.of_pairs and threshold > 0:
            return power.zoom(threshold, width, at_best)
        if power.clean and threshold > 0:
            tries = power.between_samples(threshold, 4 * self.n_thresholds)
        elif threshold > 0:
            tries += (threshold * np.exp(np.linspace(-span, span, self.n_thresholds))).tolist()
        least, best = min((power(x, width), x) for x in tries)
        if least >= (1 - (power.worth if threshold > 0 else power.threshold_worth)) * at_best:
            return threshold, at_best
        return power.best_threshold(best, width, least, span / self.n_thresholds)


def friction_effect(velocity_threshold: FloatArray, transition_width: FloatArray) -> _core.Effect:
    """Friction with these shapes (n_joints,) [rad/s]."""
    return _core.Effect.friction(velocity_threshold.tolist(), transition_width.tolist())


SearchRun = tuple[FloatArray, Filter | None, list[int], list[int] | None]


class _PowerLeft:
    """Residual power of joint j's torque as a function of friction's shape, links taken out."""

    def __init__(
        self,
        runs: Sequence[SearchRun],
        links: FloatArray,
        tau: FloatArray,
        noise: float,
        n_orders: int,
        *,
        of_pairs: bool = False,
        fixed: FloatArray | None = None,
    ) -> None:
        self._speeds = [speed for speed, *_ in runs]
        self.of_pairs = of_pairs
        self._search = _core.FrictionSearch(runs, links, tau, weak=WEAK, n_orders=n_orders, fixed=fixed)
        self.n_orders, self._close, self.clean = n_orders, CLOSE, False
        self._tau_power = float(tau @ tau)
        self.least_width = NOISE_WIDTHS * noise
        self.top_speed = max(float(np.abs(speed).max()) for speed in self._speeds)
        self.worth, self.threshold_worth = WORTH, THRESHOLD_WORTH
        if self.of_pairs:
            # Nothing but friction is in the pairs, so what counts is noise alone; neighbouring rows share half of it.
            self.worth = min(WORTH, 2 * PAIRS_WORTH / len(tau))
            self.threshold_worth = min(THRESHOLD_WORTH, 4 * PAIRS_WORTH / len(tau))

    def look_closely(self) -> None:
        """From now on take out all that the links can do, weakly determined or not, and end nearer to the best."""
        self._close, self.clean = CLOSE / 100, True

    def between_samples(self, threshold: float, count: int) -> list[float]:
        """Values of lambda halfway between the `count` sampled speeds that are nearest to `threshold`.

        Between two of them nothing changes, so to tell the truth from its neighbours no finer step exists.
        """
        speeds = np.unique(np.abs(np.concatenate(self._speeds)))
        at = int(np.searchsorted(speeds, threshold))
        near = speeds[max(at - count // 2, 0) : at + count // 2]
        return [float(x) for x in 0.5 * (near[1:] + near[:-1])]

    def best_width(self, threshold: float, width: float, at_best: float, span: float) -> tuple[float, float]:
        """Best eps around `width` at this lambda, and the power there."""
        least = self.least_width
        width, value = _golden(lambda x: self(threshold, max(x, least)), width, at_best, span, self._close)
        return max(width, least), value

    def near_best_width(self, threshold: float, width: float) -> float:
        """Power at this lambda with the best eps near `width`, by a parabola: enough to tell valleys apart."""
        span = 0.1
        left, here, right = (self(threshold, float(width * np.exp(x))) for x in (-span, 0.0, span))
        slope, bend = (right - left) / 2, left - 2 * here + right
        if bend <= 0 or abs(slope) >= bend:
            return min(left, here, right)
        return here - slope**2 / (2 * bend)

    def at_best_width(self, threshold: float, width: float, close: float = 1e-6) -> tuple[float, float]:
        """Power at this lambda with the best eps near `width`, and that eps."""
        from scipy.optimize import minimize_scalar

        near = (np.log(width) - 0.1, np.log(width) + 0.1)  # clean data: the noise's bound is far below
        found = minimize_scalar(
            lambda x: self(threshold, float(np.exp(x))), bounds=near, method="bounded", options={"xatol": close}
        )
        return float(found.fun), float(np.exp(found.x))

    def best_threshold(self, threshold: float, width: float, at_best: float, span: float) -> tuple[float, float]:
        """Best lambda around `threshold` > 0 at this eps, and the power there."""
        return _golden(lambda x: self(x, width), threshold, at_best, span, self._close)

    def zoom(
        self, threshold: float, width: float, at_best: float, spans: Sequence[float] = ZOOM
    ) -> tuple[float, float]:
        """Best lambda near `threshold` by ever finer scans: power is no smooth function of lambda, it has steps."""
        for span in spans:
            tries = [float(threshold * np.exp(x)) for x in np.linspace(-span, span, 12)]
            at_best, threshold = min([(self(x, width), x) for x in tries] + [(at_best, threshold)])
        return threshold, at_best

    def exhausted(self, power: float) -> bool:
        """Nothing left to explain, as in a simulation without noise."""
        return power <= 1e-24 * self._tau_power

    def is_clean(self, threshold: float, width: float) -> bool:
        """Less than 0.3 % of the torque is left: a simulation, or a sensor that is as good."""
        return float(self._search.power([threshold], [width], all_links=True)[0]) <= 1e-5 * self._tau_power

    def __call__(self, threshold: float, width: float) -> float:
        return float(self._search.power([threshold], [width], all_links=self.clean)[0])


def _golden(
    function: Callable[[float], float], best: float, at_best: float, span: float, close: float
) -> tuple[float, float]:
    """Golden-section steps on the logarithm around `best` > 0, until it is close and more does not pay."""
    ratio = (3 - np.sqrt(5)) / 2
    low, middle, high = np.log(best) - span, np.log(best), np.log(best) + span
    for _ in range(MOST_TURNS):
        before = at_best
        for _ in range(4):
            right = high - middle > middle - low
            step = middle + ratio * (high - middle if right else low - middle)
            value = function(float(np.exp(step)))
            if value < at_best:
                low, middle, high = (middle, step, high) if right else (low, step, middle)
                at_best = value
            else:
                low, high = (low, step) if right else (step, high)
        if high - low < close and at_best > (1 - WORTH) * before:
            break
    return float(np.exp(middle)), at_best
