"""The search for what has changed: forward steps, everything fitted again after each, until nothing pays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.wording import is_friction
from dynid_rs.identification.doubt import Doubt
from dynid_rs.model.assembly import evaluate
from dynid_rs.reference.changes import (
    DAILY,
    FRICTION,
    GAIN,
    OFFSET,
    TILT,
    Believed,
    Hypothesis,
    change_columns,
    hypotheses,
)
from dynid_rs.reference.weighing import Weighing
from dynid_rs.regression.evaluation import rmse
from dynid_rs.regression.uncertainty import NORMAL_95
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]

FREEDOM = 0.2
"""Usual change of friction's parts and of offsets from day to day, over the joint's friction torque (RMS)."""
LARGEST = 3.0
"""The same for friction that has changed: a weak prior between its three parts, which are much alike."""
LEAST_GAIN = 0.1
"""A change is named if it takes this part off some joint's error on parts of the runs that were left out."""
MOST_LOSS = 0.1
"""It may not add more than this part to another joint's."""
STEADY = 0.2
"""Parts that lose with it may lose at most this share of what the others win: what has changed acts all the time."""
SURE = 0.01
"""Family-wise error of naming a change."""
LARGE = {FRICTION: 0.3, GAIN: 0.03, TILT: 0.003, OFFSET: 0.3}
"""What is worth naming: friction and offset over the joint's friction torque (RMS), gain, tilt [rad]. Gain and tilt
have to be larger by their whole 95 % interval: under a load all that the reference lacks grows, and looks like them."""
REFERENCE_DATA = 1.0
"""Rows that a reference is taken to be made of, over those of the runs, where nothing says how well it is known."""
TIE = 2.0
"""Left-out errors that differ by less than this times the difference's standard error tie."""
MOST = 8
"""Most changes that are named."""
UPDATES = 4
"""Gauss-Newton steps after a change was named; a turn of gravity needs them."""


@dataclass(frozen=True, eq=False)
class Named:
    """A change that was named, `p_value`, and what explained as much when it was: hypothesis and what it would mean."""

    hypothesis: Hypothesis
    p_value: float
    ties: list[tuple[Hypothesis, Believed]]


class ChangeSearch:
    """Forward steps: the change that explains most, everything fitted again, until nothing pays."""

    def __init__(self, believed: Believed, runs: list[States], doubt: Doubt | None = None) -> None:
        self.believed, self.runs = believed, runs
        self._doubt = (
            None if doubt is None else [s.counted[:, :, None] * doubt.columns(believed.reference, s) for s in runs]
        )
        self.reference_noise = np.maximum(believed.reference.noise_std, 1e-300)
        self.noise = self.reference_noise
        self.named: list[Named] = []
        self._doubted = np.zeros(0, dtype=np.intp)

    def run(self) -> list[Believed]:
        """Return what is believed before the first change and after each that was named."""
        beliefs = [self.believed]
        while len(self.named) < MOST:
            found = self._next()
            if found is None:
                break
            self.named.append(found)
            self._update()
            beliefs.append(self.believed)
        return beliefs

    def name(self, kind: str) -> Named:
        """Take it that a change of the whole arm has happened, however little it explains, and fit it."""
        weighing = self.weigh()
        hypothesis = next(h for h in hypotheses(self.believed, self.columns) if h.kind == kind)
        free, held = self.split(hypothesis)
        covariance = self.covariance(weighing, free, held)
        chosen = np.isin(free, hypothesis.places)
        p_value = wald(weighing.solve(free, held)[free], covariance, chosen)
        self.named.append(Named(hypothesis, p_value, []))
        self._update()
        return self.named[-1]

    def weigh(self) -> Weighing:
        """Everything that may have changed, linear about what is believed."""
        self.columns = change_columns(self.believed, self.runs, 1 / self.noise)
        model = self.believed.model()
        # What a joint shows at rest is its stiction, here as in a fit.
        error = [s.counted * s.in_band(s.tau - evaluate(model, s)[0]) for s in self.runs]
        columns = [s.counted[:, :, None] * rows for s, rows in zip(self.runs, self.columns.rows, strict=True)]
        precision, weak = self._precision(columns)
        weighing = Weighing(self.runs, columns, error, 1 / self.noise, precision, weak)
        if self._doubt is None:
            return weighing
        self._doubted = len(precision) + np.arange(self._doubt[0].shape[2])
        return weighing.beside(self._doubt, np.ones(len(self._doubted)))

    def covariance(self, weighing: Weighing, free: NDArray[np.intp], held: NDArray[np.intp]) -> FloatArray:
        """Of the `free` coefficients, the reference's own errors included."""
        own = 1 / REFERENCE_DATA if self._doubt is None else 0.0
        return (1 + own) * weighing.covariance(free, held)

    def _precision(self, rows: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Of the day-to-day freedom of offsets and friction, and where those or what a tilt brings out are free."""
        stacked = np.concatenate(rows)
        n = stacked.shape[1]
        precision, weak = np.zeros(stacked.shape[2]), np.zeros(stacked.shape[2])
        weak[stacked.shape[2] - self.columns.n_tilt :] = 1.0
        self.friction = self._friction_torque()
        for j in range(n):
            own = slice(DAILY * j, DAILY * (j + 1))
            size = np.sqrt(np.mean(stacked[:, j, own] ** 2, axis=0)) / max(self.friction[j], 1e-300)
            precision[own] = (size / FREEDOM) ** 2
            weak[DAILY * j + 1 : DAILY * (j + 1)] = (size[1:] / LARGEST) ** 2
        return precision, weak

    def _friction_torque(self) -> FloatArray:
        """RMS of the reference's friction in the band (n_joints,); at least the noise."""
        reference = self.believed.reference
        places = [1 + k for k, (effect, _) in enumerate(reference.effects) if is_friction(effect.kind)]
        torque = [s.in_band(evaluate(reference, s)[1][:, places].sum(axis=1)) for s in self.runs]
        return np.maximum(rmse(torque), reference.noise_std)

    def split(self, *hypothesis: Hypothesis) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Places that are fitted freely (named ones and `hypothesis`), and those of day-to-day freedom and doubt."""
        places = [h.places for h in (*(named.hypothesis for named in self.named), *hypothesis)]
        free = np.concatenate([np.zeros(0, dtype=np.intp), *places])
        day = np.arange(DAILY * self.believed.robot.n_joints)
        return np.unique(free), np.concatenate([np.setdiff1d(day, free), self._doubted])

    def day(self, held: NDArray[np.intp]) -> NDArray[np.intp]:
        """Of what is `held` the day-to-day freedom alone."""
        return np.setdiff1d(held, self._doubted)

    def _next(self) -> Named | None:
        """Return the change that explains most, how sure it is, and what explains as much, with the belief in it."""
        weighing = self.weigh()
        open_ = [h for h in hypotheses(self.believed, self.columns) if not self._is_named(h)]
        scored = []
        for h in open_:
            free, held = self.split(h)
            without = self.split()
            # What the model leaves open takes most of any change, far beyond what it may be: it tells how sure one is.
            power = weighing.left_out_power(free, self.day(held))
            bare = weighing.left_out_power(without[0], np.setdiff1d(self.day(without[1]), h.places))
            ratio = np.sqrt(power.sum(axis=0) / np.maximum(bare.sum(axis=0), 1e-300))
            score = -float(np.sum(np.log(np.maximum(ratio, 1e-12))))
            if score <= 0 or ratio.min() > 1 - LEAST_GAIN or ratio.max() > 1 + MOST_LOSS:
                continue
            won = np.sum((bare - power) / self.noise**2, axis=1)
            if -won[won < 0].sum() > STEADY * won[won > 0].sum():
                continue
            x = weighing.solve(free, held)
            covariance = self.covariance(weighing, free, held)
            p_value = wald(x[free], covariance, np.isin(free, h.places))
            variance = np.diag(covariance)[np.searchsorted(free, h.places)]
            margin = NORMAL_95 * np.sqrt(np.maximum(variance, 0.0))
            if p_value < SURE / len(open_) and self._is_large(h, x, margin, weighing):
                scored.append((score, h, p_value, power, h.added(self.believed, x[h.places], self.columns)))
        if not scored:
            return None
        scored.sort(key=lambda each: -each[0])
        _, best, p_value, power, _ = scored[0]
        ties = [(h, belief) for _, h, _, other, belief in scored[1:] if _alike(other - power, self.noise)]
        return Named(best, p_value, ties)

    def _is_named(self, hypothesis: Hypothesis) -> bool:
        return any(hypothesis.place == named.hypothesis.place for named in self.named)

    def _is_large(self, h: Hypothesis, x: FloatArray, margin: FloatArray, weighing: Weighing) -> bool:
        if h.kind not in LARGE:
            return True
        if h.kind in (FRICTION, OFFSET):
            j = h.joints[0]
            torque = np.concatenate(weighing.columns)[:, j, h.places] @ x[h.places]
            return bool(np.sqrt(np.mean(torque**2)) >= LARGE[h.kind] * self.friction[j])
        named = slice(len(h.names))
        return bool(np.linalg.norm(x[h.places][named]) - np.linalg.norm(margin[named]) >= LARGE[h.kind])

    def _update(self) -> None:
        """Fit all that is named, and the noise, until the model is linear in what is left."""
        for _ in range(UPDATES):
            weighing = self.weigh()
            fresh = {h.place: h for h in hypotheses(self.believed, self.columns)}
            self.named = [replace(named, hypothesis=fresh[named.hypothesis.place]) for named in self.named]
            x = weighing.solve(*self.split())
            for named in self.named:
                h = named.hypothesis
                self.believed = h.added(self.believed, x[h.places], self.columns)
            left = rmse(weighing.left(x), [s.counted for s in self.runs])
            self.noise = np.maximum(left, self.reference_noise)


def wald(x: FloatArray, covariance: FloatArray, chosen: NDArray[np.bool_], bias: FloatArray | None = None) -> float:
    """Probability of coefficients as far from zero as the `chosen` ones, if they were zero.

    With a `bias` of x of unknown share, from all of it to all of its opposite: the greatest of these probabilities.
    """
    from scipy.special import chdtrc

    own = covariance[np.ix_(chosen, chosen)]
    scale = 1 / np.sqrt(np.maximum(np.diag(own), 1e-300))
    values, vectors = np.linalg.eigh(own * np.outer(scale, scale))
    kept = values > 1e-9
    if not kept.any():
        return 1.0  # nothing is known of them
    root = scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])
    along = x[chosen] @ root
    if bias is not None and np.any(bias[chosen]):
        aside = bias[chosen] @ root
        along = along - np.clip(along @ aside / (aside @ aside), -1.0, 1.0) * aside
    return float(chdtrc(int(kept.sum()), along @ along))


def _alike(difference: FloatArray, noise: FloatArray) -> bool:
    """Whether left-out errors that differ by this, per block and joint, tie."""
    per_block = np.sum(difference / noise**2, axis=1)
    spread = per_block.std(ddof=1) * np.sqrt(len(per_block))
    return bool(abs(per_block.sum()) < TIE * spread)
