"""The repeated experiment: a quick run makes page and figures, and prints the paper's own tables unchanged."""

import math
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from helpers import paper_tables as paper
from numpy.testing import assert_allclose, assert_array_equal

import dynid_rs

FIGURES = [f"figure_{k}.svg" for k in (5, 6, 7, 8)]
MOST_BYTES = 150_000
"""Of a figure."""
ROUNDED = 0.5e-4
"""Largest error of a number of Table 3."""
TENTH = 0.05 + 1e-9
"""Largest error of a percentage with one digit behind the point."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What the script writes in a quick run without measured data."""
    folder = tmp_path_factory.mktemp("paper")
    package = str(Path(dynid_rs.__file__).parents[1])
    environment = {name: value for name, value in os.environ.items() if name != "DYNID_DATA"}
    environment["PYTHONPATH"] = os.pathsep.join([package, environment.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-W", "error::RuntimeWarning", paper.FOLDER / "main.py", "--quick", "-o", folder],
        env=environment, capture_output=True, text=True, timeout=280, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == str(folder / "paper.md")
    return folder


@pytest.fixture(scope="module")
def page(folder):
    return (folder / "paper.md").read_text(encoding="utf-8")


def rows_after(page, words):
    """The first table behind these words: name of a row -> its cells."""
    table = re.search(r"(?:^\|.*\n)+", page[page.index(words) :], re.M)
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in table[0].splitlines()]
    return {name: cells for name, *cells in lines[2:]}


def numbers(cells):
    return np.array([float(cell) for cell in cells])


def test_every_figure_is_made_small_and_shown(folder, page):
    assert sorted(path.name for path in (folder / "figures").iterdir()) == FIGURES
    for name in FIGURES:
        path = folder / "figures" / name
        assert ElementTree.parse(path).getroot().tag == "{http://www.w3.org/2000/svg}svg"
        assert 10_000 < path.stat().st_size < MOST_BYTES
        assert f"](figures/{name})" in page


def test_the_page_has_all_its_sections(page):
    numbered = re.findall(r"^## (\d)\. ", page, re.M)
    assert numbered == [str(k) for k in range(1, 9)]
    assert "nan" not in page.split()
    assert "left out" in page  # there was no measured data


def test_table_1_is_unchanged(page):
    rows = rows_after(page, "**Table 1, as printed.**")
    printed = [numbers(cells) for cells in rows.values()]
    assert_array_equal(printed, [[120, 90, 60, 120, 120, 120], [100, 60, 60, 80, 80, 80], [120] * 6])


def test_table_3_is_unchanged_and_satisfies_eq_18(page):
    rows = rows_after(page, "**Table 3, as printed**")
    a, b = (np.array([numbers(rows[f"{letter}_{k}"]) for k in range(1, 6)]) for letter in "ab")
    theta = numbers(rows["theta_0 [rad]"])
    assert_array_equal(a, paper.SIN_COEF)
    assert_array_equal(b, paper.COS_COEF)
    # Eq. 18, literally, on joints 1 to 5; joint 6 is misprinted.
    order = np.arange(1.0, 6)[:, None]
    omega = 2 * math.pi / 20
    start, velocity = theta - (b / (omega * order)).sum(axis=0), a.sum(axis=0)
    acceleration = (order * b).sum(axis=0)
    room = ROUNDED * np.array([1 + (1 / (omega * order)).sum(), 5, order.sum()]) + 1e-12
    assert (np.abs([start, velocity, acceleration])[:, :5] <= room[:, None]).all()
    assert_allclose(velocity[5], 0.0036, atol=ROUNDED)
    assert_allclose(paper.TABLES.eq_18(0.05)[:2], [start, velocity], atol=1e-12)


def test_table_4_is_unchanged_and_its_percentages_are_right(page):
    rows = rows_after(page, "**Table 4, as printed**")
    wls, theirs = numbers(rows["WLS"]), numbers(rows["theirs"])
    assert_array_equal(wls, [2.3376, 2.1278, 1.5395, 0.3361, 0.7101, 0.2578])
    assert_array_equal(theirs, [1.9594, 1.7345, 1.1609, 0.3027, 0.5852, 0.2096])
    assert_array_equal(numbers(rows["change, %"]), [-16.2, -18.5, -24.6, -9.9, -17.6, -18.7])
    assert_allclose(numbers(rows["change, %"]), 100 * (theirs / wls - 1), rtol=0, atol=TENTH)
    assert '"Reduced by more than 20 %" holds for joint 3 alone' in page


def test_our_percentages_belong_to_our_errors(page):
    """Errors have four digits, so a percentage is off by a few hundredths more than its own rounding."""
    rows = rows_after(page, "**Ours, on the laboratory arm**")
    assert [name for name in rows if name.startswith("**")] == [
        "**training**: WLS",
        "**another designed run**: WLS",
        "**the paper's Table 3**: WLS",
    ]
    lines = re.findall(r"^\| (.*) \|$", page[page.index("**Ours, on the laboratory arm**") :], re.M)[2:17]
    cells = [line.split(" | ") for line in lines]
    for first in range(0, 15, 5):
        wls, loops, change, slow, slow_change = (numbers(row[1:]) for row in cells[first : first + 5])
        assert (wls > 0).all()
        assert_allclose(change, 100 * (loops / wls - 1), rtol=0, atol=2 * TENTH + 0.1)
        assert_allclose(slow_change, 100 * (slow / wls - 1), rtol=0, atol=2 * TENTH + 0.1)


def test_the_papers_trajectory_is_beside_ours_and_keeps_table_1(page):
    rows = rows_after(page, "On the bundled six-axis arm:")
    robot = dynid_rs.RobotModel.from_urdf(dynid_rs.simulation.bundled_robot())
    base = robot.base_parameters()
    motion = paper.table_3().evaluate(paper.sampling_times())
    condition = np.linalg.cond(base.reduce(robot.joint_torque_regressor(*motion)).reshape(-1, base.n_base))
    assert float(rows["the paper's Table 3"][1]) == pytest.approx(condition, abs=TENTH)
    assert "0 limits exceeded by the design, 0 by Table 3" in page


def test_the_friction_law_is_near_the_truth_that_was_simulated(page):
    rows = rows_after(page, "Root mean squares over the speeds of the pairs")
    assert len(rows) == 6
    share = np.array([float(cells[-1]) for cells in rows.values()])
    assert np.median(share) < 15
