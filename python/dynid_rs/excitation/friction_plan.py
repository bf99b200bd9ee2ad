"""The friction experiment within the limits of an exciting trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dynid_rs.excitation.constraints import Constraint, PhysicalLimits, StartError, torque_bound
from dynid_rs.excitation.friction_experiment import plan_friction_experiment
from dynid_rs.excitation.friction_segments import FrictionExperiment
from dynid_rs.excitation.limits import ExcitationLimits
from dynid_rs.simulation.limits import MotionLimits

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel


def friction_plan(
    robot: RobotModel, limits: ExcitationLimits | None = None, constraints: Sequence[PhysicalLimits] = ()
) -> FrictionExperiment:
    """Plan the friction experiment about the middle of the limits; it moves as fast in both directions.

    Raises
    ------
    ValueError
        The limits leave no room for it, or it does not keep torque, workspace or distance; names which.
    """
    limits = ExcitationLimits.of_robot(robot) if limits is None else limits
    pose = limits.position.mean(axis=0)
    plan = plan_friction_experiment(
        robot,
        MotionLimits(
            lower=limits.position[0],
            upper=limits.position[1],
            velocity=np.abs(limits.velocity).min(axis=0),
            acceleration=np.abs(limits.acceleration).min(axis=0),
        ),
        pose=pose,
    )
    torque: Constraint | str
    try:
        torque = torque_bound(robot, limits, pose)
        bound = [constraint.bind(robot, pose) for constraint in constraints]
    except StartError as error:
        why = str(error).rpartition("; ")[0]
        raise ValueError(
            f"the friction experiment starts in the middle of the position limits, and there, {why}; move the position "
            "limits, or leave --friction out"
        ) from None
    for constraint in bound if isinstance(torque, str) else [torque, *bound]:
        step = max(constraint.fine_step, 2e-3)
        motion = plan.evaluate(np.arange(0.0, plan.duration + step, step))
        if constraint.exact_room(motion) < 0:
            raise ValueError(
                f"the friction experiment about the middle of the limits does not keep {constraint.name}; "
                "narrow the position limits, or leave --friction out"
            )
    return plan
