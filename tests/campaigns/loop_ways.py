"""One arm and the commands that a user would give: excite, record, diagnose, excite what is open, estimate."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv as pc
from exam.examine import default_program
from exam.score import score
from scipy.interpolate import CubicSpline

import dynid_rs as dyn
from campaigns.loop_arm import Oracle, error_of
from campaigns.next_arm import Arm, Motion
from campaigns.next_experiment import limits_of

Figures = dict[str, Any]

SECONDS, MOST = 20.0, 4
"""Of a motion, and how many there are at most."""
ENOUGH = 1.05
"""Error over the oracle's up to which a model counts as good as it."""
HARMONICS = 10
"""Up to half a hertz: with five a motion of 20 s is slower than its limits."""
SEARCH = ("--criterion", "condition", "--restarts", "4", "--harmonics", str(HARMONICS))
WALK = ("--iterations", "40")
"""Steps of the search for the next experiment, fewer than by default."""
RAN, SAID_NO = 0, 1
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "RAYON_NUM_THREADS")


class CommandFailedError(Exception):
    """A command ended with an error; what it said."""


@dataclass(eq=False)
class Ways:
    """Ways of an arm from nothing to a model."""

    arm: Arm
    exciting: list[Path] = field(default_factory=list)

    def __post_init__(self) -> None:
        used = self.arm.limits
        self.limits_file = self.arm.folder / "limits.toml"
        sides = {"lower": used["middle"] - used["position"], "upper": used["middle"] + used["position"]}
        lines = ["[position]", *(f"{side} = {values.tolist()}" for side, values in sides.items())]
        for name in ("velocity", "acceleration"):
            lines += [f"[{name}]", f"limit = {used[name].tolist()}"]
        lines += ["[start]", f"position = {used['middle'].tolist()}"]
        self.limits_file.write_text("\n".join(lines) + "\n", encoding="utf-8")

    def oracle(self) -> Oracle:
        """Fitted to as many exciting motions as there are at most."""
        return Oracle(self.arm, [self.arm.played[self.excited(k)] for k in range(MOST)])

    def loop(self, oracle: Oracle) -> Iterator[Figures]:
        """Excite, record, diagnose, excite what is open, until nothing more needs to be recorded."""
        runs, result = [self.excited(0)], None
        for k in range(MOST):
            result, outcome = self.diagnosed("loop", runs, result, oracle)
            plan = self.arm.folder / f"next_{k}.csv"
            self.command("excite", self.arm.robot, "-o", plan, "--after", result, *self._motion(k + 1), *WALK)
            said = json.loads(plan.with_suffix(".json").read_text(encoding="utf-8"))["next"]
            yield {
                **outcome,
                "wanted": said["is_wanted"],
                "beyond_noise": max(said["error_beyond_noise"]["now"]),
            }
            if not said["is_wanted"]:
                return
            runs.append(self.arm.record(played(plan), SECONDS, f"loop_{k + 1}", k + 1))

    def repeated(self, way: str, oracle: Oracle, n_least: int) -> Iterator[Figures]:
        """Motions of one kind, as many as the loop had, and more until the model is as good as the oracle."""
        runs: list[Path] = []
        for k in range(MOST):
            runs.append(self.excited(k) if way == "exciting" else self.random(k))
            _, outcome = self.diagnosed(way, runs, None, oracle)
            yield outcome
            if len(runs) >= n_least and outcome["error"] <= ENOUGH:
                return

    def excited(self, k: int) -> Path:
        """Recording of the k-th exciting motion."""
        while len(self.exciting) <= k:
            n = len(self.exciting)
            plan = self.arm.folder / f"exciting_{n}.csv"
            self.command("excite", self.arm.robot, "-o", plan, *self._motion(n))
            self.exciting.append(self.arm.record(played(plan), SECONDS, f"exciting_{n}", n))
        return self.exciting[k]

    def random(self, k: int) -> Path:
        """Recording of the k-th random motion within the same limits."""
        options = {
            "duration": SECONDS,
            "n_harmonics": HARMONICS,
            "start": self.arm.limits["middle"],
            "n_restarts": 1,
            "max_iter": 1,
            "random_state": k,
        }
        robot = dyn.RobotModel.from_urdf(self.arm.robot)
        problem = dyn.FourierExcitation(**options).fit(robot, limits_of(self.arm)).problem()
        rng, x = np.random.default_rng([self.arm.truth["seed"], k]), None
        while x is None:
            x = problem.drawn(rng)
        return self.arm.record(problem.series.trajectory(x, problem.start).evaluate, SECONDS, f"random_{k}", k)

    def diagnosed(self, way: str, runs: Sequence[Path], after: Path | None, oracle: Oracle) -> tuple[Path, Figures]:
        """Folder of the result, what is right and wrong of it, and its model's error over the oracle's."""
        result = self.arm.folder / f"{way}_result_{len(runs)}"
        goes_on = () if after is None else ("--after", after)
        self.command("diagnose", self.arm.robot, *runs, "--test", self.arm.test, "-o", result, *goes_on)
        estimates = result / "estimates.parquet"
        self.command("estimate", result / "model.json", self.arm.test, "-o", estimates)
        marks = score(self.arm.truth, json.loads((result / "result.json").read_text(encoding="utf-8")), 0.0, None)
        ratio = error_of(self.arm, estimates, oracle) / oracle.error
        return result, {
            "seconds": SECONDS * len(runs),
            "right": sum(effect["found"] for effect in marks["effects"]),
            "ties": sum(effect["tie"] for effect in marks["effects"]),
            "hidden": len(marks["effects"]),
            "false": len(marks["false"]),
            "named": marks["named"],
            "error": float(np.sqrt(np.mean(ratio**2))),
            "worst": float(ratio.max()),
        }

    def _motion(self, seed: int) -> list[str]:
        return ["--limits", str(self.limits_file), "--duration", f"{SECONDS:g}", "--seed", str(seed), *SEARCH]

    def command(self, *arguments: str | Path) -> None:
        """Run `dynid` as a process."""
        environment = os.environ | dict.fromkeys(THREADS, "1")
        words = [default_program(), *map(str, arguments)]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
        if done.returncode not in (RAN, SAID_NO):
            raise CommandFailedError(f"{arguments[0]}: {(done.stderr or done.stdout).strip()[-300:]}")


def played(plan: Path) -> Motion:
    """A motion that was planned on the disk, between its samples by splines."""
    table = pc.read_csv(plan)
    t = np.asarray(table["t"])
    n = sum(name.startswith("q_") for name in table.column_names)
    columns = [np.column_stack([np.asarray(table[f"{x}_{j}"]) for j in range(n)]) for x in ("q", "dq", "ddq")]
    splines = [CubicSpline(t, x) for x in columns]

    def motion(at):
        q, dq, ddq = (spline(np.minimum(at, t[-1])) for spline in splines)
        return q, dq, ddq

    return motion
