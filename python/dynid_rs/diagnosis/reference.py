"""What has changed against a trusted model: a payload, a tilt, gains, friction, offsets; or nothing.

Everything that the reference knows is held. Friction and offsets differ a little from day to day, so every fit gives
them a little freedom (a weak prior around the reference); they are named only where they have changed a lot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.assembly import evaluate
from dynid_rs.diagnosis.changes import (
    FRICTION,
    GAIN,
    OFFSET,
    PAYLOAD,
    TILT,
    Believed,
    Hypothesis,
    change_columns,
    hypotheses,
)
from dynid_rs.diagnosis.payload import physical_payload
from dynid_rs.diagnosis.weighing import Weighing
from dynid_rs.errors import DataError
from dynid_rs.evaluation import rmse
from dynid_rs.findings import Finding, joint_words
from dynid_rs.preprocessing import Band, States, choose_band, common_rate, prepare
from dynid_rs.recording import Recording
from dynid_rs.training import check_training_runs, prepare_training_runs
from dynid_rs.uncertainty import NORMAL_95

FloatArray = NDArray[np.float64]

FREEDOM = 0.2
"""Usual change of friction's parts and of offsets from day to day, over the joint's friction torque (RMS)."""
LEAST_GAIN = 0.1
"""A change is named if it takes this part off some joint's error on parts of the runs that were left out."""
SURE = 0.01
"""Family-wise error of naming a change."""
LARGE = {FRICTION: 0.3, GAIN: 0.03, TILT: 0.003, OFFSET: 0.3}
"""What is worth naming: friction and offset over the joint's friction torque (RMS), gain, tilt [rad]. Gain and tilt
have to be larger by their whole 95 % interval: under a load all that the reference lacks grows, and looks like them."""
TIE = 2.0
"""Left-out errors that differ by less than this times the difference's standard error tie."""
MOST = 8
"""Most changes that are named."""
UPDATES = 4
"""Gauss-Newton steps after a change was named; a turn of gravity needs them."""
UNEXPLAINED = 1.5
"""Error over the reference's own from which a joint is said to hold something else."""


@dataclass(frozen=True, eq=False)
class Changes:
    """What has changed.

    Parameters
    ----------
    effects : list of dict
        As in `result.json`, in the order found: kind, joints, parameters with intervals, errors on the test runs before
        and after, p_value, ties.
    model : TorqueModel
        The reference with every named change.
    findings : list of Finding
        What a person should know.
    rmse : dict
        `train` and `test`: `before` and `after`, (n_joints,) each [torque unit].
    """

    effects: list[dict[str, Any]]
    model: _core.TorqueModel
    findings: list[Finding] = field(default_factory=list)
    rmse: dict[str, dict[str, FloatArray]] = field(default_factory=dict)


def compare(
    reference: _core.TorqueModel,
    robot: _core.RobotModel,
    train: Sequence[Recording],
    test: Sequence[Recording] = (),
    *,
    cutoff: float | None = None,
) -> Changes:
    """Find what has changed since `reference` was made.

    Parameters
    ----------
    reference : TorqueModel
        Trusted; nothing of it is fitted again.
    robot : RobotModel
        Of the same arm; its declared inertials fill what the reference leaves open (needed by a tilt).
    train, test : sequence of Recording
        Runs of the robot as it is now: learned from, and errors reported on.
    cutoff : float, optional
        Band [Hz] in which torques are compared; chosen from the motion if None.

    Raises
    ------
    DataError
        Runs of another robot or in another torque unit than the reference's, a joint that never moves.
    """
    from threadpoolctl import threadpool_limits

    train, test = list(train), list(test)
    _check(reference, robot, [*train, *test])
    band = Band(cutoff) if cutoff is not None else choose_band(train)
    rate = common_rate(train)
    runs = prepare_training_runs(train, band, rate)
    with threadpool_limits(limits=1, user_api="blas"):
        return _Search(Believed.unchanged(reference, robot.phi), runs, [prepare(r, band, rate) for r in test]).run()


class _Search:
    """Forward steps: the change that explains most, everything fitted again, until nothing pays."""

    def __init__(self, believed: Believed, runs: list[States], tests: list[States]) -> None:
        self.believed, self.runs, self.tests = believed, runs, tests
        self.noise = np.maximum(believed.reference.noise_std, 1e-300)
        self.named: list[Hypothesis] = []
        self.p_values: list[float] = []
        self.ties: list[list[Hypothesis]] = []

    def run(self) -> Changes:
        before = self.believed
        beliefs = [before]
        while len(self.named) < MOST:
            found = self._next()
            if found is None:
                break
            hypothesis, p_value, ties = found
            self.named.append(hypothesis)
            self.p_values.append(p_value)
            self.ties.append(ties)
            self._update()
            beliefs.append(self.believed)
        return self._changes(beliefs)

    def _weigh(self) -> Weighing:
        self.columns = change_columns(self.believed, self.runs, 1 / self.noise)
        model = self.believed.model()
        error = [states.in_band(states.tau - evaluate(model, states)[0]) for states in self.runs]
        return Weighing(self.runs, self.columns.rows, error, 1 / self.noise, self._precision(self.columns.rows))

    def _precision(self, rows: list[FloatArray]) -> FloatArray:
        """Of the day-to-day freedom of offsets and friction; what a tilt brings to light has a prior of its own."""
        stacked = np.concatenate(rows)
        n = stacked.shape[1]
        precision = np.zeros(stacked.shape[2])
        self.friction = self._friction_torque()
        for j in range(n):
            size = np.sqrt(np.mean(stacked[:, j, 3 * j : 3 * j + 3] ** 2, axis=0))
            precision[3 * j : 3 * j + 3] = (size / (FREEDOM * max(self.friction[j], 1e-300))) ** 2
        return precision

    def _friction_torque(self) -> FloatArray:
        """RMS of the reference's friction in the band (n_joints,); at least the noise."""
        reference = self.believed.reference
        places = [k for k, name in enumerate(reference.term_names) if "friction" in name]
        torque = [s.in_band(evaluate(reference, s)[1][:, places].sum(axis=1)) for s in self.runs]
        return np.maximum(rmse(torque), reference.noise_std)

    def _split(self, *hypothesis: Hypothesis) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Places that are fitted freely (named ones and `hypothesis`), and those of the day-to-day freedom."""
        places = [h.places for h in (*self.named, *hypothesis)]
        free = np.concatenate([np.zeros(0, dtype=np.intp), *places])
        day = np.arange(3 * self.believed.robot.n_joints)
        return np.unique(free), np.setdiff1d(day, free)

    def _next(self) -> tuple[Hypothesis, float, list[Hypothesis]] | None:
        weighing = self._weigh()
        open_ = [h for h in hypotheses(self.believed, self.columns) if not self._is_named(h)]
        scored = []
        for h in open_:
            free, held = self._split(h)
            without = self._split()
            power = weighing.left_out_power(free, held)
            bare = weighing.left_out_power(without[0], np.setdiff1d(without[1], h.places))
            ratio = np.sqrt(power.sum(axis=0) / np.maximum(bare.sum(axis=0), 1e-300))
            score = -float(np.sum(np.log(np.maximum(ratio, 1e-12))))
            if score <= 0 or ratio.min() > 1 - LEAST_GAIN:
                continue
            x = weighing.solve(free, held)
            covariance = weighing.covariance(free, held)
            p_value = _wald(x[free], covariance, np.isin(free, h.places))
            margin = NORMAL_95 * np.sqrt(np.maximum(np.diag(covariance)[np.searchsorted(free, h.places)], 0.0))
            if p_value < SURE / len(open_) and self._is_large(h, x, margin, weighing):
                scored.append((score, h, p_value, power))
        if not scored:
            return None
        scored.sort(key=lambda each: -each[0])
        _, best, p_value, power = scored[0]
        ties = [h for _, h, _, other in scored[1:] if _alike(other - power, self.noise)]
        return best, p_value, ties

    def _is_named(self, hypothesis: Hypothesis) -> bool:
        return any((h.kind, h.joints) == (hypothesis.kind, hypothesis.joints) for h in self.named)

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
            weighing = self._weigh()
            fresh = {(h.kind, h.joints): h for h in hypotheses(self.believed, self.columns)}
            self.named = [fresh[h.kind, h.joints] for h in self.named]
            x = weighing.solve(*self._split())
            for h in self.named:
                self.believed = h.added(self.believed, x[h.places], self.columns)
            self.noise = np.maximum(rmse(weighing.left(x)), self.believed.reference.noise_std)

    def _changes(self, beliefs: list[Believed]) -> Changes:
        findings: list[Finding] = []
        weighing = self._weigh()
        free, held = self._split()
        intervals = {}
        if len(free):
            std_error = np.sqrt(np.maximum(np.diag(weighing.covariance(free, held)), 0.0))
            intervals = dict(zip(free.tolist(), NORMAL_95 * std_error, strict=True))
        estimate = {h.kind: h.value(self.believed) for h in self.named}
        if PAYLOAD in estimate:
            places = next(h.places for h in self.named if h.kind == PAYLOAD)
            self.believed, notes = physical_payload(self.believed, weighing, places, free, held)
            findings += notes
        beliefs = [*beliefs[:-1], self.believed] if self.named else beliefs
        errors = {"train": [_errors(b, self.runs) for b in beliefs], "test": [_errors(b, self.tests) for b in beliefs]}
        names = self.believed.robot.joint_names
        effects = []
        for k, (h, p_value, ties) in enumerate(zip(self.named, self.p_values, self.ties, strict=True)):
            value = h.value(self.believed)
            free_value = estimate[PAYLOAD] if h.kind == PAYLOAD else value
            half = np.array([intervals[place] for place in h.places[: len(value)].tolist()])
            low, high = np.minimum(free_value - half, value), np.maximum(free_value + half, value)
            effect = {
                "rank": k + 1,
                "kind": h.kind,
                "joints": [names[j] for j in h.joints],
                "parameters": [
                    {"name": n, "value": float(v), "unit": u, "interval": [float(a), float(b)]}
                    for n, u, v, a, b in zip(h.names, h.units, value, low, high, strict=True)
                ],
                "p_value": p_value,
                "ties": [{"kind": other.kind, "joints": [names[j] for j in other.joints]} for other in ties],
            }
            if self.tests:
                effect["rmse_test_before"] = errors["test"][k].tolist()
                effect["rmse_test_after"] = errors["test"][k + 1].tolist()
            effects.append(effect)
        findings += self._unexplained(rmse(weighing.left(weighing.solve(free, held))), names)
        table = {part: {"before": all_[0], "after": all_[-1]} for part, all_ in errors.items() if len(all_[0])}
        return Changes(effects, self.believed.model(), findings, table)

    def _unexplained(self, left: FloatArray, names: Sequence[str]) -> list[Finding]:
        ratio = left / np.maximum(self.believed.reference.noise_std, 1e-300)
        return [
            Finding(
                "change_unexplained",
                "warning",
                f"{joint_words(names[j])}: the error is {ratio[j]:.1f} times that of the reference on its own runs, and "
                "no change of payload, tilt, gain, friction or offset explains it",
                column=f"tau_{j}",
                value=float(ratio[j]),
                unit="1",
            )
            for j in np.flatnonzero(ratio > UNEXPLAINED)
        ]


def _errors(believed: Believed, runs: Sequence[States]) -> FloatArray:
    model = believed.model()
    if not runs:
        return np.zeros(0)
    return rmse([states.in_band(states.tau - evaluate(model, states)[0]) for states in runs])


def _wald(x: FloatArray, covariance: FloatArray, chosen: NDArray[np.bool_]) -> float:
    """Probability of coefficients as far from zero as the `chosen` ones, if they were zero."""
    from scipy.stats import chi2

    own = covariance[np.ix_(chosen, chosen)]
    scale = 1 / np.sqrt(np.maximum(np.diag(own), 1e-300))
    values, vectors = np.linalg.eigh(own * np.outer(scale, scale))
    kept = values > 1e-9
    along = (vectors.T @ (scale * x[chosen]))[kept]
    return float(chi2.sf(np.sum(along**2 / values[kept]), int(kept.sum())))


def _alike(difference: FloatArray, noise: FloatArray) -> bool:
    """Whether left-out errors that differ by this, per block and joint, tie."""
    per_block = np.sum(difference / noise**2, axis=1)
    spread = per_block.std(ddof=1) * np.sqrt(len(per_block))
    return bool(abs(per_block.sum()) < TIE * spread)


def _check(reference: _core.TorqueModel, robot: _core.RobotModel, recordings: Sequence[Recording]) -> None:
    if robot.n_joints != reference.robot.n_joints:
        raise DataError(
            f"the reference is a model of {reference.robot.n_joints} joints, the robot {robot.name!r} has "
            f"{robot.n_joints}; is it the same arm?",
            code="wrong_reference",
        )
    check_training_runs(robot, recordings)
    for recording in recordings:
        if recording.torque_unit != reference.torque_unit:
            raise DataError(
                f"{recording.name}: torque in {recording.torque_unit}, but the reference's is in "
                f"{reference.torque_unit}; give the drive gains that the reference was made with",
                code="mixed_units",
                file=recording.name,
            )
