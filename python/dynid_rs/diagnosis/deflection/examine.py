"""`examine_deflection`: what two encoders per joint reveal, joint by joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.deflection.choice import choose
from dynid_rs.diagnosis.deflection.clock import delay_findings
from dynid_rs.diagnosis.deflection.examined import Examined, kinds_of
from dynid_rs.diagnosis.deflection.findings import DeflectionFinding
from dynid_rs.diagnosis.deflection.fitting import finished_gear, on_all_samples, search_gear
from dynid_rs.diagnosis.deflection.gear import Gear
from dynid_rs.diagnosis.deflection.load import identified_load
from dynid_rs.diagnosis.deflection.parameters import parameters_of
from dynid_rs.diagnosis.deflection.signals import GearSignals, gear_signals
from dynid_rs.diagnosis.deflection.tested import Tested, rms
from dynid_rs.preprocessing import States
from dynid_rs.recording import Recording

if TYPE_CHECKING:
    from dynid_rs.identification import ThreeLoopIdentifier

FloatArray = NDArray[np.float64]

SMALL_STEP = 0.1
"""Of a shape: in the logarithm of widths and distances, of an order in cycles."""
SIGNAL = {"backlash": "load", "encoder_eccentricity": "q", "gear_kinematic_error": "tooth"}


def examine_deflection(
    fit: ThreeLoopIdentifier, train: Sequence[Recording | States], test: Sequence[Recording | States]
) -> list[DeflectionFinding]:
    """Name what makes motor and link encoders disagree, on each joint that has two.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        Fitted to `train`; predicts the load of the gears. Measured torque is not used.
    train : sequence of Recording or States
        The runs that `fit` has seen, in their order.
    test : sequence of Recording or States
        Runs on which errors are reported; nothing is fitted or chosen on them.

    Returns
    -------
    list of DeflectionFinding
        Clocks first, then joint by joint, the largest first; empty with one encoder, or where nothing stands out.
    """
    from threadpoolctl import threadpool_limits

    if fit.encoder_delay_ is None or not fit.encoder_delay_.measured.any():
        return []
    with threadpool_limits(limits=1, user_api="blas"):
        return _examine(fit, train, test)


def _examine(
    fit: ThreeLoopIdentifier, train: Sequence[Recording | States], test: Sequence[Recording | States]
) -> list[DeflectionFinding]:
    assert fit.encoder_delay_ is not None  # the caller has looked
    robot, delay = fit.robot, fit.encoder_delay_.value.copy()
    turning = [kind == "revolute" for kind in robot.joint_kinds]
    signals = gear_signals(identified_load(fit), fit, train, delay)
    joints = [j for j in range(robot.n_joints) if fit.encoder_delay_.measured[j] and has_two(signals[j])]
    searched = {j: search_gear(signals[j], turning[j]) for j in joints}
    loss = [np.zeros_like(states.tau) for states in fit.runs_]
    for j, gear in searched.items():
        whole = on_all_samples(gear, signals[j])
        delay[j] += whole.late
        for k, z in enumerate(whole.z):
            loss[k][:, j] = z
    load = identified_load(fit, loss)
    signals = gear_signals(load, fit, train, delay)
    tests = gear_signals(load, fit, test, delay)
    found, late = [], []
    for j in joints:
        units = ("rad" if turning[j] else "m", _torque_unit(fit.torque_unit_, turning[j]))
        examined = examine_gear(finished_gear(searched[j], signals[j]), j, len(joints), units)
        tested = Tested.of(examined, tests[j])
        late.append((examined, tested))
        found += findings_of(examined, tested)
    return [*delay_findings(late), *found]


def examine_signals(
    train: Sequence[GearSignals],
    test: Sequence[GearSignals],
    *,
    joint: int = 0,
    n_joints: int = 1,
    turning: bool = True,
) -> list[DeflectionFinding]:
    """Name what makes the encoders of one joint disagree whose load is known otherwise, e.g. from a torque sensor.

    Parameters
    ----------
    train, test : sequence of GearSignals
        See `GearSignals.of_arrays`.
    joint : int
        Its number, for the findings.
    n_joints : int
        How many are looked at in all: the chance of a false finding is shared among them.
    turning : bool
        Whether the joint turns.
    """
    if not has_two(train):
        return []
    gear = finished_gear(search_gear(train, turning), train)
    examined = examine_gear(gear, joint, n_joints, ("rad" if turning else "m", "N*m" if turning else "N"))
    tested = Tested.of(examined, test)
    return [*delay_findings([(examined, tested)]), *findings_of(examined, tested)]


def has_two(runs: Sequence[GearSignals]) -> bool:
    """Whether the joint has two channels that are not copies of each other, and moves."""
    return all(np.ptp(run.deflection) > 1e-12 for run in runs) and any(np.ptp(run.dq[run.used]) > 0 for run in runs)


def examine_gear(gear: Gear, joint: int, n_joints: int, units: tuple[str, str]) -> Examined:
    """Choose a gear's terms, and fit them once more beside the shapes' own uncertainty."""
    choice = choose(gear.system(), n_joints)
    names = list(choice.names)
    changes = gear.shape_columns(names, *gear.system(names).coefficients(names))
    system = gear.system(names, changes)
    every = list(system.columns)
    u, x = system.coefficients(every)
    covariance = system.covariance(every)
    # The search's shapes come from thinned samples: one more step of Gauss-Newton on all of them, where it is small.
    for name in changes:
        place = system.among(every, name)[0]
        if max(abs(x[place]), np.sqrt(max(covariance[place, place], 0.0))) > SMALL_STEP:
            u, x = system.coefficients(names)
            x = np.concatenate([x, np.zeros(len(changes))])
            break
    else:
        shapes = gear.shapes
        for name in changes:
            shapes = shapes.bent(name[:-1], float(x[system.among(every, name)[0]]))
        gear = replace(gear, shapes=shapes)
    return Examined(joint, gear, choice, u, x, covariance, system, units)


def findings_of(gear: Examined, tested: Tested) -> list[DeflectionFinding]:
    """Findings of one gear beside its clock."""
    found = []
    kept = ["delay"]
    for kind, terms in gear.groups().items():
        before = rms(tested.left(kept))
        kept = [name for name in gear.names if name in kept or name in terms]
        ties = {other for name in terms for other in gear.choice.ties.get(name, ())}
        found.append(
            DeflectionFinding(
                kind=kind,
                joints=(gear.joint,),
                parameters=parameters_of(gear, kind, terms),
                p_value=gear.choice.p_values["cubic" if "cubic" in terms else terms[0]],
                rms_test_before=(before,),
                rms_test_after=(rms(tested.left(kept)),),
                ties=tuple(other for other in kinds_of(sorted(ties)) if other != kind),
                plot=tested.picture(terms, SIGNAL.get(kind, "load")),
                signal=SIGNAL.get(kind, "load"),
            )
        )
    return found


def _torque_unit(torque_unit: str, turning: bool) -> str:
    return torque_unit if turning or torque_unit != "N*m" else "N"
