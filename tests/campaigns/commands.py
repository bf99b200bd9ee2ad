"""Commands that write, what they write, and whose files a folder holds after one of them was ended."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from helpers.small_arm import write_robot, write_runs

import dynid_rs
from dynid_rs.archive.cache import Cache, unpacked
from dynid_rs.base.held import clear_leftovers
from dynid_rs.base.together import finish_killed

PROGRAM = (sys.executable, "-c", "from dynid_rs.cli import main; main()")
ENVIRONMENT = os.environ | {
    "PYTHONPATH": str(Path(dynid_rs.__file__).parents[1]),
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONDONTWRITEBYTECODE": "1",  # what the interpreter writes is not what is tried
}
OLD = b"an older result\n"
FOUR = ("model.json", "report.html", "residuals.parquet", "result.json")
FLEET = """
[defaults]
residual = "none"

[[robot]]
name = "first"
robot = "robot.urdf"
runs = ["run_[01].parquet"]
test = "run_2.parquet"
"""


@dataclass(frozen=True)
class Writing:
    """A command and the folders that it fills, each with files that belong together.

    Parameters
    ----------
    name : str
        Of the command.
    arguments : function of Path
        What is given to `dynid`, in a folder with a robot and runs; results go below ``out``.
    groups : tuple of (str, tuple of str)
        Folders below ``out``, and names in each.
    """

    name: str
    arguments: Callable[[Path], tuple[object, ...]]
    groups: tuple[tuple[str, tuple[str, ...]], ...]


def _runs(folder: Path) -> tuple[Path, ...]:
    return tuple(folder / f"run_{k}.parquet" for k in range(2))


def _identify(folder: Path, *options: object) -> tuple[object, ...]:
    return ("identify", folder / "robot.urdf", *_runs(folder), "-o", folder / "out", "--force", *options)


ALL = (
    Writing("identify", lambda d: _identify(d, "--residual", "none"), ((".", FOUR),)),
    Writing(
        "stream",
        lambda d: _identify(d, "--residual", "none", "--memory", "5MB", "--cache", d / "cache"),
        ((".", FOUR),),
    ),
    Writing(
        "diagnose",
        lambda d: ("diagnose", d / "robot.urdf", *_runs(d), "-o", d / "out", "--force"),
        ((".", (*FOUR, "open.json")),),
    ),
    Writing(
        "excite",
        lambda d: (
            "excite",
            d / "robot.urdf",
            "-o",
            d / "out" / "plan.csv",
            "--friction",
            d / "out" / "slow.csv",
            "--force",
        ),
        ((".", ("plan.csv", "plan.html", "plan.json", "slow.csv", "slow.json")),),
    ),
    Writing(
        "fleet",
        lambda d: ("fleet", d / "fleet.toml", "-o", d / "out", "--force"),
        ((".", ("fleet.csv", "fleet.html", "fleet.json", "fleet.parquet", "quantities.parquet")), ("first", FOUR)),
    ),
    Writing(
        "simulate",
        lambda d: ("simulate", "-o", d / "out", "--duration", "5", "--runs", "2", "--force"),
        ((".", ("run_0.parquet", "run_1.parquet", "truth.json", "robot.urdf")),),
    ),
    Writing(
        "estimate",
        lambda d: ("estimate", d / "model.json", d / "run_0.parquet", "-o", d / "out" / "torque.parquet", "--force"),
        ((".", ("torque.parquet",)),),
    ),
)
BY_NAME = {writing.name: writing for writing in ALL}


def prepare(folder: Path, model: Path) -> None:
    """Robot, runs, a fleet and a model: what the commands read."""
    write_robot(folder)
    write_runs(folder)
    (folder / "fleet.toml").write_text(FLEET)
    (folder / "model.json").write_bytes(model.read_bytes())


def lay_old_results(writing: Writing, folder: Path) -> None:
    """Older files under every name, and nothing else."""
    subprocess.run(["rm", "-rf", folder / "out", folder / "cache"], check=True)
    for below, names in writing.groups:
        (folder / "out" / below).mkdir(parents=True, exist_ok=True)
        for name in names:
            # A simulation's own mark, without which it takes nothing for its own.
            (folder / "out" / below / name).write_bytes(OLD)


def start(writing: Writing, folder: Path, *prefix: str) -> subprocess.Popen[bytes]:
    """The command in a process group of its own; what it says goes to ``said``."""
    command = [*prefix, *PROGRAM, *map(str, writing.arguments(folder))]
    with (folder / "said").open("wb") as said:
        return subprocess.Popen(command, env=ENVIRONMENT, cwd=folder, stdout=said, stderr=said, start_new_session=True)


def faults_of(writing: Writing, folder: Path) -> list[str]:
    """What is wrong in the folders now, after the next process that writes there came by."""
    wrong = []
    for below, names in writing.groups:
        place = folder / "out" / below
        finish_killed(place)
        clear_leftovers(place)
        found = {path.name: path.read_bytes() for path in place.iterdir() if path.is_file()}
        missing = set(names) - set(found)
        if missing:
            wrong.append(f"{below}: lost {sorted(missing)}")
        old = {name for name in names if found.get(name) == OLD}
        if old and old != set(names):
            wrong.append(f"{below}: a mixture, old are {sorted(old)}")
        empty = [name for name, content in found.items() if not content]
        left = [path.name for path in place.iterdir() if path.name.startswith(".dynid-")]
        if empty or left:
            wrong.append(f"{below}: empty {empty}, left {left}")
    cache = Cache(folder / "cache")
    cache.sweep()
    damaged = [path.name for path in cache.entries() if unpacked(path.read_bytes()) is None]
    left = [path.name for path in folder.glob("cache/*/.dynid-*")]
    return wrong + ([f"cache: damaged {damaged}, left {left}"] if damaged or left else [])


def is_new(writing: Writing, folder: Path) -> bool:
    """Whether the first group is the new one."""
    below, names = writing.groups[0]
    return (folder / "out" / below / names[0]).read_bytes() != OLD


def digest(folder: Path) -> str:
    """Of all results, to compare runs."""
    hashed = hashlib.sha256()
    for path in sorted((folder / "out").rglob("*")):
        if path.is_file():
            hashed.update(path.name.encode() + path.read_bytes())
    return hashed.hexdigest()
