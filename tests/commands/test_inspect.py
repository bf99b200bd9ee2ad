"""`dynid inspect`: what a file holds, what is wrong with it, and three exit codes."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
import typer
from helpers.data import ROOT, data_folder
from helpers.run_files import renamed, valid_columns, write_csv, write_npz, write_parquet
from helpers.small_arm import dynid, refusal, study
from typer.testing import CliRunner

from dynid_rs.commands._run import run_command
from dynid_rs.commands.inspect import inspect

URDF = """<robot name="three">
  <link name="base"/>
  {links}
</robot>"""
LINK = """<link name="l{i}"><inertial><mass value="1"/><origin xyz="0 0 0.1"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="{name}" type="revolute"><parent link="{parent}"/><child link="l{i}"/>
    <axis xyz="0 1 0"/><limit lower="{lower}" upper="2" velocity="9" effort="99"/></joint>"""


def robot_file(tmp_path, names=("shoulder", "elbow", "wrist"), lower=-2.0):
    parents = ["base", *(f"l{i}" for i in range(len(names)))]
    links = [
        LINK.format(i=i, name=n, parent=p, lower=lower) for i, (n, p) in enumerate(zip(names, parents, strict=False))
    ]
    path = tmp_path / "robot.urdf"
    path.write_text(URDF.format(links="\n".join(links)))
    return path


def run(*arguments):
    app = typer.Typer()
    app.command()(inspect)
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit)
    return result


@pytest.fixture
def good(tmp_path):
    return write_parquet(tmp_path / "good.parquet", valid_columns(n_samples=1000))


@pytest.fixture
def bad(tmp_path):
    columns = valid_columns(n_samples=1000)
    columns["tau_1"] = np.zeros(1000)
    return write_csv(tmp_path / "bad.csv", columns)


def test_good_run(good):
    result = run(good)
    assert result.exit_code == 0
    assert result.stderr == ""
    for text in (
        "good.parquet",
        "1000 rows",
        "9.99 s at 100 Hz",
        "3 joints",
        "one encoder",
        "tau_0 ... tau_2",
    ):
        assert text in result.stdout
    assert "\x1b" not in result.stdout


def test_a_joint_that_slides_is_told_in_its_own_units(tmp_path, good):
    robot = robot_file(tmp_path)
    robot.write_text(robot.read_text().replace('name="elbow" type="revolute"', 'name="elbow" type="prismatic"'))
    printed = run(good, "--robot", robot)
    assert "torque in N*m, N where it slides" in printed.stdout
    rows = [line.split() for line in printed.stdout.splitlines()]
    assert ["elbow", "m,", "N"] in [row[:3] for row in rows]
    assert ["wrist", "rad,", "N*m"] in [row[:3] for row in rows]
    assert "rad/s" not in printed.stdout
    answer = json.loads(run(good, "--robot", robot, "--json").stdout)
    assert [joint["kind"] for joint in answer["runs"][0]["joints"]] == ["revolute", "prismatic", "revolute"]
    assert "rad/s" in run(good).stdout


def test_a_run_without_torque_is_read_and_says_so(tmp_path):
    columns = {name: x for name, x in valid_columns(n_samples=1000).items() if not name.startswith("tau")}
    path = write_csv(tmp_path / "motion.csv", columns)
    printed = run(path)
    assert printed.exit_code == 1
    assert printed.stderr == ""
    assert "3 joints, one encoder per joint, no torque" in printed.stdout
    assert "not readable" not in printed.stdout
    told = json.loads(run(path, "--json", "--robot", robot_file(tmp_path)).stdout)["runs"][0]
    assert told["torque_unit"] is None
    assert told["joints"][0]["tau"] is None
    lacking, *others = told["findings"]
    assert (lacking["code"], lacking["severity"], lacking["column"]) == ("missing_column", "error", "tau_0")
    assert "takes the run for its motion all the same" in lacking["message"]
    assert not [one for one in others if (one.get("column") or "").startswith("tau")]
    (tmp_path / "dynid.toml").write_text('[columns]\ntau = "torque_{i}"\n')
    assert f"there is {tmp_path / 'dynid.toml'}: give it with --config" in " ".join(run(path).stdout.split())


def test_run_with_an_error_ends_in_one(bad):
    result = run(bad)
    assert result.exit_code == 1
    assert "tau_1 is 0 N*m in every row" in result.stdout
    assert result.stderr == ""


def test_one_unreadable_file_among_others(tmp_path, good, bad):
    (tmp_path / "cut.parquet").write_bytes(good.read_bytes()[:-9])
    result = run(good, tmp_path / "cut.parquet", bad, tmp_path / "none.npz")
    assert result.exit_code == 2
    assert "good.parquet" in result.stdout
    assert "in every row" in result.stdout
    lines = result.stderr.splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("error: cut.parquet: this Parquet file is cut off")
    assert "none.npz" in lines[1]
    assert "Traceback" not in result.output


def test_json(tmp_path, good, bad):
    columns = valid_columns(n_samples=1000) | {f"current_target_{j}": np.zeros(1000) for j in range(3)}
    other = write_npz(tmp_path / "amps.npz", renamed(columns, tau="current"))
    answer = json.loads(run("--json", good, other).stdout)
    assert (answer["format"], answer["version"], answer["ok"]) == ("dynid-inspect", 1, True)
    first, second = answer["runs"]
    assert first["n_samples"] == 1000
    assert first["rate_hz"] == pytest.approx(100)
    assert first["encoders"] == 1
    assert first["columns"]["q"] == ["q_0", "q_1", "q_2"]
    assert first["joints"][1]["q"] == pytest.approx([-0.8, 0.8], abs=1e-3)
    assert second["torque_unit"] == "A"
    assert second["columns"]["ignored"] == ["current_target_0", "current_target_1", "current_target_2"]
    answer = json.loads(run("--json", bad).stdout)
    assert not answer["ok"]
    finding = answer["runs"][0]["findings"][0]
    assert (finding["code"], finding["severity"], finding["file"]) == ("stuck", "error", "bad.csv")
    assert (finding["column"], finding["rows"]) == ("tau_1", [0, 1000])


def mapped(folder):
    """A run whose columns have names of their own, two of them such as those of signals; its rules, and findings."""
    columns = valid_columns(n_samples=1000)
    names = {"t": "ms"} | {f"tau_{j}": f"M_A{j + 1}" for j in range(3)} | {f"q_{j}": f"q_{j + 1}" for j in range(3)}
    made = {names.get(name, name): values for name, values in columns.items()}
    made |= {f"enc_A{j + 1}": columns[f"q_{j}"] + (j == 0) for j in range(3)}
    made["enc_A2"] = -made["enc_A2"]
    made["M_A3"] = np.zeros(1000)
    rules = folder / "dynid.toml"
    rules.write_text('[columns]\nt = "ms"\nq = "q_{n}"\nq_motor = "enc_A{n}"\ntau = "M_A{n}"\n')
    return write_csv(folder / "mapped.csv", made), rules


def test_findings_name_the_columns_of_the_file(tmp_path):
    path, rules = mapped(tmp_path)
    answer = json.loads(run("--json", path, "--config", rules).stdout)
    found = {finding["code"]: finding for finding in answer["runs"][0]["findings"]}
    expected = {"stuck": "M_A3", "motor_flipped": "enc_A2", "encoder_offset": "enc_A1"}
    assert {code: found[code]["column"] for code in expected} == expected
    assert found["motor_flipped"]["message"].startswith("enc_A2 runs against q_2: ")
    assert found["encoder_offset"]["message"].startswith("enc_A1 lies +1 rad beside q_1: ")
    said = run(path, "--config", rules).stdout
    assert "M_A3 is 0 N*m in every row" in said
    assert "q_motor_" not in said


def test_a_clock_is_named_as_the_file_calls_it(tmp_path):
    path, rules = mapped(tmp_path)
    rules.write_text(f'{rules.read_text()}[units]\ntime = "us"\n')
    answer = json.loads(run("--json", path, "--config", rules).stdout)
    assert ("sampling_rate", "ms") in {(one["code"], one.get("column")) for one in answer["runs"][0]["findings"]}


def test_json_of_unreadable_files(tmp_path, good):
    columns = valid_columns()
    columns["q_1"][4] = np.nan
    path = write_csv(tmp_path / "nan.csv", columns)
    result = run("--json", path, good)
    assert result.exit_code == 2
    answer = json.loads(result.stdout)
    assert not answer["ok"]
    error = answer["runs"][0]["error"]
    assert error["class"] == "DataError"
    assert (error["code"], error["file"], error["column"], error["row"]) == (
        "not_finite",
        "nan.csv",
        "q_1",
        4,
    )
    assert "n_samples" in answer["runs"][1]


def test_config(tmp_path):
    columns = renamed(valid_columns(), q="angle")
    path = write_csv(tmp_path / "run.csv", columns)
    (tmp_path / "dynid.toml").write_text('[columns]\nq = "angle_{i}"\n')
    result = run(path)
    assert result.exit_code == 2
    assert "dynid.toml: give it with --config" in result.stderr
    assert run(path, "--config", tmp_path / "dynid.toml").exit_code == 0


def test_wrong_config_stops_everything(tmp_path, good):
    (tmp_path / "dynid.toml").write_text("[drives]\n")
    result = run("--json", good, "--config", tmp_path / "dynid.toml")
    assert result.exit_code == 2
    assert json.loads(result.stdout)["error"]["code"] == "bad_config"
    assert result.stderr.startswith("error: dynid.toml, [drives]: this key is not known; did you mean drive?")
    result = run(good, "--config", tmp_path / "none.toml")
    assert result.exit_code == 2
    assert result.stdout == ""
    assert "none.toml" in result.stderr


def test_robot_gives_names_and_limits(tmp_path, good):
    robot = robot_file(tmp_path)
    result = run(good, "--robot", robot)
    assert result.exit_code == 0
    assert "elbow" in result.stdout
    assert json.loads(run(good, "--robot", robot, "--json").stdout)["robot"] == "three"
    result = run(good, "--robot", robot_file(tmp_path, lower=-0.5))
    assert "position_limits" in result.stdout


def test_robot_with_other_joints(tmp_path, good):
    result = run(good, "--robot", robot_file(tmp_path, names=("a", "b")))
    assert result.exit_code == 2
    assert "column q_2 is there, but the robot has 2 joints (a, b)" in result.stderr


def test_robot_that_cannot_be_read(tmp_path, good):
    robot = robot_file(tmp_path)
    robot.write_text("<robot")
    result = run(good, "--robot", robot, "--json")
    assert result.exit_code == 2
    assert "robot.urdf" in json.loads(result.stdout)["error"]["message"]
    result = run(good, "--robot", tmp_path / "none.urdf")
    assert result.exit_code == 2
    assert "none.urdf" in result.stderr


def test_no_run_is_wrong_use():
    assert run().exit_code == 2


def test_hostile_names_do_not_reach_the_terminal(tmp_path):
    columns = valid_columns() | {"x\x1b[31m": np.zeros(400), "[bold]y[/bold]": np.zeros(400)}
    result = run(write_parquet(tmp_path / "run.parquet", columns))
    assert result.exit_code == 0
    assert "\x1b" not in result.stdout
    assert "[bold]y[/bold]" in result.stdout


RAISES = {
    "value": (ValueError("first\nsecond"), 2, "error: first second\n"),
    "os": (PermissionError("a.csv: no"), 2, "error: a.csv: no\n"),
    "interrupt": (KeyboardInterrupt(), 130, "interrupted\n"),
}


@pytest.mark.parametrize(("error", "code", "text"), RAISES.values(), ids=RAISES)
def test_errors_become_exit_codes(error, code, text, capsys):
    @run_command
    def command(json_output=False):
        raise error

    with pytest.raises(typer.Exit) as caught:
        command()
    assert caught.value.exit_code == code
    assert capsys.readouterr().err == text
    if code == 2:
        with pytest.raises(typer.Exit):
            command(json_output=True)
        assert json.loads(capsys.readouterr().out)["error"]["class"] == type(error).__name__


def test_our_own_bugs_keep_their_traceback():
    @run_command
    def command():
        raise KeyError("bug")

    with pytest.raises(KeyError):
        command()


def test_exit_code_is_the_return_value():
    assert run_command(lambda: None)() is None
    assert run_command(lambda: 0)() is None
    with pytest.raises(typer.Exit) as caught:
        run_command(lambda: 1)()
    assert caught.value.exit_code == 1


def test_reader_that_leaves_early(good):
    script = "import typer; from dynid_rs.commands.inspect import inspect; typer.run(inspect)"
    package = ROOT / "python"
    process = subprocess.Popen(
        [sys.executable, "-c", script, *[str(good)] * 300],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": str(package)},
    )
    process.stdout.close()
    errors = process.stderr.read().decode()
    process.stderr.close()
    assert process.wait(240) == 141
    assert errors == ""


def test_measured_runs():
    """Real runs load with nothing but a joint count, and no check cries error at them."""
    data = data_folder()
    runs = {
        "ur10e_innopolis/20_02_12_40sec_12harm": (6, "A"),
        "kuka_kr300_weigand/traj_A": (6, "N*m"),
        "panda_gaz/excite": (7, "N*m"),
        "rokae_xmate3pro/excite": (7, "N*m"),
        "kuka_lwr4p_flobaroid/measurements_1": (7, "N*m"),
        "dualarm7_hujinfei/excite_13p5": (7, "A"),
    }
    result = run("--json", *(data / f"{name}.parquet" for name in runs))
    assert result.exit_code == 0
    answers = json.loads(result.stdout)["runs"]
    assert [(len(a["joints"]), a["torque_unit"]) for a in answers] == list(runs.values())
    delays = [f["value"] for f in answers[1]["findings"] if f["code"] == "encoder_delay"]
    assert len(delays) == 3
    assert all(2.6e-3 < delay < 3.2e-3 for delay in delays)


@pytest.mark.parametrize(
    "option",
    [("--base", "upper"), ("--tip", "hand"), ("--gravity", "0,0,9.81"), ("--xacro",)],
    ids=lambda option: option[0],
)
def test_what_is_about_the_robot_needs_one(option):
    said = refusal(dynid("inspect", study().runs[0], *option))
    assert said == "--base, --tip, --gravity and --xacro are about the robot file; name it by --robot"
