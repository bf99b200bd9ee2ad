"""What has changed against a trusted model: a payload, a tilt, gains, friction, offsets; or nothing.

Everything that the reference knows is held. Friction and offsets differ a little from day to day, so every fit gives
them a little freedom (a weak prior around the reference); they are named only where they have changed a lot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.errors import DataError
from dynid_rs.base.findings import Finding, joint_words
from dynid_rs.identification.doubt import Doubt
from dynid_rs.identification.training import prepare_training_runs
from dynid_rs.model.assembly import evaluate, with_band
from dynid_rs.model.curves import over_angle
from dynid_rs.reference.change_search import ChangeSearch
from dynid_rs.reference.changes import PAYLOAD, Believed, Hypothesis
from dynid_rs.reference.gear_loss import gear_loss, reach
from dynid_rs.reference.payload import hidden_directions, moved, physical_payload
from dynid_rs.regression.evaluation import rmse
from dynid_rs.regression.uncertainty import NORMAL_95
from dynid_rs.runs.facts import check_training_runs
from dynid_rs.runs.preprocessing import Band, States, choose_band, common_rate, prepare
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]

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
    doubt: Doubt | None = None,
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
    doubt : Doubt, optional
        How well the reference's parameters are known; without it, as if it had been learned from as much as `train`.

    Raises
    ------
    DataError
        Runs of another robot or in another torque unit than the reference's, a joint that never moves.
    """
    from threadpoolctl import threadpool_limits

    train, test = list(train), list(test)
    check_runs(reference, robot, [*train, *test])
    band = Band(cutoff) if cutoff is not None else choose_band(train)
    rate = common_rate(train)
    runs = prepare_training_runs(train, band, rate, torque_delay=reference.torque_delay)
    with threadpool_limits(limits=1, user_api="blas"):
        search = ChangeSearch(Believed.unchanged(reference, robot.phi), runs, doubt)
        changes = _report(search, search.run(), [prepare(recording, band, rate) for recording in test])
        return replace(changes, model=with_band(changes.model, (band.cutoff, rate, False)))


def _report(search: ChangeSearch, beliefs: list[Believed], tests: list[States]) -> Changes:
    """Everything that `search` has named, with intervals and errors."""
    findings: list[Finding] = []
    weighing = search.weigh()
    free, held = search.split()
    half = np.zeros(len(weighing.precision))
    if len(free):
        variance = np.diag(search.covariance(weighing, free, held))
        loss = gear_loss(search, weighing, free, held)
        half[free] = reach(np.sqrt(np.maximum(variance, 0.0)), np.abs(loss.shift))
        payload = next((h for h in (named.hypothesis for named in search.named) if h.kind == PAYLOAD), None)
        if loss.joints and payload is not None:
            shift = float(loss.shift[np.searchsorted(free, payload.places[0])])
            findings.append(loss.finding(search.believed.reference, shift))
    believed, unseen = beliefs[-1], np.zeros(len(half), dtype=bool)
    for h in (named.hypothesis for named in search.named if named.hypothesis.kind == PAYLOAD):
        believed, notes = physical_payload(believed, weighing, h.places, free, held)
        findings += notes
        unseen[h.places] = moved(np.eye(len(h.places)), hidden_directions(weighing, h.places, free, held))
    steps = [*beliefs[:-1], believed]
    errors = {"train": [_errors(b, search.runs) for b in steps], "test": [_errors(b, tests) for b in steps]}
    joints = believed.robot.joint_names
    effects = []
    for k, named in enumerate(search.named):
        h = named.hypothesis
        value, estimate = h.value(believed), h.value(beliefs[-1])
        margin = half[h.places[: len(value)]]
        low, high = np.minimum(estimate - margin, value), np.maximum(estimate + margin, value)
        known = ~unseen[h.places[: len(value)]]
        weighed = h.kind == PAYLOAD and known[0]
        effect: dict[str, Any] = {
            "rank": k + 1,
            "kind": h.kind,
            "joints": [joints[j] for j in h.joints],
            "parameters": [
                {"name": n, "value": float(v), "unit": u, "interval": [float(a), float(b)] if is_known else None}
                for n, u, v, a, b, is_known in zip(h.names, h.units, value, low, high, known, strict=True)
            ],
            "p_value": named.p_value,
            "ties": [_tie(other, belief, tests) for other, belief in named.ties],
            "plot": load_plot(believed, search.runs, float(margin[0] / abs(value[0]))) if weighed else None,
        }
        if tests:
            effect["rmse_test_before"] = errors["test"][k].tolist()
            effect["rmse_test_after"] = errors["test"][k + 1].tolist()
        effects.append(effect)
    left = rmse(weighing.left(weighing.solve(free, held)), [states.counted for states in search.runs])
    findings += _unexplained(left / search.reference_noise, joints)
    table = {part: {"before": every[0], "after": every[-1]} for part, every in errors.items() if len(every[0])}
    return Changes(effects, believed.model(), findings, table)


def load_plot(believed: Believed, runs: Sequence[States], margin: float) -> dict[str, Any]:
    """Torque of what is carried, over the angle of the joint that bears most of it.

    `margin`: half of the 95 % interval of the mass, over the mass.
    """
    model, robot = believed.model(), believed.robot
    carried, left, angles = [], [], []
    for states in runs:
        aligned = states.aligned(model.encoder_delay, model.encoder_error)
        regressor = robot.joint_torque_regressor(aligned.q, aligned.dq, aligned.ddq)[:, :, -10:]
        carried.append(states.in_band(regressor @ believed.payload * np.asarray(model.torque_scale)))
        left.append(states.in_band(states.tau - evaluate(model, states)[0]))
        angles.append(states.q[states.rows])
    torque, rest, angle = (np.concatenate(parts) for parts in (carried, left, angles))
    used = np.concatenate([states.counted for states in runs])
    j = int(np.argmax(np.sum(torque**2 * used, axis=0)))
    at = used[:, j]
    return over_angle(robot, j, angle[at, j], torque[at, j], rest[at, j], margin / NORMAL_95)


def _tie(other: Hypothesis, belief: Believed, tests: list[States]) -> dict[str, Any]:
    joints = belief.robot.joint_names
    entry: dict[str, Any] = {"kind": other.kind, "joints": [joints[j] for j in other.joints]}
    return entry | ({"rmse_test_after": _errors(belief, tests).tolist()} if tests else {})


def _errors(believed: Believed, runs: Sequence[States]) -> FloatArray:
    model = believed.model()
    if not runs:
        return np.zeros(0)
    errors = [states.in_band(states.tau - evaluate(model, states)[0]) for states in runs]
    return rmse(errors, [states.counted for states in runs])


def _unexplained(ratio: FloatArray, names: Sequence[str]) -> list[Finding]:
    """Joints whose error is `ratio` (n_joints,) times that of the reference on its own runs, if that is much."""
    return [
        Finding(
            "change_unexplained",
            "warning",
            f"{joint_words(names[j])}: the error is {ratio[j]:.1f} times the reference's on its own runs, and no "
            "change of payload, tilt, gain, friction or offset explains it",
            column=f"tau_{j}",
            value=float(ratio[j]),
            unit="1",
        )
        for j in np.flatnonzero(ratio > UNEXPLAINED).tolist()
    ]


def check_runs(
    reference: _core.TorqueModel, robot: _core.RobotModel, recordings: Sequence[Recording], *, all_move: bool = True
) -> None:
    """Refuse runs that cannot be held against a trusted model; with `all_move` off joints may rest in all of them.

    Raises
    ------
    DataError
        Of another robot, or in another torque unit.
    """
    if robot.n_joints != reference.robot.n_joints:
        raise DataError(
            f"the reference is a model of {reference.robot.n_joints} joints, the robot {robot.name!r} has "
            f"{robot.n_joints}; is it the same arm?",
            code="wrong_reference",
        )
    check_training_runs(robot, recordings, all_move=all_move)
    for recording in recordings:
        if recording.torque_unit != reference.torque_unit:
            raise DataError(
                f"{recording.name}: torque in {recording.torque_unit}, but the reference's is in "
                f"{reference.torque_unit}; give the drive gains that the reference was made with",
                code="mixed_units",
                file=recording.name,
            )
