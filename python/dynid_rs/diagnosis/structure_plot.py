"""Changes of geometry, gravity, load and clocks as curves: the torque that they bring over an angle, lag over speed.

They act on several joints at once. Drawn is the joint whose torque, or whose encoders, show most of it; the curve is
the mean of the torque at an angle, for it depends on the other joints' angles too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.units import angle_units
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.estimates import Estimate
from dynid_rs.diagnosis.gear_model import Gear
from dynid_rs.diagnosis.shaped import Place
from dynid_rs.diagnosis.structural import undone
from dynid_rs.diagnosis.structural.about import About
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.curves import binned, over_angle
from dynid_rs.regression.linear_model import LinearModel
from dynid_rs.regression.uncertainty import NORMAL_95

FloatArray = NDArray[np.float64]

DRAWN = frozenset({"gravity_tilt", "kinematic_error"})
"""Changes of structure that are a torque over an angle; a gain and a clock of the torque scale and shift all of it."""


def structure_plot(
    found: Belief, place: Place, known: Sequence[Estimate], model: LinearModel, x: FloatArray
) -> dict[str, Any] | None:
    """Torque that a tilted base or a displaced frame brings, over the angle of the joint that shows most of it.

    `model` and its unknowns `x` (n,) tell what is left beside it; None of other kinds.
    """
    kind, joints = place
    if kind not in DRAWN:
        return None
    setup, about = found.setup, About.of(found.fit)
    bare = undone(setup, replace(setup, robot=setup.declared), kind, joints).robot
    brought = []
    for states in found.fit.runs_:
        still = np.zeros_like(states.q)
        motion = (states.q, still, still) if kind == "gravity_tilt" else (states.q, states.dq, states.ddq)
        with_it, without = (robot.inverse_dynamics(*motion, about.phi) for robot in (setup.robot, bare))
        brought.append((with_it - without)[:, :, None])
    torque = {j: column[:, 0] for j, column in about.in_band(brought).items()}
    if not torque:
        return None
    j = max(torque, key=lambda joint: float(np.mean(torque[joint][model.counted[joint]] ** 2)))
    left = model.rows[j][:, -1] - model.rows[j][:, :-1] @ x[model.places[j]]
    angle = np.concatenate([states.q[states.rows, j] for states in found.fit.runs_])
    used = model.counted[j]
    return over_angle(setup.robot, j, angle[used], torque[j][used], left[used], uncertainty(known))


def uncertainty(known: Sequence[Estimate]) -> float:
    """How far the size of a change is known: its standard deviation over itself, of all its numbers together."""
    spreads = [(e.value, (e.interval[1] - e.interval[0]) / (2 * NORMAL_95)) for e in known if e.interval is not None]
    size = float(np.linalg.norm([value for value, _ in spreads]))
    return float(np.linalg.norm([std for _, std in spreads])) / size if size else 0.0


def delay_plot(fit: ThreeLoopIdentifier, clock: Mapping[str, Any]) -> dict[str, Any] | None:
    """Motor minus link angle over the speed, less what the load explains: a link channel that is late is a line.

    `clock` as `sensors/messages.py::encoder_entries` has it; on the fastest joint of those with two encoders.
    """
    gears = [gear for gear in Gear.all_of(fit) if gear.joint in clock["joints"]]
    speeds = [gear.rows([states.dq[:, gear.joint] for states in fit.runs_]) for gear in gears]
    if not gears:
        return None
    at = max(range(len(gears)), key=lambda k: float(np.std(np.concatenate(speeds[k]))))
    gear, speed = gears[at], np.concatenate(speeds[at])
    j, load = gear.joint, np.concatenate(gear.rows(gear.load))
    shown = np.concatenate(gear.rows([(states.q_motor - states.q)[:, j] for states in fit.raw_runs_]))
    share, *_ = np.linalg.lstsq(np.column_stack([load, speed]), shown, rcond=None)
    name = fit.robot.joint_names[j]
    angle = angle_units(fit.robot.joint_kinds)[j]
    covariance = np.array([[clock["std_error"] ** 2]])
    return {
        "signal": f"dq_{name}",
        "unit": f"{angle}/s",
        "quantity": "deflection",
        "value_unit": angle,
        "joint": name,
        **binned(speed, shown - share[0] * load, speed[:, None], np.array([clock["value"]]), covariance),
    }
