"""Measured robots: what is learned from, what is tested on, and the errors that must be reached.

`python tests/real_robots.py` prints the README's table.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from helpers import data

import dynid_rs as dyn
from dynid_rs.identification.results import evaluate_runs, summarise
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.runs.checks import check_recording, refused_sources
from dynid_rs.runs.readers import Config
from dynid_rs.runs.splitting import split_runs


@dataclass(frozen=True)
class Case:
    """One robot and one torque channel; `bounds` on error over torque standard deviation per joint."""

    folder: str
    train: tuple[str, ...]
    test: tuple[str, ...] = ()
    test_from: float | None = None
    torque: str | None = None
    bounds: tuple[float, ...] | None = None


CASES = {
    "UR10e, currents": Case(
        "ur10e_innopolis",
        ("20_02_12_50sec_12harm", "20_02_10_30sec_12harm", "20_02_19_14harm50sec"),
        ("20_02_12_40sec_12harm",),
        bounds=(0.067, 0.035, 0.046, 0.077, 0.092, 0.089),
    ),
    "KUKA KR300, two encoders": Case("kuka_kr300_weigand", ("traj_A",), ("traj_B",)),
    "Franka Panda, joint torque": Case(
        "panda_gaz", ("excite",), test_from=14.0, bounds=(0.059, 0.014, 0.018, 0.039, 0.064, 0.034, 0.155)
    ),
    "xMate3 Pro, joint torque": Case(
        "rokae_xmate3pro",
        ("excite",),
        test_from=13.0,
        bounds=(0.763, 0.068, 0.108, 0.045, 0.252, 0.246, 0.389),
    ),
    "xMate3 Pro, motor torque": Case(
        "rokae_xmate3pro",
        ("excite",),
        test_from=13.0,
        torque="tau_motor_{i}",
        bounds=(0.076, 0.155, 0.068, 0.128, 0.099, 0.460, 0.127),
    ),
}


def identify(case: Case) -> tuple[ThreeLoopIdentifier, dict]:
    """The fitted identifier and the content of its result.json, by the same steps as `dynid identify`."""
    robot = dyn.RobotModel.from_urdf(data.data_file(case.folder))
    config = Config() if case.torque is None else replace(Config(), columns={"tau": case.torque})
    runs, tests = (
        [_read(data.data_file(case.folder, f"{name}.parquet"), robot, config) for name in names]
        for names in (case.train, case.test)
    )
    split = split_runs(runs, tests, case.test_from)
    identifier = ThreeLoopIdentifier(robot).fit(split.train)
    train = evaluate_runs(identifier.model_, split.train, identifier.raw_runs_)
    test = evaluate_runs(identifier.model_, split.test, [identifier.states(recording) for recording in split.test])
    return identifier, summarise(identifier, train, test, [])


def _read(path, robot, config):
    recording = dyn.read_recording(path, robot, config)
    return recording.without(*refused_sources(check_recording(recording, robot)))


def relative_errors(result: dict, key: str = "after") -> np.ndarray:
    """RMSE on the test runs over the torque's standard deviation, (n_joints,)."""
    test = result["rmse"]["test"]
    return np.array(test[key]) / np.array(test["torque_std"])


if __name__ == "__main__":
    print("| robot, torque channel | weighted least squares | three loops |")
    print("|---|---|---|")
    for name, case in CASES.items():
        result = identify(case)[1]
        cells = [" ".join(f"{100 * x:.1f}" for x in relative_errors(result, key)) for key in ("wls", "after")]
        print(f"| {name} | {cells[0]} | {cells[1]} |", flush=True)
