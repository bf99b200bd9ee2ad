"""`dynid export --c-header`: one C99 file per model gives the estimator's numbers, whatever is in the model."""

import json
import re
import subprocess

import numpy as np
import pytest
from helpers.compiled_header import COMPILERS, OF_THE_SIZE, PLAIN, STRICT, assert_same, compiled, difference, run
from helpers.robots import random_chain
from helpers.small_arm import dynid, refusal, snapshot
from helpers.whole_model import (
    RESIDUALS,
    STEP,
    every_effect,
    recorded_states,
    spoiled,
    whole_model,
    write_again,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid_rs import _core
from dynid_rs.model.export import c_header, c_prefix
from dynid_rs.simulation import bundled_robot


@pytest.fixture(scope="module")
def robot():
    return _core.RobotModel.from_urdf(bundled_robot())


@pytest.fixture(scope="module")
def states():
    """Every sample known."""
    return {name: np.nan_to_num(values, nan=30.0) for name, values in recorded_states().items()}


@pytest.mark.parametrize("standard", COMPILERS)
@pytest.mark.parametrize("inputs", [None, *RESIDUALS])
def test_every_effect_and_every_residual_on_a_recorded_run(tmp_path, robot, states, inputs, standard):
    model = whole_model(robot, states, inputs, seed=7)
    kinds = {effect.kind for effect, _ in model.effects}
    assert kinds == {entry["kind"] for entry in _core.effect_catalogue()}, "an effect is not in the test"
    library = compiled(c_header(model, "arm"), standard)
    off = assert_same(model, library, states)
    _, _, status = model.evaluate(**states)
    for bit in (2, 4) if inputs else (2,):
        assert set(np.unique(status & bit)) == {0, bit}, "the states should be on either side of it"
    worst = model.term_names[int(off.max(axis=1).argmax())]
    print(f"\n{standard}, residual on {inputs}: at most {off.max():.0e} of the term's size ({worst})")


@pytest.mark.parametrize("seed", range(6))
def test_any_chain(tmp_path, seed):
    """Sliding joints, odd axes and frames, one encoder or two, with an error on one side or both."""
    chain = random_chain(seed)
    robot = _core.RobotModel.from_urdf_string(chain.urdf, gravity=chain.gravity)
    rng = np.random.default_rng(seed)
    t = np.arange(400) * STEP
    n = chain.n_joints
    wave, phase = rng.uniform(0.5, 2.0, n), rng.uniform(0, 6, n)
    angle = t[:, None] * wave * 5 + phase
    states = {"q": np.sin(angle), "dq": 5 * wave * np.cos(angle), "ddq": -25 * wave**2 * np.sin(angle)}
    if seed % 2:
        states |= {f"{name}_motor": values + 1e-3 * np.cos(3 * angle) for name, values in states.items()}
    both = states | {f"{name}_motor": states.get(f"{name}_motor", states[name]) for name in ("q", "dq", "ddq")}
    states["temperature"] = 20.0 + 5 * t[:, None] * np.ones(n)
    model = whole_model(robot, both, RESIDUALS[seed % 4], seed=seed, both_sides=seed % 2 == 0)
    assert_same(model, compiled(c_header(model, "arm")), states, f"seed {seed}:")


def test_a_model_without_effects_errors_or_residual(tmp_path, robot, states):
    n = robot.n_joints
    model = _core.TorqueModel(
        robot,
        robot.phi.ravel(),
        [],
        encoder_delay=[0.0] * n,
        noise_std=[0.0] * n,
        domain=([[-9.0, 9.0]] * n, [9.0] * n, [99.0] * n),
    )
    library = compiled(c_header(model, "arm"))
    assert_same(model, library, states)
    assert_same(model, library, {name: states[name] for name in ("q", "dq", "ddq")})


def test_what_is_no_state_is_held_as_the_estimator_holds_it(tmp_path, robot):
    clean = {name: np.nan_to_num(values, nan=30.0) for name, values in recorded_states().items()}
    model = whole_model(robot, clean, "deflection", seed=1)
    states = spoiled(clean)
    states["temperature"][30:40, 2] = np.nan
    tau, terms, std, status = run(compiled(c_header(model, "arm"), PLAIN), states)
    for values in (tau, terms, std):
        assert np.isfinite(values).all()
    bad = [0, 50, 60, 61, 70]
    np.testing.assert_array_equal(np.flatnonzero(status & 1), bad)
    np.testing.assert_array_equal(np.flatnonzero(status & 8), range(30, 40))
    assert np.all(tau[0] == 0.0)
    for k in bad[1:]:
        np.testing.assert_array_equal(terms[k], terms[k - 1])
    # What effects remember goes on as if the bad rows had not come.
    good = np.setdiff1d(np.arange(len(tau)), [*bad, *range(30, 40)])
    clean["temperature"][30:40, 2] = 25.0  # nothing above the reference
    kept = np.setdiff1d(np.arange(len(tau)), bad)
    _, expected, _ = model.evaluate(**{name: values[kept] for name, values in clean.items()})
    off = difference(terms[good], expected[np.isin(kept, good)])
    assert off.max() <= OF_THE_SIZE


def test_another_step_is_another_warm_up(tmp_path, robot, states):
    model = whole_model(robot, states, None, seed=2)
    library = compiled(c_header(model, "arm"), PLAIN)
    _, terms, _ = model.evaluate(**states, step=0.02)
    k = model.term_names.index("thermal_friction")
    assert difference(run(library, states, 0.02)[1], terms)[k].max() <= OF_THE_SIZE
    assert difference(run(library, states)[1], terms)[k].max() > 1e-3


@pytest.mark.parametrize("delays", [0.0123, [0.0123, 0.0, 0.002, 0.0, 0.0056, 0.0], [0.0123, 0.003, *4 * [0.0056]]])
def test_a_late_torque_channel_at_states_that_come_faster(tmp_path, robot, states, delays):
    """The rings are as long as the model's own step asks for; a program whose states come faster says how long."""
    model = whole_model(robot, states, None, seed=7).with_torque_delay(delays)
    some, step = {name: values[:300] for name, values in states.items()}, 0.001
    header = c_header(model, "arm")
    longer = "".join(f"#define ARM_N_{name} 15\n" for name in ("DELAY", "LATE") if f"#ifndef ARM_N_{name}" in header)
    _, terms, status = model.evaluate(**some, step=step)
    library = compiled(longer + header, PLAIN)
    assert difference(run(library, some, step)[1], terms).max() <= OF_THE_SIZE
    np.testing.assert_array_equal(run(library, some, step)[3], status)
    assert np.all(run(compiled(header), some, step)[3] & 512), "too short a ring is said in every step"


def test_an_effect_too_much_or_too_little_would_be_seen(tmp_path, robot, states):
    """The comparison bites: every effect's size, changed by 1e-9 in C alone, is off by more than is allowed."""
    model = whole_model(robot, states, None, seed=7)
    header = c_header(model, "arm")
    spoilt = header.replace(
        "sum += columns[k] * coefficients[k];", "sum += 1.000000001 * columns[k] * coefficients[k];"
    )
    assert spoilt != header
    _, terms, _ = model.evaluate(**states)
    off = difference(run(compiled(spoilt, PLAIN), states)[1], terms)
    assert np.all(off[1:].max(axis=1) > 50 * OF_THE_SIZE)


NAMES = [
    'a"; int x = system("rm -rf"); //',
    "*/ #error caught /*",
    "line\nbreak \\",
    "??/ trigraph ??=",
    "%s%n \x7f ä 機械",
    "dynid_n DYNID_N_JOINTS",
]


def with_names(model, names, folder):
    """The same model with other names of robot and joints, through its file."""
    path = folder / "model.json"
    model.save(path)
    content = json.loads(path.read_text())
    content["robot"]["name"] = names[0]
    for joint, name in zip(content["robot"]["joints"], names, strict=True):
        joint["name"] = name
    return write_again(content, path)


EACH_LATE = [0.0123, 0.0, 0.002, 0.0, 0.0056, 0.0]
ALL_AND_EACH = [0.0123, 0.003, 0.0123, 0.0056, 0.0123, 0.003]


@pytest.mark.parametrize("delays", [0.0123, EACH_LATE, ALL_AND_EACH])
@pytest.mark.parametrize("standard", ["c99", "c++17"])
def test_a_late_torque_channel(tmp_path, robot, states, standard, delays):
    model = whole_model(robot, states, None, seed=7).with_torque_delay(delays)
    library = compiled(c_header(model, "arm"), standard)
    assert_same(model, library, states)
    some = {name: values[:40].copy() for name, values in states.items()}
    some["q"][7:9] = np.nan
    _, _, _, status = run(library, some)
    assert status[:4].tolist() == [512 | 2] * 4 or np.all(status[:4] & 512)
    assert status[7:9].tolist() == [1, 1]
    assert not np.any(status[9:] & 512), "time goes on while nothing usable comes"


def test_an_early_torque_channel_is_left_as_it_is(tmp_path, robot, states):
    """No state is known before it comes: the torque is that of the state, and the header says so."""
    plain = whole_model(robot, states, None, seed=7)
    header = c_header(plain.with_torque_delay(-0.01), "arm")
    assert "early: joint_1 by 0.01 s, joint_2 by 0.01 s" in header
    assert f"#define ARM_TORQUE_DELAY {(-0.01).hex()} " in header
    assert_same(plain, compiled(header, PLAIN), states)


def test_one_channel_that_is_early_is_told_by_its_joint(tmp_path, robot, states):
    """It was told of all torque channels, those that are late among them."""
    delays = [-0.01, 0.0123, 0.0, 0.0, 0.0, 0.0]
    plain = whole_model(robot, states, None, seed=7)
    header = c_header(plain.with_torque_delay(delays), "arm")
    (line,) = (line for line in header.splitlines() if line.startswith("#define ARM_TORQUE_DELAY "))
    assert line.split()[2] == "0x0p+0"
    assert line.endswith("[s]; early: joint_1 by 0.01 s; torques there are those of the state */")
    library = compiled(header, PLAIN)
    assert_same(plain.with_torque_delay(np.maximum(delays, 0.0)), library, states)


def test_states_beyond_the_limits(tmp_path, robot, states):
    model = whole_model(robot, states, "deflection", seed=7)
    wild = {name: values.copy() for name, values in states.items()}
    wild["dq"][50, 1], wild["ddq_motor"][60, 2], wild["q"][70, 0] = 1e6, -1e9, 1e12
    _, _, status = model.evaluate(**wild)
    assert np.flatnonzero(status & 4096).tolist() == [50, 60, 70]
    assert_same(model, compiled(c_header(model, "arm")), wild)


def test_names_of_a_model_file_are_never_c(tmp_path, robot, states):
    model = with_names(whole_model(robot, states, None), NAMES, tmp_path)
    assert model.robot.joint_names == NAMES
    header = c_header(model, "arm")
    header.encode("ascii")
    library = compiled(header, PLAIN)
    assert [library.name(0, j).decode() for j in range(6)] == NAMES
    assert [library.name(1, k).decode() for k in range(library.sizes(1))] == model.term_names
    assert library.name(0, 6) == library.name(1, -1) == b""
    assert_same(model, library, states)


def test_the_command_writes_what_python_returns(tmp_path, robot, states):
    model = whole_model(robot, states, "joint_state")
    model.save(tmp_path / "model.json")
    printed = dynid("export", "--c-header", tmp_path / "model.json", "-o", tmp_path / "arm.h")
    assert printed.exit_code == 0, printed.output
    assert "arm_estimate is one step" in printed.stdout
    assert (tmp_path / "arm.h").read_text(encoding="ascii") == c_header(model, "arm")
    printed = dynid(
        "export", "--c-header", tmp_path / "model.json", "-o", tmp_path / "6 axes.h", "--name", "left", "--json"
    )
    assert json.loads(printed.stdout) == {"c_header": str(tmp_path / "6 axes.h"), "name": "left"}
    printed = dynid("export", "--c-header", tmp_path / "model.json", "-o", tmp_path / "6 axes.h", "--force", "--json")
    assert json.loads(printed.stdout)["name"] == "model_6_axes" == c_prefix("6 axes")
    # Two models in one program, and libdynid's own header beside them.
    (tmp_path / "both.c").write_text('#include "arm.h"\n#include "6 axes.h"\nint main(void) { return 0; }\n')
    subprocess.run(["gcc", "-std=c99", *STRICT, "-o", tmp_path / "both", tmp_path / "both.c"], check=True)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "say what to write: --urdf OUT.urdf, --mjcf OUT.xml, or --c-header with -o OUT.h"),
        (["--c-header", "--urdf", "out.urdf"], "say what to write: --urdf OUT.urdf"),
        (["--c-header"], "needs -o OUT.h"),
        (["--c-header", "-o", "out.h", "--robot", "robot.urdf"], "--robot belongs to --urdf"),
        (["--urdf", "out.urdf", "-o", "out.h"], "belong to --c-header"),
        (["--urdf", "out.urdf", "--name", "x"], "belong to --c-header"),
        (["--c-header", "-o", "nowhere/out.h"], "does not exist"),
        (["--c-header", "-o", "model.json"], "would be replaced"),
        (["--c-header", "-o", "out.h", "--name", "a b"], '"a b" cannot begin the names of a C header'),
        (["--c-header", "-o", "out.h", "--name", "dynid"], "cannot begin the names"),
    ],
)
def test_wrong_use_is_refused_in_a_sentence(tmp_path, monkeypatch, robot, states, arguments, said):
    monkeypatch.chdir(tmp_path)
    whole_model(robot, states, None).save("model.json")
    before = snapshot(tmp_path)
    assert said in refusal(dynid("export", "model.json", *arguments))
    assert snapshot(tmp_path) == before


@given(st.text())
@settings(max_examples=200, deadline=None)
def test_any_file_name_gives_a_prefix(text):
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,39}", c_prefix(text))


@pytest.mark.parametrize("flag", ["-ffast-math", "-ffinite-math-only", "-ffast-math -fsigned-zeros"])
def test_arithmetic_without_nan_is_refused_by_the_compiler(tmp_path, robot, states, flag):
    (tmp_path / "arm.h").write_text(c_header(whole_model(robot, states, None), "arm"))
    command = ["gcc", "-std=c99", *flag.split(), "-fsyntax-only", "-x", "c", str(tmp_path / "arm.h")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "compile without -ffast-math and -ffinite-math-only" in done.stderr


def test_one_effect_alone_needs_no_other(tmp_path, robot, states):
    """Each effect brings what it calls, and nothing else is in the file."""
    rng = np.random.default_rng(0)
    for effect, size in every_effect(robot.n_joints, rng):
        model = whole_model(robot, states, None, effects=[(effect, size)])
        header = c_header(model, "arm")
        defined = set(re.findall(r"static inline \w+ arm_(\w+)\(const double \*shape", header))
        assert defined == {effect.kind}
        assert_same(model, compiled(header, PLAIN), states, effect.kind)
