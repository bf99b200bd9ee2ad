"""Small simulated arms that lack something, and what a diagnosis says of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dynid_rs import Recording, RobotModel
from dynid_rs.diagnosis.loop import Diagnosis, diagnose
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.identification.results import score
from dynid_rs.simulation import SimulatedArm, build_effects, bundled_robot, equip, parse_wish, simulate, typical_arm
from dynid_rs.simulation.folder import run_columns
from helpers.small_arm import URDF

ROBOT = RobotModel.from_urdf_string(URDF)
"""Three joints: shoulder (upright axis), elbow, wrist."""
SIX_AXES = RobotModel.from_urdf(bundled_robot())
HALF_WIDTHS = 2.0
"""Half-widths of a 95 % interval within which the truth lies: 4 standard errors, seeded."""


def rigid(robot: RobotModel = ROBOT) -> SimulatedArm:
    """Arm whose gears do not yield and whose channels have one clock: the declared model lacks nothing."""
    return replace(typical_arm(robot).rigid(), delay=0.0)


def with_effects(arm: SimulatedArm, *wishes: str) -> SimulatedArm:
    """The arm with effects of the laboratory, `KIND[:joint[:size]]`."""
    return equip(arm, build_effects([parse_wish(wish) for wish in wishes], typical_arm(arm.robot)))


def recorded(
    arm: SimulatedArm,
    *,
    n_runs: int = 3,
    duration: float = 12.0,
    rate: float = 200.0,
    seed: int = 0,
    encoders: int = 1,
    **options: Any,
) -> list[Recording]:
    """Runs of an arm."""
    runs = simulate(arm, n_runs=n_runs, duration=duration, rate=rate, seed=seed, **options).recordings
    return [
        Recording(
            run.t,
            run.q,
            tau=run.tau,
            q_motor=run.q_motor if encoders == 2 else None,
            temperature=run.temperature,
            name=run.name,
            joints=run.joints,
        )
        for run in runs
    ]


def measured(*wishes: str, robot: RobotModel = ROBOT, **options: Any) -> list[Recording]:
    """Runs of a rigid arm with effects."""
    arm = rigid(robot)
    return recorded(with_effects(arm, *wishes) if wishes else arm, **options)


def columns_of(recording: Recording) -> dict[str, np.ndarray]:
    """A recording as a file has it, positions and torques alone."""
    columns = run_columns(recording)
    return {name: x for name, x in columns.items() if not name.startswith(("dq_", "ddq_", "dq_motor"))}


def found_in(runs: Sequence[Recording], robot: RobotModel = ROBOT, *, n_test: int = 1, **options: Any) -> Diagnosis:
    """Diagnose runs, the last of them for testing; `options` as `Setup` has them."""
    return diagnose(Setup(robot, options=options), runs[:-n_test], runs[-n_test:])


def names(found: Diagnosis) -> set[tuple[str, tuple[str, ...]]]:
    """Kind and joints of all that was named."""
    return {(entry["kind"], tuple(entry["joints"])) for entry in found.entries}


def entry_of(found: Diagnosis, kind: str) -> dict[str, Any]:
    """The only entry of a kind."""
    (entry,) = (entry for entry in found.entries if entry["kind"] == kind)
    return entry


def holds(entry: dict[str, Any], truth: dict[str, float]) -> list[str]:
    """Numbers whose interval, twice as wide, does not hold the truth; one of a few is it, or is not."""
    wrong = []
    known = {parameter["name"]: parameter for parameter in entry["parameters"]}
    for name, true in truth.items():
        low, high = known[name]["interval"] or [known[name]["value"]] * 2
        middle, half = (low + high) / 2, (high - low) / 2
        if not abs(true - middle) <= HALF_WIDTHS * half:
            wrong.append(f"{name}: {true:.6g} is not in {low:.6g} to {high:.6g}")
    return wrong


def truth_of(arm: SimulatedArm, kind: str, left_out: Iterable[str] = ()) -> dict[str, float]:
    """Numbers of the arm's only effect of a kind, as the laboratory has them."""
    (effect,) = (effect for effect in arm.effects if effect.kind == kind)
    values = {value.name: float(np.ravel(value.value)[0]) for value in effect.values}
    return {name: value for name, value in values.items() if name not in left_out}


def errors(found: Diagnosis, runs: Sequence[Recording]) -> tuple[np.ndarray, np.ndarray]:
    """Error per joint of the declared model and of the one with what was found, in the band."""
    before = score(found.before.model_, [found.before.states(run) for run in runs]).rmse
    after = score(found.after.model_, [found.after.states(run) for run in runs]).rmse
    return before, after
