"""`dynid init`: what it notices, with the evidence; what it asks; and that nothing is put right in silence."""

import json
import os
import select
import subprocess
import sys
import time
import tomllib
import warnings
from dataclasses import replace

import jsonschema
import numpy as np
import pytest
from helpers.data import ROOT
from helpers.log_files import DEGREE, columns_of, joint_states, table, text, write_mcap
from helpers.processes import ENVIRONMENT
from helpers.run_files import write_csv, write_parquet
from helpers.small_arm import JOINTS, as_current, dynid, refusal, run, write_robot
from hypothesis import given
from hypothesis import strategies as st

from dynid_rs import DataError, RobotModel
from dynid_rs.runs.readers import Config, read_config, read_run
from dynid_rs.runs.readers.guess import guess
from dynid_rs.runs.readers.key_page import schema


def init(folder, robot, *paths, code=0, **options):
    result = dynid("init", robot, *paths, "-o", folder / "dynid.toml", "--json", **options)
    assert result.exit_code == code, result.output
    written = tomllib.loads((folder / "dynid.toml").read_text())
    jsonschema.validate(written, schema())
    return json.loads(result.stdout), written


def test_a_plain_run_needs_nothing(tmp_path):
    robot = write_robot(tmp_path)
    answer, written = init(tmp_path, robot, write_csv(tmp_path / "run.csv", run(0)))
    assert answer["taken"] == []
    assert answer["questions"] == []
    assert written["columns"] == {"t": "t", "q": "q_{i}", "tau": "tau_{i}"}
    assert written["units"] == {}
    assert written["robot"] == {"joints": list(JOINTS), "gravity": [0.0, 0.0, -9.81]}


def test_questions_name_the_columns_of_the_file(tmp_path):
    columns = run(0)
    n = sum(name.startswith("q_") for name in columns)
    columns |= {f"enc_A{j + 1}": columns[f"q_{j}"] * (-1.0 if j == 1 else 1.0) for j in range(n)}
    rules = tmp_path / "known.toml"
    rules.write_text('[columns]\nq_motor = "enc_A{n}"\n')
    answer, _ = init(
        tmp_path, write_robot(tmp_path), write_csv(tmp_path / "run.csv", columns), "--config", rules, code=1
    )
    asked = next(one for one in answer["questions"] if one["code"] == "motor_flipped")
    assert (asked["column"], asked["message"].partition(" ")[0]) == ("enc_A2", "enc_A2")


def test_editors_are_told_the_schema_of_this_version(tmp_path):
    """By an address that holds wherever the file goes: that of the schema in the repository, at the release's tag."""
    init(tmp_path, write_robot(tmp_path), write_csv(tmp_path / "run.csv", run(0)))
    first, *rest = (tmp_path / "dynid.toml").read_text().splitlines()
    assert not any("#:schema" in line for line in rest)
    workspace = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]
    repository = workspace["repository"].replace("https://github.com/", "https://raw.githubusercontent.com/")
    head, _, path = first.removeprefix("#:schema ").partition(f"/v{workspace['version']}/")
    assert head == repository
    assert json.loads((ROOT / path).read_text()) == schema()


def test_amperes_called_effort_are_noticed_by_the_arms_model(tmp_path):
    robot = write_robot(tmp_path)
    states = {k: [] for k in range(2)}
    for k, rows in states.items():
        for stamp, names, q, dq, effort in joint_states(k):
            gains = np.array([8.0, 11.0, 5.0])[[JOINTS.index(name) for name in names]]
            rows.append((stamp, names, q, dq, effort / gains))
    paths = [write_mcap(tmp_path / f"run_{k}.mcap", {"/joint_states": rows}) for k, rows in states.items()]
    answer, written = init(tmp_path, robot, *paths)
    (taken,) = answer["taken"]
    assert taken["key"] == "[columns] current"
    assert "current" in taken["evidence"]
    assert written["columns"]["tau"] is False
    assert written["columns"]["current"] == "effort_{joint}"
    recording = read_run(paths[0], RobotModel.from_urdf(robot), read_config(tmp_path / "dynid.toml")).recording
    assert recording.torque_unit == "A"
    # Without init it is no secret either.
    result = dynid("identify", robot, *paths, "--residual", "none", "-o", tmp_path / "out")
    assert result.exit_code == 1
    findings = json.loads((tmp_path / "out" / "result.json").read_text())["data"]["findings"]
    assert "current_as_torque" in {finding["code"] for finding in findings}


@pytest.mark.parametrize(
    ("spoil", "code"),
    [
        (lambda c: c.update(tau_1=c["tau_2"], tau_2=c["tau_1"]), "torque_swapped"),
        (lambda c: c.update(tau_1=-c["tau_1"]), "torque_flipped"),
    ],
)
def test_swapped_and_inverted_columns_are_asked_and_not_repaired(spoil, code, tmp_path):
    robot, paths = write_robot(tmp_path), []
    for k in range(2):
        columns = run(k)
        spoil(columns)
        paths.append(write_parquet(tmp_path / f"run_{k}.parquet", columns))
    answer, written = init(tmp_path, robot, *paths, code=1)
    assert code in {question["code"] for question in answer["questions"]}
    assert written["columns"]["tau"] == "tau_{i}"
    assert "signs" not in written or written["signs"] == {}
    assert "TO BE ANSWERED" in (tmp_path / "dynid.toml").read_text()


def test_motors_own_turns_and_velocities_in_other_units(tmp_path):
    robot, ratios = write_robot(tmp_path), np.array([101.0, 80.0, 50.0])
    columns = run(0, encoders=2, velocity=True)
    for j, ratio in enumerate(ratios):
        columns[f"q_motor_{j}"] *= ratio
        columns[f"dq_{j}"] *= DEGREE
    columns = {name: x for name, x in columns.items() if not name.startswith("dq_motor")}
    answer, written = init(tmp_path, robot, write_csv(tmp_path / "run.csv", columns))
    assert {one["key"]: one["value"] for one in answer["taken"]}["[units] velocity"] == "deg/s"
    np.testing.assert_allclose(written["gear"]["ratio"], ratios, rtol=1e-2)
    assert written["units"] == {"velocity": "deg/s"}


@pytest.mark.parametrize("names", [("q_motor_{}", "dq_motor_{}"), ("motor_pos_{}", "motor_vel_{}")])
def test_a_log_of_the_motors_alone(tmp_path, names):
    """Their positions and velocities are the links'; by their usual names they were refused as q and q_motor in one."""
    robot, columns = write_robot(tmp_path), run(0, velocity=True)
    renamed = {"q": names[0], "dq": names[1], "tau": "tau_{}"}
    log = {"t": columns["t"]}
    log |= {new.format(j): columns[f"{old}_{j}"] for old, new in renamed.items() for j in range(3)}
    path = write_csv(tmp_path / "run.csv", log)
    _, written = init(tmp_path, robot, path)
    q, dq = (name.replace("{}", "{i}") for name in names)
    not_read = {"q_motor": False, "dq_motor": False}
    assert written["columns"] == {"t": "t", "q": q, "dq": dq, "tau": "tau_{i}"} | not_read
    recording = read_run(path, RobotModel.from_urdf(robot), read_config(tmp_path / "dynid.toml")).recording
    np.testing.assert_array_equal(recording.q[:, 1], columns["q_1"])
    np.testing.assert_array_equal(recording.dq[:, 1], columns["dq_1"])


@pytest.mark.parametrize(
    ("gear", "applied"),
    [
        ("ratio = [50, 80, 120]", ["q", "dq", "ddq_motor"]),
        ('ratio = [50, 80, 120]\napply_to = ["q_motor", "dq_motor"]', ["q", "dq"]),
        ('ratio = [50, 80, 120]\napply_to = ["q", "dq"]', ["q", "dq"]),
    ],
)
def test_gears_and_signs_of_motors_go_with_them(tmp_path, gear, applied):
    """Their own turns were read as the links' where rules say which gears the motors have, and in degrees then."""
    robot, columns = write_robot(tmp_path), run(0, velocity=True)
    log = {"t": columns["t"]}
    for j, ratio in enumerate((50, 80, -120)):
        log |= {f"{d}q_motor_{j}": ratio * columns[f"{d}q_{j}"] for d in ("", "d")} | {f"tau_{j}": columns[f"tau_{j}"]}
    path, known = write_csv(tmp_path / "run.csv", log), tmp_path / "known.toml"
    known.write_text(f"[gear]\n{gear}\n[signs]\nq_motor = [1, 1, -1]\n")
    _, written = init(tmp_path, robot, path, "--config", known)
    assert written["gear"] == {"ratio": [50.0, 80.0, 120.0], "apply_to": applied}
    assert written["signs"] == {"q": [1, 1, -1]}
    recording = read_run(path, RobotModel.from_urdf(robot), read_config(tmp_path / "dynid.toml")).recording
    for j in range(3):
        np.testing.assert_allclose(recording.q[:, j], columns[f"q_{j}"], rtol=1e-12)
        np.testing.assert_allclose(recording.dq[:, j], columns[f"dq_{j}"], rtol=1e-12)


def test_gears_of_the_robot_stay_so(tmp_path):
    """What is on the motors' side by the robot file's ratios was lost in the file that is written."""
    known, columns = tmp_path / "known.toml", run(0)
    known.write_text('[gear]\napply_to = ["tau"]\n')
    drives = "".join(
        f'<transmission name="{name}_drive"><type>a</type><joint name="{name}"/><actuator name="{name}_motor">'
        f'<drake:rotor_inertia value="1e-5"/><drake:gear_ratio value="{ratio}"/></actuator></transmission>'
        for name, ratio in zip(JOINTS, (50, 80, 120), strict=True)
    )
    robot = tmp_path / "geared.urdf"
    text = write_robot(tmp_path).read_text().replace("<robot ", '<robot xmlns:drake="http://drake.mit.edu" ')
    robot.write_text(text.replace("</robot>", f"{drives}</robot>"))
    for j, ratio in enumerate((50, 80, 120)):
        columns[f"tau_{j}"] /= ratio
    path = write_csv(tmp_path / "run.csv", columns)
    _, written = init(tmp_path, robot, path, "--config", known)
    assert written["gear"] == {"apply_to": ["tau"]}
    recording = read_run(path, RobotModel.from_urdf(robot), read_config(tmp_path / "dynid.toml")).recording
    np.testing.assert_allclose(recording.tau[:, 2], run(0)["tau_2"], rtol=1e-12)


def test_motors_beside_positions_that_are_told_are_the_motors(tmp_path):
    """Where rules say which columns the positions are, the motors' encoder was lost, and its velocity the links'."""
    robot, columns = write_robot(tmp_path), run(0, velocity=True)
    log = {"time": columns["t"]}
    log |= {name: columns[f"q_{j}"] for j, name in enumerate(("base", "mid", "tip"))}
    for j in range(3):
        log |= {f"q_motor_{j}": columns[f"q_{j}"], f"dq_motor_{j}": columns[f"dq_{j}"]}
        log[f"trq_meas_{j}"] = columns[f"tau_{j}"]
    told = tmp_path / "told.toml"
    told.write_text('[columns]\nq = ["base", "mid", "tip"]\n')
    answer, written = init(tmp_path, robot, write_csv(tmp_path / "run.csv", log), "--config", told)
    signals = {"q": ["base", "mid", "tip"], "q_motor": "q_motor_{i}", "dq_motor": "dq_motor_{i}"}
    assert written["columns"] == {"t": "time", "tau": "trq_meas_{i}"} | signals
    assert "the only positions" not in str(answer)


def test_what_is_not_to_be_read_stays_so(tmp_path):
    """A velocity that is known to be a controller's: it was read again by the file that was written."""
    known = tmp_path / "known.toml"
    known.write_text("[columns]\ndq = false\n")
    path = write_csv(tmp_path / "run.csv", run(0, velocity=True))
    _, written = init(tmp_path, write_robot(tmp_path), path, "--config", known)
    assert written["columns"] == {"t": "t", "q": "q_{i}", "tau": "tau_{i}", "dq": False}


def test_a_person_at_a_terminal_is_asked(tmp_path, monkeypatch):
    from dynid_rs.commands import init as command
    from dynid_rs.commands._init_look import look

    path = tmp_path / "run.csv"
    path.write_text(text(table(0, time=1e3)))
    model, asked = RobotModel.from_urdf(write_robot(tmp_path)), []
    monkeypatch.setattr(command.typer, "confirm", lambda question, default: asked.append(question) or False)
    found = look(model, [path], Config(), command._ask)
    assert any("[units] time = 'ms'" in question for question in asked)
    assert found.taken == []
    assert [one.key for one in found.refused] == ["[units] time"]


def at_a_terminal(*words, answers):
    """`dynid` before a pseudo-terminal: each question is answered as it comes; what was said, and the exit code."""
    import pty

    ours, theirs = pty.openpty()
    code = "from dynid_rs.__main__ import main; main()"
    command = [sys.executable, "-c", code, *map(str, words)]
    done = subprocess.Popen(
        command, env=ENVIRONMENT | {"TERM": "dumb"}, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True
    )
    os.close(theirs)
    said, left, seen, end = "", list(answers), 0, time.monotonic() + 120
    while time.monotonic() < end:
        if not select.select([ours], [], [], 1.0)[0]:
            continue
        try:
            said += os.read(ours, 4096).decode()
        except OSError:  # nobody is at the other end
            break
        if left and left[0][0] in said[seen:]:
            seen = len(said)
            os.write(ours, f"{left.pop(0)[1]}\n".encode())
    os.close(ours)
    ended = done.wait(20)
    assert left == [], said
    return ended, said


def inverted(folder):
    paths = []
    for k in range(2):
        columns = run(k)
        columns.update(tau_1=-columns["tau_1"])
        paths.append(write_parquet(folder / f"run_{k}.parquet", columns))
    return write_robot(folder), *paths


TERMINAL = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals there")


@TERMINAL
@pytest.mark.parametrize(("said", "code"), [("", 0), ("n", 1)])
def test_a_sign_is_asked_for_at_a_terminal(said, code, tmp_path):
    words = ("init", *inverted(tmp_path), "-o", tmp_path / "dynid.toml")
    ended, printed = at_a_terminal(*words, answers=[("write [signs] = {'tau': [1, -1, 1]}? [Y/n]", said)])
    assert ended == code, printed
    text = (tmp_path / "dynid.toml").read_text()
    assert tomllib.loads(text)["signs"] == ({} if said else {"tau": [1, -1, 1]})
    assert ("TO BE ANSWERED" in text) == bool(said)


@TERMINAL
def test_nothing_is_asked_where_nothing_is_open(tmp_path):
    paths = write_robot(tmp_path), write_csv(tmp_path / "run.csv", run(0))
    ended, printed = at_a_terminal("init", *paths, "-o", tmp_path / "dynid.toml", answers=[])
    assert ended == 0, printed
    assert "?" not in printed
    assert "Enter" not in printed


@TERMINAL
def test_drive_gains_and_the_chain_are_asked_for(tmp_path):
    branch = (
        '<link name="tool"/><joint name="flange" type="fixed"><parent link="hand"/><child link="tool"/></joint>'
        '<link name="probe"/><joint name="side" type="revolute"><parent link="fore"/><child link="probe"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    robot = write_robot(tmp_path)
    robot.write_text(robot.read_text().replace("</robot>", branch))
    path = write_csv(tmp_path / "run.csv", as_current(run(0)))
    answers = [
        ("last link of the chain", "nowhere"),
        ("last link of the chain", "tool"),
        ("per ampere", "20,15"),
        ("per ampere", "20,15,6"),
    ]
    ended, printed = at_a_terminal("init", robot, path, "-o", tmp_path / "dynid.toml", answers=answers)
    assert ended == 0, printed
    written = tomllib.loads((tmp_path / "dynid.toml").read_text())
    assert written["robot"]["tip"] == "tool"
    assert written["drive"] == {"gain": [20, 15, 6]}
    jsonschema.validate(written, schema())
    # A script says the same by options.
    words = ("init", robot, path, "--tip", "tool", "--drive-gain", "20,15,6", "-o", tmp_path / "same.toml")
    assert dynid(*words).exit_code == 0
    assert tomllib.loads((tmp_path / "same.toml").read_text()) == written


def test_gains_of_a_file_that_holds_torque_are_not_written(tmp_path):
    """They are for currents, and `identify` refuses them beside torque."""
    robot, columns = write_robot(tmp_path), run(0)
    path = write_csv(tmp_path / "run.csv", {**as_current(columns), **columns})
    answer = dynid("init", robot, path, "--drive-gain", "20", "-o", tmp_path / "dynid.toml")
    assert answer.exit_code == 0, answer.output
    assert "they are not used" in answer.output
    assert tomllib.loads((tmp_path / "dynid.toml").read_text()).get("drive", {}) == {}


def test_scripts_accept_a_question_by_its_code(tmp_path):
    words = ("init", *inverted(tmp_path), "-o", tmp_path / "dynid.toml")
    assert "--accept must be one of torque_flipped" in refusal(dynid(*words, "--accept", "anything"))
    assert dynid(*words, "--accept", "torque_flipped").exit_code == 0
    assert tomllib.loads((tmp_path / "dynid.toml").read_text())["signs"] == {"tau": [1, -1, 1]}


def test_another_mounting_is_accepted_with_its_gravity(tmp_path):
    robot = write_robot(tmp_path)
    paths = [write_csv(tmp_path / f"run_{k}.csv", run(k)) for k in range(2)]
    words = ("init", robot, *paths, "--gravity", "-9.81,0,0", "--force", "-o", tmp_path / "dynid.toml", "--json")
    asked = dynid(*words)
    assert [one["code"] for one in json.loads(asked.stdout)["questions"]] == ["mounting"]
    assert tomllib.loads((tmp_path / "dynid.toml").read_text())["robot"]["gravity"] == [-9.81, 0.0, 0.0]
    accepted = dynid(*words, "--accept", "mounting")
    assert json.loads(accepted.stdout)["questions"] == []
    gravity = tomllib.loads((tmp_path / "dynid.toml").read_text())["robot"]["gravity"]
    np.testing.assert_allclose(gravity, [0.0, 0.0, -9.81], atol=0.3)


def test_a_toml_that_is_there_stays(tmp_path):
    robot, path = write_robot(tmp_path), write_csv(tmp_path / "run.csv", run(0))
    (tmp_path / "dynid.toml").write_text("mine")
    assert "give --force" in refusal(dynid("init", robot, path, "-o", tmp_path / "dynid.toml"))
    said = refusal(dynid("init", robot, path, "-o", "-"))
    assert said == "-: nothing but --json is written to standard output; name a file or a folder"
    assert (tmp_path / "dynid.toml").read_text() == "mine"
    assert dynid("init", robot, path, "-o", tmp_path / "dynid.toml", "--force").exit_code == 0


def test_rules_for_another_robot_are_refused(tmp_path):
    robot, path = write_robot(tmp_path), write_csv(tmp_path / "run.csv", run(0))
    (tmp_path / "dynid.toml").write_text('[robot]\njoints = ["a", "b", "c"]\n')
    sentence = refusal(dynid("identify", robot, path, "--config", tmp_path / "dynid.toml", "-o", tmp_path / "out"))
    assert "was written for a, b, c, and the robot has shoulder, elbow, wrist" in sentence


GUESSES = {
    "abb": (("ROB_1 Axis 1 Position", "ROB_1 Axis 1 Torque Reference", "ROB_1 Axis 1 Torque"), {"q", "tau"}),
    "rsi": (("RIst.A1", "MotorCurrent.A1", "MotorTemp.A1"), {"q", "current", "temperature"}),
    "camel": (("ActualPosition1", "TargetPosition1", "ActualTorque1", "PositionError1"), {"q", "q_reference", "tau"}),
    "plain": (("axis1", "torque1"), {"q", "tau"}),
    "ros": (("joint_1_pos", "joint_1_vel", "joint_1_eff"), {"q", "dq", "tau"}),
    "model": (("pos_0", "tau_model_0", "tau_meas_0"), {"q", "tau"}),
}


@pytest.mark.parametrize(("first", "signals"), GUESSES.values(), ids=GUESSES)
def test_names_are_guessed_by_their_words(first, signals):
    start = 0 if "_0" in first[0] else 1
    names = ["time"]
    for name in first:
        head, _, tail = name.rpartition(str(start))
        names += [f"{head}{start + k}{tail}" for k in range(6)]
    found = guess(names, [f"joint_{k}" for k in range(6)], {})
    assert found.time == ("time",)
    assert set(found.columns) == signals
    assert "model" not in str(found.columns.get("tau"))
    assert "Reference" not in str(found.columns.get("tau"))


def test_columns_of_init_are_those_of_the_run(tmp_path):
    """A list where no template does, and back."""
    _, q, _, tau = columns_of(0)
    columns = {"t": columns_of(0)[0]}
    columns |= {name: q[:, j] for j, name in enumerate(("q_shoulder", "q_elbow", "q_wrist"))}
    columns |= {f"m{name}": tau[:, j] for j, name in enumerate("xyz")}
    rules = tmp_path / "given.toml"
    rules.write_text('[columns]\ntau = ["mx", "my", "mz"]\n')
    robot, path = write_robot(tmp_path), write_csv(tmp_path / "run.csv", columns)
    result = dynid("init", robot, path, "--config", rules, "-o", tmp_path / "dynid.toml")
    assert result.exit_code == 0, result.output
    written = tomllib.loads((tmp_path / "dynid.toml").read_text())["columns"]
    assert written == {"t": "t", "q": "q_{joint}", "tau": ["mx", "my", "mz"]}


def test_percent_is_a_current_with_a_gain(tmp_path):
    """The mend that the refusal of such a file names."""
    from helpers.log_files import VARIANTS

    path, rules = VARIANTS["fanuc, percent of what"].write(tmp_path, 0), tmp_path / "given.toml"
    rules.write_text(
        '[columns]\nt = "Time"\nq = "J{n} Position"\ntau = false\ncurrent = "J{n} Torque"\n[drive]\n'
        "gain = [2, 3, 0.5]\n"
    )
    recording = read_run(path, RobotModel.from_urdf(write_robot(tmp_path)), read_config(rules)).recording
    _, q, _, tau = columns_of(0)
    np.testing.assert_allclose(recording.q, q, rtol=1e-12)
    np.testing.assert_allclose(recording.tau, tau * [2, 3, 0.5], rtol=1e-12)
    assert recording.torque_unit == "N*m"


KUKA = {
    "rsi": ("IPOC", "AIPos.A{n}", "MACur.A{n}", 1e3, "MACur is the motor current in percent of each drive's largest"),
    "trace, percent": ("Zeit [s]", "AxisAct_A{n} [deg]", "MACur_A{n} [%]", 1, "the current is in percent of what"),
    "trace, ampere": ("Zeit [s]", "AxisAct_A{n} [deg]", "MACur_A{n} [A]", 1, ""),
    "trace, nobody says": ("Zeit", "AxisAct_A{n}", "MACur_A{n}", 1, ""),
}


@pytest.mark.parametrize(("t", "q", "current", "time", "said"), KUKA.values(), ids=KUKA)
def test_motor_currents_of_kuka_are_no_torques(t, q, current, time, said, tmp_path):
    """Percent or ampere, they are read as those of RTDE are: without a gain, which the rules ask for."""
    robot, path = write_robot(tmp_path), tmp_path / "run.csv"
    path.write_text(text(table(0, t, q, current, time=time, angle=DEGREE)))
    answer, written = init(tmp_path, robot, path)
    assert written["columns"]["tau"] is False
    assert written["columns"]["current"] == current.split(" ")[0]
    assert not written.get("drive")
    assert any("currents without a gain: no torques" in note and "[drive] gain" in note for note in answer["notes"])
    commented = " ".join((tmp_path / "dynid.toml").read_text().replace("\n#  ", "").split())
    assert "currents without a gain: no torques, and what is learned from them is not in N m" in commented
    assert said in commented
    rules = read_config(tmp_path / "dynid.toml")
    recording = read_run(path, RobotModel.from_urdf(robot), rules).recording
    assert recording.torque_unit == "A"
    np.testing.assert_allclose(recording.tau, columns_of(0)[3], rtol=1e-12)
    shown = dynid("inspect", path, "--robot", robot, "--config", tmp_path / "dynid.toml", "--json")
    assert said in shown.output
    geared = read_run(path, RobotModel.from_urdf(robot), replace(rules, drive_gain=(2.0, 3.0, 0.5))).recording
    assert geared.torque_unit == "N*m"
    np.testing.assert_allclose(geared.tau, columns_of(0)[3] * [2, 3, 0.5], rtol=1e-12)


def test_the_gears_torque_of_kuka_comes_before_its_currents(tmp_path):
    t, q, _, tau = columns_of(0)
    columns = {"IPOC": t * 1e3}
    for name, values in (("AIPos", q * DEGREE), ("GearTorque", tau), ("MACur", tau / 10)):
        columns |= {f"{name}.A{j + 1}": values[:, j] for j in range(3)}
    robot, path = write_robot(tmp_path), write_csv(tmp_path / "run.csv", columns)
    answer, written = init(tmp_path, robot, path)
    assert written["columns"]["tau"] == "GearTorque.A{n}"
    assert not any("without a gain" in note for note in answer["notes"])
    assert any("current is ignored because torque is read" in note for note in answer["notes"])


@pytest.mark.parametrize("order", [1, -1])
def test_of_two_signals_of_a_kind_the_actual_one_is_taken(order):
    """Whichever stands first in the file."""
    both = ["actual_position", "position"][::order]
    names = ["t", *(f"{head}_{j}" for head in (*both, "tau") for j in range(3))]
    found = guess(names, ["a", "b", "c"], {})
    assert found.columns["q"] == "actual_position_{i}"
    assert list(found.others.values()) == ["actual_position_- was taken for q"]


def test_joints_in_the_order_of_messages_are_a_question():
    """rostopic echo -p writes the names beside the numbers; JointState sorts them as it likes."""
    names = ["%time", *(f"field.{word}{k}" for word in ("name", "position", "velocity", "effort") for k in range(6))]
    found = guess(names, [f"joint_{k}" for k in range(6)], {})
    assert found.columns["q"] == "field.position{i}"
    assert found.columns["tau"] == "field.effort{i}"
    assert any("field.name- names the joints of each column" in question for question in found.questions)


JOINT_WORDS = st.lists(
    st.text(st.characters(exclude_categories=("Cs",)), min_size=1, max_size=6), min_size=3, max_size=3, unique=True
)


@given(JOINT_WORDS, st.text(st.characters(exclude_categories=("Cs",)), max_size=4), JOINT_WORDS)
def test_rules_are_read_back_whatever_columns_are_called(names, head, joints):
    """As TOML, and through the templates."""
    from dynid_rs.commands._init_write import rule_text
    from dynid_rs.runs.readers.columns import fill

    for columns in (names, [f"{head}{k}" for k in range(3)], [f"{head}{joint}{head}" for joint in joints]):
        rule = tomllib.loads(f"q = {rule_text(columns, joints)}")["q"]
        back = rule if isinstance(rule, list) else [fill(rule, k, joint) for k, joint in enumerate(joints)]
        assert back == columns


def test_percent_at_the_end_of_a_name_is_no_newton_metre(tmp_path):
    t, q, _, tau = columns_of(0)
    columns = {"t": t}
    for j in range(3):
        columns |= {f"Axis{j + 1}_Pos": q[:, j], f"Axis{j + 1}_Torque_percent": tau[:, j]}
    path = write_csv(tmp_path / "run.csv", columns)
    said = refusal(dynid("init", write_robot(tmp_path), path, "-o", tmp_path / "dynid.toml"))
    assert "column Axis1_Torque_percent is in percent of a rated torque or current" in said


def test_a_joint_more_than_the_arm_has_is_doubted():
    """Of three columns the first two may be other joints than the arm's."""
    names = ["t", *(f"{signal}_{j}" for signal in ("q", "tau") for j in range(3))]
    found = guess(names, ["elbow", "wrist"], {})
    assert found.columns["q"] == ("q_0", "q_1")
    assert any(
        doubt.startswith("q_2 is there too, of a joint more than the arm has: q_0, q_1") for doubt in found.doubts
    )
    assert not guess(names, ["shoulder", "elbow", "wrist"], {}).doubts


@pytest.mark.parametrize("first", [0, 1])
def test_columns_of_a_joint_more_than_the_arm_has_are_read_by_what_init_wrote(tmp_path, first):
    """A track or a gripper behind the arm: the template of all columns would be refused by every other command."""
    t, q, _, tau = columns_of(0)
    wide = {"t": t, "q": np.column_stack([q, 0 * t]), "tau": np.column_stack([tau, 0 * t])}
    columns = {"t": t, **{f"{name}_{j + first}": wide[name][:, j] for name in ("q", "tau") for j in range(4)}}
    robot, path = write_robot(tmp_path), write_csv(tmp_path / "run.csv", columns)
    _, written = init(tmp_path, robot, path)
    assert written["columns"]["q"] == [f"q_{j + first}" for j in range(3)]
    recording = read_run(path, RobotModel.from_urdf(robot), read_config(tmp_path / "dynid.toml")).recording
    np.testing.assert_allclose(recording.q, q, atol=1e-9)


def test_a_dead_torque_channel_is_said_without_a_library_s_warnings(tmp_path):
    """Negative zeros too, as a product with a sign leaves them."""
    robot, columns = write_robot(tmp_path), run(0)
    dead = columns | {f"tau_{j}": -0.0 * columns["t"] for j in range(3)}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        answer, _ = init(tmp_path, robot, write_csv(tmp_path / "run.csv", dead), code=1)
    said = [one["message"] for one in answer["questions"] if one["code"] == "stuck"]
    assert said[0] == "tau_0 (shoulder) is 0 N*m in every row; its channel is dead"
    assert len(said) == 3


def test_the_same_of_several_files_is_said_once_and_evidence_asks_for_nothing(tmp_path):
    robot, paths = write_robot(tmp_path), []
    for k in range(6):
        t, q, dq, tau = columns_of(k % 3)
        named = zip(("actual_q", "actual_qd", "actual_current"), (q * DEGREE, dq * DEGREE, tau / 10), strict=True)
        columns = {"timestamp": t, **{f"{name}_{j}": x[:, j] for name, x in named for j in range(3)}}
        paths.append(write_csv(tmp_path / f"run_{k}.csv", columns))
    answer, written = init(tmp_path, robot, *paths)
    (note,) = [note for note in answer["notes"] if "RTDE" in note]
    assert note.startswith("run_0.csv, run_1.csv, run_2.csv, run_3.csv and 2 more: read as")
    assert written["units"]["angle"] == "deg"
    (taken,) = [one for one in answer["taken"] if one["key"] == "[units] angle"]
    assert "degrees" in taken["evidence"]
    assert "write in" not in taken["evidence"]


@pytest.mark.parametrize("called", [JOINTS, ("a1", "a2", "a3")])
def test_rows_of_joint_states_are_known_by_their_names_or_told_by_init(tmp_path, called):
    """In any order, by the robot's names without a word; by other names that count, `dynid init` maps them."""
    t, q, dq, tau = columns_of(0)
    order = (2, 0, 1)
    columns = {"%time": 1_714_560_000 * 10**9 + np.round(t * 1e9).astype(np.int64)}
    for word, values in (("position", q), ("velocity", dq), ("effort", tau)):
        columns |= {f"field.{word}_{called[j]}": values[:, j] for j in order}
    robot, path = write_robot(tmp_path), write_csv(tmp_path / "run.csv", columns)
    model, rules = RobotModel.from_urdf(robot), None
    if called != JOINTS:
        with pytest.raises(DataError, match=r"column field\.position_shoulder is missing"):
            read_run(path, model)
        init(tmp_path, robot, path)
        rules = read_config(tmp_path / "dynid.toml")
    recording = read_run(path, model, rules).recording
    np.testing.assert_allclose(recording.q, q, atol=1e-9)
    np.testing.assert_allclose(recording.tau, tau, atol=1e-9)
    np.testing.assert_allclose(recording.t, t - t[0], atol=1e-8)


def test_a_log_of_other_names_is_sent_to_init_and_init_sends_nobody_to_itself(tmp_path):
    t, q, _, tau = columns_of(0)
    columns = {"t": t, **{f"a{j}": q[:, j] for j in range(3)}, **{f"b{j}": tau[:, j] for j in range(3)}}
    robot, path = write_robot(tmp_path), write_csv(tmp_path / "run.csv", columns)
    assert "(dynid init writes one)" in refusal(dynid("identify", robot, path, "-o", tmp_path / "out"))
    said = refusal(dynid("init", robot, path, "-o", tmp_path / "dynid.toml"))
    assert "so write it by hand" in said
    assert "dynid init writes" not in said


def test_one_column_in_degrees_is_named_and_not_taken_for_all(tmp_path):
    """Among radians: a rule for all would make the other joints hardly move."""
    robot, columns = write_robot(tmp_path), run(0)
    columns = {**columns, "q_1": np.asarray(columns["q_1"]) * DEGREE}
    path = write_csv(tmp_path / "run.csv", columns)
    answer, written = init(tmp_path, robot, path, code=1)
    assert "angle" not in written["units"]
    assert "the others like radians" in json.dumps(answer)
    said = dynid("identify", robot, path, "--residual", "none", "-o", tmp_path / "out")
    assert said.exit_code == 1
    findings = json.loads((tmp_path / "out" / "result.json").read_text())["data"]["findings"]
    assert ("units_mixed", "q_1") in {(finding["code"], finding.get("column")) for finding in findings}


def test_slides_in_millimetres_are_lengths_and_no_angles_nor_currents(tmp_path):
    robot, columns = write_robot(tmp_path), run(0)
    text = robot.read_text()
    axis = text.index('type="revolute"')
    robot.write_text(text[:axis] + 'type="prismatic"' + text[axis + len('type="revolute"') :])
    columns = {**columns, "q_0": 1e3 * np.asarray(columns["q_0"])}
    answer, written = init(tmp_path, robot, write_csv(tmp_path / "run.csv", columns))
    assert [one["key"] for one in answer["taken"]] == ["[units] length"]
    assert written["units"] == {"length": "mm"}


def test_radians_that_are_called_degrees_are_asked_about(tmp_path):
    robot, paths = write_robot(tmp_path), [write_csv(tmp_path / f"run_{k}.csv", run(k)) for k in range(3)]
    (tmp_path / "deg.toml").write_text('[units]\nangle = "deg"\n')
    for command, *more in (("inspect",), ("identify", "--residual", "none", "-o", tmp_path / "out")):
        given = (paths[0], "--robot", robot) if command == "inspect" else (robot, *paths)
        said = dynid(command, *given, "--config", tmp_path / "deg.toml", *more)
        assert "if they are radians, take the rule out" in " ".join(said.output.split())
    assert "units_radians" not in dynid("inspect", paths[0], "--json").output


@pytest.mark.parametrize(("step", "doubted"), [(1, True), (4, False)])
def test_a_counter_of_rows_is_not_silently_milliseconds(tmp_path, step, doubted):
    columns = run(0)
    path = write_csv(tmp_path / "run.csv", columns | {"t": step * np.arange(float(len(columns["t"])))})
    answer, written = init(tmp_path, write_robot(tmp_path), path)
    (taken,) = (one for one in answer["taken"] if one["key"] == "[units] time")
    assert taken["value"] == written["units"]["time"] == "ms"
    assert ("if it counts rows and not milliseconds" in taken["evidence"]) == doubted
