"""One case in a folder: robot.urdf, run_0.parquet and so on, and truth.json, which only the scorer reads."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from exam.draw import NAMED, STRANGE, draw
from exam.hidden import VISIBLE, Exam, Hidden, encoder_error, hide, shown_torque
from exam.oracle import p_value, seen
from exam.sensors import table_of_run

ROBOT, TRUTH = "robot.urdf", "truth.json"


def write_case(seed: int, folder: Path) -> dict[str, Any]:
    """Write the case of a seed and return its truth."""
    exam = hide(draw(seed))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ROBOT).write_text(exam.world.arm.urdf(), encoding="utf-8")
    names = []
    for s in exam.world.runs:
        torque = shown_torque(exam, s)[:: s.every]
        shown = s.recorded
        table = table_of_run(exam.world, exam.sensors, shown, torque, encoder_error(exam, shown))
        names.append(f"run_{s.run}.parquet")
        pq.write_table(pa.table(table), folder / names[-1])
    truth = truth_of(exam, names)
    (folder / TRUTH).write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return truth


def truth_of(exam: Exam, names: list[str]) -> dict[str, Any]:
    """Return everything that is true of a case, as JSON has it."""
    world, case = exam.world, exam.world.case
    joints = [joint.name for joint in world.arm.joints]
    soft = [joints[j] for j in np.flatnonzero(world.compliance)]
    return {
        "seed": case.seed,
        "case": asdict(case),
        "group": group_of(exam),
        "joints": joints,
        "train": names[: case.n_train],
        "test": names[case.n_train :],
        "effects": [_told(exam, k, hidden, joints) for k, hidden in enumerate(exam.hidden)],
        "left": exam.left.tolist(),
        "elastic": None if exam.elastic is None else exam.elastic.ratio.tolist(),
        # True of the arm, though nothing that the torque model lacks: right if named, not missed if not.
        "facts": {"joint_elasticity": soft, "torque_gain": joints if case.current else []},
    }


def group_of(exam: Exam) -> str:
    """Return the group of a case by what is visible in it, whatever was wished."""
    kinds = [hidden.effect.kind for hidden in exam.hidden if hidden.strength >= VISIBLE]
    if exam.elastic is not None and exam.elastic.strength >= VISIBLE:
        return "elastic"
    if any(kind in STRANGE for kind in kinds):
        return "outside"
    if kinds:
        return "single" if len(kinds) == 1 else "mixture"
    return "clean" if np.max(exam.left) < VISIBLE else "hazy"


def _told(exam: Exam, k: int, hidden: Hidden, joints: list[str]) -> dict[str, Any]:
    effect, world = hidden.effect, exam.world
    unit = float(world.amperes[effect.joints[0]])
    parameters = {
        name: float(value) * (unit if name in effect.torques else 1.0)
        for name, value in effect.truth(hidden.size).items()
    }
    return {
        "kind": effect.kind,
        "joints": [joints[j] for j in effect.joints],
        "named": effect.kind in NAMED,
        "size": float(hidden.size),
        "shape": effect.shape,
        "parameters": parameters,
        "ratio": hidden.strength,
        "ratios": hidden.ratio.tolist(),
        "seen": seen(exam, k),
        "p_value": p_value(exam, k),
    }
