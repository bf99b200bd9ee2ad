"""Bad input, one fault per test: exit 2, one sentence with the place and the mend, nothing written or changed."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from helpers.run_files import csv_text, folder_of_another_user, write, write_parquet
from helpers.small_arm import JOINTS, URDF, as_current, dynid, refusal, run, snapshot, write_robot, write_runs

OLD = {"model.json": "old model", "result.json": "old result", "residuals.parquet": "", "report.html": "old"}


@pytest.fixture
def folder(tmp_path):
    """A folder with the robot, three good runs and older results in `old`."""
    write_robot(tmp_path)
    write_runs(tmp_path)
    (tmp_path / "old").mkdir()
    for name, text in OLD.items():
        (tmp_path / "old" / name).write_text(text)
    return tmp_path


def refused(folder: Path, *arguments: object, robot: str = "robot.urdf") -> str:
    """Identify into a new folder and into the old one; the sentence. Nothing may change on the disk."""
    before = snapshot(folder)
    sentences = set()
    for output in ("deep/new", "old"):
        result = dynid("identify", folder / robot, *arguments, "-o", folder / output, "--force")
        sentences.add(refusal(result))
        assert snapshot(folder) == before
    (sentence,) = sentences
    assert "Errno" not in sentence
    assert "os error" not in sentence
    return sentence


def good(folder: Path, *numbers: int) -> list[Path]:
    return [folder / f"run_{k}.parquet" for k in numbers]


def spoiled_csv(folder: Path, spoil) -> Path:
    """Run 0 as bad.csv, its lines changed by `spoil`; line 0 is the header."""
    lines = csv_text(run(0)).splitlines()
    spoil(lines)
    path = folder / "bad.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def put_cell(line: int, column: str, text: str):
    def spoil(lines):
        cells = lines[line].split(",")
        cells[lines[0].split(",").index(column)] = text
        lines[line] = ",".join(cells)

    return spoil


def cut_line(lines):
    lines[700] = lines[700][: len(lines[700]) // 2].rpartition(",")[0]
    del lines[701:]


CSV_FAULTS = {
    "bad cell": (put_cell(7, "q_1", "abc"), ("row 7 (line 8), column q_1", "'abc' is not a number", "correct")),
    "empty cell": (put_cell(9, "tau_2", ""), ("row 9 (line 10), column tau_2", "empty", "cut the row out")),
    "decimal comma": (put_cell(3, "q_0", '"0,5"'), ("row 3 (line 4), column q_0", "decimal points")),
    "nan": (put_cell(5, "tau_1", "nan"), ("row 5 (line 6), column tau_1", "nan is not a finite", "cut")),
    "infinity": (put_cell(5, "q_2", "-inf"), ("row 5 (line 6), column q_2", "-inf is not a finite", "cut")),
    "time that is none": (put_cell(4, "t", "nan"), ("row 4 (line 5), column t", "nan is not a finite", "cut")),
    "cut off in a line": (cut_line, ("row 700 (line 701)", "cells, the header has 7", "cut off")),
    "header again": (
        lambda lines: lines.insert(600, lines[0]),
        ("row 600 (line 601)", "header appears a second time", "split it"),
    ),
    "no header": (lambda lines: lines.pop(0), ("line 1", "expected a header", "add one")),
    "column twice": (
        lambda lines: lines.__setitem__(0, lines[0].replace("q_1", "q_0")),
        ("column q_0 appears 2 times", "rename or remove"),
    ),
    "time stands still": (
        put_cell(101, "t", "0.495"),
        ("row 101 (line 102), column t", "time stands still", "remove the repeated rows"),
    ),
    "too few samples": (
        lambda lines: lines.__delitem__(slice(20, None)),
        ("column t", "19 samples are too few; at least 20 are needed"),
    ),
    "no samples": (lambda lines: lines.__delitem__(slice(1, None)), ("no rows, only the names of the columns",)),
}


@pytest.mark.parametrize(("spoil", "words"), CSV_FAULTS.values(), ids=CSV_FAULTS)
def test_csv_cell_line_and_time(folder, spoil, words):
    sentence = refused(folder, spoiled_csv(folder, spoil), *good(folder, 1))
    assert sentence.startswith("bad.csv")
    assert all(word in sentence for word in words), sentence
    as_test = refused(folder, *good(folder, 1), "--test", folder / "bad.csv")
    assert as_test == sentence


@pytest.mark.parametrize("suffix", [".parquet", ".npz", ".csv"])
@pytest.mark.parametrize("part", [0.0, 0.02, 0.5, 0.98])
def test_truncated_run(folder, suffix, part):
    path = write(folder / f"cut{suffix}", run(0))
    data = path.read_bytes()
    cut = data[: int(part * len(data)) // 97 * 97]
    if suffix == ".csv":  # inside a row's last number a cut leaves a shorter number, which nobody can tell
        cut = cut[: cut.rfind(b",")]
    path.write_bytes(cut)
    sentence = refused(folder, path, *good(folder, 1))
    assert "cut" + suffix in sentence


UNREADABLE = {
    "missing": ("none.parquet", None, ("cannot read this file: it does not exist; check the path",)),
    "folder": ("old", None, ("it is a folder; name a file",)),
    "below a file": ("robot.urdf/run.csv", None, ("a part of its path is a file",)),
    "rubbish": ("bad.parquet", b"\x00\x01rubbish" * 40, ("expected a Parquet file",)),
    "text for parquet": ("bad.parquet", b"t,q_0\n" * 40, ("starts with the text 't,q_0",)),
    "suffix": ("run.xlsx", b"x" * 100, ("expected a workbook (.xlsx), but it starts with the text",)),
}


@pytest.mark.parametrize(("name", "data", "words"), UNREADABLE.values(), ids=UNREADABLE)
def test_unreadable_run(folder, name, data, words):
    if data is not None:
        (folder / name).write_bytes(data)
    sentence = refused(folder, folder / name)
    assert all(word in sentence for word in words), sentence


def without(*names):
    return lambda c: {name: values for name, values in c.items() if name not in names}


def renamed(old, new):
    return lambda c: {new if name == old else name: values for name, values in c.items()}


def with_more(*names):
    return lambda c: c | {name: c["q_0"] + 0.1 for name in names}


COLUMNS = {
    "no time": (without("t"), ("the time column is missing", "[columns] t =")),
    "no torque": (without("tau_0", "tau_1", "tau_2"), ("tau_0", "is missing", "(or current_0, ... in A)", "map it")),
    "no position": (without("q_0", "q_1", "q_2"), ("column q_0 or q_shoulder is missing", "map it")),
    "one torque missing": (without("tau_1"), ("column tau_1", "tau for 2 of 3 joints", "add the column")),
    "one position missing": (without("q_2"), ("column q_2 or q_wrist", "q for 2 of 3 joints", "robot of this run")),
    "half a motor side": (with_more("q_motor_0"), ("q_motor_1", "q_motor = false")),
    "time twice": (with_more("time"), ("columns t and time both give the time; remove one",)),
    "position twice": (with_more("q_elbow"), ("columns q_1 and q_elbow both give q of joint elbow; remove one",)),
    "one joint more": (with_more("q_3", "tau_3"), ("column q_3 is there, but the robot has 3 joints", "robot of this")),
    "counted from one": (
        lambda c: {f"{n[:-1]}{int(n[-1]) + 1}" if n != "t" else n: x for n, x in c.items()},
        ("column q_0 or q_shoulder is missing", 'q = "q_{n}"'),
    ),
    "another robot's names": (renamed("q_0", "q_hip"), ("column q_0 or q_shoulder is missing", "q for 2 of 3")),
}


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
@pytest.mark.parametrize(("change", "words"), COLUMNS.values(), ids=COLUMNS)
def test_columns(folder, suffix, change, words):
    sentence = refused(folder, *good(folder, 1), write(folder / f"bad{suffix}", change(run(0))))
    assert sentence.startswith(f"bad{suffix}: ")
    assert all(word in sentence for word in words), sentence


def test_parquet_column_twice(folder):
    columns = run(0)
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table([*columns.values(), columns["q_0"]], names=[*columns, "q_0"])
    pq.write_table(table, folder / "bad.parquet")
    sentence = refused(folder, folder / "bad.parquet")
    assert sentence == "bad.parquet: column q_0 appears 2 times; rename or remove all but one"


def test_run_of_a_robot_with_more_joints(folder):
    robot = URDF.replace('<joint name="wrist" type="revolute">', '<joint name="wrist" type="fixed">')
    (folder / "two.urdf").write_text(robot)
    sentence = refused(folder, *good(folder, 0, 1), robot="two.urdf")
    assert sentence.startswith("run_0.parquet: column q_2 is there, but the robot has 2 joints (shoulder, elbow)")


def test_joint_that_never_moves_in_any_run(folder):
    paths = []
    for k in range(2):
        columns = run(k)
        columns["q_1"][:] = 0.3
        paths.append(write(folder / f"still_{k}.csv", columns))
    sentence = refused(folder, *paths, "--test", *good(folder, 2))
    assert sentence.startswith("still_0.csv, still_1.csv: joint elbow never moves (q_1 stays within 0.005)")
    assert sentence.endswith("record a run that moves it")


def test_a_joint_that_its_file_locks_is_to_be_fixed_there(folder):
    robot = folder / "robot.urdf"
    robot.write_text(
        robot.read_text().replace('lower="-2" upper="2" velocity="3"', 'lower="0.3" upper="0.3" velocity="3"')
    )
    columns = run(0)
    columns["q_1"][:] = 0.3
    path = write(folder / "still.csv", columns)
    said = refused(folder, path, "--test", *good(folder, 2))
    assert said.endswith("cannot be learned, its limits lock it, so make it fixed in the robot file")
    said = refusal(dynid("excite", robot, "-o", folder / "plan.csv"))
    assert said == "joint elbow is locked at 0.3 by its limits; widen them, or make the joint fixed in the robot file"


def test_joint_that_moves_in_one_run_is_enough(folder):
    columns = run(0)
    columns["q_1"][:] = 0.3
    path = write(folder / "still.csv", columns)
    result = dynid(
        "identify", folder / "robot.urdf", path, *good(folder, 1), "--test", *good(folder, 2),
        "-o", folder / "out", "--residual", "none", "--json",
    )  # fmt: skip
    assert result.exit_code in (0, 1)  # its torque tells of a motion that was wiped out here
    findings = json.loads(result.stdout)["data"]["findings"]
    assert ("joint_never_moves", "still.csv", "q_1") in {(f["code"], f["file"], f.get("column")) for f in findings}


def standing_still(k: int = 0):
    columns = run(k)
    rng = np.random.default_rng(0)
    for j in range(len(JOINTS)):
        columns[f"q_{j}"] = 0.4 + 1e-6 * rng.normal(size=len(columns["t"]))
    return columns


def test_run_that_stands_still(folder):
    sentence = refused(folder, write(folder / "still.csv", standing_still()), "--test", *good(folder, 2))
    assert sentence.startswith("still.csv: joint shoulder never moves")


def test_one_training_run_of_two_stands_still(folder):
    """All others move, but this one would add nothing but noise."""
    path = write(folder / "still.csv", {n: x * 1.0 for n, x in standing_still().items()})
    columns = run(0)
    for j in range(len(JOINTS)):
        columns[f"q_{j}"][:] = 0.4
    write(path, columns)
    sentence = refused(folder, *good(folder, 0), path, "--test", *good(folder, 2))
    assert sentence.startswith("still.csv: only 0 s of motion are left")
    assert "record a longer motion" in sentence


def test_test_run_that_stands_still(folder):
    columns = run(0)
    for j in range(len(JOINTS)):
        columns[f"q_{j}"][:] = 0.4
    path = write(folder / "still.csv", columns)
    sentence = refused(folder, *good(folder, 1), "--test", path, "--residual", "none")
    assert sentence.startswith("still.csv: only 0 s of motion are left to test on")
    assert sentence.endswith("test on a longer motion")


def shortened(seconds: float, start: float = 3.0):
    columns = run(0)
    part = (columns["t"] >= start) & (columns["t"] < start + seconds)
    return {name: values[part] for name, values in columns.items()}


def test_run_too_short_for_the_band(folder):
    path = write(folder / "short.csv", shortened(0.5))
    sentence = refused(folder, path, *good(folder, 1), "--cutoff", "5")
    assert sentence.startswith("short.csv: 0.5 s are too short for a band of")
    assert "s are needed" in sentence
    sentence = refused(folder, *good(folder, 1), "--test", path, "--residual", "none", "--cutoff", "5")
    assert sentence.startswith("short.csv: 0.5 s are too short for a band of")


def test_run_too_short_to_be_cut_in_two(folder):
    sentence = refused(folder, write(folder / "short.csv", shortened(0.26)))
    assert sentence.startswith("short.csv (after 0.17 s), column t: 18 samples are too few")


SAME = {
    "to learn from": ((0, 0), (2,), "run_0.parquet is given twice to learn from; name it once"),
    "the last kept aside": ((0, 0), (), "run_0.parquet is given twice to learn from; name it once"),
    "to test on": ((0,), (2, 2), "run_2.parquet is given twice to test on; name it once"),
    "both": ((0, 1), (2, 1), "run_1.parquet is both learned from and tested on; "),
}


@pytest.mark.parametrize(("train", "test", "words"), SAME.values(), ids=SAME)
def test_the_same_run_twice(folder, train, test, words):
    tests = [argument for path in good(folder, *test) for argument in ("--test", path)]
    assert refused(folder, *good(folder, *train), *tests).startswith(words)


def test_a_copy_of_a_run(folder):
    copy = write(folder / "copy.csv", run(0))
    sentence = refused(folder, *good(folder, 0, 1), "--test", copy)
    assert sentence.startswith("copy.csv (run_0.parquet) is both learned from and tested on; ")


def test_amperes_among_newton_metres(folder):
    ampere = write_parquet(folder / "ampere.parquet", as_current(run(0)))
    sentence = refused(folder, *good(folder, 1), ampere, "--test", *good(folder, 2))
    assert sentence.startswith("ampere.parquet and run_1.parquet hold different signals (torque in A and N*m")
    assert sentence.endswith("learn from runs of one kind")
    sentence = refused(folder, *good(folder, 1), "--test", ampere)
    assert sentence.startswith("ampere.parquet holds torque in A and run_1.parquet in N*m; test on runs of one kind")


def test_one_encoder_among_two(folder):
    two = write_parquet(folder / "two.parquet", run(0, encoders=2))
    sentence = refused(folder, *good(folder, 1), two, "--test", *good(folder, 2))
    assert "hold different signals" in sentence
    sentence = refused(folder, *good(folder, 1), "--test", two)
    assert sentence.startswith("two.parquet holds motor and link positions and run_1.parquet only one of them; ")


def test_deflection_without_a_second_encoder(folder):
    sentence = refused(folder, *good(folder, 0, 1), "--residual", "deflection")
    assert "needs two encoders" in sentence


def test_swapped_arguments(folder):
    run_file, robot = good(folder, 0)[0], folder / "robot.urdf"
    for arguments in ((run_file, robot), (run_file, *good(folder, 1))):
        sentence = refusal(dynid("identify", *arguments, "-o", folder / "new"))
        assert sentence == (
            f"{run_file}: this is a run, and a robot (URDF or robot.toml) is expected here; "
            "the robot comes before the runs"
        )
    sentence = refused(folder, robot)
    assert sentence.startswith("robot.urdf: the suffix .urdf is not known; expected a run as .parquet, .csv, ")
    assert sentence.endswith("(this is a robot or a config, and the robot comes before the runs)")
    assert "this is a run, and a robot" in refusal(dynid("inspect", run_file, "--robot", run_file))
    assert "this is a run, and a robot" in refusal(dynid("simulate", run_file, "-o", folder / "new"))
    assert not (folder / "new").exists()
    sentence = refusal(dynid("identify", folder / "none.csv", robot, "-o", folder / "new"))
    assert "none.csv: cannot read this file: it does not exist" in sentence


def test_report_of_what_is_no_result(folder):
    mend = "name the folder that `dynid identify -o` wrote"
    path = good(folder, 0)[0]
    assert refusal(dynid("report", path)) == f"{path}: this is a file, and a folder with results is expected; {mend}"
    assert refusal(dynid("report", folder)) == f"{folder}: there is no result.json in this folder; {mend}"
    assert refusal(dynid("report", folder / "none")).startswith(f"{folder / 'none'}: there is no such folder")


OPTIONS = {
    "gain: text": (
        ("--drive-gain", "a,b,c"),
        "--drive-gain must be one number or 3 with commas between, found 'a,b,c'",
    ),
    "gain: too few": (("--drive-gain", "1,2"), "--drive-gain must be one number or 3, found 2: '1,2'"),
    "gain: empty": (("--drive-gain", " "), "--drive-gain must be one number or 3 with commas between, found ' '"),
    "gain: nan": (("--drive-gain", "1,nan,2"), "--drive-gain must be one finite number or 3, found '1,nan,2'"),
    "gain: zero": (("--drive-gain", "1,0,2"), "--drive-gain must be positive, found 0"),
    "gain: negative": (("--drive-gain", "1,-3,2"), "--drive-gain must be positive, found -3"),
    "gain: for torques": (("--drive-gain", "1,2,3"), "run_0.parquet: holds torque, and drive gains (--drive-gain"),
    "cutoff: nan": (("--cutoff", "nan"), "--cutoff must be a positive frequency in Hz, found nan"),
    "cutoff: zero": (("--cutoff", "0"), "--cutoff must be a positive frequency in Hz, found 0"),
    "cutoff: negative": (("--cutoff", "-5"), "--cutoff must be a positive frequency in Hz, found -5"),
    "cutoff: infinite": (("--cutoff", "inf"), "--cutoff must lie below half the sampling rate, 100 Hz for run_"),
    "cutoff: too high": (("--cutoff", "100"), "--cutoff must lie below half the sampling rate, 100 Hz for run_"),
    "cutoff: tiny": (("--cutoff", "0.001"), "run_0.parquet: 8.0"),
    "gravity: text": (("--gravity", "down"), "--gravity must be 3 numbers with commas between, found 'down'"),
    "gravity: two": (("--gravity", "0,-9.81"), "--gravity must be 3 numbers, found 2: '0,-9.81'"),
    "gravity: decimal comma": (("--gravity", "0,0,-9,81"), "--gravity must be 3 numbers, found 4: '0,0,-9,81'"),
    "gravity: nan": (("--gravity", "0,0,nan"), "--gravity must be 3 finite numbers, found '0,0,nan'"),
    "gravity: mm": (("--gravity", "0,0,-9810"), "--gravity must be in m/s^2, at most 100, found 0,0,-9810"),
    "weighting": (("--weighting", "best"), "--weighting must be one of joint_variance, full_covariance, none"),
    "residual": (
        ("--residual", "gmr"),
        "--residual must be auto, load_free_deflection, deflection, joint_state or none, found 'gmr'",
    ),
    "compensator": (("--compensator", "gmr"), "--compensator must be mixture or rbf, found 'gmr'"),
    "test-from: two runs": (("--test-from", "3"), "--test-from cuts a lone run"),
    "base": (("--base", "nothing"), 'robot.urdf: option `base`: no link is named "nothing"'),
    "tip": (("--tip", "nothing"), 'robot.urdf: option `tip`: no link is named "nothing"'),
}


@pytest.mark.parametrize(("options", "words"), OPTIONS.values(), ids=OPTIONS)
def test_options(folder, options, words):
    assert refused(folder, *good(folder, 0, 1), *options).removeprefix(f"{folder}/").startswith(words)


@pytest.mark.parametrize("seconds", ["0", "-1", "8", "nan", "inf"])
def test_test_from_outside_of_the_run(folder, seconds):
    sentence = refused(folder, *good(folder, 0), "--test-from", seconds)
    assert sentence.startswith("run_0.parquet: --test-from must lie inside the run (0 to 8 s), found ")


def test_test_from_beside_test(folder):
    sentence = refused(folder, *good(folder, 0), "--test", *good(folder, 1), "--test-from", "3")
    assert sentence.startswith("--test-from cuts a lone run; with --test or several runs there is nothing to cut")


ROBOTS = {
    "missing": (None, ("cannot read this file: it does not exist",)),
    "empty": ("", ("the file is empty",)),
    "cut": (URDF[: len(URDF) // 2], ("bad.urdf:8:85: ", "not closed")),
    "not xml": ("hello", ("bad.urdf:1:1: ", "delete it")),
    "not a robot": ("<sdf/>", ("robot",)),
    "no joint moves": (URDF.replace("revolute", "fixed"), ("joint",)),
    "mass": (
        URDF.replace('<mass value="8"/>', '<mass value="heavy"/>'),
        ("bad.urdf:3:62: ", "mass", '"heavy"', "in kg"),
    ),
    "loop": (URDF.replace('<parent link="base"/>', '<parent link="hand"/>'), ()),
}


@pytest.mark.parametrize(("text", "words"), ROBOTS.values(), ids=ROBOTS)
def test_robot(folder, text, words):
    if text is not None:
        (folder / "bad.urdf").write_text(text)
    sentence = refused(folder, *good(folder, 0, 1), robot="bad.urdf")
    assert "bad.urdf" in sentence
    assert all(word in sentence for word in words), sentence


def test_pipes_instead_of_files(folder):
    os.mkfifo(folder / "pipe.urdf")
    os.mkfifo(folder / "pipe.csv")
    for sentence in (
        refusal(dynid("identify", folder / "pipe.urdf", *good(folder, 0), "-o", folder / "new")),
        refusal(dynid("identify", folder / "robot.urdf", folder / "pipe.csv", "-o", folder / "new")),
    ):
        assert "this is a device or a pipe, not a file; save it as a file first" in sentence


CONFIGS = {
    "missing": (None, "cannot read this file: it does not exist"),
    "not toml": ("[columns\n", "is not valid TOML"),
    "unknown key": ("[unit]\n", "this key is not known; did you mean units?"),
    "gain": ("[drive]\ngain = [1, 2]\n", "has 2 numbers, but the robot has 3 joints"),
    "column": ('[columns]\nq = "angle_{i}"\n', "column angle_0 is missing"),
}


@pytest.mark.parametrize(("text", "words"), CONFIGS.values(), ids=CONFIGS)
def test_config(folder, text, words):
    config = folder / "bad.toml"
    if text is not None:
        config.write_text(text)
    run_file = write_parquet(folder / "ampere.parquet", as_current(run(0)))
    sentence = refused(folder, run_file, "--config", config)
    assert words in sentence
    assert "bad.toml" in sentence or "angle_0" in sentence


def out(folder: Path, output: Path) -> str:
    before = snapshot(folder)
    sentence = refusal(dynid("identify", folder / "robot.urdf", *good(folder, 0, 1), "-o", output))
    assert snapshot(folder) == before
    return sentence


def test_file_in_the_place_of_the_folder(folder):
    path = folder / "robot.urdf"
    assert out(folder, path) == f"{path}: {path} is not a folder; name another place"
    assert out(folder, path / "a" / "b").startswith(f"{path}/a/b: {path} is not a folder; ")


def test_link_to_nowhere_in_the_place_of_the_folder(folder):
    (folder / "link").symlink_to(folder / "nowhere")
    assert "is not a folder" in out(folder, folder / "link")


def test_folder_in_the_place_of_a_result(folder):
    (folder / "out" / "report.html").mkdir(parents=True)
    sentence = out(folder, folder / "out")
    assert sentence.startswith(f"{folder}/out/report.html: this is a folder, where a file is to be written; ")


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc")
def test_folder_that_not_even_root_can_write(folder):
    sentence = out(folder, Path("/proc/dynid/results"))
    assert sentence.startswith("/proc/dynid/results: the folder /proc cannot be written (")
    assert sentence.endswith("; name another place")


def test_name_that_is_too_long(folder):
    assert "its path cannot be written (file name too long)" in out(folder, folder / ("x" * 300))


def test_folder_without_rights(folder):
    """Seen by a user whom rights bind: root may do everything."""
    dynid("identify", "--help")  # all modules are loaded before the rights go
    with folder_of_another_user(0o555) as other:
        sentence = refusal(dynid("identify", folder / "robot.urdf", *good(folder, 0), "-o", other / "out"))
        assert sentence == (
            f"{other}/out: the folder {other} cannot be written (permission denied); name another place"
        )


def test_json_says_the_same_to_programs(folder):
    path = spoiled_csv(folder, put_cell(7, "q_1", "abc"))
    result = dynid("identify", folder / "robot.urdf", path, "-o", folder / "new", "--json")
    assert result.exit_code == 2
    answer = json.loads(result.stdout)
    assert list(answer) == ["error"]
    error = answer["error"]
    assert (error["class"], error["code"]) == ("DataError", "bad_cell")
    assert (error["file"], error["column"], error["row"]) == ("bad.csv", "q_1", 6)
    assert result.stderr == f"error: {error['message']}\n"
    assert not (folder / "new").exists()
