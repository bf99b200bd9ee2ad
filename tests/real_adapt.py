"""Friction and payload that follow measured arms: errors without and with, on runs that nothing was identified from.

`python tests/real_adapt.py` prints the tables of docs/how_to/adapt.md. Every sample is predicted before anything is
learnt of it; what was learnt goes over from one run to the next, as after a restart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from helpers import data

import dynid_rs as dyn
from dynid_rs.model.adapt import AdaptedRun
from dynid_rs.runs.checks import check_recording, refused_sources


@dataclass(frozen=True)
class Chain:
    """An arm, what its model is identified from, and the runs that follow one another."""

    folder: str
    train: tuple[str, ...]
    runs: tuple[str, ...]
    parts: tuple[str, ...] = ("friction",)
    mass: float | None = None


CHAINS = {
    "UR10e, runs of other days, friction": Chain(
        "ur10e_innopolis",
        ("20_02_12_50sec_12harm", "20_02_10_30sec_12harm", "20_02_19_14harm50sec"),
        (
            "20_02_05_20sec_8harm",
            "20_02_05_20sec_12harm",
            "20_02_06_20sec_10harm",
            "20_02_10_20sec_7harm",
            "20_02_12_40sec_12harm",
        ),
    ),
    "UR10e with a load, friction and payload": Chain(
        "ur10e_innopolis",
        ("20_02_12_50sec_12harm", "20_02_10_30sec_12harm", "20_02_19_14harm50sec"),
        ("20_02_19_14harm50secLoad",),
        ("friction", "payload"),
        2.0,
    ),
    "xMate7 Pro, slower and slower, friction": Chain(
        "rokae_xmate7p", ("traj1_p3", "traj2_p3"), ("traj3_p3", "traj1_p5", "traj2_p5", "traj3_p5")
    ),
    "xMate7 Pro, faster, friction": Chain(
        "rokae_xmate7p", ("traj1_p3", "traj2_p3"), ("traj1_p1", "traj2_p1", "traj3_p1")
    ),
}


def read(chain: Chain, name: str, robot: dyn.RobotModel) -> dyn.Recording:
    recording = dyn.read_recording(data.data_file(chain.folder, f"{name}.parquet"), robot)
    return recording.without(*refused_sources(check_recording(recording, robot)))


def followed(chain: Chain) -> list[AdaptedRun]:
    """The runs of a chain, one after the other."""
    robot = dyn.RobotModel.from_urdf(data.data_file(chain.folder))
    train = [read(chain, name, robot) for name in chain.train]
    model = dyn.ThreeLoopIdentifier(robot).fit(train).model_
    following = dyn.Adaptation(model, chain.parts, mass=chain.mass, watch=dyn.Watch(model).fit(train))
    done: list[AdaptedRun] = []
    for name in chain.runs:
        known = done[-1].remembered if done else None
        done.append(following.adapt(read(chain, name, robot), remembered=known))
    return done


def rows(done: list[AdaptedRun]) -> list[str]:
    """A line per run: error with over error without, per joint, and factors at its end."""
    lines = []
    for run in done:
        before, after = run.rmse()
        ratio = " ".join(f"{x:.2f}" for x in after / before)
        factors = " ".join(f"{x:.2f}" for x in run.factors[-1])
        mean = np.exp(np.mean(np.log(after / before)))
        lines.append(f"| {run.name} | {ratio} | {mean:.2f} | {factors} |")
    return lines


if __name__ == "__main__":
    for title, chain in CHAINS.items():
        print(f"\n{title}:\n")
        print("| run | error with over without, per joint | mean | factors at the end |")
        print("|---|---|---|---|")
        done = followed(chain)
        print("\n".join(rows(done)), flush=True)
        if "payload" in chain.parts:
            print("\npayload at the end:", " ".join(f"{x:.3f}" for x in done[-1].load[-1]))
