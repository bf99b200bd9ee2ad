"""libdynid from C and C++: the estimator's bits, refusals that are codes, and no leak."""

import os
import re
import shutil
import subprocess

import numpy as np
import pytest
from helpers.binaries import find_estimator
from helpers.data import ROOT
from helpers.whole_model import RESIDUALS, SIGNALS, recorded_states, spoiled, whole_model

from dynid_rs import _core
from dynid_rs.simulation import bundled_robot

FLAGS = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O2"]
PROGRAMS = {"c": ("gcc", "-std=c99", "estimate.c"), "cpp": ("g++", "-std=c++17", "estimate.cpp")}


def tool(name):
    path = shutil.which(name)
    assert path, f"{name} is not on the path; these tests compile C and C++ (Debian: apt install {name})"
    return path


@pytest.fixture(scope="session")
def library():
    """Folder of the built libdynid."""
    command = [tool("cargo"), "build", "--release", "--locked", "--quiet", "--package", "dynid-c"]
    subprocess.run(command, cwd=ROOT, check=True)
    return (ROOT / os.environ.get("CARGO_TARGET_DIR", "target")) / "release"


def compiled(library, source, target, compiler, *flags):
    folders = [f"-I{ROOT / 'rust/dynid-c'}", f"-I{ROOT / 'examples/c'}"]
    link = [str(library / "libdynid.a"), "-lm", "-lpthread", "-ldl"]
    command = [tool(compiler), *FLAGS, *flags, *folders, str(source), *link, "-o", str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return target


@pytest.fixture(scope="session")
def programs(library, tmp_path_factory):
    folder = tmp_path_factory.mktemp("programs")
    return {
        name: compiled(library, ROOT / "examples/c" / source, folder / name, compiler, standard)
        for name, (compiler, standard, source) in PROGRAMS.items()
    }


def rows_of(states):
    return np.hstack([states[name] for name in SIGNALS]).tolist()


def text_of(states):
    return "\n".join(" ".join(map(repr, row)) for row in rows_of(states)) + "\n"


def csv_of(states):
    header = ",".join(f"{name}_{j}" for name in SIGNALS for j in range(states[name].shape[1]))
    return "\n".join([header, *(",".join(map(repr, row)) for row in rows_of(states))]) + "\n"


def run(program, *arguments, text=""):
    return subprocess.run(
        [str(program), *map(str, arguments)],
        input=text,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def assert_same_bits(actual, expected):
    np.testing.assert_array_equal(
        np.ascontiguousarray(actual).view(np.uint64), np.ascontiguousarray(expected).view(np.uint64)
    )


@pytest.mark.parametrize("inputs", [None, *RESIDUALS])
@pytest.mark.parametrize("language", PROGRAMS)
def test_the_examples_give_the_bits_of_the_estimator(programs, tmp_path, language, inputs):
    robot = _core.RobotModel.from_urdf(bundled_robot())
    model = whole_model(robot, recorded_states(), inputs, seed=3)
    states = spoiled(recorded_states())
    path = tmp_path / "model.json"
    model.save(path)
    done = run(find_estimator(), path, "--format", "csv", text=csv_of(states))
    assert done.returncode == 0, done.stderr
    expected = np.array([[float(cell) for cell in line.split(",")] for line in done.stdout.splitlines()[1:]])
    done = run(programs[language], path, 7, text=text_of(states))
    assert done.returncode == 0, done.stderr
    answers = np.array([[float(cell) for cell in line.split()] for line in done.stdout.splitlines()])
    n, n_terms = robot.n_joints, len(model.term_names)
    assert len(answers) == len(states["q"]) > 1500
    torques = n + n_terms * n
    assert_same_bits(answers[:, :torques], expected[:, :torques])
    np.testing.assert_array_equal(answers[:, -1], expected[:, -1])
    # The binary does not print what it expects of the error; Python does, of states that are good.
    good = answers[:, -1] != 1
    std = model.predicted_std(**{name: states[name][good] for name in SIGNALS[:6]})
    assert_same_bits(answers[good, -1 - n : -1], std)
    met = int(np.bitwise_or.reduce(answers[:, -1].astype(int)))
    assert met == 1 | 2 | (4 if inputs else 0) | 8, "the states should meet every status"


def test_the_example_names_what_it_loads(programs, tmp_path):
    robot = _core.RobotModel.from_urdf(bundled_robot())
    states = recorded_states()
    model = whole_model(robot, states, None)
    model.save(tmp_path / "model.json")
    done = run(programs["c"], tmp_path / "model.json", 3, text="")
    assert done.returncode == 0
    assert done.stdout == ""
    assert all(f"{joint} [rad]" in done.stderr for joint in robot.joint_names)
    assert done.stderr.splitlines()[1] == "terms: " + " ".join(model.term_names)
    assert "torques in N*m" in done.stderr


@pytest.mark.parametrize("language", PROGRAMS)
def test_what_is_no_model_is_refused_in_a_sentence(programs, tmp_path, language):
    broken = tmp_path / "broken.json"
    broken.write_text("{}")
    for path, words in ((broken, "not a torque model"), (tmp_path / "missing.json", "No such file")):
        done = run(programs[language], path, 3)
        assert done.returncode == 2
        assert re.fullmatch(rf"error: .*{words}.*\n", done.stderr)
    assert run(programs[language]).returncode == 2


def test_valgrind_finds_no_leak_and_no_wrong_access(library, tmp_path):
    """Every function once, every refusal once, under valgrind; under gcc's sanitisers where valgrind is not there."""
    model = whole_model(_core.RobotModel.from_urdf(bundled_robot()), recorded_states(), "load_free_deflection")
    model.save(tmp_path / "model.json")
    source = ROOT / "tests/c/every_function.c"
    valgrind = shutil.which("valgrind")
    # A leak is only seen by a tool that follows every block: valgrind, or the sanitiser that gcc brings.
    flags = ["-g"] if valgrind else ["-g", "-fsanitize=address,undefined"]
    program = compiled(library, source, tmp_path / "every_function", "gcc", "-std=c99", *flags)
    watch = [valgrind, "--quiet", "--leak-check=full", "--show-leak-kinds=all", "--errors-for-leak-kinds=all"]
    command = [*watch, "--error-exitcode=9", str(program)] if valgrind else [str(program)]
    done = subprocess.run(
        [*command, str(tmp_path / "model.json")], capture_output=True, text=True, timeout=240, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith("all ")


def test_a_leak_would_be_found(library, tmp_path):
    """The watch of the test above barks: the same program told to keep one estimator."""
    model = whole_model(_core.RobotModel.from_urdf(bundled_robot()), recorded_states(), None)
    model.save(tmp_path / "model.json")
    valgrind = shutil.which("valgrind")
    flags = ["-g"] if valgrind else ["-g", "-fsanitize=address,undefined"]
    source = ROOT / "tests/c/every_function.c"
    program = compiled(library, source, tmp_path / "every_function", "gcc", "-std=c99", *flags)
    watch = [valgrind, "--quiet", "--leak-check=full", "--errors-for-leak-kinds=all", "--error-exitcode=9"]
    command = [*watch, str(program)] if valgrind else [str(program)]
    done = subprocess.run(
        [*command, str(tmp_path / "model.json"), "leak"], capture_output=True, text=True, timeout=240, check=False
    )
    assert done.returncode != 0
    assert "lost" in done.stderr or "leak" in done.stderr
