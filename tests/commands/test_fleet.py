"""A fleet: one row per robot, whatever is wrong with one of them, and nothing done twice."""

from __future__ import annotations

import csv
import json
import os
import signal
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers.run_files import write
from helpers.small_arm import URDF, dynid, refusal, run, snapshot, write_robot, write_runs

from dynid_rs.archive import work
from dynid_rs.archive.work import Work
from dynid_rs.commands._fleet_file import FleetRobot, read_fleet
from dynid_rs.commands._fleet_rows import Place, failed, rows_of

FLEET = """
[defaults]
residual = "none"

[[robot]]
name = "first"
robot = "arm/robot.urdf"
runs = ["arm/run_[01].parquet"]
test = "arm/run_2.parquet"

[[robot]]
name = "second"
robot = "arm/robot.urdf"
runs = ["arm/run_1.parquet", "arm/run_2.parquet"]
test = ["arm/run_0.parquet"]
output = "elsewhere/second"
cutoff = 4.0
"""


def fleet(folder, text=FLEET, *arguments, name="fleet.toml"):
    """Run `dynid fleet` on `text`; the printed answer and fleet.json."""
    arm = folder / "arm"
    if not arm.exists():
        arm.mkdir()
        write_robot(arm)
        write_runs(arm)
    (folder / name).write_text(text)
    printed = dynid("fleet", folder / name, "-o", folder / "out", *arguments)
    path = folder / "out" / "fleet.json"
    return printed, json.loads(path.read_text()) if path.is_file() else None


def test_one_row_per_robot(tmp_path):
    printed, answer = fleet(tmp_path)
    assert printed.exit_code == 0, printed.output
    assert (answer["n_robots"], answer["done"], answer["no"], answer["failed"]) == (2, 2, 0, 0)
    first, second = answer["robots"]
    assert (first["name"], first["n_joints"], first["n_runs"], first["n_test_runs"]) == ("first", 3, 2, 1)
    assert first["n_samples"] == 3202
    assert 0 < first["least_percent"] <= first["error_percent"] <= first["most_percent"] < first["wls_percent"]
    result = json.loads((tmp_path / "out" / "first" / "result.json").read_text())
    test = result["rmse"]["test"]
    share = 100 * np.array(test["after"]) / test["torque_std"]
    np.testing.assert_allclose([first["error_percent"], first["most_percent"]], [share.mean(), share.max()])
    assert first["message"] == result["verdict"]
    assert [joint["joint"] for joint in first["joints"]] == result["joints"]
    second_result = json.loads((tmp_path / "elsewhere" / "second" / "result.json").read_text())
    assert second_result["data"]["cutoff_hz"] == 4.0
    rows = list(csv.DictReader((tmp_path / "out" / "fleet.csv").read_text().splitlines()))
    table = pq.read_table(tmp_path / "out" / "fleet.parquet").to_pydict()
    assert [row["name"] for row in rows] == table["name"] == ["first", "second"]
    assert [float(row["error_percent"]) for row in rows] == table["error_percent"]
    assert table["error_percent"] == [first["error_percent"], second["error_percent"]]
    for text in ("first", "second", "weighted least squares", "done", "fleet.csv"):
        assert text in printed.stdout


def test_a_robot_of_a_fleet_is_what_identify_makes_of_it(tmp_path):
    fleet(tmp_path)
    arm = tmp_path / "arm"
    runs = (arm / "run_0.parquet", arm / "run_1.parquet", "--test", arm / "run_2.parquet")
    dynid("identify", arm / "robot.urdf", *runs, "--residual", "none", "-o", tmp_path / "alone")
    assert snapshot(tmp_path / "alone") == snapshot(tmp_path / "out" / "first")


BAD = (
    FLEET
    + """
[[robot]]
name = "no_file"
robot = "arm/robot.urdf"
runs = ["arm/missing.parquet"]

[[robot]]
name = "no_match"
robot = "arm/robot.urdf"
runs = ["arm/*.npz"]

[[robot]]
name = "wrong_robot"
robot = "arm/robot.urdf"
runs = ["other.parquet"]

[[robot]]
name = "wrong_option"
robot = "arm/robot.urdf"
runs = ["arm/run_0.parquet"]
prior = "perhaps"

[[robot]]
name = "wrong_type"
robot = "arm/robot.urdf"
runs = ["arm/run_0.parquet"]
cutoff = "wide"

[[robot]]
name = "no_runs"
robot = "arm/robot.urdf"
"""
)


def test_a_bad_robot_stops_no_other(tmp_path):
    columns = {name: x for name, x in run(1).items() if not name.endswith("_2")}
    write(tmp_path / "other.parquet", columns)
    printed, answer = fleet(tmp_path, BAD, "--jobs", "2")
    assert printed.exit_code == 1
    assert (answer["done"], answer["failed"]) == (2, 6)
    said = {row["name"]: row["message"] for row in answer["robots"] if row["status"] == "failed"}
    assert "missing.parquet: cannot read this file: it does not exist" in said["no_file"]
    assert "runs: no file matches 'arm/*.npz'" in said["no_match"]
    assert "other.parquet" in said["wrong_robot"]
    assert "--prior must be" in said["wrong_option"]
    assert "cutoff must be a number, found 'wide'" in said["wrong_type"]
    assert "runs is missing" in said["no_runs"]
    for name, message in said.items():
        assert f"{name}: {message}" in printed.stdout
    table = pq.read_table(tmp_path / "out" / "fleet.parquet").to_pydict()
    assert np.isnan(table["error_percent"]).tolist() == [False] * 2 + [True] * 6


def test_what_has_not_changed_is_not_done_again(tmp_path):
    fleet(tmp_path)
    before = snapshot(tmp_path / "out")
    model = tmp_path / "out" / "first" / "model.json"
    stamp = model.stat().st_mtime_ns
    printed, _ = fleet(tmp_path)
    assert printed.exit_code == 0
    assert snapshot(tmp_path / "out") == before
    assert model.stat().st_mtime_ns == stamp

    # Another run, a missing result, a damaged row: done again, each alone.
    other = tmp_path / "elsewhere" / "second" / "model.json"
    stamps = (stamp, other.stat().st_mtime_ns)

    def changed():
        fleet(tmp_path)
        nonlocal stamps
        now = (model.stat().st_mtime_ns, other.stat().st_mtime_ns)
        answer = tuple(new != old for new, old in zip(now, stamps, strict=True))
        stamps = now
        return answer

    other.unlink()
    assert changed() == (False, True)
    row = tmp_path / "out" / ".rows" / "first.json"
    row.write_text(row.read_text()[:50])
    assert changed() == (True, False)
    columns = run(2)
    columns["tau_0"] = columns["tau_0"] + 1e-6
    write(tmp_path / "arm" / "run_2.parquet", columns)
    assert changed() == (True, True)  # both use it
    assert changed() == (False, False)


def test_what_another_command_has_finished_is_left_alone(tmp_path):
    (tmp_path / "out" / "first").mkdir(parents=True)
    result = tmp_path / "out" / "first" / "result.json"
    result.write_text("mine")
    printed, answer = fleet(tmp_path)
    assert printed.exit_code == 1
    assert "holds a finished result already (result.json)" in answer["robots"][0]["message"]
    assert answer["robots"][1]["status"] == "done"
    assert result.read_text() == "mine"
    printed, answer = fleet(tmp_path, FLEET, "--force")
    assert printed.exit_code == 0, printed.output
    assert json.loads(result.read_text())["format"] == "dynid-result"


def test_a_table_that_no_fleet_wrote_is_left_alone(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "fleet.csv").write_text("mine")
    assert "fleet.csv: there is one already" in refusal(fleet(tmp_path)[0])
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["fleet.csv"]


def test_jobs_change_nothing(tmp_path):
    for jobs in ("1", "2"):
        (tmp_path / jobs).mkdir()
        printed, _ = fleet(tmp_path / jobs, FLEET, "--jobs", jobs)
        assert printed.exit_code == 0
    one, two = (
        {name: content for name, content in snapshot(tmp_path / jobs / "out" / "first").items()} for jobs in ("1", "2")
    )
    assert one == two
    assert "--jobs must be at least 1" in refusal(fleet(tmp_path / "1", FLEET, "--jobs=0")[0])


def test_a_table_in_csv(tmp_path):
    text = (
        "name,robot,runs,test,residual\na,arm/robot.urdf,arm/run_0.parquet; arm/run_1.parquet,arm/run_2.parquet,none\n"
    )
    printed, answer = fleet(tmp_path, text, "--json", name="fleet.csv")
    assert printed.exit_code == 0, printed.output
    assert json.loads(printed.stdout) == answer
    assert (answer["robots"][0]["n_runs"], answer["robots"][0]["n_test_runs"]) == (2, 1)


def test_archives_of_a_fleet_are_streamed(tmp_path):
    text = FLEET.replace("[defaults]", '[defaults]\nmemory = "10MB"')
    printed, _ = fleet(tmp_path, text, "--cache", tmp_path / "cache")
    assert printed.exit_code in (0, 1)
    result = json.loads((tmp_path / "out" / "first" / "result.json").read_text())
    assert "streamed" in {finding["code"] for finding in result["data"]["findings"]}
    assert json.loads(dynid("cache", tmp_path / "cache", "--json").stdout)["entries"] >= 6


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "it names no robot"),
        ("[[robot]\n", "it is not valid TOML"),
        ("robots = 1", "'robots' is not known"),
        ("robot = 1", "expected [defaults]"),
        ("robot = [1]", "expected one [[robot]] per robot"),
        ('[[robot]]\nname = "a/b"', "name must be letters"),
        ('[[robot]]\nurdf = "x"', "'urdf' is not known; did you mean 'robot'?"),
        ('[[robot]]\nname = "a"\ndrive_gian = 3', "did you mean 'drive_gain'?"),
        ('[[robot]]\nname = "a"\noutput = 3', "output must be a path"),
        ('[[robot]]\nname = "a"\nforce = true', "'force' is not known"),
        ('[[robot]]\nname = "a"\n[[robot]]\nname = "a"', "the name 'a' is there twice"),
        ('[[robot]]\nname = "a"\noutput = "x"\n[[robot]]\nname = "b"\noutput = "x"', "is there twice"),
        ('[[robot]]\nname = "a"\noutput = "x"\n[[robot]]\nname = "b"\noutput = "y/../x"', "is there twice"),
    ],
)
def test_files_that_are_no_fleet(tmp_path, text, said):
    path = tmp_path / "fleet.toml"
    path.write_text(text or "\n")
    assert said in refusal(dynid("fleet", path, "-o", tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_more_files_that_are_no_fleet(tmp_path):
    def said(name, content):
        path = tmp_path / name
        path.write_bytes(content)
        return refusal(dynid("fleet", path, "-o", tmp_path / "out"))

    assert "the suffix .txt is not known" in said("fleet.txt", b"x")
    assert "it is not UTF-8 text" in said("fleet.csv", b"\xff\xfe\x00")
    assert "has 1 cells and the header 2" in said("fleet.csv", b"name,robot\na\n")
    assert "it names no robot; give one [[robot]]" in said("fleet.csv", b"name,robot\n")
    assert "the column 'name' is there twice; keep one" in said("fleet.csv", b"name,name,robot\na,b,c\n")
    assert "its columns are parted by ';', expected commas" in said("fleet.csv", b"name;robot;runs\na;b;c\n")
    assert "its columns are parted by tabs" in said("fleet.csv", b"name\trobot\na\tb\n")
    said_of_place = said("fleet.csv", b"name,robot,runs\nfleet.html,a.urdf,a.csv\n")
    assert "'fleet.html' would stand where the fleet's own fleet.html does; give it another name" in said_of_place
    assert "does not exist" in refusal(dynid("fleet", tmp_path / "none.toml", "-o", tmp_path / "out"))


def dies(place):
    """Stand-in for a robot whose identification takes more memory than there is."""
    if place.name == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    return failed(place.robot, f"looked at {place.name}"), {}


def test_a_robot_whose_process_keeps_dying_is_a_row(monkeypatch):
    monkeypatch.setattr(work, "MOST_DEATHS", 0)  # that a batch is tried again, the tests of units of work look at
    robots = [FleetRobot(name, Path(), Path(name), ()) for name in ("a", "deadly", "b")]
    places = [Place(robot, Path("rows"), "", None) for robot in robots]
    rows = list(rows_of(places, Work(n_jobs=2), dies))
    assert [row["name"] for row in rows] == ["a", "deadly", "b"]
    assert [row["message"] for row in rows] == [
        "looked at a",
        "its process died again and again (out of memory, or killed)",
        "looked at b",
    ]


def test_an_error_of_the_program_is_a_row(tmp_path, monkeypatch):
    def bug(self, make_work, say):
        raise KeyError("a bug")

    monkeypatch.setattr("dynid_rs.commands._job.Job.identified", bug)
    printed, answer = fleet(tmp_path)
    assert printed.exit_code == 1
    assert {row["message"] for row in answer["robots"]} == {"an error of the program: KeyError: 'a bug'"}


def test_what_a_xacro_source_reads_is_part_of_it(tmp_path):
    pytest.importorskip("xacro")
    arm = tmp_path / "arm"
    arm.mkdir()
    write_runs(arm)
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    part = '<robot {}><xacro:property name="m" value="{}"/></robot>'
    head = f'<robot name="small_arm" {space}><xacro:include filename="part.xacro"/>'
    source = URDF.replace('<robot name="small_arm">', head).replace('mass value="8"', 'mass value="${m}"')
    (arm / "robot.xacro").write_text(source)
    text = FLEET.split('[[robot]]\nname = "second')[0].replace("robot.urdf", "robot.xacro")
    keys = []
    for mass in (8, 8, 9):
        (arm / "part.xacro").write_text(part.format(space, mass))
        printed, _ = fleet(tmp_path, text + "xacro = true\n")
        assert printed.exit_code == 0, printed.output
        keys.append(json.loads((tmp_path / "out" / ".rows" / "first.json").read_text())["key"])
    assert keys[0] == keys[1] != keys[2]
    # In CSV the switch is a word.
    table = "name,robot,runs,xacro\nplain,arm/robot.urdf,arm/run_0.parquet,no\n"
    (tmp_path / "words.csv").write_text(table)
    assert read_fleet(tmp_path / "words.csv", tmp_path / "out")[0].job().xacro is False


def test_a_file_whose_name_looks_like_a_pattern(tmp_path):
    (tmp_path / "cell[1]").mkdir()
    (tmp_path / "cell[1]" / "a.csv").write_text("x")
    path = tmp_path / "fleet.toml"
    path.write_text('[[robot]]\nname = "a"\nrobot = "r.urdf"\nruns = ["cell[1]/a.csv"]\n')
    assert read_fleet(path, tmp_path / "out")[0].job().runs == (tmp_path / "cell[1]" / "a.csv",)


def test_patterns_are_relative_to_the_file(tmp_path):
    (tmp_path / "data").mkdir()
    for k in (2, 0, 1):
        (tmp_path / "data" / f"run_{k}.csv").write_text("x")
    path = tmp_path / "fleet.toml"
    path.write_text(
        '[[robot]]\nname = "a"\nrobot = "r.urdf"\nruns = "data/run_[0-1].csv; data/run_2.csv"\nphysical = true\n'
    )
    (robot,) = read_fleet(path, tmp_path / "out")
    job = robot.job()
    assert job.runs == tuple(tmp_path / "data" / f"run_{k}.csv" for k in range(3))
    assert (job.robot, job.output, job.physical) == (tmp_path / "r.urdf", tmp_path / "out" / "a", True)
