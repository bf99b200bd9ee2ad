"""Runs as a watch hands them back, made by hand: what is said of them is known beforehand."""

from functools import cache
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from dynid_rs import RobotModel, Watch, _core
from dynid_rs.base.changes import Change
from dynid_rs.model.watch import Watched
from dynid_rs.simulation import bundled_robot

HOSTILE = '<script>alert("x")</script>\\n {joint="0"} 7 \u00e9&amp;'
"""A joint's name that breaks whatever is not quoted."""
DEVIATION, ROW = 0.5, 0.2
DAY = 432_000
"""Rows."""
CLOCK = 1_772_323_200.0
"""2026-03-01 00:00 UTC."""


@cache
def watch(torque_unit="N*m", second="joint_2"):
    """Watch of the bundled arm, whose second joint has this name."""
    text = Path(bundled_robot()).read_text(encoding="utf-8")
    quoted = escape(second, {'"': "&quot;"})
    robot = RobotModel.from_urdf_string(text.replace('name="joint_2"', f'name="{quoted}"'))
    n = robot.n_joints
    model = _core.TorqueModel(
        robot,
        robot.phi,
        [],
        encoder_delay=[0.0] * n,
        noise_std=[DEVIATION] * n,
        domain=([[-4.0, 4.0]] * n, [6.0] * n, [60.0] * n),
        torque_unit=torque_unit,
    )
    return Watch(model)


def change(kind, joint="joint_2", size=0.2, *, t=10.0, said="settled", half=0.02, moments=None, either=None):
    unit = {"load": "kg", "offset": "N*m"}.get(kind, "")
    moments = (0.1, 0.0, -0.05) if kind == "load" and moments is None else moments
    return Change(t, kind, joint, size, (size - half, size + half), moments, said, either, unit)


def run(*changes, name="run.csv", rows=600, start=0.0, n=6, seed=0, unseen=()):
    """White noise of the size that is expected, in which nothing of `unseen` joints was watched."""
    left = np.random.default_rng(seed).normal(size=(rows, n)) * DEVIATION
    watched = np.ones((rows, n), dtype=bool)
    watched[:, list(unseen)] = False
    t = start + ROW * np.arange(1, rows + 1)
    return Watched(name, changes, t, left, np.full((rows, n), DEVIATION), watched)


def both(kind, joint="joint_2", size=0.2, *, t=10.0, outcome="settled", **more):
    """A change as it is said twice."""
    first = change(kind, joint, 1.1 * size, t=t, said="named", half=0.06, **more)
    return first, change(kind, joint, size, t=t + 20.0, said=outcome, **more)
