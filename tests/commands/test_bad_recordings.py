"""A bad recording is named rightly, and the same by every command: the file, the column, the unit, the mend."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from helpers.run_files import write
from helpers.small_arm import JOINTS, URDF, dynid, refusal, run, study, write_robot, write_runs

import dynid_rs as dyn
from dynid_rs.base.errors import DataError
from dynid_rs.model.inertials import inertial_findings
from dynid_rs.runs.checks import check_recording
from dynid_rs.runs.checks.clocks import Clock, clock_findings
from dynid_rs.runs.facts import check_training_runs
from dynid_rs.sensors import channel_errors

NEW = {"torque_spike", "torque_beyond_effort", "sampling_rate", "absurd_value"}
COMMANDS = ("inspect", "identify", "diagnose")


def written(folder, change, bad=(1,), suffix=".parquet", **kind):
    """Three runs of the small arm, `bad` ones of them changed in place."""
    paths = []
    for k in range(3):
        columns = run(k, **kind)
        if k in bad:
            change(columns)
        paths.append(write(folder / f"run_{k}{suffix}", columns))
    return paths


def told(command, folder, paths, *options):
    """What a command says of bad runs: the error of `--json`, or with `inspect` of the first bad run's finding."""
    robot = write_robot(folder)
    if command == "inspect":
        result = dynid("inspect", *paths, "--robot", robot, "--json", *options)
        (first, *_) = (
            r for r in json.loads(result.stdout)["runs"] if "error" in r or r["findings"][0]["severity"] == "error"
        )
        return result, first.get("error") or first["findings"][0]
    result = dynid(command, robot, *paths, "-o", folder / "out", "--json", *options)
    return result, json.loads(result.stdout)["error"]


def times(factor, start=0.0):
    def change(columns):
        columns["t"] = start + columns["t"] * factor

    return change


def ticks(columns):
    columns["t"] = 1_700_000_000_000_000_000 + np.round(columns["t"] * 1e9).astype(np.int64)


CLOCKS = {
    "ms": (times(1e3), "milliseconds", "ms"),
    "us": (times(1e6), "microseconds", "us"),
    "ns": (times(1e9), "nanoseconds", "ns"),
    "ms since 1970": (times(1e3, 1.7e12), "milliseconds", "ms"),
    "ns since 1970": (ticks, "nanoseconds", "ns"),
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(("change", "words", "unit"), CLOCKS.values(), ids=CLOCKS)
def test_the_run_in_another_unit_of_time_is_named_with_its_unit(tmp_path, command, change, words, unit):
    result, error = told(command, tmp_path, written(tmp_path, change))
    assert error["file"] == "run_1.parquet"
    assert (error["code"], error["column"]) == ("sampling_rate", "t")
    assert f"but in {words}, it seems (200 Hz, " in error["message"]
    assert "write this file again with t in seconds like the others" in error["message"]
    assert f'[units] time = "{unit}"' in error["message"]
    assert result.exit_code == (1 if command == "inspect" else 2)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", COMMANDS)
def test_all_runs_in_nanoseconds_need_one_key(tmp_path, command):
    _, error = told(command, tmp_path, written(tmp_path, ticks, bad=(0, 1, 2)))
    assert error["message"].endswith('say so in dynid.toml: [units] time = "ns"')


def test_a_test_run_and_streamed_runs_are_looked_at_too(tmp_path):
    paths, robot = written(tmp_path, times(1e6), bad=(2,)), write_robot(tmp_path)
    for options in ((), ("--memory", "5MB")):
        sentence = refusal(dynid("identify", robot, *paths[:2], "--test", paths[2], "-o", tmp_path / "out", *options))
        assert sentence.startswith("run_2.parquet: t is not in seconds")


def test_a_run_in_seconds_among_milliseconds(tmp_path):
    paths = written(tmp_path, times(1e3), bad=(0, 2))
    (tmp_path / "dynid.toml").write_text('[units]\ntime = "ms"\n')
    for command in COMMANDS:
        _, error = told(command, tmp_path, paths, "--config", tmp_path / "dynid.toml")
        assert error["file"] == "run_1.parquet"
        assert "t is not in milliseconds" in error["message"]
        assert "but in seconds" in error["message"]


BESIDE = {
    "100 ns": (times(1e7), r'but in steps of 100 ns, it seems (200 Hz, 8 s): .* [units] time = "100ns"'),
    "row numbers": (lambda columns: columns.update(t=np.arange(float(len(columns["t"])))), "but counts rows, it seems"),
    "a unit that does not meet": (times(3e4), "no unit of time brings it there"),
    "a hundredth of the rate": (times(100), "its rate (a median step of 0.5 s, 2 Hz, .* have 200 Hz, and no unit"),
    "beyond all clocks": (times(1e300), "its rate (a median step of 5e+297 s, .* have 200 Hz, and no unit"),
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(("change", "words"), BESIDE.values(), ids=BESIDE)
def test_beside_others_a_unit_is_named_only_where_it_meets_their_rate(tmp_path, command, change, words):
    result, error = told(command, tmp_path, written(tmp_path, change))
    assert (error["file"], error["code"], error["column"]) == ("run_1.parquet", "sampling_rate", "t")
    begin, _, end = words.partition(".*")
    assert begin in error["message"]
    assert end in error["message"]
    assert len(error["message"]) < 400
    assert result.exit_code == (1 if command == "inspect" else 2)


def test_the_run_that_narrows_the_band_is_named_where_another_is_too_short_for_it(tmp_path):
    paths = written(tmp_path, times(40), bad=(1,), duration=4.0)
    _, error = told("identify", tmp_path, paths)
    assert error["file"] == "run_1.parquet"
    assert error["message"].startswith("run_1.parquet: its sampling rate narrows the band of all runs to 2 Hz: run_0")


def test_a_band_of_no_width_has_short_numbers(tmp_path):
    _, error = told("identify", tmp_path, written(tmp_path, times(1)), "--cutoff", "1e-300")
    assert "too short for a band of 1e-300 Hz; at least 4e+300 s are needed" in error["message"]


def test_digits_of_time_that_are_lost_are_no_rows_that_repeat(tmp_path, robot):
    words = "no step shorter than 2 s, and the digits below are lost; write the time since the run began"
    for suffix in (".csv", ".parquet"):
        (path, *_) = written(tmp_path, times(1, 1e16), bad=(0,), suffix=suffix)
        with pytest.raises(DataError, match=words):
            dyn.read_recording(path, robot)
    with pytest.raises(DataError, match=words):
        recordings(times(1, 1e16))

    def repeat(columns):
        columns["t"][5] = columns["t"][4]

    with pytest.raises(DataError, match="remove the repeated rows"):
        recordings(repeat)


def clock(rate, speed, duration=20.0, unit="s"):
    return Clock("run", rate, duration, speed, unit)


SETS = {
    "slow motion at 50 Hz": ([clock(50, 0.05)], {}),
    "a joint that creeps": ([clock(100, 0.001), clock(100, 1.0)], {}),
    "rests only": ([clock(100, 0.0)], {}),
    "polled slowly": ([clock(4, 0.3, 300.0)], {}),
    "2 Hz beside two that are as slow": ([clock(2, 0.3, 300.0), clock(5, 0.3, 300.0), clock(4, 0.3, 300.0)], {}),
    "two loggers": ([clock(50, 1.0), clock(4000, 2.0)], {}),
    "a current loop": ([clock(20_000, 2.0, 2.0)], {}),
    "5 kHz in ms": ([clock(5, 0.003, 20_000.0)], {0: "ms"}),
    "15 kHz in ms among its like": ([clock(15_000, 2.0), clock(15, 0.002, 20_000.0), clock(15_000, 1.0)], {1: "ms"}),
    "15 kHz in ms beside one": ([clock(15, 0.002, 20_000.0), clock(15_000, 1.0)], {0: "ms"}),
    "15 kHz in us, odd by itself": ([clock(0.015, 2e-6, 2e7)], {0: "us"}),
    "seconds read as ns": ([clock(1e11, 1e9, 2e-8, "ns")], {0: "s"}),
}  # fmt: skip


@pytest.mark.parametrize(("clocks", "units"), SETS.values(), ids=SETS)
def test_units_of_time_by_what_robots_do(clocks, units):
    found = clock_findings(clocks)
    assert set(found) == set(units)
    for k, unit in units.items():
        assert f'"{unit}"' in found[k].message


def test_nothing_that_rests_on_time_is_said_of_a_run_in_another_unit():
    (damaged, *_) = recordings(times(1e3), encoders=2)
    assert [finding.code for finding in check_recording(damaged)] == ["sampling_rate"]


def one(name, row, value):
    def change(columns):
        columns[name][row] = value

    return change


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(("column", "suffix"), [("tau_1", ".csv"), ("q_2", ".parquet")])
def test_a_number_beyond_all_numbers_is_named_with_its_place(tmp_path, command, column, suffix):
    _, error = told(command, tmp_path, written(tmp_path, one(column, 100, 1e300), suffix=suffix))
    assert (error["code"], error["file"]) == ("absurd_value", f"run_1{suffix}")
    assert (error["column"], error["row"]) == (column, 100)
    line = " (line 102)" if suffix == ".csv" else ""
    assert error["message"].startswith(f"run_1{suffix}, row 101{line}, column {column}: 1e+300 is no value")
    assert error["message"].endswith("cut these rows out or split the run there")


def recordings(*changes, **kind):
    """The small arm's runs in memory, the first ones changed in place."""
    result = []
    for k in range(3):
        columns = run(k, **kind)
        if k < len(changes):
            changes[k](columns)
        signals = {
            signal: np.stack([columns[f"{signal}_{j}"] for j in range(3)], axis=1)
            for signal in ("q", "dq", "tau", "q_motor")
            if f"{signal}_0" in columns
        }
        result.append(dyn.Recording(columns["t"], name=f"run_{k}", joints=JOINTS, **signals))
    return result


@pytest.fixture
def robot():
    return dyn.RobotModel.from_urdf_string(URDF)


def test_arrays_are_refused_like_files(robot):
    runs = recordings(one("q_1", 7, 1e300))
    for learn in (check_training_runs, lambda robot, runs: channel_errors(robot, runs)):
        with pytest.raises(DataError, match=r"run_0: q_1 \(elbow\) is 1e\+300 in row 8"):
            learn(robot, runs)


def scaled(signal, factor):
    def change(columns):
        for j in range(3):
            columns[f"{signal}_{j}"] = factor * columns[f"{signal}_{j}"]

    return change


def starting(command, folder, change, *, bad=(1,)):
    """First error among the findings of a command that gives an answer."""
    paths, robot = written(folder, change, bad), write_robot(folder)
    if command == "inspect":
        findings = json.loads(dynid("inspect", *paths, "--robot", robot, "--json").stdout)["runs"][1]["findings"]
    else:
        result = dynid(command, robot, *paths, "-o", folder / "out", "--json")
        assert result.exit_code == 1
        findings = json.loads(result.stdout)["data"]["findings"]
    return next(finding for finding in findings if finding["severity"] == "error")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_lone_torque_far_beyond_the_drive_is_an_error_everywhere(tmp_path, command):
    finding = starting(command, tmp_path, one("tau_0", 500, 1e6))
    assert (finding["code"], finding["file"], finding["column"]) == ("torque_spike", "run_1.parquet", "tau_0")
    assert finding["rows"] == [500, 501]
    assert "tau_0 (shoulder) is 1e+06 N*m in row 501" in finding["message"]
    assert "the robot file allows 80; a damaged number: cut the row out" in finding["message"]


@pytest.mark.parametrize("command", COMMANDS)
def test_torques_in_newton_millimetres_are_an_error_everywhere(tmp_path, command):
    finding = starting(command, tmp_path, scaled("tau", 1e3), bad=(0, 1, 2))
    assert finding["code"] == "torque_beyond_effort"
    assert '[units] torque = "mN*m"' in finding["message"]


def test_without_effort_limits_the_channel_itself_tells(robot):
    (damaged, *clean) = recordings(one("tau_2", 30, -1e6))
    findings = [finding for finding in check_recording(damaged) if finding.severity == "error"]
    assert [(f.code, f.column, f.rows) for f in findings] == [("torque_spike", "tau_2", (30, 31))]
    assert not any(finding.code in NEW for recording in clean for finding in check_recording(recording, robot))


def test_damaged_torques_of_all_sizes_and_on_a_still_joint_are_told_by_the_effort_limits(robot):
    def many(columns):
        columns["tau_0"][[100, 300, 500]] = 900.0, 4000.0, 1e5  # the least is not far from what was measured
        columns["q_2"][:] = 0.1
        columns["tau_2"][200] = 300.0

    (damaged, *_) = recordings(many)
    spikes = [finding for finding in check_recording(damaged, robot) if finding.code == "torque_spike"]
    assert [(f.column, f.rows) for f in spikes] == [("tau_0", (500, 501)), ("tau_2", (200, 201))]
    assert "(and so are 2 more)" in spikes[0].message


class Placeholder:
    """Limits that somebody filled in."""

    lower, upper, effort_limits = np.full(3, -9.0), np.full(3, 9.0), np.ones(3)


def test_limits_that_say_nothing_and_amperes_are_left_alone(robot):
    (large, *_) = recordings(scaled("tau", 100.0))
    current = dyn.Recording(large.t, large.q, tau=large.tau, torque_unit="A", joints=JOINTS)
    assert any(finding.code == "torque_beyond_effort" for finding in check_recording(large, robot))
    assert not any(finding.code in NEW for finding in check_recording(large, Placeholder()))
    assert not any(finding.code in NEW for finding in check_recording(current, robot))


@pytest.mark.parametrize("rate", [50.0, 1000.0])
def test_rests_slow_motion_and_impacts_raise_no_alarm(robot, rate):
    columns = run(0, rate=rate)
    n = len(columns["t"])
    rng = np.random.default_rng(0)
    for j in range(3):
        q, tau = columns[f"q_{j}"], columns[f"tau_{j}"]
        q[: n // 2], tau[: n // 2] = q[n // 2], tau[n // 2]
        tau += 0.01 * rng.standard_normal(n)
        tau[3 * n // 4] *= 4  # something was hit
    columns["t"] = 4.0 * columns["t"]
    q, tau = (np.stack([columns[f"{signal}_{j}"] for j in range(3)], axis=1) for signal in ("q", "tau"))
    findings = check_recording(dyn.Recording(columns["t"], q, tau=tau, joints=JOINTS), robot)
    assert not [f.code for f in findings if f.code in NEW and f.severity != "info" and f.code != "sampling_rate"]
    assert not [f for f in findings if f.severity == "error"]


def test_a_velocity_in_another_unit_does_not_make_a_rest_look_stuck(robot):
    def change(columns):
        rng = np.random.default_rng(1)
        for j in range(3):
            columns[f"q_{j}"][:200] = columns[f"q_{j}"][200]
            noise = 5e-4 * rng.standard_normal(len(columns["t"]))
            columns[f"dq_{j}"] = 1e3 * (np.gradient(columns[f"q_{j}"], columns["t"]) + noise)

    (damaged, *_) = recordings(change)
    findings = [finding for finding in check_recording(damaged, robot) if finding.severity != "info"]
    assert {finding.code for finding in findings} == {"dq_disagrees"}
    assert "times as large" in findings[0].message


def test_a_velocity_that_is_right_still_shows_a_frozen_position(robot):
    def change(columns):
        for j in range(3):
            columns[f"dq_{j}"] = np.gradient(columns[f"q_{j}"], columns["t"])
        columns["q_0"][700:800] = columns["q_0"][700]

    (damaged, *_) = recordings(change)
    first = check_recording(damaged, robot)[0]
    assert (first.code, first.column, first.rows) == ("stuck", "q_0", (700, 800))


@pytest.mark.parametrize("with_robot", [True, False])
def test_one_position_that_jumps_is_no_degrees_and_no_broken_motor_encoder(robot, with_robot):
    def change(columns):
        for j in range(2):
            columns[f"q_{j}"][500 + j] = 50.0

    (damaged, *_) = recordings(change, encoders=2)
    codes = [
        finding.code
        for finding in check_recording(damaged, robot if with_robot else None)
        if finding.severity != "info"
    ]
    assert codes[:2] == ["position_jump", "position_jump"]
    assert not {"units_degrees", "motor_disagrees"} & set(codes)


@pytest.mark.parametrize(("column", "value", "code"), [("tau_0", 1e4, "torque_spike"), ("q_0", 50.0, "position_jump")])
def test_a_damaged_sample_ends_the_diagnosis_before_anything_else_is_blamed(robot, column, value, code):
    errors = channel_errors(robot, recordings(one(column, 500, value)))
    assert [(finding.code, finding.file) for finding in errors] == [(code, "run_0")]


def test_a_still_joint_is_called_that_by_the_diagnosis(robot, monkeypatch):
    def still(columns):
        columns["q_1"][:] = 0.3

    import dynid_rs.sensors as sensors

    monkeypatch.setattr(sensors, "channel_findings", lambda *_: pytest.fail("channels were judged first"))
    with pytest.raises(DataError, match="joint elbow never moves"):
        channel_errors(robot, recordings(still, still, still))


BODIES = {
    "negative": ('ixx="0.1"', 'ixx="-1"', "principal moments of inertia about its centre are -1, 0.08, 0.1 kg m^2"),
    "triangle": ('izz="0.08"', 'izz="0.8"', "0.1, 0.1, 0.8 kg m^2, the greatest exceeds the other two together"),
    "massless": ('<mass value="8"/>', '<mass value="0"/>', "it has inertia and a mass of 0 kg"),
}


@pytest.mark.parametrize(("good", "bad", "words"), BODIES.values(), ids=BODIES)
def test_an_inertial_of_no_body_is_named_by_its_link(good, bad, words):
    assert good in URDF
    (finding,) = inertial_findings(dyn.RobotModel.from_urdf_string(URDF.replace(good, bad, 1)), "robot.urdf")
    assert (finding.code, finding.severity, finding.file) == ("inertial_not_physical", "warning", "robot.urdf")
    assert finding.message.startswith("the inertial of link upper is that of no body: ")
    assert words in finding.message


def test_rounded_inertials_and_points_are_bodies(robot):
    assert inertial_findings(robot) == []
    assert inertial_findings(dyn.RobotModel.from_urdf_string(URDF.replace('izz="0.08"', 'izz="0.21"'))) == []
    points = re.sub(r'(i[xyz][xyz])="[^"]*"', r'\1="0"', URDF)
    assert inertial_findings(dyn.RobotModel.from_urdf_string(points)) == []


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_warns_of_such_an_inertial(tmp_path, command):
    paths = written(tmp_path, lambda columns: None)
    robot = tmp_path / "odd.urdf"
    robot.write_text(URDF.replace('ixx="0.1"', 'ixx="-1"', 1))
    if command == "inspect":
        result = dynid("inspect", *paths, "--robot", robot, "--json")
        findings = json.loads(result.stdout)["robot_findings"]
        assert "odd.urdf" in dynid("inspect", *paths, "--robot", robot).stdout
    else:
        result = dynid(command, robot, *paths, "-o", tmp_path / "out", "--json", "--prior", "robot")
        findings = json.loads(result.stdout)["data"]["findings"]
    assert [(f["code"], f["file"]) for f in findings if f["severity"] == "warning"] == [
        ("inertial_not_physical", "odd.urdf")
    ]


@pytest.mark.parametrize("zero", ["0", " 0.0 ", "-0e3"])
def test_a_reduction_of_zero_is_refused(tmp_path, zero):
    ratio = "<mechanicalReduction>{}</mechanicalReduction>"
    drive = f'<transmission name="d"><joint name="elbow"/>\n<actuator name="m">{ratio}'
    robot, paths = tmp_path / "robot.urdf", written(tmp_path, lambda columns: None)

    def inspected(value):
        end = f"<!-- {ratio.format(0)}\n -->{drive.format(value)}</actuator></transmission></robot>"
        robot.write_text(URDF.replace("</robot>", end))
        return dynid("inspect", *paths, "--robot", robot)

    assert inspected("100").exit_code == 0
    place = f"{URDF.count(chr(10)) + 2}:20"
    sentence = refusal(inspected(zero))
    says = "<transmission>: mechanicalReduction is zero, expected rotor speed over joint speed; correct it"
    assert sentence.startswith(f"{robot}:{place}: {says}")
    with pytest.raises(dyn.UrdfError, match="mechanicalReduction is zero"):
        dyn.RobotModel.from_urdf(robot)


def degrees(columns):
    for name in [name for name in columns if name.startswith("q_")]:
        columns[name] = np.rad2deg(columns[name])


def test_a_model_is_held_against_no_damaged_run(tmp_path):
    """Nothing is weighed or compared in degrees; an estimate is of what the file holds, and says what that is."""
    bad, model = written(tmp_path, degrees)[1], study().output / "model.json"
    for words in (("payload", model, bad), ("compare", model, model, bad)):
        result = dynid(*words, "--json")
        error = json.loads(result.stdout)["error"]
        assert (result.exit_code, error["code"], error["file"]) == (2, "units_degrees", "run_1.parquet"), words
    result = dynid("estimate", model, bad, "--json")
    assert result.exit_code == 1
    assert [finding["code"] for finding in json.loads(result.stdout)["findings"]][:1] == ["units_degrees"]
    good = dynid("estimate", model, tmp_path / "run_0.parquet", "--json")
    assert (good.exit_code, json.loads(good.stdout)["findings"]) == (0, [])


def test_python_says_what_commands_say(tmp_path):
    """A fit warns of a damaged run; `inspect` asks runs together."""
    bad = dyn.read_recording(written(tmp_path, degrees)[1])
    robot = dyn.RobotModel.from_urdf(write_robot(tmp_path))
    fresh = dyn.ThreeLoopIdentifier(robot, residual=None)
    with pytest.warns(dyn.DamageWarning, match="degrees"):
        fresh.fit(bad)
    assert "units_degrees" in [finding.code for finding in dyn.inspect(bad, robot)]

    def exchanged(columns):
        one, other = "tau_0", "tau_1"
        columns[one], columns[other] = columns[other], columns[one].copy()

    runs = [dyn.read_recording(path) for path in written(tmp_path, exchanged, bad=(0, 1, 2))]
    assert not any(finding.severity == "error" for finding in dyn.inspect(runs))
    assert "torque_swapped" in [finding.code for finding in dyn.inspect(runs, robot)]


def test_a_block_that_is_written_twice_is_said_of_the_run_and_not_of_two(tmp_path):
    robot, paths, columns = write_robot(tmp_path), write_runs(tmp_path, n_runs=1), run(1)
    twice = write(tmp_path / "twice.parquet", {name: np.concatenate([x[:900], x[800:]]) for name, x in columns.items()})
    sentence = refusal(dynid("identify", robot, paths[0], "--test", twice, "-o", tmp_path / "out"))
    assert sentence.startswith("twice.parquet: time goes back, and what follows was written before")
    assert "rows 901 to 1000 are there twice; cut them out" in sentence


def test_a_position_that_hangs_for_a_few_rows_of_a_slow_logger_is_stuck(tmp_path):
    columns = {name: x[::4] for name, x in run(0).items()}  # 50 Hz
    row = int(np.argmax(np.abs(np.gradient(columns["q_1"]))[20:-40])) + 20
    columns["q_1"][row : row + 8] = columns["q_1"][row]
    slow = write(tmp_path / "slow.parquet", columns)
    found = [f.code for f in check_recording(dyn.read_recording(slow)) if f.severity == "error"]
    assert found == ["stuck"]
