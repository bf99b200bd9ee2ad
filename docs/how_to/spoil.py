"""Write spoiled.csv: a simulated run whose third encoder stands still for half a second while the arm moves."""

import csv

from dynid_rs import read_robot
from dynid_rs.simulation import bundled_robot, simulate, typical_arm
from dynid_rs.simulation.folder import run_columns

arm = typical_arm(read_robot(bundled_robot())).rigid()
(run,) = simulate(arm, n_runs=1, duration=8.0, rate=200.0).recordings
columns = {name: values.copy() for name, values in run_columns(run).items() if name.startswith(("t", "q_"))}
columns = {name: values for name, values in columns.items() if not name.startswith("q_motor")}
fastest = int(abs(columns["q_2"][100:-100] - columns["q_2"][:-200]).argmax())
columns["q_2"][fastest : fastest + 100] = columns["q_2"][fastest]
with open("spoiled.csv", "w", newline="", encoding="utf-8") as stream:
    writer = csv.writer(stream)
    writer.writerow(columns)
    writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
