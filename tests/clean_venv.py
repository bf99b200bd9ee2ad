"""`python tests/clean_venv.py FOLDER`: the wheel in FOLDER that fits this machine, as a newcomer meets it.

A new venv, `pip install WHEEL`, then `dynid demo`, `dynid init` and `dynid identify` on a log as a Universal Robots
controller writes it, and the online binary; no compiler is on the path, nor anything else but the venv. The seconds
that each step took are printed and judged by nobody.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

from helpers import log_files
from helpers.small_arm import write_robot

LOG = "ur rtde, spaces, currents"
HEAVY = ("scipy", "sklearn", "pyarrow", "plotly", "typer", "rich", "pandas", "polars", "matplotlib")
"""Libraries that `import dynid_rs` leaves alone: whoever evaluates a model does not wait for them."""
LOOK = f"import sys, dynid_rs; print([name for name in {HEAVY!r} if name in sys.modules]); print(dynid_rs.__file__)"


def main(folder: Path) -> None:
    """Every step, or an error."""
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as made:
        place = Path(made)
        venv.create(place / "venv", with_pip=True)
        home = place / "venv" / ("Scripts" if os.name == "nt" else "bin")
        python = home / ("python.exe" if os.name == "nt" else "python")
        environment = {"PATH": str(home), "HOME": made, "SYSTEMROOT": os.environ.get("SYSTEMROOT", "")}
        pip = {name: value for name, value in os.environ.items() if name.startswith("PIP_")}

        def run(name, *words, given=None, **more):
            start = time.monotonic()
            program = python if words[0] == "python" else home / words[0]
            command = [str(program), *map(str, words[1:])]
            streams = {"input": given, "capture_output": True, "text": True, "encoding": "utf-8"}
            done = subprocess.run(command, cwd=place, env=environment | more, check=False, **streams)
            print(f"{time.monotonic() - start:6.1f} s  {name}", flush=True)
            if done.returncode:
                sys.exit(f"{' '.join(command)} ended with {done.returncode}:\n{done.stdout}\n{done.stderr}")
            return done.stdout

        run("pip install", "python", "-m", "pip", "install", "--quiet", *_wheel(folder), **pip)
        heavy, where = run("import dynid_rs", "python", "-c", LOOK).splitlines()
        assert heavy == "[]", f"import dynid_rs brings {heavy}"
        assert Path(where).is_relative_to(place.resolve() if os.name == "nt" else place), where

        told = json.loads(run("dynid demo", "dynid", "demo", "--json"))
        assert told["found"] == told["put_in"], told
        assert (place / told["report"]).is_file(), told

        robot, runs = write_robot(place), [log_files.VARIANTS[LOG].write(place, k) for k in range(2)]
        run("dynid init", "dynid", "init", robot, *runs, "-o", "dynid.toml", "--yes")
        words = ("identify", robot, *runs, "--config", "dynid.toml", "-o", "result", "--json")
        result = json.loads(run("dynid identify", "dynid", *words))
        assert result["torque_unit"] == "A", result["torque_unit"]

        model = place / "result" / "model.json"
        run("dynid estimate", "dynid", "estimate", model, runs[1], "--config", "dynid.toml", "--states", "states.csv")
        states = (place / "states.csv").read_text()
        answers = run("dynid-estimator", "dynid-estimator", model, given=states).splitlines()
        assert len(answers) == len(states.splitlines()), f"{len(answers)} lines of answers"
    print(f"{time.monotonic() - begin:6.1f} s  all told, from nothing to a model")


def _wheel(folder: Path) -> list[str]:
    """Words for pip: the package from the folder alone, what it needs from where pip finds it."""
    wheels = sorted(folder.glob("*.whl"))
    if not wheels:
        sys.exit(f"{folder}: holds no wheel; build one with make wheels")
    from packaging.tags import sys_tags
    from packaging.utils import parse_wheel_filename

    ours = set(sys_tags())
    fitting = [wheel for wheel in wheels if parse_wheel_filename(wheel.name)[3] & ours]
    if not fitting:
        sys.exit(f"{folder}: none of {', '.join(wheel.name for wheel in wheels)} fits this machine")
    return [str(fitting[0].resolve())]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
