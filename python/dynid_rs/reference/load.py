"""What an arm carries: the payload that separates its runs from a trusted model, as a body with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.errors import DataError
from dynid_rs.base.findings import Finding, joint_words
from dynid_rs.identification.doubt import Doubt
from dynid_rs.identification.training import prepare_training_runs
from dynid_rs.model.assembly import evaluate
from dynid_rs.model.units import torque_units
from dynid_rs.reference.change_search import ChangeSearch, wald
from dynid_rs.reference.changes import PAYLOAD, Believed
from dynid_rs.reference.compare import check_runs
from dynid_rs.reference.gear_loss import gear_loss, reach
from dynid_rs.reference.payload import hidden_directions, moved, physical_payload
from dynid_rs.regression.evaluation import rmse
from dynid_rs.runs.checks.motion import moving_joints
from dynid_rs.runs.preprocessing import Band, States, choose_band, common_rate
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]

STEP = 1e-6
"""Of the difference that carries the covariance to mass, centre and inertia, over a parameter's standard deviation."""
LEAST_STEP = 1e-4
"""...where that is nothing [kg, kg*m, kg*m^2]."""


@dataclass(frozen=True, eq=False)
class Load:
    """A body on the last link, seen in one frame.

    Parameters
    ----------
    mass : float
        [kg].
    centre : ndarray (3,)
        Centre of mass [m].
    inertia : ndarray (6,)
        About the centre, along the frame's axes: Ixx, Iyy, Izz, Ixy, Ixz, Iyz [kg*m^2].
    intervals : ndarray (10, 2)
        95 % of mass, centre and inertia, in this order; infinite where the runs do not show the quantity.
    p_value : float
        Probability of a load as large as this one if there were none.
    rmse_before, rmse_after : ndarray (n_joints,)
        Error without and with the load, both beside what may differ from day to day, in the band [N*m].
    findings : list of Finding
        What a person should know.
    """

    mass: float
    centre: FloatArray
    inertia: FloatArray
    intervals: FloatArray
    p_value: float
    rmse_before: FloatArray
    rmse_after: FloatArray
    findings: list[Finding] = field(default_factory=list)


def weigh_load(
    reference: _core.TorqueModel,
    runs: Sequence[Recording],
    *,
    cutoff: float | None = None,
    frame: tuple[FloatArray, FloatArray] | None = None,
    doubt: Doubt | None = None,
) -> Load:
    """Weigh what the arm carries on `runs`, beside the friction and the offsets that differ from day to day.

    Parameters
    ----------
    reference : TorqueModel
        Of the arm without the load, in N*m.
    runs : sequence of Recording
        With the load.
    cutoff : float, optional
        Band [Hz] in which torques are compared; chosen from the motion if None.
    frame : ((3, 3), (3,)), optional
        Rotation and translation [m] of the flange in the last link's frame; that frame itself by default.
    doubt : Doubt, optional
        How well the reference's parameters are known; without it, as if it had been learned from as much as `runs`.

    Raises
    ------
    DataError
        Runs of another robot or in another torque unit than the reference's, or a reference in ampere.
    """
    from threadpoolctl import threadpool_limits

    runs = list(runs)
    if reference.torque_unit != "N*m":
        raise DataError(
            "the model was learned from currents, in which a load has no kilograms; identify again with --drive-gain",
            code="wrong_reference",
        )
    # The wrist alone is enough to weigh a tool.
    check_runs(reference, reference.robot, runs, all_move=False)
    band = Band(cutoff) if cutoff is not None else choose_band(runs)
    prepared = [
        replace(states, resting=states.resting | ~moving_joints(run))
        for run, states in zip(
            runs,
            prepare_training_runs(runs, band, common_rate(runs), torque_delay=reference.torque_delay),
            strict=True,
        )
    ]
    with threadpool_limits(limits=1, user_api="blas"):
        search = ChangeSearch(Believed.unchanged(reference, reference.robot.phi), prepared, doubt)
        before = _left(search)
        named = search.name(PAYLOAD)
        weighing = search.weigh()
        free, held = search.split()
        estimate = search.believed.payload
        covariance = search.covariance(weighing, free, held)
        places = named.hypothesis.places
        at = np.searchsorted(free, places)
        covariance = covariance[np.ix_(at, at)]
        loss = gear_loss(search, weighing, free, held)
        shift = loss.shift[at]
        believed, findings = physical_payload(search.believed, weighing, places, free, held)
        hidden = hidden_directions(weighing, places, free, held)
        counted = [states.counted for states in prepared]
        size = rmse([states.in_band(states.tau) - _mean(states) for states in prepared], counted)
        search.believed = believed
        after = _left(search)
        model = believed.model()
        alone = rmse([states.in_band(states.tau - evaluate(model, states)[0]) for states in prepared], counted)
    rotation, translation = (np.eye(3), np.zeros(3)) if frame is None else frame
    value = _body(believed.payload, rotation, translation)
    slopes = _slopes(estimate, covariance, rotation, translation)
    std = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, covariance, slopes), 0.0))
    margin = reach(std, np.abs(slopes @ shift))
    unseen = moved(slopes, hidden)
    # Of a mass that may be any, so may the centre and the inertia about it.
    margin[unseen | unseen[0]] = np.inf
    middle = _body(estimate, rotation, translation)
    # The nearest body may lie beside the estimate: the interval holds both.
    low, high = np.minimum(middle - margin, value), np.maximum(middle + margin, value)
    intervals = np.stack([low, high], axis=1)
    if not np.isfinite(intervals).all():
        findings.append(
            Finding(
                "load_partly_unseen",
                "info",
                "the runs do not show all of the load: numbers without an interval are those of the body nearest to "
                "what they show; move more joints, or all of them in more ways",
            )
        )
    if loss.joints:
        findings.append(loss.finding(reference, float(shift[0])))
    findings += _misfit(reference, alone, size)
    p_value = wald(estimate, covariance, np.ones(len(estimate), dtype=bool), shift)
    return Load(float(value[0]), value[1:4], value[4:], intervals, p_value, before, after, findings)


def _left(search: ChangeSearch) -> FloatArray:
    """Error (n_joints,) of what is believed, beside the friction and the offsets that differ from day to day."""
    weighing, (_, held) = search.weigh(), search.split()
    left = weighing.left(weighing.solve(np.zeros(0, dtype=np.intp), search.day(held)))
    return rmse(left, [states.counted for states in search.runs])


def _mean(states: States) -> FloatArray:
    """Mean (n_joints,) of a run's torque in the band, over the samples that count."""
    torque = states.in_band(states.tau)
    mean: FloatArray = np.sum(torque * states.counted, axis=0) / np.maximum(states.counted.sum(axis=0), 1)
    return mean


def _misfit(reference: _core.TorqueModel, left: FloatArray, size: FloatArray) -> list[Finding]:
    """Joints on which model and load together tell nothing: what they leave is as large as the torque's deviation."""
    lost = np.flatnonzero((left >= size) & (size > 0)).tolist()
    if not lost:
        return []
    joints, units = reference.robot.joint_names, torque_units(reference)
    said = ", ".join(f"{left[j]:.3g} {units[j]} of {size[j]:.3g}" for j in lost)
    return [
        Finding(
            "load_misfit",
            "warning",
            f"with the load the model leaves {said} on {joint_words(*(joints[j] for j in lost))}, all that the torque "
            "there does: a channel, or the model, is wrong, and the load may be too; look with dynid inspect --robot "
            "at these runs and at those that the model was learned from",
            column=f"tau_{lost[0]}",
            value=float(left[lost[0]]),
            unit=units[lost[0]],
        )
    ]


def _body(phi: FloatArray, rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Mass, centre, and inertia about it (10,) of ten link parameters, in a frame that stands so in the link's."""
    mass = float(phi[0])
    if mass == 0:
        return np.zeros(10)
    pseudo = _core.pseudo_inertia(phi)[0]
    centre = pseudo[:3, 3] / mass
    # Second moments about the centre; the inertia is their trace less themselves.
    moments = rotation.T @ (pseudo[:3, :3] - mass * np.outer(centre, centre)) @ rotation
    inertia = np.trace(moments) * np.eye(3) - moments
    entries = [inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    return np.array([mass, *(rotation.T @ (centre - translation)), *entries])


def _slopes(phi: FloatArray, covariance: FloatArray, rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Derivative (10, 10) of what `_body` says by the parameters."""
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    steps = STEP * np.maximum(size, LEAST_STEP)
    slopes = np.empty((10, 10))
    for k, step in enumerate(steps):
        ahead, behind = (_body(phi + sign * step * np.eye(10)[k], rotation, translation) for sign in (1, -1))
        slopes[:, k] = (ahead - behind) / (2 * step)
    return slopes
