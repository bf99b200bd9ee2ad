"""Hypotheses that are no torque columns of the catalogue: changes of geometry, gravity, gains, encoders and clocks.

Their columns are derivatives of the predicted torque; accepting one changes the robot or a channel, and the fit is made
again there.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from dynid_rs.diagnosis.hypotheses import Hypothesis
from dynid_rs.diagnosis.setup import FloatArray, Setup
from dynid_rs.diagnosis.structural.about import About
from dynid_rs.diagnosis.structural.encoder_eccentricity import eccentricity_hypotheses
from dynid_rs.diagnosis.structural.gravity_tilt import tilt_hypotheses
from dynid_rs.diagnosis.structural.kinematic_error import kinematic_hypotheses
from dynid_rs.diagnosis.structural.torque_delay import delay_hypotheses, delay_of, with_delay
from dynid_rs.diagnosis.structural.torque_gain import gain_hypotheses
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.placement import displacement, tilt_of, tilted_gravity, with_displacement

KINDS: dict[str, Callable[[About, Setup], list[Hypothesis]]] = {
    "torque_delay": delay_hypotheses,
    "gravity_tilt": tilt_hypotheses,
    "kinematic_error": kinematic_hypotheses,
    "torque_gain": gain_hypotheses,
    "encoder_eccentricity": eccentricity_hypotheses,
}
REFITTED = tuple(kind for kind in KINDS if kind != "torque_gain")
"""Kinds that move the robot or a channel in steps, a fit after each; gains are fitted in every round."""


def undone(setup: Setup, declared: Setup, kind: str, joints: tuple[int, ...]) -> Setup:
    """Return the setup with one change of structure back where `declared` has it."""
    if kind == "torque_delay":
        return with_delay(setup, joints, float(delay_of(declared, joints)[0]))
    if kind == "torque_gain":
        return replace(setup, gain_joints=tuple(j for j in setup.gain_joints if j not in joints))
    if kind == "encoder_eccentricity":
        error = setup.encoder_error.copy()
        error[list(joints)] = declared.encoder_error[list(joints)]
        return replace(setup, encoder_error=error)
    if kind == "gravity_tilt":
        return replace(setup, robot=setup.robot.with_gravity(declared.robot.gravity.tolist()))
    change = displacement(setup.robot, declared.robot, joints[0])
    return replace(setup, robot=with_displacement(setup.robot, joints[0], change))


def value_of(setup: Setup, kind: str, joints: tuple[int, ...]) -> FloatArray:
    """What a change of structure is now, (k,), in the order of its hypothesis."""
    if kind == "torque_delay":
        return delay_of(setup, joints)
    if kind == "encoder_eccentricity":
        error: FloatArray = setup.encoder_error[joints[0]]
        return error
    if kind == "gravity_tilt":
        return np.array(tilt_of(setup.declared, setup.robot))
    return displacement(setup.declared, setup.robot, joints[0])


def with_value(setup: Setup, kind: str, joints: tuple[int, ...], x: FloatArray) -> Setup:
    """Return the setup with one change of structure at a value, as `value_of` gives it; of a gain it is not asked.

    Raises
    ------
    ValueError
        As many numbers as the kind has none.
    """
    if kind == "torque_gain":
        return replace(setup, gain_joints=tuple(sorted({*setup.gain_joints, *joints})))
    n_numbers = {"torque_delay": 1, "encoder_eccentricity": 2, "gravity_tilt": 2, "kinematic_error": 6}[kind]
    if x.shape != (n_numbers,):
        raise ValueError(f"{kind} has {n_numbers} numbers, found {x.size}")
    if kind == "torque_delay":
        return with_delay(setup, joints, float(x[0]))
    if kind == "encoder_eccentricity":
        error = setup.encoder_error.copy()
        error[joints[0]] = x
        return replace(setup, encoder_error=error)
    if kind == "gravity_tilt":
        return replace(setup, robot=setup.robot.with_gravity(tilted_gravity(setup.declared.gravity, *x).tolist()))
    return replace(setup, robot=with_displacement(setup.robot, joints[0], x))


def structural_hypotheses(
    fit: ThreeLoopIdentifier, setup: Setup, kinds: Collection[str] = tuple(KINDS)
) -> list[Hypothesis]:
    """Every hypothesis of these kinds beside the model that `fit` has of `setup`.

    What no torque shows is none: a lone joint that slides along gravity has a tilt of second order only.
    """
    about = About.of(fit)
    return [h for kind in kinds for h in KINDS[kind](about, setup) if h.columns]
