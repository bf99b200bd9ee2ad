"""Runs as people give them in Python: what contradicts its position is left out, as by every command."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
from helpers.run_files import write
from helpers.small_arm import run as columns_of_run
from helpers.small_arm import write_robot, write_runs

import dynid_rs as dyn
from dynid_rs.runs.given import as_recordings


def test_python_leaves_a_late_velocity_out_as_commands_do(tmp_path):
    """Said once of a run, of each joint with how late it is; the fit is that of the run without."""
    columns = columns_of_run(1)
    for k in range(3):
        dq = np.gradient(columns[f"q_{k}"], columns["t"])
        columns[f"dq_{k}"] = np.concatenate([np.full(10, dq[0]), dq[:-10]])
    robot = dyn.RobotModel.from_urdf(write_robot(tmp_path))
    run = dyn.read_recording(write(tmp_path / "run_1.parquet", columns))
    fresh = dyn.ThreeLoopIdentifier(robot, residual=None)
    with pytest.warns(dyn.DamageWarning, match=r"dq_\d .* dq is not used"):
        found = fresh.fit(run).links_.x_
    again = dyn.ThreeLoopIdentifier(robot, residual=None).fit(run)  # no second warning
    np.testing.assert_array_equal(again.links_.x_, found)
    without = dyn.ThreeLoopIdentifier(robot, residual=None).fit(run.without("dq"))
    np.testing.assert_array_equal(without.links_.x_, found)
    np.testing.assert_array_equal(again.states(run).dq, without.states(run.without("dq")).dq)
    assert "dq_disagrees" in [finding.code for finding in dyn.inspect(run)]


def test_a_run_that_was_looked_at_is_let_go(tmp_path):
    read = dyn.read_recording(write_runs(tmp_path, n_runs=1)[0])
    assert as_recordings([read]) == [read]
    gone = weakref.ref(read)
    del read
    gc.collect()
    assert gone() is None
