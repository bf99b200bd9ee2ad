"""Contact: an outside force for a limited time, as bursts of residual on one or several joints.

Only what is local in time counts (a running median is taken off), against the scale that the same joint's residual has
elsewhere, near its reversals against other reversals. Where a joint has just turned round, friction can be anything up to
its own size: that much of a burst says nothing; nor does a joint that is faster or more loaded than in any other run
that was learned from. Joints that rest are only looked at in runs in which the whole arm rests; then nothing but a force from outside can
change their torque.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.assembly import evaluate
from dynid_rs.columns import run_rows
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.links import stack_one, weighted_system
from dynid_rs.memory import WEAK
from dynid_rs.preprocessing import States, stretches

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LENGTHS = (0.3, 0.6, 1.0)
"""Bursts [s] that are looked for; longer ones are found by their parts."""
LOCAL = 5.0
"""What changes more slowly than this [s] is no burst."""
SURE, LIKELY = 5.8, 4.8
"""Standard deviations of a burst, on one joint or taken together over all: of the first, and of more beside it.

Thirty clean arms with four runs of 20 s each have none above 5.3.
"""
EDGE = 2.0
"""A window reaches as far as its burst stands out by this many standard deviations of the narrowest kernel."""
NEAREST = 0.25
"""Windows closer than this [s] are one."""
REST_TIME, REST_RANGE = 2.0, 0.01
"""A joint rests while it stays within this part of its usual range for this time [s]."""
REST_RUN = 0.8
"""An arm that rests for this part of a run was held there on purpose; shorter rest is a pause, with brakes in it."""
PRESLIDING, SLOW = 0.01, 0.02
"""Since a reversal friction is not settled for this way [rad], and below this part of the usual speed."""
UNFITTED_SPEED = 0.8
"""Runs that were not learned from are looked at below this part of the training runs' greatest speed."""
REVERSAL_EDGES = (0.15, 0.3, 0.5, 0.8)
"""Times from a reversal [s] between which residuals are compared with each other."""
QUANTILES, REST_QUANTILES = (0.5, 0.75, 0.9), (0.5, 0.75)
"""The scale is the greatest that these quantiles give: contact is rare, wrong models are not."""
LEAST_VALUES = 20


@dataclass(frozen=True)
class Contact:
    """One burst: `start`, `end` [s] of its run's clock, the joints that feel it, each one's peak [torque unit]."""

    run: str
    start: float
    end: float
    joints: tuple[int, ...]
    peak: tuple[float, ...]
    strength: float


@dataclass(frozen=True, eq=False)
class Watch:
    """Residual of one run on its rows' grid, ready to be searched; every matrix (n_grid, n_joints).

    `residual` with the running median taken off; `seen` where a joint says something; `slack` how much of it friction
    may be; `unsure` standard deviation of the model's own prediction; `since` time [s] to the nearest reversal;
    `resting` (n_grid,) whether the whole arm rests.
    """

    name: str
    t: FloatArray
    residual: FloatArray
    seen: BoolArray
    slack: FloatArray
    unsure: FloatArray
    since: FloatArray
    resting: BoolArray
    step: float


def find_contacts(fit: ThreeLoopIdentifier, runs: Sequence[States]) -> list[Contact]:
    """Find bursts in runs that were prepared without any exclusion, training and test runs alike.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        Fitted without a third loop; windows that are known already may have been excluded.
    runs : sequence of States
        Channels as recorded.
    """
    usual = _Usual(fit)
    watches = [_watch(fit, states, usual) for states in runs]
    scores = [[_smooth(watch, length) for watch in watches] for length in LENGTHS]
    scales = [_scales(watches, level) for level in scores]
    z = [
        [
            np.maximum(np.abs(x.m) - x.slack, 0) / np.hypot(scale, x.unsure)
            for x, scale in zip(level, scaled, strict=True)
        ]
        for level, scaled in zip(scores, scales, strict=True)
    ]
    strengths = [np.max([_together(level[k]) for level in z], axis=0) for k in range(len(watches))]
    if max(float(strength.max()) for strength in strengths) < SURE:
        return []
    return [
        _contact(watch, [level[k] for level in z], strengths[k], rows)
        for k, watch in enumerate(watches)
        # The narrowest kernel says where a burst ends, all of them together where there is one.
        for rows in _windows(strengths[k], _together(z[0][k]), watch)
    ]


def _contact(watch: Watch, z: Sequence[FloatArray], strength: FloatArray, window: tuple[int, int]) -> Contact:
    """Put a window (half-open range of samples) in words: when, which joints, how much."""
    rows = slice(*window)
    peaks = np.max([level[rows].max(axis=0) for level in z], axis=0)
    joints = np.flatnonzero(peaks >= min(peaks.max(), max(EDGE + 1, 0.3 * peaks.max())))
    residual = watch.residual[rows]
    peak = residual[np.abs(residual).argmax(axis=0), np.arange(len(peaks))]
    return Contact(
        watch.name,
        float(watch.t[window[0]]),
        float(watch.t[window[1] - 1]),
        tuple(joints.tolist()),
        tuple(peak[joints].tolist()),
        float(strength[rows].max()),
    )


def windows_of(
    contacts: Sequence[Contact], known: Mapping[str, Sequence[tuple[float, float]]] | None = None
) -> dict[str, tuple[tuple[float, float], ...]]:
    """Windows (start, end) [s] by run name, those of `known` joined with them."""
    result: dict[str, list[tuple[float, float]]] = {name: list(windows) for name, windows in (known or {}).items()}
    for contact in contacts:
        result.setdefault(contact.run, []).append((contact.start, contact.end))
    return {name: _joined(windows) for name, windows in result.items()}


def _joined(windows: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    joined: list[tuple[float, float]] = []
    for start, end in sorted(windows):
        if joined and start <= joined[-1][1] + NEAREST:
            joined[-1] = (joined[-1][0], max(end, joined[-1][1]))
        else:
            joined.append((start, end))
    return tuple(joined)


class _Usual:
    """What joints do in the training runs, and how well the model knows what it predicts."""

    def __init__(self, fit: ThreeLoopIdentifier) -> None:
        from scipy.linalg import svd

        runs = fit.runs_
        self._fit = fit
        self._plan = fit.observations_.plan
        system = weighted_system(fit.observations_, fit.links_)[:, :-1]
        norms = np.linalg.norm(system, axis=0)
        norms[norms == 0] = 1.0
        _, s, vt = svd(_core.triangular_factor(system / norms), full_matrices=False, lapack_driver="gesvd")
        good = s > WEAK * s[0]
        self._root: FloatArray = vt[good].T / s[good] / norms[:, None]
        self.range: FloatArray = np.ptp(np.concatenate([states.q for states in runs]), axis=0)
        self._most = {states.name: self._extremes(states) for states in runs}
        self.top: FloatArray = np.max(list(self._most.values()), axis=0)[0]
        names = [name for effect in fit.observations_.plan.effects for name in effect.coefficient_names]
        sides = [names.index(name) for name in ("coulomb_pos", "coulomb_neg")]
        self.coulomb: FloatArray = np.abs(fit.links_.own_[:, sides]).max(axis=1)

    def unsure(self, states: States, load: FloatArray) -> FloatArray:
        """Standard deviation of the predicted torque in the band on the rows' grid, (n_grid, n_joints)."""
        fit, plan = self._fit, self._plan
        rows = run_rows(plan, replace(states, tau_link=load), states.tau, kept=states.grid.tolist())
        scale = fit.links_.torque_scale_
        return np.stack(
            [np.linalg.norm(stack_one(plan, j, x, scale)[:, :-1] @ self._root, axis=1) for j, x in enumerate(rows)],
            axis=1,
        )

    def _extremes(self, states: States) -> FloatArray:
        return np.stack([np.abs(states.dq).max(axis=0), np.abs(self.load(states)).max(axis=0)])

    def load(self, states: States) -> FloatArray:
        """Rigid-body torque [N m] that is predicted at every sample, (n, n_joints)."""
        return self._plan.robot.inverse_dynamics(states.q, states.dq, states.ddq, self._fit.model_.phi)

    def familiar(self, states: States, load: FloatArray) -> BoolArray:
        """Samples of joints no faster and no more loaded than in another training run; a lone run knows its own."""
        others = [most for run, most in self._most.items() if run != states.name]
        speed, torque = np.max(others or list(self._most.values()), axis=0)
        if states.name not in self._most:
            speed = UNFITTED_SPEED * speed  # friction's powers of speed go astray before they leave the data
        result: BoolArray = (np.abs(states.dq) <= speed) & (np.abs(load) <= torque)
        return result


def _watch(fit: ThreeLoopIdentifier, states: States, usual: _Usual) -> Watch:
    from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d

    grid, step = states.grid, states.step / states.rate
    aligned = states if fit.encoder_delay_ is None else states.aligned(fit.encoder_delay_.value)
    load = usual.load(aligned)
    error = states.band.apply(states.tau - evaluate(fit.model_, states)[0], states.rate)[grid]
    q, dq, t = states.q[grid], states.dq[grid], states.t[grid]
    width = max(3, int(REST_TIME / step))
    rests = maximum_filter1d(q, width, axis=0) - minimum_filter1d(q, width, axis=0) < REST_RANGE * usual.range
    resting = rests.all(axis=1)
    resting &= resting.mean() > REST_RUN
    guard = max(1, int(1 / states.band.cutoff / step))
    inside = np.ones(len(t), dtype=bool)
    inside[:guard] = inside[-guard:] = False
    known = ~rests & usual.familiar(aligned, load)[grid]
    seen = np.where(resting[:, None], inside[:, None], states.moving[grid][:, None] & known)
    # Pauses have another torque; what the median bridges there is what lies on both sides.
    usable = seen.any(axis=1)
    local = np.zeros_like(error)
    if usable.any():
        bridged = np.stack([np.interp(t, t[usable], column[usable]) for column in error.T], axis=1)
        local = bridged - median_filter(bridged, size=(max(3, int(LOCAL / step)), 1), mode="nearest")
    since, way = _since_reversal(t, q, dq)
    unsettled = ((way < PRESLIDING) | (np.abs(dq) < SLOW * usual.top)) & ~resting[:, None]
    return Watch(
        states.name,
        t,
        np.where(seen, local, 0.0),
        seen,
        unsettled * usual.coulomb,
        usual.unsure(aligned, load) * ~resting[:, None],
        since,
        resting,
        step,
    )


def _since_reversal(t: FloatArray, q: FloatArray, dq: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Time to the nearest reversal and way from where it was, per sample and joint."""
    time, way = np.full(q.shape, np.inf), np.full(q.shape, np.inf)
    for j in range(q.shape[1]):
        turns = np.flatnonzero(np.diff(np.signbit(dq[:, j])))
        if len(turns):
            right = np.clip(np.searchsorted(turns, np.arange(len(t))), 0, len(turns) - 1)
            for nearest in (turns[np.maximum(right - 1, 0)], turns[right]):
                time[:, j] = np.minimum(time[:, j], np.abs(t - t[nearest]))
                way[:, j] = np.minimum(way[:, j], np.abs(q[:, j] - q[nearest, j]))
    return time, way


@dataclass(frozen=True, eq=False)
class _Level:
    """Residual of one run through a kernel of unit power, what friction and the model's own doubt may be of it,
    and where most of the kernel saw something; (n_grid, n_joints) each."""

    m: FloatArray
    slack: FloatArray
    unsure: FloatArray
    enough: BoolArray


def _smooth(watch: Watch, length: float) -> _Level:
    """Look at a run through a kernel of `length` [s]."""
    from scipy.ndimage import convolve1d

    kernel = np.hanning(max(1, round(length / watch.step)) + 2)[1:-1]
    if len(kernel) % 2 == 0:
        kernel = np.hanning(len(kernel) + 3)[1:-1]
    kernel /= np.linalg.norm(kernel)
    share = np.sqrt(np.maximum(convolve1d(watch.seen.astype(float), kernel**2, axis=0, mode="constant"), 1e-12))
    enough = watch.seen & (share > np.sqrt(0.5))
    # What the model does not know is wrong in the same direction all over the kernel.
    return _Level(
        *(
            np.where(enough, convolve1d(x * watch.seen, kernel, axis=0, mode="constant") / share, 0.0)
            for x in (watch.residual, watch.slack, watch.unsure)
        ),
        enough,
    )


def _scales(watches: Sequence[Watch], level: Sequence[_Level]) -> list[FloatArray]:
    """Standard deviation that a joint's smoothed residual has by itself at every sample."""
    scales = [np.full(x.m.shape, np.inf) for x in level]
    n = level[0].m.shape[1]
    edges = (0.0, *REVERSAL_EDGES, np.inf)
    for j in range(n):
        for at_rest, quantiles in ((False, QUANTILES), (True, REST_QUANTILES)):
            masks = [x.enough[:, j] & (watch.resting == at_rest) for watch, x in zip(watches, level, strict=True)]
            values = [np.abs(x.m[mask, j]) for mask, x in zip(masks, level, strict=True)]
            # A run that rests is a pose of its own; runs that move are alike.
            common = 0.0 if at_rest else _scale(np.concatenate(values), quantiles)
            for scale, mask, own in zip(scales, masks, values, strict=True):
                size = max(common, _scale(own, quantiles))
                scale[mask, j] = size if size > 0 else np.inf
            if at_rest:
                continue
            for low, high in zip(edges[:-1], edges[1:], strict=True):
                near = [
                    mask & (watch.since[:, j] >= low) & (watch.since[:, j] < high)
                    for mask, watch in zip(masks, watches, strict=True)
                ]
                alike = _scale(
                    np.concatenate([np.abs(x.m[mask, j]) for mask, x in zip(near, level, strict=True)]), quantiles
                )
                for scale, mask in zip(scales, near, strict=True):
                    scale[mask, j] = np.maximum(scale[mask, j], alike)
    return scales


def _scale(values: FloatArray, quantiles: Sequence[float]) -> float:
    from scipy.stats import norm

    if len(values) < LEAST_VALUES:
        return 0.0
    at = np.quantile(values, quantiles)
    return float(np.max(at / norm.ppf(0.5 + np.array(quantiles) / 2)))


def _together(z: FloatArray) -> FloatArray:
    """Standard deviations of all joints taken together, or of the one that stands out most, (n_grid,)."""
    from scipy.stats import chi2

    tail = np.clip(chi2.logsf(np.sum(z**2, axis=1), z.shape[1]), -700, None)
    # One degree of freedom with the same chance.
    result: FloatArray = np.maximum(np.sqrt(chi2.isf(np.exp2(tail / np.log(2)), 1)), z.max(axis=1))
    return result


def _windows(strength: FloatArray, near: FloatArray, watch: Watch) -> list[tuple[int, int]]:
    """Half-open ranges of samples around every burst, as far as it stands out."""
    marked = np.zeros(len(strength), dtype=bool)
    reach = max(1, round(LENGTHS[0] / 2 / watch.step))
    for peak in np.flatnonzero(strength > LIKELY):
        first = last = int(peak)
        # A dip no longer than the narrowest kernel is inside the burst.
        while first > 0 and near[max(0, first - reach) : first].max() > EDGE:
            first -= 1
        while last < len(near) - 1 and near[last + 1 : last + 1 + reach].max() > EDGE:
            last += 1
        marked[first : last + 1] = True
    gap = max(1, round(NEAREST / watch.step))
    for first, last in stretches(~marked):
        if 0 < first and last < len(marked) and last - first <= gap:
            marked[first:last] = True
    return stretches(marked)
