"""Repeat Section 6 of the paper and write a page with our figures beside its own: `make paper`."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import clock
import designs
import figures
import laboratory
import measured
import page
import shortcomings

from dynid_rs import RobotModel
from dynid_rs.model.assembly import evaluate
from dynid_rs.regression.evaluation import compare
from dynid_rs.simulation import bundled_robot


def main() -> None:
    """Friction, trajectory, link dynamics, compensation; then the same on measured robots."""
    options = _options()
    data = Path(options.data) if options.data else None
    extent = laboratory.QUICK if options.quick else laboratory.FULL
    pictures = options.output / "figures"
    pictures.mkdir(parents=True, exist_ok=True)

    robot = RobotModel.from_urdf(bundled_robot())
    _say("exciting trajectories (Table 2)")
    arms = {"the bundled six-axis arm": designs.design(robot, extent.seeds, **extent.search)}
    if data is not None and (data / measured.UR10E).is_dir():
        ur10e = RobotModel.from_urdf(data / measured.UR10E / "robot.urdf")
        arms["UR10e"] = designs.design(ur10e, extent.seeds, **extent.search)
    designed = next(iter(arms.values()))

    _say("measuring on the laboratory arm")
    lab = laboratory.measure(robot, designed.found["block"], extent)
    _say("friction experiment (Figure 6)")
    friction = laboratory.friction(lab)
    _say("three loops (Table 4)")
    outcomes = laboratory.identify(lab)
    _say("measured robots")
    robots = measured.measured_robots(data)
    _say("run times")
    ours = outcomes["ours"]
    times = page.Times(
        clock.machine(),
        designed.seconds["block"],
        clock.identification(robot, lab.timed, extent.repeats),
        clock.online_cycle(ours.identifier.model_, ours.states[laboratory.DESIGNED][0], extent.repeats),
    )

    _say("figures")
    joints = [f"joint {j + 1}" for j in range(robot.n_joints)]
    figures.exciting_trajectory(pictures / "figure_5.svg", designed.found["block"][0].trajectory_, joints)
    figures.friction(pictures / "figure_6.svg", friction, joints[:2])
    (run,) = ours.states[laboratory.DESIGNED]
    for name, model in (("figure_7.svg", ours.identifier.baseline_), ("figure_8.svg", ours.identifier.model_)):
        comparison = compare(run, evaluate(model, run)[0])
        figures.torque(pictures / name, run.t[run.rows], comparison.measured, comparison.predicted, joints)

    experiment = page.Experiment(arms, lab, friction, outcomes, robots, times, quick=options.quick)
    text = page.write(experiment) + shortcomings.write(experiment)
    (options.output / "paper.md").write_text(text, encoding="utf-8")
    print(options.output / "paper.md")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("docs/measured"), help="folder for paper.md and figures/"
    )
    parser.add_argument(
        "--data", default=os.environ.get("DYNID_DATA"), help="folder of measured robots; DYNID_DATA if left out"
    )
    parser.add_argument("--quick", action="store_true", help="short searches and runs, to see that it works")
    return parser.parse_args()


def _say(step: str) -> None:
    print(step, flush=True)


if __name__ == "__main__":
    main()
