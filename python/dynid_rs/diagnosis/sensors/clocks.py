"""Torque channels on another clock than the encoders: one delay for all joints, or joints with a delay of their own.

A torque that is read d late leaves ``-d dtau/dt`` of the predicted torque beside the model, whose friction and inertia
absorb a part: d is estimated beside all of it, by Gauss-Newton on the shift. A clock knows nothing of where a torque
comes from, so gravity's part, inertia's and friction's must all be late by the same d. Effects that look like a delay
(friction with memory, a geometry that is wrong) are late in one part only, and are not taken for one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.assembly import evaluate
from dynid_rs.diagnosis.sensors.beside import Beside
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.preprocessing import States

FloatArray = NDArray[np.float64]

LEVEL = 2e-3
"""Chance that an arm without any delay is given one; shared by all places that are tried."""
AGREES = 1e-2
"""Parts of the torque disagree about the delay where chance alone would do so less often."""
POINTS = 5e-2
"""Gravity's and inertia's parts point to a delay where chance alone would do so less often."""
N_STEPS = 4
"""Gauss-Newton steps; each leaves about a tenth of the error of the one before."""
FARTHEST = 0.5
"""Greatest delay over the band's shortest period: beyond it a shift has no slope to follow."""
LEAST_DELAY = 2e-5
"""Delays below this [s] change nothing that could be measured."""
SAME = 2.0
"""Friction's part says the same as the only other one where it stands out by so many standard errors, too."""
GEAR_WAYS = (0.1, 0.4)
"""Ways over which a gear's inner friction turns round, over the standard deviation of its deflection."""
GEAR_SURE = 4.0
"""Gears whose inner friction stands out by this many standard errors have it beside the delay."""


LATEST = 0.1
"""A torque channel that is later than this [s] is no channel of a controller."""


@dataclass(frozen=True, eq=False)
class DelayParts:
    """Delay [s] of gravity's, inertia's and friction's part of every joint's torque, (3, n_joints), NaN where unseen.

    `covariance` (3 n_joints, 3 n_joints) in the same order; `dof` independent stretches behind it.
    """

    value: FloatArray
    covariance: FloatArray
    dof: int

    @property
    def std_error(self) -> FloatArray:
        """(3, n_joints) [s]."""
        return np.sqrt(np.diag(self.covariance)).reshape(self.value.shape)


@dataclass(frozen=True, eq=False)
class TorqueDelay:
    """Places with a delay: all joints, or one. Delays of several places add up where they share joints.

    `places` joints of each; `value`, `std_error`, `p_value` (n_places,) of each [s, s, 1]; `dof` for its interval.
    """

    n_joints: int
    places: tuple[tuple[int, ...], ...] = ()
    value: tuple[float, ...] = ()
    std_error: tuple[float, ...] = ()
    p_value: tuple[float, ...] = ()
    dof: int = 1

    @property
    def per_joint(self) -> FloatArray:
        """Delay of every joint's torque channel [s], (n_joints,)."""
        total = np.zeros(self.n_joints)
        for joints, value in zip(self.places, self.value, strict=True):
            total[list(joints)] += value
        return total

    def intervals(self) -> list[tuple[float, float]]:
        """95 % interval of every place's delay [s]."""
        from scipy.stats import t

        reach = float(t.ppf(0.975, max(self.dof, 1)))
        return [(v - reach * s, v + reach * s) for v, s in zip(self.value, self.std_error, strict=True)]


def delay_parts(fit: ThreeLoopIdentifier, beside: Beside | None = None) -> DelayParts:
    """Estimate how late every part of every joint's torque is, beside the whole model.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        Fitted without a third loop.
    beside : Beside, optional
        Of `fit`, where it is there already.
    """
    beside = Beside(fit) if beside is None else beside
    n = beside.n_joints
    parts = [torque_parts(fit, k) for k in range(len(fit.runs_))]
    slopes = [[_slope(states, part) for part in run] for states, run in zip(fit.runs_, parts, strict=True)]
    whole = beside.apart([np.sum(run, axis=0) for run in slopes])
    gears = _gear_friction(beside, fit, [gravity + inertia for gravity, inertia, _ in parts], whole)
    farthest = FARTHEST / fit.band_.cutoff
    delay = np.zeros(n)
    for _ in range(N_STEPS):
        weighed = beside.weigh(np.concatenate([whole, gears], axis=1), _shifted(beside, fit, delay))
        step = np.nan_to_num(weighed.value[:n])
        delay = np.clip(delay + step, -farthest, farthest)
        if np.all(np.abs(step) < LEAST_DELAY):
            break
    columns = [*(beside.apart([run[k] for run in slopes]) for k in range(3)), gears]
    found = beside.weigh(np.concatenate(columns, axis=1), _shifted(beside, fit, delay))
    every = slice(0, 3 * n)
    return DelayParts(found.value[every].reshape(3, n) + delay, found.covariance[every, every], found.dof)


def choose_delay(parts: DelayParts, *, of_one: bool = True) -> TorqueDelay:
    """Find the places that are late: all joints together, single ones if asked for, or none.

    Forward steps by the surest place, each against the scatter that is left, then the chance to drop a place again.
    """
    n = parts.value.shape[1]
    everywhere = tuple(range(n))
    own = [(j,) for j in range(n) if _told_twice(parts, j)]
    places = [everywhere, *own] if n > 1 and of_one else [everywhere]
    seen = np.isfinite(parts.value[:2])
    seen_joints = np.flatnonzero(seen.any(axis=0))
    places = [joints for joints in places if set(joints) & set(seen_joints.tolist())]
    level = LEVEL / (n + 1)
    chosen: list[tuple[int, ...]] = []
    while len(chosen) < len(places):
        rest = [joints for joints in places if joints not in chosen]
        p_values = [_p_values(parts, [*chosen, joints])[-1] for joints in rest]
        best = int(np.argmin(p_values))
        if p_values[best] > level:
            break
        chosen.append(rest[best])
    while chosen:
        p_values = _p_values(parts, chosen)
        worst = int(np.argmax(p_values))
        if p_values[worst] <= level:
            break
        chosen.pop(worst)
    found = measure_delay(parts, chosen)
    # Slow motion or friction with memory can look like a delay of seconds; no channel is that late.
    return found if np.all(np.abs(found.per_joint) <= LATEST) else measure_delay(parts, [])


def _told_twice(parts: DelayParts, j: int) -> bool:
    """Whether more than one part of joint j's torque may speak of its clock; a lone one is joined by friction's."""
    if np.isfinite(parts.value[:2, j]).sum() != 1:
        return True
    alone, friction = float(np.nansum(parts.value[:2, j])), float(parts.value[2, j])
    return friction * alone > 0 and abs(friction) > SAME * float(parts.std_error[2, j])


def measure_delay(parts: DelayParts, places: Sequence[tuple[int, ...]]) -> TorqueDelay:
    """Delay of known places from all parts that agree; friction's counts where it does."""
    n = parts.value.shape[1]
    if not places:
        return TorqueDelay(n)
    smooth, every = (_Adjusted(parts, places, friction=friction) for friction in (False, True))
    used = every if _friction_agrees(smooth, every) else smooth
    return TorqueDelay(
        n,
        tuple(places),
        tuple(used.value.tolist()),
        tuple(used.std_error.tolist()),
        tuple(_p_values(parts, places)),
        used.t_dof,
    )


def moved_delay(delay: TorqueDelay, step: TorqueDelay) -> TorqueDelay:
    """Delay with another step on top; its errors are those of the last one."""
    value = tuple(a + b for a, b in zip(delay.value, step.value, strict=True))
    return replace(delay, value=value, std_error=step.std_error, dof=step.dof)


def _p_values(parts: DelayParts, places: Sequence[tuple[int, ...]]) -> list[float]:
    """Chance of delays this great where there are none, place by place.

    Friction's part adds its weight where gravity's and inertia's point the same way by themselves.
    """
    smooth, every = (_Adjusted(parts, places, friction=friction) for friction in (False, True))
    if smooth.dof < 0:
        return [1.0] * len(places)
    alone, together = smooth.p_values(), every.p_values()
    helps = (alone < POINTS) & (smooth.value * every.value > 0) & _friction_agrees(smooth, every)
    result: list[float] = np.where(helps, np.minimum(alone, together), alone).tolist()
    return result


def _friction_agrees(smooth: _Adjusted, every: _Adjusted) -> bool:
    from scipy.stats import chi2

    more = every.n_values - smooth.n_values
    return bool(more > 0 and chi2.sf(every.squares - smooth.squares, more) > AGREES)


class _Adjusted:
    """Delays of places fitted to the delays of the parts by generalised least squares."""

    def __init__(self, parts: DelayParts, places: Sequence[tuple[int, ...]], *, friction: bool) -> None:
        from scipy.stats import chi2

        n = parts.value.shape[1]
        seen = np.isfinite(parts.value)
        seen[2] &= friction
        flat = np.flatnonzero(seen.ravel())
        covariance = parts.covariance[np.ix_(flat, flat)]
        joint = flat % n
        design = np.stack([np.isin(joint, joints).astype(float) for joints in places], axis=1)
        root = np.linalg.cholesky(covariance + 1e-12 * np.diag(np.diag(covariance)))
        A, b = np.linalg.solve(root, design), np.linalg.solve(root, parts.value.ravel()[flat])
        self.value, *_ = np.linalg.lstsq(A, b, rcond=None)
        self.squares = float(np.sum((b - A @ self.value) ** 2))
        self.n_values, self.dof = len(flat), len(flat) - len(places)
        # Parts that scatter more than their errors say (the model is wrong elsewhere): the scatter is the measure.
        scattered = self.dof > 0 and chi2.sf(self.squares, self.dof) < AGREES
        spread = self.squares / self.dof if scattered else 1.0
        self.t_dof = max(self.dof, 1) if scattered else max(parts.dof, 1)
        self.std_error = np.sqrt(spread * np.diag(np.linalg.pinv(A.T @ A)))

    def p_values(self) -> FloatArray:
        """Chance (n_places,) of delays this great where there are none."""
        from scipy.stats import t

        result: FloatArray = 2 * t.sf(np.abs(self.value) / self.std_error, self.t_dof)
        return result


def _shifted(beside: Beside, fit: ThreeLoopIdentifier, delay: FloatArray) -> FloatArray:
    """Weighted torque of all rows as it was read `delay` (n_joints,) [s] later."""
    if not np.any(delay):
        return beside.torque
    runs = []
    for states in fit.runs_:
        tau = states.band.apply(states.tau, states.rate)
        at = states.t[states.rows]
        runs.append(np.stack([np.interp(at + d, states.t, column) for d, column in zip(delay, tau.T, strict=True)], 1))
    return beside.stacked(runs)


def torque_parts(fit: ThreeLoopIdentifier, run: int) -> list[FloatArray]:
    """Gravity's, inertia's and friction's predicted torque at every sample of a run, (n, n_joints) each."""
    model, states = fit.model_, fit.runs_[run]
    # The runs of the fit are on the motor's clock; the model puts the link channel there by itself.
    total, terms, _ = evaluate(model, fit.raw_runs_[run])
    still = np.zeros_like(states.q)
    gravity = model.robot.inverse_dynamics(states.q, still, still, model.phi) * model.torque_scale
    inertia = terms[:, 0] - gravity
    if "rotor_inertia" in model.term_names:
        inertia = inertia + terms[:, model.term_names.index("rotor_inertia")]
    return [gravity, inertia, total - inertia - gravity]


def _slope(states: States, torque: FloatArray) -> FloatArray:
    """What a unit of delay leaves: minus the torque's rate in the band at the rows."""
    return -states.in_band(np.gradient(torque, 1 / states.rate, axis=0))


def _gear_friction(
    beside: Beside, fit: ThreeLoopIdentifier, load: Sequence[FloatArray], delays: FloatArray
) -> FloatArray:
    """Columns of gears that lose torque inside when they wind up, where there are such: they look early.

    That friction follows the way of the deflection (of the load where it is not measured), as a joint's own follows
    the way of the joint; what it does to delays is taken out, and it is no finding.
    """
    n = beside.n_joints
    wound = [s.q_motor - s.q if s.two_encoders else x for s, x in zip(fit.runs_, load, strict=True)]
    scale = np.std(np.concatenate(wound), axis=0)
    columns = []
    for way in GEAR_WAYS:
        effect = _core.Effect.of("friction_hysteresis", presliding_distance=np.where(scale > 0, way * scale, 1.0))
        torque = []
        for states, x in zip(fit.runs_, wound, strict=True):
            still = np.zeros_like(x)
            torque.append(states.in_band(_core.effect_columns(effect, x, still, still, step=1 / states.rate)[:, :, 0]))
        columns.append(beside.apart(torque))
    trial = beside.weigh(np.concatenate([delays, *columns], axis=1))
    sure = np.abs(trial.value[n:] / trial.std_error[n:]).reshape(len(columns), n) > GEAR_SURE
    lossy = sure.any(axis=0)
    kept: FloatArray = np.concatenate([column[:, lossy] for column in columns], axis=1)
    return kept
