"""Time of every loop of the paper's Figure 2 on 20 s of 1 kHz data of six joints (the paper: 1 s, 5 s, 2 s in MATLAB).

Wall clock and processor time, least of several rounds; the first is what a user waits for, the second does not see what
else the machine does.
"""

from __future__ import annotations

import time

from threadpoolctl import threadpool_limits

import dynid_rs as dyn
from dynid_rs.identification.loops import Loops
from dynid_rs.identification.training import prepare_training_data
from dynid_rs.simulation import bundled_robot, simulate, typical_arm

ROUNDS = 5
STEPS = ("start", "fit_friction", "fit_links", "fit_residual")


def timed(function):
    """Seconds of wall clock and of the processor."""
    wall, processor = time.perf_counter(), time.process_time()
    function()
    return time.perf_counter() - wall, time.process_time() - processor


def main():
    robot = dyn.RobotModel.from_urdf(bundled_robot())
    runs = simulate(typical_arm(robot), n_runs=1, duration=20.0, rate=1000.0, seed=0).recordings
    data = prepare_training_data(runs, [], [], None)
    for prior in ("auto", None):
        rounds = []
        for _ in range(ROUNDS):
            links = dyn.LinkDynamicsIdentifier(prior=prior)
            laws = ["paper"] * robot.n_joints
            loops = Loops(robot, data, dyn.FrictionIdentifier(), links, dyn.ResidualCompensator(), laws)
            with threadpool_limits(limits=1, user_api="blas"):
                rounds.append([timed(getattr(loops, step)) for step in STEPS])
        print(f"first round of the loops, prior={prior!r}")
        for k, step in enumerate(STEPS):
            wall, processor = (min(entry[k][clock] for entry in rounds) for clock in (0, 1))
            print(f"  {step:<14} {1e3 * wall:7.1f} ms  {1e3 * processor:7.1f} ms of processor")


if __name__ == "__main__":
    main()
