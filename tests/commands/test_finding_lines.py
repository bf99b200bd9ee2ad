"""Findings at the end of `identify` and `diagnose`: one line of every kind."""

from __future__ import annotations

from dynid_rs.commands._identify_view import finding_lines


def coarse(file, j):
    message = f"q_{j} moves in steps of 1.5e-3 rad"
    return {"code": "lost_bits", "severity": "warning", "message": message, "file": file, "column": f"q_{j}"}


def test_the_same_of_many_joints_and_runs_is_one_line():
    findings = [coarse(file, j) for file in ("a.csv", "b.csv") for j in range(3)]
    gap = {"code": "gap", "severity": "warning", "message": "b.csv: a gap of 2 s"}
    assert finding_lines([*findings, gap | {"file": "b.csv"}]) == [
        "warning: a.csv: q_0 moves in steps of 1.5e-3 rad (also q_1, q_2, b.csv)",
        "warning: b.csv: a gap of 2 s",
    ]


def test_nothing_wrong_is_no_line():
    assert finding_lines([]) == []
