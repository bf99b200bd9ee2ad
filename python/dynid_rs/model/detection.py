"""How soon contacts show against how many false ones: steps of torque added to runs that nothing touched."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid_rs.base.drawing import line, panels, titled
from dynid_rs.model.observer import MomentumObserver
from dynid_rs.runs.given import Runs, as_recordings

FloatArray = NDArray[np.float64]

LEVELS = np.geomspace(0.05, 20.0, 200)
"""What thresholds are multiplied by."""
SECOND = 1.0
"""A false contact is a second in which thresholds were passed [s]."""
HELD, EVERY = 0.3, 1.0
"""A step lasts so long, and comes so often, give or take a quarter [s]."""
BEGIN = 2.0
"""The first step of a run, at the earliest [s]."""


@dataclass(frozen=True, eq=False)
class DetectionCurve:
    """Delays against false contacts, by kind of threshold.

    `"identified"`: the observer's own, from state to state. `"constant"`: per joint a multiple of the greatest that
    healthy runs showed. Both on the same runs and the same steps, at the same levels (n_levels,).

    Attributes
    ----------
    levels : ndarray (n_levels,)
        What thresholds are multiplied by.
    hours : float
        Of runs without contact [h]: fewer false contacts than one over it cannot be told from none.
    false_per_hour : mapping of str to ndarray (n_levels,)
        Seconds with a contact where there was none, per hour.
    delay : mapping of str to ndarray (n_levels,)
        Median of all steps [s], infinite where more than half are missed. It holds the filter's own delay.
    missed : mapping of str to ndarray (n_levels,)
        Share of the steps that nothing showed.
    """

    levels: FloatArray
    hours: float
    false_per_hour: Mapping[str, FloatArray]
    delay: Mapping[str, FloatArray]
    missed: Mapping[str, FloatArray]

    def to_json(self) -> dict[str, Any]:
        """For a file: infinite delays are null."""

        def finite(values: FloatArray) -> list[float | None]:
            return [float(x) if np.isfinite(x) else None for x in values]

        names = ("false_per_hour", "delay", "missed")
        curves = {name: {kind: finite(values) for kind, values in getattr(self, name).items()} for name in names}
        return {"levels": self.levels.tolist(), "hours": self.hours, **curves}

    def plot(self, axes: Any = None) -> NDArray[Any]:
        """Draw delays and missed steps over false contacts per hour; the axes (1, 2)."""
        drawn = panels(1, 2, axes)
        left, right = drawn[0]
        for k, kind in enumerate(self.false_per_hour):
            shown = np.maximum(self.false_per_hour[kind], 0.5 / self.hours)
            line(left, shown, 1e3 * self.delay[kind], color=f"C{3 * k}", label=kind)
            line(right, shown, 100 * self.missed[kind], color=f"C{3 * k}", label=None)
        titled(drawn, ["steps of torque"])
        left.set_ylabel("median delay [ms]")
        right.set_ylabel("missed [%]")
        for axis in (left, right):
            axis.set_xscale("log")
            axis.set_xlabel("false contacts per hour")
        left.legend()
        return drawn


def detection_curve(
    observer: MomentumObserver, runs: Runs, torque: ArrayLike, *, random_state: int = 0
) -> DetectionCurve:
    """Add steps of torque to runs that nothing touched, and count what is found and what is false, level by level.

    The torque that is measured is less by the step: the controller holds the motion against it.

    Parameters
    ----------
    observer : MomentumObserver
        Fitted on other runs, long enough to learn from.
    runs : recording, data frame, or list of them
        Without contact; neither the model nor the observer has seen them.
    torque : float or array_like (n_joints,)
        Size of a step on each joint [torque unit]; joint and sign are drawn.

    Raises
    ------
    ValueError
        The observer has learned nothing, a size is not positive, or the runs are too short for a step.
    """
    recordings = as_recordings(runs, observer.model.robot)
    sizes = np.broadcast_to(np.asarray(torque, dtype=np.float64), (observer.model.robot.n_joints,))
    if getattr(observer, "uncertainty_", None) is None:
        raise ValueError("detection_curve: the observer has learned nothing; fit it on two minutes without contact")
    if not hasattr(observer, "greatest_"):
        raise ValueError(
            "detection_curve: of an observer that was loaded the greatest healthy torque, which a constant threshold "
            "is set by, is not known; fit it on two minutes without contact"
        )
    if not np.all(sizes > 0) or not np.all(np.isfinite(sizes)):
        raise ValueError(
            "detection_curve: the size of a step is not positive; give one per joint, in the torques' unit"
        )
    rng = np.random.default_rng(random_state)
    kinds = ("identified", "constant")
    peaks: dict[str, list[FloatArray]] = {kind: [] for kind in kinds}
    delays: dict[str, list[FloatArray]] = {kind: [] for kind in kinds}
    for run in recordings:
        step = 1.0 / run.rate
        firsts = _begins(rng, len(run.t), step)
        pushed = run.tau.copy()
        length = round(HELD / step)
        for first in firsts:
            j = int(rng.integers(run.n_joints))
            pushed[first : first + length, j] -= sizes[j] * rng.choice((-1.0, 1.0))
        untouched, touched = _ratios(observer, run), _ratios(observer, replace(run, tau=pushed))
        for kind in kinds:
            peaks[kind].append(_greatest(untouched[kind], max(1, round(SECOND / step))))
            delays[kind] += [_delays(touched[kind], first, length, step) for first in firsts]
    seconds = sum(map(len, peaks["identified"])) * SECOND
    if not delays["identified"] or seconds == 0:
        raise ValueError(f"detection_curve: no run is longer than {BEGIN + 2 * EVERY:g} s; give longer runs")
    false, median, missed = {}, {}, {}
    for kind in kinds:
        own = np.concatenate(peaks[kind])
        false[kind] = np.array([np.count_nonzero(own > level) for level in LEVELS]) * 3600 / seconds
        told = np.sort(np.stack(delays[kind]), axis=0)
        median[kind] = told[(len(told) - 1) // 2]
        missed[kind] = np.mean(np.isinf(told), axis=0)
    return DetectionCurve(LEVELS, seconds / 3600, false, median, missed)


def _ratios(observer: MomentumObserver, run: Any) -> dict[str, FloatArray]:
    """External torque over its threshold, the joint that is furthest beyond (n_samples,)."""
    seen = observer.observe(run)
    external = np.abs(seen.external)
    return {
        "identified": (external / seen.threshold).max(axis=1),
        "constant": (external / np.maximum(observer.greatest_, np.finfo(float).tiny)).max(axis=1),
    }


def _begins(rng: np.random.Generator, n: int, step: float) -> list[int]:
    """Samples at which steps begin."""
    found, t = [], BEGIN + rng.uniform(0.0, EVERY)
    while round((t + EVERY) / step) < n:
        found.append(round(t / step))
        t += EVERY * rng.uniform(0.75, 1.25)
    return found


def _greatest(ratio: FloatArray, size: int) -> FloatArray:
    """Of every second but for the first, in which the observer begins."""
    greatest: FloatArray = ratio[size : len(ratio) // size * size].reshape(-1, size).max(axis=1)
    return greatest


def _delays(ratio: FloatArray, first: int, length: int, step: float) -> FloatArray:
    """Seconds after which each level was passed (n_levels,); infinite where it was not, or was before the step."""
    highest = np.maximum.accumulate(ratio[first : first + length])
    at = np.searchsorted(highest, LEVELS, side="right")
    early = ratio[max(0, first - length // 3) : first].max()
    delays: FloatArray = np.where((at < len(highest)) & (early <= LEVELS), at * step, np.inf)
    return delays
