"""`dynid payload`: what an arm carries, in the frame of its flange and in the words of robot controllers."""

import json
import re
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers.run_files import write
from helpers.small_arm import URDF, as_current, dynid, refusal, run, study
from load_coverage import held, weighed
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from scipy.special import ndtr

from dynid_rs import RobotModel, TorqueModel
from dynid_rs.base.findings import Finding
from dynid_rs.commands.payload import _answer, _frame, _lines
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.reference import compare, weigh_load
from dynid_rs.reference.change_search import wald
from dynid_rs.reference.gear_loss import reach
from dynid_rs.reference.load import Load, _body, _slopes
from dynid_rs.reference.load_data import principal_axes, quantities, vendor_words
from dynid_rs.reference.payload import moved
from dynid_rs.simulation import Tracking, simulate, typical_arm
from dynid_rs.simulation.effects.structure import box_parameters
from dynid_rs.simulation.folder import run_columns

MASS, CENTRE = 1.5, (0.03, -0.02, 0.06)
INERTIA = (0.004, 0.003, 0.002, 0.0003, -0.0002, 0.0001)
"""Of the tool, in the flange's frame: Ixx, Iyy, Izz, Ixy, Ixz, Iyz about its centre."""
FLANGE = """
  <link name="flange"/>
  <joint name="mount" type="fixed"><parent link="hand"/><child link="flange"/>
    <origin xyz="0.1 0.02 0.03" rpy="0.3 -0.5 1.2"/></joint>"""
TOOL = f"""
  <link name="tool"><inertial><origin xyz="{CENTRE[0]} {CENTRE[1]} {CENTRE[2]}"/><mass value="{MASS}"/>
    <inertia ixx="{INERTIA[0]}" iyy="{INERTIA[1]}" izz="{INERTIA[2]}" ixy="{INERTIA[3]}" ixz="{INERTIA[4]}"
      iyz="{INERTIA[5]}"/></inertial></link>
  <joint name="grip" type="fixed"><parent link="flange"/><child link="tool"/></joint>"""
HALF_WIDTHS = 2.0
"""Half-widths of a 95 % interval within which the truth lies: 4 standard errors, seeded."""
DIGITS = 1e-6
"""Of what controllers are given."""
COVERED, NOTHING = (5, 7), (3,)
"""Seeds of `load_coverage` on which intervals without the bias of lossy gears missed mass and centre, or nothing on the
flange was taken for something: of 1, 3, ... 15 they missed on five, and took nothing for something on seven."""


def with_parts(*parts):
    return URDF.replace("</robot>", "".join(parts) + "\n</robot>")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A robot file with a flange, and a run of the small arm with the tool on it."""
    folder = tmp_path_factory.mktemp("payload")
    (folder / "robot.urdf").write_text(with_parts(FLANGE))
    # The friction of the arm without it.
    bare, heavy = (RobotModel.from_urdf_string(with_parts(*parts)) for parts in ((FLANGE,), (FLANGE, TOOL)))
    loaded = replace(typical_arm(bare).rigid(), robot=heavy, phi=heavy.phi)
    columns = run_columns(simulate(loaded, n_runs=1, duration=10, seed=9).recordings[0])
    kept = {name: x for name, x in columns.items() if name.startswith(("t", "q_")) and "motor" not in name}
    write(folder / "run.parquet", kept)
    return folder


def matrix(inertia):
    xx, yy, zz, xy, xz, yz = inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def some_load():
    return Load(MASS, np.array(CENTRE), np.array(INERTIA), np.zeros((10, 2)), 0.0, np.zeros(3), np.zeros(3))


def test_a_body_is_told_in_the_frame_of_the_flange():
    """The tool as its robot file has it, out of what it adds to the last link's parameters."""
    bare, loaded = (RobotModel.from_urdf_string(with_parts(*parts)) for parts in ((FLANGE,), (FLANGE, TOOL)))
    joint, rotation, translation = loaded.link_frame("flange")
    assert joint == 2
    found = _body(loaded.phi[-10:] - bare.phi[-10:], rotation, translation)
    assert_allclose(found, [MASS, *CENTRE, *INERTIA], rtol=0, atol=1e-12)


def test_principal_axes_are_a_rotation_near_the_frames_own():
    axes, moments = principal_axes(np.array(INERTIA))
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert_allclose(axes @ np.diag(moments) @ axes.T, matrix(INERTIA), atol=1e-15)
    assert np.all(np.diag(axes) > 0.7)
    axes, moments = principal_axes(np.array([3.0, 2.0, 1.0, 0, 0, 0]))
    assert_allclose(axes, np.eye(3), atol=1e-15)
    assert_allclose(moments, [3, 2, 1])


def numbers(text):
    return [float(word) for word in re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?", text)]


def test_every_makers_words_hold_the_same_body():
    words = vendor_words(some_load())
    mass, *rest = numbers(words["ur"])
    assert (mass, rest) == (MASS, [*CENTRE, *INERTIA])
    millimetres = 1e3 * np.array(CENTRE)
    _, mass, x, y, z, a, b, c, *about = [1.0, *numbers(words["kuka"].removeprefix("LOAD_DATA[1]="))]
    assert (mass, [x, y, z]) == (MASS, pytest.approx(millimetres))
    turn = Rotation.from_euler("z", a, degrees=True) * Rotation.from_euler("y", b, degrees=True)
    turn = (turn * Rotation.from_euler("x", c, degrees=True)).as_matrix()
    assert_allclose(turn @ np.diag(about) @ turn.T, matrix(INERTIA), atol=DIGITS)
    mass, x, y, z, w, i, j, k, *about = numbers(words["abb"].partition(":=")[2])
    assert (mass, [x, y, z]) == (MASS, pytest.approx(millimetres))
    turn = Rotation.from_quat([i, j, k, w]).as_matrix()
    assert_allclose(turn @ np.diag(about) @ turn.T, matrix(INERTIA), atol=DIGITS)
    mass, x, y, z, *about = numbers(words["fanuc"].replace("cm*s^2", ""))
    assert (mass, [x, y, z]) == (MASS, pytest.approx(millimetres / 10))
    assert_allclose(np.array(about) * 9.80665 / 100, INERTIA[:3], atol=DIGITS)  # kgf*cm*s^2 -> kg*m^2


def test_quantities_have_units():
    told = quantities(some_load())
    assert [entry["name"] for entry in told[:4]] == ["mass", "cx", "cy", "cz"]
    assert (told[3]["value"], told[3]["unit"]) == (pytest.approx(60), "mm")


def test_what_the_torque_does_not_show_has_no_interval():
    """The centre's y, and with it what the inertia about the centre is made of."""
    bare, loaded = (RobotModel.from_urdf_string(with_parts(*parts)) for parts in ((FLANGE,), (FLANGE, TOOL)))
    phi = loaded.phi[-10:] - bare.phi[-10:]
    slopes = _slopes(phi, 1e-6 * np.eye(10), np.eye(3), np.zeros(3))
    unseen = moved(slopes, np.eye(10)[:, [2]])
    assert unseen.tolist() == [False, False, True, False, True, False, True, True, False, True]
    assert not moved(slopes, np.zeros((10, 0))).any()
    load = replace(some_load(), intervals=np.where(unseen[:, None], [-np.inf, np.inf], 0.0))
    assert [entry["interval"] is None for entry in quantities(load)] == unseen.tolist()


def few_joints(kinds, axes):
    """An arm of one link per joint, its reference, and the same arm with a box on the last link: its runs and `phi`."""
    chain = ['<robot name="few"><link name="l0"/>']
    for k, (kind, axis) in enumerate(zip(kinds, axes, strict=True), start=1):
        chain.append(
            f'<link name="l{k}"><inertial><origin xyz="0.02 0.01 0.05"/><mass value="{6 / k}"/>'
            '<inertia ixx="0.05" iyy="0.06" izz="0.04" ixy="0.002" ixz="0.001" iyz="0"/></inertial></link>'
            f'<joint name="j{k}" type="{kind}"><parent link="l{k - 1}"/><child link="l{k}"/><origin xyz="0.03 0 0.1"/>'
            f'<axis xyz="{axis}"/><limit lower="-1" upper="1" velocity="2" effort="200"/></joint>'
        )
    robot = RobotModel.from_urdf_string("".join([*chain, "</robot>"]))
    arm = replace(typical_arm(robot).rigid(), delay=0.0)
    phi = box_parameters(2.0, np.array([0.05, -0.04, 0.1]), np.array([0.05, 0.1, 0.3]))
    loaded = replace(arm, phi=arm.phi + np.pad(phi, (len(arm.phi) - 10, 0)))
    learned = simulate(arm, n_runs=2, duration=20, seed=1, tracking=Tracking()).recordings
    reference = ThreeLoopIdentifier(robot, residual=None).fit(learned).model_
    return reference, list(simulate(loaded, n_runs=2, duration=13, seed=5, tracking=Tracking()).recordings), phi


def test_what_an_axis_askew_hides_has_no_interval():
    """The centre along the last axis, and five of the moments about it, three of which no column shows at all."""
    reference, runs, phi = few_joints(["prismatic", "prismatic", "revolute"], ["1 0 0", "0 1 0", "0 0.6 0.8"])
    load, truth = weigh_load(reference, runs), _body(phi, np.eye(3), np.zeros(3))
    assert np.isfinite(load.intervals).all(axis=1).tolist() == [True, True] + [False] * 8
    assert held(load, truth).all()
    (effect,) = compare(reference, reference.robot, runs).effects
    told = {p["name"]: p["interval"] for p in effect["parameters"]}
    assert [name for name, interval in told.items() if interval is not None] == ["mass", "hx"]
    for name, value in zip(told, phi, strict=True):
        assert told[name] is None or told[name][0] <= value <= told[name][1]


def test_where_no_mass_is_seen_nothing_is_and_the_nearest_body_has_the_torque():
    """One joint feels the moments about its axis, whatever the mass."""
    reference, runs, phi = few_joints(["revolute"], ["0 1 0"])
    load = weigh_load(reference, runs)
    assert np.isinf(load.intervals).all()
    moments = load.mass * load.centre
    assert_allclose(moments[[0, 2]], phi[[1, 3]], atol=0.15 * np.linalg.norm(phi[1:4]))
    # An offset of that day, which was weighed beside it, is no error of the load.
    assert load.rmse_after[0] < 1.3 * reference.noise_std[0] < 0.5 * load.rmse_before[0]


def test_a_mass_that_no_torque_shows_is_no_load_data():
    """Two joints put one of 2 kg at 27 kg, the nearest body's, and controllers were given that."""
    reference, runs, _ = few_joints(["revolute", "revolute"], ["0 0 1", "0 1 0"])
    answer = _answer(weigh_load(reference, runs), "l2", reference.robot.joint_names, [])
    assert answer["seen"]
    assert (answer["load"][0]["interval"], answer["words"]) == (None, {})


def test_the_command_weighs_a_tool(place):
    arguments = (study().model, place / "run.parquet", "--robot", place / "robot.urdf", "--flange", "flange")
    printed = dynid("payload", *arguments, "--json")
    assert printed.exit_code == 0, printed.output
    answer = json.loads(printed.stdout)
    assert (answer["format"], answer["frame"], answer["seen"]) == ("dynid-payload", "flange", True)
    assert answer["load"][0]["value"] == pytest.approx(MASS, rel=0.05)
    bounds = np.array([entry["interval"] for entry in answer["load"]])
    truth = np.array([MASS, *(1e3 * np.array(CENTRE)), *INERTIA])
    # A moment that may be none has zero for its lower end: the middle then says nothing.
    told = (bounds[:, 0] > 0) | ~np.isin([entry["name"] for entry in answer["load"]], ("Ixx", "Iyy", "Izz"))
    far = np.abs(bounds.mean(axis=1) - truth) / (np.diff(bounds)[:, 0] / 2)
    assert np.all(far[told] < HALF_WIDTHS)
    assert set(answer["words"]) == {"ur", "kuka", "abb", "fanuc"}
    printed = dynid("payload", *arguments)
    assert "load in the frame of flange" in printed.stdout
    assert "KUKA: LOAD_DATA[1]={M " in printed.stdout


def test_no_load_is_a_no():
    printed = dynid("payload", study().model, study().runs[2])
    assert printed.exit_code == 1, printed.output
    assert printed.stdout.startswith("no load is seen: ")
    assert "kg, 95 %" not in printed.stdout  # which would be a load


def test_a_load_by_a_model_of_wrong_data_is_no_answer(place, tmp_path):
    """Torques of the motors' side fit as well as those of the joints, and everything on the arm weighs a hundredth."""
    geared = {f"tau_{j}": 0.01 for j in range(3)}

    def on_the_motors(columns):
        return {name: x * geared.get(name, 1.0) for name, x in columns.items()}

    runs_ = [write(tmp_path / f"run_{k}.parquet", on_the_motors(run(k))) for k in range(2)]
    printed = dynid("identify", study().robot, *runs_, "-o", tmp_path / "out", "--residual", "none")
    assert printed.exit_code == 1, printed.output
    loaded = pq.read_table(place / "run.parquet").to_pydict()
    path = write(tmp_path / "load.parquet", on_the_motors({name: np.array(x) for name, x in loaded.items()}))
    for model in (tmp_path / "out", tmp_path / "out" / "model.json"):
        printed = dynid("payload", model, path)
        assert printed.exit_code == 1, printed.output
        assert "error: the model was learned from runs with an error in them" in printed.stdout
        assert "run_0.parquet: the torque" in printed.stdout
    # A model that somebody was given alone says nothing of its data; one beside another file neither.
    alone = tmp_path / "model.json"
    alone.write_bytes((tmp_path / "out" / "model.json").read_bytes())
    for said in ("[]", "[" * 100_000):
        (tmp_path / "result.json").write_text(said)
        assert dynid("payload", alone, path).exit_code == 0


def test_a_joint_that_neither_model_nor_load_explain_is_named(place, tmp_path):
    columns = {name: np.array(x) for name, x in pq.read_table(place / "run.parquet").to_pydict().items()}
    columns["tau_1"] = -columns["tau_1"]
    printed = dynid("payload", study().model, write(tmp_path / "run.parquet", columns))
    assert "on joint elbow, all that the torque there does" in printed.stdout
    assert "all that the torque" not in dynid("payload", study().model, place / "run.parquet").stdout


def test_moments_that_may_be_zero_are_said_to_be_open_beside_the_load_data():
    names = ("mass", "Ixx", "Iyy")
    load = [
        {"name": n, "value": 1.0, "interval": [low, 2.0], "unit": "1"}
        for n, low in zip(names, (0.5, 0, 0.5), strict=True)
    ]
    load.append({"name": "Izz", "value": 1.0, "interval": None, "unit": "1"})
    answer = {
        "seen": True,
        "frame": "hand",
        "load": load,
        "words": {},
        "joints": [],
        "rmse": {"before": [], "after": []},
    }
    late = [Finding("encoder_delay", "info", "comes late", "run_0", f"q_motor_{j}") for j in range(3)]
    lines = _lines(answer, late, "N*m")
    assert [line for line in lines if line == "note: these runs do not determine Ixx, Izz, which may as well be zero"]
    assert lines[-1] == "info: comes late (also q_motor_1, q_motor_2)"


def test_no_moment_is_less_than_nothing():
    told = quantities(Load(1.0, np.zeros(3), np.ones(6), np.array([[-2.0, 3.0]] * 10), 0.0, np.zeros(3), np.zeros(3)))
    lows = {entry["name"]: entry["interval"][0] for entry in told}
    assert [lows[name] for name in ("Ixx", "Iyy", "Izz", "Ixy")] == [0.0, 0.0, 0.0, -2.0]
    tiny = Load(-0.1, np.zeros(3), np.full(6, -2e-7), np.array([[-2.0, 3.0]] * 10), 0.9, np.zeros(3), np.zeros(3))
    assert all(entry["interval"][0] <= entry["value"] <= entry["interval"][1] for entry in quantities(tiny))


@pytest.mark.parametrize(
    ("interval", "words"),
    [
        ([-0.485, 0.311], "nothing that the noise would not look like; what it carries weighs less than 0.311 kg"),
        ([-0.485, -0.1], "less than the model's arm does"),
        (None, "nothing that the noise would not look like"),
    ],
)
def test_less_than_the_models_arm_is_said_where_the_whole_interval_says_so(interval, words):
    answer = {"seen": False, "load": [{"name": "mass", "value": -0.2, "interval": interval, "unit": "kg"}]}
    assert _lines(answer, [], "N*m") == [f"no load is seen: the arm carries {words}"]


def test_what_cannot_be_weighed_is_refused_in_a_sentence(place, tmp_path):
    model, loaded, robot = study().model, place / "run.parquet", place / "robot.urdf"
    assert "belong together" in refusal(dynid("payload", model, loaded, "--flange", "flange"))
    assert "does not move with hand" in refusal(dynid("payload", model, loaded, "--flange", "base", "--robot", robot))
    assert "no link of the chain" in refusal(dynid("payload", model, loaded, "--flange", "x", "--robot", robot))
    currents = write(tmp_path / "run.parquet", as_current(run(0)))
    assert "give the drive gains" in refusal(dynid("payload", model, currents))
    runs = [write(tmp_path / f"run_{k}.parquet", as_current(run(k))) for k in range(2)]
    dynid("identify", study().robot, *runs, "-o", tmp_path / "amperes", "--residual", "none")
    sentence = refusal(dynid("payload", tmp_path / "amperes" / "model.json", currents))
    assert "identify again with --drive-gain" in sentence


def test_a_flange_is_found_behind_any_base_and_in_no_table_or_other_arm(place, tmp_path):
    robot, table = place / "robot.urdf", tmp_path / "arm.toml"
    whole = RobotModel.from_urdf(robot)
    part = RobotModel.from_urdf(robot, base=whole.link_names[0])
    for model in (whole, part):
        for found, expected in zip(_frame(model, robot, "flange"), whole.link_frame("flange")[1:], strict=True):
            assert_allclose(found, expected, rtol=0, atol=0)
    table.write_text("")
    with pytest.raises(ValueError, match=r"names no link that is fixed to hand; leave --flange and --robot out"):
        _frame(whole, table, "flange")
    source = tmp_path / "arm.xacro"
    source.write_text(robot.read_text())
    with pytest.raises(ValueError, match=r"arm.xacro: is a xacro source; expand it first: xacro in.xacro > out.urdf, "):
        _frame(whole, source, "flange")  # this command has no --xacro to ask for
    other = tmp_path / "other.urdf"
    other.write_text(robot.read_text().replace(f'"{whole.joint_names[0]}"', '"another"'))
    with pytest.raises(ValueError, match=r"other.urdf: the chain to hand is not the model's"):
        _frame(whole, other, "flange")


def test_a_run_counts_once():
    """Twice the samples would make the intervals of the load too narrow."""
    assert "is given twice" in refusal(dynid("payload", study().model, study().runs[2], study().runs[2]))


def test_the_wrist_alone_weighs_a_tool(place, tmp_path):
    """Controllers weigh tools with the last joints only; what a resting joint's friction holds is nobody's weight."""
    model = TorqueModel.load(study().model)
    bare, heavy = (RobotModel.from_urdf_string(with_parts(*parts)) for parts in ((FLANGE,), (FLANGE, TOOL)))
    t = np.arange(2000) / 200
    rate, size, middle = np.array([0.0, 0.9, 1.7]), np.array([0.0, 0.6, 1.1]), np.array([0.4, -0.3, 0.2])
    q = middle + size * np.sin(np.outer(t, rate))
    dq, ddq = size * rate * np.cos(np.outer(t, rate)), -size * rate**2 * np.sin(np.outer(t, rate))
    more = heavy.inverse_dynamics(q, dq, ddq) - bare.inverse_dynamics(q, dq, ddq)
    tau = model.torque(q, dq, ddq) + more + np.random.default_rng(0).normal(0, 0.05, q.shape)
    tau[:, 0] += 3.0  # stiction
    columns = {"t": t, **{f"q_{j}": q[:, j] for j in range(3)}, **{f"tau_{j}": tau[:, j] for j in range(3)}}
    path = write(tmp_path / "wrist.parquet", columns)
    printed = dynid("payload", study().model, path, "--robot", place / "robot.urdf", "--flange", "flange", "--json")
    assert printed.exit_code == 0, printed.output
    answer = json.loads(printed.stdout)
    assert answer["load"][0]["value"] == pytest.approx(MASS, rel=0.05)


@pytest.mark.parametrize("bias", [0.0, 0.5, 2.0, 10.0])
def test_an_interval_holds_as_often_as_it_says_under_the_greatest_bias(bias):
    half = reach(np.array([2.0]), np.array([2.0 * bias]))[0] / 2.0
    assert ndtr(half - bias) - ndtr(-half - bias) == pytest.approx(0.95, abs=1e-3)


def test_a_bias_of_either_sign_makes_a_load_no_surer():
    estimate, covariance, every = np.array([3.0, 1.0]), np.eye(2), np.ones(2, dtype=bool)
    bare = wald(estimate, covariance, every)
    assert bare == pytest.approx(np.exp(-5.0))  # chi2 of two
    for sign in (-1.0, 1.0):
        assert wald(estimate, covariance, every, sign * np.array([2.0, 0.0])) == pytest.approx(np.exp(-1.0))
        # No bias explains more than there is.
        assert wald(estimate, covariance, every, sign * np.array([9.0, 0.0])) == pytest.approx(np.exp(-0.5))


def test_intervals_hold_where_gears_lose_torque():
    """Without their bias mass and centre are missed on these arms; how often: `python tests/load_coverage.py`."""
    hits = []
    for seed in COVERED:
        load, truth = weighed(seed, elastic=True)
        assert "gear_loss" in [finding.code for finding in load.findings]
        hits.append(held(load, truth))
    assert np.all(np.array(hits)[:, [0, 3]])
    assert np.mean(hits) > 0.9


def test_what_gears_lose_is_no_load():
    for seed in NOTHING:
        load, _ = weighed(seed, elastic=True, carried=False)
        assert load.p_value > 0.01


def test_rigid_gears_lose_nothing():
    load, truth = weighed(1, elastic=False)
    assert load.findings == []
    assert held(load, truth)[0]
    assert np.diff(load.intervals[0]) < 0.1
