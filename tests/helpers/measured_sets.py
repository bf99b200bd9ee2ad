"""Measured arms as the plain command gets them, what its answer may be at most, and what it is today.

`python tests/results_page.py` runs them; `test_measured.py` holds the answers against the figures here.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from helpers import data

UR10E = ("20_02_12_50sec_12harm", "20_02_10_30sec_12harm", "20_02_19_14harm50sec")
XMATE7 = ("traj1_p3", "traj2_p3")
COMMAND = "from dynid_rs.cli import main; main()"


@dataclass(frozen=True)
class Limits:
    """What an answer has to keep: relative error per joint, number of effects, kinds to be named (any of `a|b`)."""

    error: tuple[float, ...] | None = None
    effects: int = 10
    named: tuple[str, ...] = ()


@dataclass(frozen=True)
class Reached:
    """What the answer is today: relative errors per joint, effects, after over declared and over least squares."""

    error: tuple[float, ...]
    effects: int
    of_declared: float
    of_wls: float
    named: bool = True


@dataclass(frozen=True)
class Measured:
    """One arm: title, folder, runs to learn from and to test on (none: the last third of the run is kept aside)."""

    title: str
    folder: str
    train: tuple[str, ...]
    test: tuple[str, ...]
    limits: Limits

    def command(self, output: Path, verb: str = "diagnose") -> list[str]:
        """Return the plain `dynid identify` or `dynid diagnose`, no option given."""

        def run(name: str) -> str:
            return str(data.place() / self.folder / f"{name}.parquet")

        tests = [part for name in self.test for part in ("--test", run(name))]
        arguments = [verb, run("robot").replace(".parquet", ".urdf"), *map(run, self.train), *tests]
        return [sys.executable, "-c", COMMAND, *arguments, "-o", str(output)]

    def answer(self, verb: str, output: Path) -> dict[str, Any]:
        """Run the command and return result.json."""
        done = subprocess.run(
            self.command(output, verb), capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False
        )
        if not (output / "result.json").is_file():
            raise RuntimeError(f"{self.title}: {done.stderr.strip() or done.stdout.strip()}")
        return json.loads((output / "result.json").read_text(encoding="utf-8"))


MOST_OF_DECLARED, MOST_OF_WLS = 1.02, 1.05
"""Error after the diagnosis over that of the declared model and of weighted least squares, on the worst joint."""

SETS = {
    "ar5": Measured(
        "Rokae AR5, base mounted sideways",
        "rokae_ar5",
        ("excite",),
        (),
        Limits((0.03, 0.06, 0.06, 0.04, 0.18, 0.11, 0.10), 6, ("gravity_tilt",)),
    ),
    "tx40": Measured(
        "Staubli TX40, coupled wrist",
        "staubli_tx40_figaroh",
        ("excite",),
        (),
        Limits(None, 10, ("inertial_coupling|coupled_friction",)),
    ),
    "ur10": Measured(
        "UR10, one run of 27 s", "ur10_unisa", ("excite",), (), Limits((0.06, 0.06, 0.04, 0.06, 0.10, 0.15), 4)
    ),
    "lwr": Measured(
        "KUKA LWR4+",
        "kuka_lwr4p_flobaroid",
        ("measurements_1", "measurements_2"),
        ("measurements_3",),
        Limits((1.0,) * 7),
    ),
    "kuka": Measured(
        "KUKA KR300, two encoders",
        "kuka_kr300_weigand",
        ("traj_A",),
        ("traj_B",),
        Limits((0.09, 0.21, 0.10, 0.27, 0.16, 0.14), 10, ("counterbalance",)),
    ),
    "panda": Measured(
        "Franka Panda, joint torque",
        "panda_gaz",
        ("excite",),
        (),
        Limits((0.055, 0.012, 0.012, 0.026, 0.024, 0.012, 0.058)),
    ),
    "dual": Measured(
        "seven axes, harmonic drives, currents",
        "dualarm7_hujinfei",
        ("excite_13p5",),
        ("excite_15p7",),
        Limits(None, 12),
    ),
    "xmate3": Measured("Rokae xMate3 Pro", "rokae_xmate3pro", ("excite",), (), Limits()),
    "xmate7": Measured("Rokae xMate7 Pro", "rokae_xmate7p", XMATE7, ("traj3_p3",), Limits(None, 12)),
    "xmate7-slow": Measured(
        "Rokae xMate7 Pro, slow against fast", "rokae_xmate7p", XMATE7, ("traj3_p5",), Limits(None, 12)
    ),
    "ur10e": Measured(
        "UR10e, currents",
        "ur10e_innopolis",
        UR10E,
        ("20_02_12_40sec_12harm",),
        Limits((0.026, 0.011, 0.016, 0.031, 0.047, 0.042), 12, ("load_dependent_friction",)),
    ),
}

IDENTIFIED = SETS | {
    "kuka-back": Measured("KUKA KR300, run B against run A", "kuka_kr300_weigand", ("traj_B",), ("traj_A",), Limits()),
    "ur10e-short": Measured(
        "UR10e, two shorter runs",
        "ur10e_innopolis",
        ("20_02_10_30sec_12harm", "20_02_05_20sec_8harm"),
        ("20_02_12_50sec_12harm",),
        Limits(),
    ),
}
"""What `dynid identify` is measured on: the sets above, and two more splits of arms that have the runs for it."""

SLACK = 1.1
"""Another machine, another library of linear algebra: errors may be so many times those below."""
REACHED: dict[str, Reached] = {
    "ar5": Reached((0.009, 0.024, 0.037, 0.028, 0.148, 0.069, 0.087), 14, 0.35, 0.19),
    "tx40": Reached((0.020, 0.033, 0.030, 0.061, 0.495, 0.245), 6, 1.00, 0.73),
    "ur10": Reached((0.050, 0.038, 0.036, 0.054, 0.108, 0.106), 3, 1.01, 0.59),
    "lwr": Reached((0.263, 0.013, 0.159, 0.034, 0.351, 0.345, 0.288), 6, 1.16, 0.33),
    "kuka": Reached((0.068, 0.200, 0.081, 0.174, 0.174, 0.157), 6, 1.05, 0.84),
    "panda": Reached((0.056, 0.008, 0.008, 0.018, 0.031, 0.013, 0.057), 7, 1.00, 0.89),
    "dual": Reached((0.118, 0.070, 0.159, 0.093, 0.069, 0.072, 0.091), 1, 1.26, 1.02),
    "xmate3": Reached((0.525, 0.043, 0.141, 0.024, 0.203, 0.185, 0.233), 2, 1.03, 1.30),
    "xmate7": Reached((0.085, 0.014, 0.034, 0.021, 0.153, 0.089, 0.149), 8, 0.99, 0.84),
    "xmate7-slow": Reached((0.963, 0.096, 0.267, 0.097, 0.256, 0.182, 0.253), 8, 1.05, 0.99),
    "ur10e": Reached((0.025, 0.009, 0.015, 0.029, 0.043, 0.039), 11, 0.99, 0.76),
}
"""What each set reaches today; the limits stand beside its runs above. A set without figures is held to its limits."""


def relative(result: dict[str, Any], key: str = "after") -> list[float]:
    """Error on test runs over the torque's standard deviation, per joint."""
    test = result["rmse"]["test"]
    return [error / size for error, size in zip(test[key], test["torque_std"], strict=True)]


def worst_ratio(result: dict[str, Any], key: str) -> float:
    """Error after the diagnosis over another one, on the worst joint."""
    test = result["rmse"]["test"]
    return max(after / other for after, other in zip(test["after"], test[key], strict=True))


def missing_names(result: dict[str, Any], limits: Limits) -> list[str]:
    """Kinds that had to be named and were not."""
    kinds = {effect["kind"] for effect in result["effects"]}
    return [wanted for wanted in limits.named if not kinds & set(wanted.split("|"))]
