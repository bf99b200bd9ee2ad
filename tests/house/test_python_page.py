"""docs/how_to/python.md does what it says: its blocks are run in order, and what it prints is what stands there."""

import contextlib
import io
import re

import matplotlib
import numpy as np
import pytest
from helpers.data import ROOT
from helpers.diagnosed import ROBOT, columns_of, measured
from helpers.run_files import write_csv
from helpers.small_arm import URDF
from test_readme import numbers, words

import dynid_rs

PAGE = (ROOT / "docs" / "how_to" / "python.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(python|text)\n(.*?)```", PAGE, re.S)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The robot, three runs of an arm with hysteresis on the elbow, and one in another program's words."""
    monkeypatch.chdir(tmp_path)
    matplotlib.use("agg")  # no window, wherever this runs
    (tmp_path / "robot.urdf").write_text(URDF)
    runs = measured("friction_hysteresis:elbow")
    for letter, run in zip("abc", runs, strict=True):
        write_csv(tmp_path / f"run_{letter}.csv", columns_of(run))
    log = {"time_ms": 1e3 * runs[1].t}
    for j in range(ROBOT.n_joints):
        log |= {f"actual_q_{j}": np.rad2deg(runs[1].q[:, j]), f"effort_{j}": runs[1].tau[:, j]}
    write_csv(tmp_path / "log.csv", log)
    yield tmp_path
    import matplotlib.pyplot as plt

    plt.close("all")


def test_every_block_runs_and_prints_what_stands_there(folder):
    names, printed = {}, ""
    shown = 0
    for kind, block in BLOCKS:
        if kind == "python":
            output = io.StringIO()
            with contextlib.redirect_stdout(output):
                exec(block, names)
            printed = output.getvalue()
            continue
        shown += 1
        assert words(block) == words(printed)
        for said, found in zip(numbers(block), numbers(printed), strict=True):
            np.testing.assert_allclose(found, said, rtol=0.1, atol=3 if said and said[0] > 10 else 0)
    assert shown == 4
    for picture in ("run", "friction", "residual"):
        assert (folder / f"{picture}.png").stat().st_size > 10_000
    assert {path.name for path in folder.glob("*.json")} == {"model.json", "model_with_effects.json"}


def test_the_page_names_everything_that_there_is():
    table = PAGE.split("## All names")[1]
    assert set(re.findall(r"`(\w+)`", table)) == set(dynid_rs.__all__)
