"""What a run shows of forces from outside: the residual that is local in time, and where it may be trusted.

Where a joint has just turned round, friction can be anything up to its own size: that much of a burst says nothing; nor
does a joint that is faster or more loaded than in any other run that was learned from. A joint that rests while others
move is not looked at. In a pause of the whole arm no model is needed: what holds it does not change for a while and
come back by more than friction may hold, unless a force from outside does. Nor does it change where the whole arm rests
nearly all of the time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.memory import WEAK
from dynid_rs.base.spread import spread
from dynid_rs.identification.loads import with_load
from dynid_rs.identification.smooth_friction import sign_by_way
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.assembly import evaluate
from dynid_rs.regression.columns import Plan, run_rows
from dynid_rs.regression.fitted import weighted_system
from dynid_rs.runs.preprocessing import MEMORY, STILL_SPEED, States, stretches

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LOCAL = 5.0
"""What changes more slowly than this [s] is no burst."""
REST_TIME, REST_RANGE = 2.0, 0.01
"""A joint rests while it stays within this part of its usual range for this time [s]."""
REST_RUN = 0.8
"""An arm that rests for this part of a run was held there on purpose; shorter rest is a pause, with brakes in it."""
QUIET = 0.15
"""What the torque is before and after a burst in a pause is told by the pause's first and last samples [s]."""
AGREE = 0.25
"""They differ by less than this part of the burst. What changes one way only, as controllers settle and brakes close,
leaves the line between them by less than all of it; a quarter leaves room for noise."""
RELEASED = 0.2
"""A brake that closes and opens again takes the whole arm's torque below this part of what it was: to noise."""
TREMBLING = 0.15
"""Reversals closer than this [s] are one: an arm takes longer to come back."""
PRESLIDING, SLOW = 0.01, 0.02
"""Since a reversal friction is not settled for this way [rad], and below this part of the usual speed."""
UNFITTED_SPEED = 0.8
"""Runs that were not learned from are looked at below this part of the training runs' greatest speed."""


@dataclass(frozen=True, eq=False)
class Watch:
    """Residual of one run on its rows' grid, ready to be searched; every matrix (n_grid, n_joints).

    `residual` with the running median taken off, in a pause the torque at its ends; `seen` where a joint says
    something; `slack` how much of it friction may be; `unsure` standard deviation of the model's own prediction, in a
    pause of those ends; `since` time [s] to the nearest reversal, `turn` which one that is; `resting` (n_grid,) whether
    the whole arm rests, `pause` (n_grid,) the number of the pause that a sample is in, -1 in none.
    """

    name: str
    t: FloatArray
    residual: FloatArray
    seen: BoolArray
    slack: FloatArray
    unsure: FloatArray
    since: FloatArray
    turn: NDArray[np.intp]
    resting: BoolArray
    pause: NDArray[np.intp]
    step: float


class Usual:
    """What joints do in the training runs, and how well the model knows what it predicts."""

    def __init__(self, fit: ThreeLoopIdentifier) -> None:
        from scipy.linalg import svd

        runs = fit.runs_
        self._fit = fit
        self._plan = fit.observations_.plan
        self._loaded = with_load(self._plan, fit.links_, fit.links_.own_)
        system = weighted_system(fit.observations_, fit.links_)[:, :-1]
        norms = np.linalg.norm(system, axis=0)
        norms[norms == 0] = 1.0
        _, s, vt = svd(_core.triangular_factor(system / norms), full_matrices=False, lapack_driver="gesvd")
        good = s > WEAK * s[0]
        self._root: FloatArray = vt[good].T / s[good] / norms[:, None]
        self.range: FloatArray = np.ptp(np.concatenate([states.q for states in runs]), axis=0)
        self._most = {states.name: self._extremes(states) for states in runs}
        self.top: FloatArray = np.max(list(self._most.values()), axis=0)[0]
        self.coulomb: FloatArray = _turning(self._plan, fit.links_.own_)

    def unsure(self, states: States) -> FloatArray:
        """Standard deviation of the predicted torque in the band on the rows' grid, (n_grid, n_joints)."""
        fit, plan = self._fit, self._plan
        rows = run_rows(plan, self._loaded(states), states.tau, kept=states.grid.tolist())
        unsure = np.empty((len(rows[0]), len(rows)))
        for j, (own, scale) in enumerate(zip(rows, fit.links_.torque_scale_, strict=True)):
            root = self._root[plan.unknowns(j)]
            root[plan.n_own :] *= scale
            unsure[:, j] = np.linalg.norm(own[:, :-1] @ root, axis=1)
        return unsure

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


def _turning(plan: Plan, own: FloatArray) -> FloatArray:
    """Friction that turns round with the motion (n_joints,): Coulomb's greater side, and what is told by the way."""
    law, at = plan.friction
    sides = [at.start + k for k, name in enumerate(law.coefficient_names) if name.startswith("coulomb")]
    by_way = [part for effect, part in plan.terms(own) if effect.kind == sign_by_way(1).kind]
    turning: FloatArray = np.abs(own[:, sides]).max(axis=1)
    for part in by_way:
        turning += np.abs(part).sum(axis=1)
    return turning


def watch_run(fit: ThreeLoopIdentifier, states: States, usual: Usual) -> Watch:
    """Look at a run (channels as recorded) for what the fitted model does not hold."""
    from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d

    grid, step = states.grid, states.step / states.rate
    delay = np.zeros(states.q.shape[1]) if fit.encoder_delay_ is None else fit.encoder_delay_.value
    aligned = states.aligned(delay, fit.encoder_error)
    load = usual.load(aligned)
    error = states.band.apply(states.tau - evaluate(fit.model_, states)[0], states.rate)[grid]
    q, t = states.q[grid], states.t[grid]
    width = max(3, int(REST_TIME / step))
    rests = maximum_filter1d(q, width, axis=0) - minimum_filter1d(q, width, axis=0) < REST_RANGE * usual.range
    resting = rests.all(axis=1)
    resting &= resting.mean() > REST_RUN
    # What the filters make of a run's ends in motion a fit outweighs, and a search for bursts finds.
    guard = max(1, int(MEMORY / states.band.cutoff / step))
    inside = np.ones(len(t), dtype=bool)
    inside[:guard] = inside[-guard:] = False
    known = ~rests & usual.familiar(aligned, load)[grid]
    seen = inside[:, None] & (resting[:, None] | states.moving[grid][:, None] & known)
    # Pauses have another torque; what the median bridges there is what lies on both sides.
    usable = seen.any(axis=1)
    local = np.zeros_like(error)
    if usable.any():
        bridged = np.stack([np.interp(t, t[usable], column[usable]) for column in error.T], axis=1)
        local = bridged - median_filter(bridged, size=(max(3, int(LOCAL / step)), 1), mode="nearest")
    held, doubt, pause = _held(states)
    if resting.any():
        pause[:] = -1
    at_rest = (pause >= 0)[:, None]
    seen, local = np.where(at_rest, np.isfinite(held), seen), np.where(at_rest, np.nan_to_num(held), local)
    unsure = np.where(at_rest, doubt, usual.unsure(aligned))
    since, way, turn = _since_reversal(states.t, states.q, states.dq)
    unsettled = (way < PRESLIDING) | (np.abs(states.dq) < SLOW * usual.top)
    slack = _in_band_at_most(states, unsettled * usual.coulomb)[grid]
    return Watch(
        states.name,
        t,
        np.where(seen, local, 0.0),
        seen,
        np.where(at_rest, usual.coulomb, slack) * ~resting[:, None],
        unsure * ~resting[:, None],
        since[grid],
        turn[grid],
        resting,
        pause,
        step,
    )


def _held(states: States) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
    """How far the torque in pauses is from what it is at their ends, how well those tell it, and which pause it is.

    (n_grid, n_joints) twice, NaN where a joint's torque does not come back, or a brake took it; (n_grid,), -1 in none.
    """
    from scipy.ndimage import uniform_filter1d

    grid = states.grid
    tau = uniform_filter1d(states.tau, states.step, axis=0)[grid]
    still = np.all(np.abs(states.dq[grid]) <= STILL_SPEED * np.abs(states.dq).max(axis=0), axis=1)
    held, doubt, number = np.full(tau.shape, np.nan), np.zeros(tau.shape), np.full(len(grid), -1)
    quiet = max(1, round(QUIET * states.rate / states.step))
    guard = max(1, int(states.rate / states.step / states.band.cutoff))
    for k, (first, last) in enumerate(stretches(still)):
        rows = slice(first + guard, last - guard)  # the band's filter takes slow motion for none
        if rows.stop - rows.start < 3 * quiet:
            continue
        pause = tau[rows]
        before, after = pause[:quiet].mean(axis=0), pause[-quiet:].mean(axis=0)
        burst = pause - np.linspace(before, after, len(pause))
        # Standard error of a mean of few rows, whose noise all differences tell.
        noise = np.array([spread(np.abs(steps), (0.5,)) for steps in np.diff(pause, axis=0).T]) / np.sqrt(2)
        doubt[rows] = noise / np.sqrt(quiet)
        most = np.abs(burst).max(axis=0)
        peak = pause[np.argmax(np.linalg.norm(burst / np.where(most > 0, most, 1.0), axis=1))]
        if np.linalg.norm(peak) >= RELEASED * np.linalg.norm(before):
            inside = slice(rows.start + quiet, rows.stop - quiet)
            held[inside] = np.where(np.abs(after - before) <= AGREE * most, burst, np.nan)[quiet:-quiet]
        number[rows] = k
    return held, doubt, number


def _in_band_at_most(states: States, x: FloatArray) -> FloatArray:
    """What errors between -x and x (n, n_joints) may be in the band, whatever they are in time.

    A joint that was at rest is off by up to its friction, and what the filter makes of that reaches into the motion.
    """
    from scipy.ndimage import convolve1d

    reach = int(MEMORY * states.rate / states.band.cutoff)
    impulse = np.zeros((2 * reach + 1, 1))
    impulse[reach] = 1.0
    weights = np.abs(states.band.apply(impulse, states.rate)[:, 0])
    return np.asarray(convolve1d(x, weights, axis=0, mode="nearest"))


def _since_reversal(t: FloatArray, q: FloatArray, dq: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
    """Time to the nearest reversal, way from where one was, and the number of the nearest, per sample and joint."""
    time, way = np.full(q.shape, np.inf), np.full(q.shape, np.inf)
    number = np.zeros(q.shape, dtype=np.intp)
    for j in range(q.shape[1]):
        turns = np.flatnonzero(np.diff(np.signbit(dq[:, j])))
        if len(turns):
            # A speed that trembles round zero turns round once.
            once = np.concatenate([[0], np.cumsum(np.diff(t[turns]) > TREMBLING)])
            right = np.clip(np.searchsorted(turns, np.arange(len(t))), 0, len(turns) - 1)
            for beside in (np.maximum(right - 1, 0), right):
                nearest = turns[beside]
                apart = np.abs(t - t[nearest])
                number[:, j] = np.where(apart < time[:, j], once[beside], number[:, j])
                time[:, j] = np.minimum(time[:, j], apart)
                way[:, j] = np.minimum(way[:, j], np.abs(q[:, j] - q[nearest, j]))
    return time, way, number
