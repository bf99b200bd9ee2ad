"""Gaps and jumps of time: a run falls into parts there, and that is said."""

import json

import numpy as np
import pytest
from helpers.run_files import JOINTS, csv_text, valid_columns, write_csv, write_parquet
from helpers.small_arm import dynid, run, write_robot, write_runs

from dynid_rs.base.errors import DataError
from dynid_rs.runs.checks.repeats import repeat_findings
from dynid_rs.runs.parts import Parts, find_parts
from dynid_rs.runs.readers import PartsWarning, count_parts, read_recording, read_recordings, read_run


def with_gap(row=100, length=1.0, **kwargs):
    columns = valid_columns(**kwargs)
    columns["t"][row:] += length
    return columns


def test_a_gap_splits_a_run_and_says_so(tmp_path):
    columns = with_gap()
    path = write_csv(tmp_path / "run.csv", columns)
    first, second = read_recordings(path, JOINTS)
    assert (first.n_samples, second.n_samples) == (100, 300)
    assert (first.name, second.name) == ("run.csv (part 1 of 2)", "run.csv (part 2 of 2)")
    np.testing.assert_array_equal(second.q[:, 0], columns["q_0"][100:])
    assert second.line_of(0) == 102
    with pytest.warns(PartsWarning, match=r"a gap of 1.01 s before row 101 \(line 102\): read as 2 parts.*longest"):
        assert read_recording(path, JOINTS).n_samples == 300
    (said,) = read_run(path, JOINTS).findings()
    assert (said.code, said.severity, said.rows, said.line) == ("long_gap", "warning", (99, 101), 102)
    assert count_parts(path, JOINTS) == 2


def test_a_clock_that_is_set_back_splits_too(tmp_path):
    columns = valid_columns()
    columns["t"][250:] -= columns["t"][250]
    path = write_parquet(tmp_path / "run.parquet", columns)
    assert [part.n_samples for part in read_recordings(path, JOINTS)] == [250, 150]
    (said,) = read_run(path, JOINTS).findings()
    assert said.code == "time_backwards"
    assert "time goes back by 2.49 s before row 251" in said.message


def test_one_damaged_stamp_costs_its_row(tmp_path):
    columns = valid_columns()
    columns["t"][48] = 0.1
    path = write_csv(tmp_path / "run.csv", columns)
    assert [part.n_samples for part in read_recordings(path, JOINTS)] == [48, 351]
    assert "1 rows in pieces that are too short are left out" in read_run(path, JOINTS).split.text


def test_short_pieces_are_left_out_and_shreds_are_refused(tmp_path):
    assert find_parts(with_gap(row=15)["t"]) == Parts(((15, 400),), (15,), 15)
    columns = valid_columns()
    columns["t"] += 5.0 * (np.arange(400) // 19)  # a gap after every 19 rows
    with pytest.raises(DataError, match=r"a gap of .* cannot be bridged"):
        read_recordings(write_csv(tmp_path / "run.csv", columns), JOINTS)


@pytest.mark.parametrize("t", [np.zeros(0), np.arange(5.0), np.full(50, np.nan), np.zeros(50), np.arange(50.0)[::-1]])
def test_time_that_is_none_stays_in_one_part(t):
    assert find_parts(t).rows == ((0, len(t)),)


def test_identify_learns_from_every_part(tmp_path):
    robot, runs = write_robot(tmp_path), write_runs(tmp_path)
    columns = run(0)
    columns["t"][700:] += 30.0
    (tmp_path / "gap.csv").write_text(csv_text(columns))
    result = dynid("identify", robot, tmp_path / "gap.csv", runs[1], "--test", runs[2], "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    data = json.loads((tmp_path / "out" / "result.json").read_text())["data"]
    assert data["train"] == ["gap.csv (part 1 of 2)", "gap.csv (part 2 of 2)", "run_1.parquet"]
    (said,) = [finding for finding in data["findings"] if finding["code"] == "long_gap"]
    assert said["rows"] == [699, 701]


def test_inspect_shows_every_part(tmp_path):
    write_csv(tmp_path / "run.csv", with_gap())
    result = dynid("inspect", tmp_path / "run.csv", "--json")
    shown = json.loads(result.stdout)["runs"]
    assert [one["n_samples"] for one in shown] == [100, 300]


def test_runs_in_which_one_joint_moves(tmp_path):
    """Each run moves one joint only; together they move all."""
    robot = write_robot(tmp_path)
    paths = []
    for j in range(3):
        columns = run(j, rate=100.0)
        for other in {0, 1, 2} - {j}:
            columns[f"q_{other}"][:] = columns[f"q_{other}"][0]
        paths.append(write_parquet(tmp_path / f"joint_{j}.parquet", columns))
    result = dynid("identify", robot, *paths, "--test", write_runs(tmp_path)[0], "-o", tmp_path / "out")
    assert result.exit_code in (0, 1), result.output
    assert (tmp_path / "out" / "model.json").exists()


def test_a_file_in_parts_is_read_once(tmp_path, monkeypatch):
    from dynid_rs import RobotModel
    from dynid_rs.archive import runs as module
    from dynid_rs.commands._inputs import run_sources
    from dynid_rs.runs.readers import Config

    robot, columns, calls = RobotModel.from_urdf(write_robot(tmp_path)), run(0), []
    for row in (400, 800, 1200):
        columns["t"][row:] += 5.0
    path = write_csv(tmp_path / "run.csv", columns)
    sources = run_sources([path], robot, Config())

    def counted(*arguments, **named):
        calls.append(arguments)
        return read_run(*arguments, **named)

    monkeypatch.setattr(module, "read_run", counted)
    read = [source.read()[0] for source in sources]
    assert [one.n_samples for one in read] == [400, 400, 400, len(columns["t"]) - 1200]
    assert len(calls) == 1
    assert len({source.content() for source in sources}) == 4


def test_parts_at_rest_are_left_out_where_others_move(tmp_path):
    """A log that was started again before the arm was: what is left of the first one says nothing."""
    columns = valid_columns()
    for name in [name for name in columns if name != "t"]:
        columns[name][300:] = columns[name][300]
    columns["t"][300:] += 5.0
    path = write_csv(tmp_path / "run.csv", columns)
    (kept,) = read_recordings(path, JOINTS)
    assert (kept.name, kept.n_samples) == ("run.csv", 300)
    assert count_parts(path, JOINTS) == 1
    assert read_run(path, JOINTS).split.text.endswith("read as 1 part (rows 1 to 300); 100 rows at rest are left out")
    assert Parts(((0, 5), (5, 9))).in_motion(np.zeros((9, 2))) == Parts(((0, 5), (5, 9))), "nothing moves at all"


def test_a_block_that_a_log_wrote_twice_is_to_be_cut_out(tmp_path):
    columns = valid_columns()
    order = np.r_[0:300, 200:400]
    path = write_csv(tmp_path / "run.csv", {name: x[order] for name, x in columns.items()})
    said = repeat_findings(read_recordings(path, JOINTS))[1]
    assert said.rows == (0, 100)
    assert (
        said.message == "rows 1 to 100 are samples of run.csv (part 1 of 2) too; the log wrote them twice: cut them out"
    )
