"""The command line as a whole: help, version, exit codes, streams."""

import json
import os
import pty
import subprocess
import sys

import pytest
from helpers.processes import DYNID, ENVIRONMENT, process
from helpers.small_arm import dynid, study, write_robot, write_runs

import dynid_rs

COMMANDS = ("inspect", "identify", "estimate", "simulate", "report")


def test_version():
    result = dynid("--version")
    assert result.exit_code == 0
    assert result.stdout == f"{dynid_rs.__version__}\n"


def test_help_lists_every_command():
    result = dynid("--help")
    assert result.exit_code == 0
    assert all(f"  {command} " in result.stdout for command in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_every_command(command):
    result = dynid(command, "--help")
    assert result.exit_code == 0
    assert result.stderr == ""
    assert result.stdout.startswith(f"Usage: dynid {command} ") or f" {command} [OPTIONS]" in result.stdout
    assert "--json" in result.stdout


SAID = {
    "inspect": "--robot ROBOT URDF, robot.toml, MuJoCo model (.xml) or, with --xacro, xacro: joint names, kinds",
    "compare": "Exit code 0: compared, whichever is better; 2: a file cannot be read, or the two cannot be compared.",
}


@pytest.mark.parametrize("command", SAID)
def test_help_says_what_is_taken_and_how_it_ends(command):
    assert SAID[command] in " ".join(dynid(command, "--help").stdout.replace("│", " ").split())


WRONG_USE = {
    "no such option": (("identify", "--bogus"), "--bogus"),
    "no such command": (("identity",), "identity"),
    "nothing to do": (("identify", "-o", "out"), "ROBOT"),
    "no runs": (("identify", "robot.urdf", "-o", "out"), "RUN"),
    "no output": (("identify", "robot.urdf", "run.csv"), "--output"),
    "no run": (("estimate", "model.json"), "RUN"),
    "too many": (("estimate", "model.json", "run.csv", "run.csv"), "run.csv"),
    "not a number": (("identify", "robot.urdf", "run.csv", "-o", "out", "--cutoff", "ten"), "--cutoff"),
}


@pytest.mark.parametrize(("arguments", "words"), WRONG_USE.values(), ids=WRONG_USE)
def test_wrong_use(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = dynid(*arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert words in result.stderr
    assert "Traceback" not in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("diagnose", "robot.urdf", "run.csv"), "Missing option '--output' / '-o'"),
        (("excite", "robot.urdf", "-o", "x.csv", "--harmonics", "few"), "Invalid value for '--harmonics': "),
        (("diagnos", "robot.urdf"), "No such command 'diagnos'"),
    ],
)
def test_wrong_use_is_an_object_with_json(arguments, message):
    """Programs found nothing on standard output."""
    bare, asked = process(*arguments), process(*arguments, "--json")
    assert (bare.returncode, asked.returncode) == (2, 2)
    assert bare.stdout == ""
    (error,) = json.loads(asked.stdout).values()
    assert error["class"] == "UsageError"
    assert error["message"].startswith(message)
    assert asked.stderr == bare.stderr
    assert f"Error: {error['message']}" in asked.stderr


@pytest.mark.parametrize("asked", ["--help", "--version"])
def test_what_needs_no_numbers_starts_without_their_libraries(asked):
    heavy = ("numpy", "scipy", "sklearn", "pyarrow")
    code = (
        f"import sys; sys.argv = ['dynid', {asked!r}]\n"
        "from dynid_rs.cli import main\n"
        "try:\n    main()\n"
        f"finally:\n    sys.stderr.write(str([name for name in {heavy!r} if name in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "[]"


def test_no_command_shows_the_help():
    assert "identify" in dynid().output


def test_no_progress_where_stderr_is_no_terminal(tmp_path):
    robot, runs = write_robot(tmp_path), write_runs(tmp_path, n_runs=2)
    output = tmp_path / "out"
    pretend = {"FORCE_COLOR": "1", "TTY_COMPATIBLE": "1"}  # words that make other programs colour a pipe
    done = process("identify", robot, *runs, "-o", output, "--residual", "none", **pretend)
    assert done.returncode == 0
    assert done.stderr == ""
    assert "\x1b" not in done.stdout
    assert f"report: {output / 'report.html'}\n" in done.stdout


def test_progress_on_a_terminal(tmp_path):
    """Standard error is a terminal, standard output a pipe: the answer stays clean."""
    robot, runs = write_robot(tmp_path), write_runs(tmp_path, n_runs=2)
    ours, theirs = pty.openpty()
    arguments = ["identify", robot, *runs, "-o", tmp_path / "out", "--residual", "none", "--json"]
    with subprocess.Popen(
        [*DYNID, *map(str, arguments)],
        env=ENVIRONMENT | {"TERM": "xterm"},
        stdout=subprocess.PIPE,
        stderr=theirs,
    ) as child:
        os.close(theirs)
        answer = child.stdout.read()
        shown = b""
        while True:
            try:
                part = os.read(ours, 4096)
            except OSError:  # Linux: the other side is closed
                break
            if not part:
                break
            shown += part
    os.close(ours)
    assert child.returncode == 0
    for step in (b"reading", b"filtering the runs", b"weighted least squares", b"testing"):
        assert step in shown  # each is drawn, however short
    assert json.loads(answer)["format"] == "dynid-result"


def test_errors_for_programs(tmp_path):
    """With --json one object on standard output, and nothing else there; the sentence for people stays."""
    path = tmp_path / "run.csv"
    path.write_text("t,q_0,tau_0\n" + "".join(f"{k / 100},0,{'x' if k == 7 else 0}\n" for k in range(50)))
    for arguments in (
        ("identify", write_robot(tmp_path), path, "-o", tmp_path / "out"),
        ("estimate", study().model, path),
    ):
        done = process(*arguments, "--json")
        assert done.returncode == 2
        answer = json.loads(done.stdout)
        assert list(answer) == ["error"]
        assert done.stderr == f"error: {answer['error']['message']}\n"
        assert answer["error"]["class"] == "DataError"
        assert answer["error"]["file"] == "run.csv"


def test_report_is_written_again(tmp_path):
    for name in ("result.json", "residuals.parquet"):
        (tmp_path / name).write_bytes((study().output / name).read_bytes())
    result = dynid("report", tmp_path, "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout) == {"report": str(tmp_path / "report.html")}
    assert (tmp_path / "report.html").read_bytes() == (study().output / "report.html").read_bytes()


def test_reader_that_leaves_early(tmp_path):
    """`dynid identify ... | head -0`: no traceback, and the results are there."""
    robot, runs = write_robot(tmp_path), write_runs(tmp_path, n_runs=2)
    with subprocess.Popen(
        [*DYNID, "identify", str(robot), *map(str, runs), "-o", str(tmp_path / "out"), "--residual", "none"],
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as child:
        child.stdout.close()
        errors = child.stderr.read()
    assert errors == b""
    assert child.returncode == 141
    assert (tmp_path / "out" / "result.json").is_file()
