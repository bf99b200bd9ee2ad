"""robot.toml: the same robot as its URDF, as Pinocchio's and as the paper's forward kinematics; in every command."""

import json
import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest
from helpers.robots import random_states
from helpers.run_files import write_parquet
from helpers.small_arm import dynid, refusal, run, write, write_robot
from helpers.tolerances import COMPLEX_STEP, LAST_DIGITS, PINOCCHIO
from numpy.testing import assert_allclose, assert_array_equal

from dynid_rs import DataError, MdhError, RobotModel, TorqueModel, UrdfError, read_recording
from dynid_rs.runs.readers import read_config
from dynid_rs.simulation import bundled_robot

N_TABLES = 60
STATES = 50
GRAVITY = (3.1, -5.2, -7.4)


@dataclass(frozen=True)
class Row:
    """One row: kind, [alpha, a, d, theta] [rad, m], mass [kg], centre [m], inertia about it (3, 3) [kg m^2]."""

    slides: bool
    alpha: float
    a: float
    d: float
    theta: float
    mass: float
    com: np.ndarray
    inertia: np.ndarray


def random_table(seed, square=0.3, theta=True):
    """1-8 rows; some angles are right ones, as on real arms. With `theta` off its offsets are zero."""
    rng = np.random.default_rng(seed)

    def angle():
        return rng.integers(-1, 3) * math.pi / 2 if rng.random() < square else rng.uniform(-math.pi, math.pi)

    def row():
        alpha, offset = float(angle()), float(angle())
        a, d = rng.uniform(-0.6, 0.6, size=2) * (rng.random(2) < 0.7)
        half = rng.normal(size=(3, 3)) * 0.3
        inertia = np.trace(half @ half.T) * np.eye(3) - half @ half.T
        slides = bool(rng.random() < 0.25)
        mass, com = float(rng.uniform(0.2, 20)), rng.uniform(-0.3, 0.3, size=3)
        return Row(slides, alpha, float(a), float(d), offset if theta else 0.0, mass, com, inertia)

    return [row() for _ in range(1 + seed % 8)]


def error(tau, expected):
    """Largest difference of a joint over its largest torque: single samples may be sums of terms that cancel."""
    return np.max(np.max(np.abs(tau - expected), axis=0) / np.max(np.abs(expected), axis=0))


def number(x):
    return repr(float(x))


def toml(rows, angle="rad"):
    """The table as robot.toml."""
    lines = ['name = "table"', f'angle = "{angle}"', f"gravity = [{', '.join(map(number, GRAVITY))}]"]
    turn = math.degrees if angle == "deg" else float
    for row in rows:
        entries = {
            f"{a}{b}": row.inertia["xyz".index(a), "xyz".index(b)] for a, b in ("xx", "yy", "zz", "xy", "xz", "yz")
        }
        lines += [
            "[[joint]]",
            f'kind = "{"prismatic" if row.slides else "revolute"}"',
            f"alpha = {number(turn(row.alpha))}",
            f"a = {number(row.a)}",
            f"d = {number(row.d)}",
            f"theta = {number(turn(row.theta))}",
            f"mass = {number(row.mass)}",
            f"com = [{', '.join(map(number, row.com))}]",
            f"inertia_com = {{ {', '.join(f'{name} = {number(entry)}' for name, entry in entries.items())} }}",
        ]
    return "\n".join(lines) + "\n"


def roll_pitch_yaw(rotation):
    """Angles with rotation = Rz(yaw) Ry(pitch) Rx(roll), also where the pitch is a right angle."""
    r = rotation
    pitch = math.atan2(-r[2][0], math.hypot(r[2][1], r[2][2]))
    if math.hypot(r[2][1], r[2][2]) < 1e-8:  # roll and yaw turn about the same axis: all of it is roll
        return math.atan2(-r[1][2], r[1][1]), pitch, 0.0
    roll = math.atan2(r[2][1], r[2][2])
    # Yaw from what is left after pitch and roll: accurate however small cos(pitch) is.
    cosine, sine = math.cos(roll), math.sin(roll)
    yaw = math.atan2(sine * r[0][2] - cosine * r[0][1], cosine * r[1][1] - sine * r[1][2])
    return roll, pitch, yaw


def urdf(rows):
    """The table as URDF, one joint per row: origin and rpy converted here."""
    parts = ['<robot name="table"><link name="l0"/>']
    for k, row in enumerate(rows, start=1):
        cosine, sine = math.cos(row.alpha), math.sin(row.alpha)
        ct, st = math.cos(row.theta), math.sin(row.theta)
        rotation = [[ct, -st, 0.0], [cosine * st, cosine * ct, -sine], [sine * st, sine * ct, cosine]]
        rpy = (row.alpha, 0.0, 0.0) if row.theta == 0 else roll_pitch_yaw(rotation)
        xyz = (row.a, -sine * row.d, cosine * row.d)
        i = row.inertia
        parts.append(
            f'<link name="l{k}"><inertial><origin xyz="{" ".join(map(number, row.com))}"/>'
            f'<mass value="{number(row.mass)}"/><inertia ixx="{number(i[0, 0])}" ixy="{number(i[0, 1])}" '
            f'ixz="{number(i[0, 2])}" iyy="{number(i[1, 1])}" iyz="{number(i[1, 2])}" izz="{number(i[2, 2])}"/>'
            f'</inertial></link><joint name="j{k}" type="{"prismatic" if row.slides else "revolute"}">'
            f'<parent link="l{k - 1}"/><child link="l{k}"/><axis xyz="0 0 1"/>'
            f'<origin xyz="{" ".join(map(number, xyz))}" rpy="{" ".join(map(number, rpy))}"/></joint>'
        )
    return "".join(parts) + "</robot>"


@pytest.mark.parametrize("first", range(0, N_TABLES, 20))
def test_torques_are_those_of_the_equivalent_urdf(first):
    for seed in range(first, first + 20):
        rows = random_table(seed)
        robot = RobotModel.from_mdh_string(toml(rows))
        other = RobotModel.from_urdf_string(urdf(rows), gravity=GRAVITY)
        states = random_states(STATES, len(rows), seed)
        assert_array_equal(robot.gravity, other.gravity)
        assert error(robot.rnea(*states), other.rnea(*states)) <= LAST_DIGITS


@pytest.mark.parametrize("first", range(0, N_TABLES, 20))
def test_torques_are_the_same_bits_where_rpy_says_the_rotation_exactly(first):
    for seed in range(first, first + 20):
        rows = random_table(seed, theta=False)
        robot = RobotModel.from_mdh_string(toml(rows))
        other = RobotModel.from_urdf_string(urdf(rows), gravity=GRAVITY)
        states = random_states(STATES, len(rows), seed)
        assert_array_equal(robot.rnea(*states), other.rnea(*states))
        assert_array_equal(robot.joint_torque_regressor(*states), other.joint_torque_regressor(*states))


def pinocchio_model(rows):
    """Joint by joint: SE3 placements multiplied from the four elementary transformations."""

    def turned(axis, angle):
        return pin.SE3(pin.AngleAxis(angle, np.eye(3)[axis]).matrix(), np.zeros(3))

    def moved(axis, way):
        return pin.SE3(np.eye(3), way * np.eye(3)[axis])

    model = pin.Model()
    model.gravity.linear = np.array(GRAVITY)
    parent = 0
    for k, row in enumerate(rows):
        placement = turned(0, row.alpha) * moved(0, row.a) * turned(2, row.theta) * moved(2, row.d)
        kind = pin.JointModelPZ() if row.slides else pin.JointModelRZ()
        parent = model.addJoint(parent, kind, placement, f"joint_{k + 1}")
        model.appendBodyToJoint(parent, pin.Inertia(row.mass, row.com, row.inertia), pin.SE3.Identity())
    return model


@pytest.mark.parametrize("seed", range(N_TABLES))
def test_torques_are_pinocchios(seed):
    rows = random_table(seed)
    model = pinocchio_model(rows)
    data = model.createData()
    robot = RobotModel.from_mdh_string(toml(rows))
    states = random_states(STATES, len(rows), seed)
    expected = np.array([pin.rnea(model, data, *state) for state in zip(*states, strict=True)])
    assert error(robot.rnea(*states), expected) <= PINOCCHIO


def transformation(row, q):
    """T(i-1 -> i) of the modified convention, entry by entry; complex q for derivatives."""
    theta, d = (row.theta, row.d + q) if row.slides else (row.theta + q, row.d)
    ct, st, ca, sa = np.cos(theta), np.sin(theta), math.cos(row.alpha), math.sin(row.alpha)
    return np.array(
        [
            [ct, -st, 0, row.a],
            [st * ca, ct * ca, -sa, -d * sa],
            [st * sa, ct * sa, ca, d * ca],
            [0, 0, 0, 1],
        ]
    )


def potential_energy(rows, q):
    """Of all links under gravity, by forward kinematics."""
    pose, energy = np.eye(4), 0.0
    for row, angle in zip(rows, q, strict=True):
        pose = pose @ transformation(row, angle)
        centre = (pose @ np.array([*row.com, 1.0]))[:3]
        energy = energy - row.mass * np.dot(GRAVITY, centre)
    return energy


@pytest.mark.parametrize("seed", range(0, N_TABLES, 4))
def test_gravity_torques_are_the_slope_of_the_energy_by_forward_kinematics(seed):
    rows = random_table(seed)
    robot = RobotModel.from_mdh_string(toml(rows))
    q = random_states(10, len(rows), seed)[0]
    step = 1e-30
    expected = np.array(
        [[potential_energy(rows, sample + 1j * step * unit).imag / step for unit in np.eye(len(rows))] for sample in q]
    )
    assert_allclose(robot.rnea(q, 0 * q, 0 * q), expected, **COMPLEX_STEP)


def test_degrees_are_another_spelling():
    rows = random_table(7)
    states = random_states(STATES, len(rows), 0)
    in_radians, in_degrees = (RobotModel.from_mdh_string(toml(rows, angle)) for angle in ("rad", "deg"))
    assert error(in_degrees.rnea(*states), in_radians.rnea(*states)) <= LAST_DIGITS


# ---------------------------------------------------------------- files


def bundled_table():
    return bundled_robot().with_suffix(".toml")


def test_the_bundled_table_is_the_bundled_urdf():
    table, urdf = RobotModel.from_mdh(bundled_table()), RobotModel.from_urdf(bundled_robot())
    states = random_states(1000, 6, 0)
    assert error(table.rnea(*states), urdf.rnea(*states)) <= LAST_DIGITS
    for name in ("name", "joint_names", "link_names", "joint_kinds"):
        assert getattr(table, name) == getattr(urdf, name)
    limits = ("lower", "upper", "velocity_limits", "acceleration_limits", "effort_limits")
    for name in (*limits, "rotor_inertia", "gear_ratio", "gravity"):
        assert_array_equal(getattr(table, name), getattr(urdf, name))


def test_the_suffix_says_the_format(tmp_path):
    upper = tmp_path / "ARM.TOML"
    upper.write_text(toml(random_table(3)))
    assert RobotModel.from_file(upper).name == RobotModel.from_file(str(upper)).name == "table"
    assert RobotModel.from_file(bundled_robot()).name == "six_axis"
    assert_array_equal(RobotModel.from_file(upper).gravity, GRAVITY)
    assert_array_equal(RobotModel.from_file(upper, gravity=(0, 0, 1)).gravity, (0, 0, 1))
    assert_array_equal(RobotModel.from_file(bundled_robot()).gravity, (0, 0, -9.81))
    assert_array_equal(RobotModel.from_file(upper, rotor_inertia=[1, 2, 3, 4]).rotor_inertia, [1, 2, 3, 4])
    for name in ("base", "tip"):
        with pytest.raises(ValueError, match=rf"ARM\.TOML: a robot\.toml is one chain .*leave out {name}$"):
            RobotModel.from_file(upper, **{name: "link"})
    with pytest.raises(FileNotFoundError, match=r"none\.toml"):
        RobotModel.from_file(tmp_path / "none.toml")
    wrong = tmp_path / "robot.urdf"
    wrong.write_text(toml(random_table(3)))
    with pytest.raises(UrdfError):
        RobotModel.from_file(wrong)


def test_refusals_are_sentences_with_a_place():
    text = toml(random_table(1)).replace("alpha", "aplha", 1)
    with pytest.raises(MdhError, match=r"^arm\.toml:6:1: aplha of joint 1: this key is not known; is alpha meant\?$"):
        RobotModel.from_mdh_string(text, source_name="arm.toml")
    assert issubclass(MdhError, ValueError)


def test_the_page_of_the_format_holds_a_robot(request):
    page = (request.config.rootpath / "docs" / "reference" / "robot_toml.md").read_text(encoding="utf-8")
    example = page.split("```toml\n")[1].split("```")[0]
    robot = RobotModel.from_mdh_string(example)
    assert robot.joint_names == ["shoulder", "elbow"]
    assert_allclose(robot.gear_ratio, [121.0, np.nan])


# ---------------------------------------------------------------- commands

SMALL = """
name = "small_arm"
angle = "deg"
[[joint]]
name = "shoulder"
alpha = 0.0
a = 0.0
d = 0.4
theta = 0.0
gear_ratio = 100
[[joint]]
name = "elbow"
alpha = -90.0
a = 0.0
d = 0.0
theta = 0.0
gear_ratio = 80
[[joint]]
name = "wrist"
alpha = 0.0
a = 0.4
d = 0.0
theta = 0.0
gear_ratio = 50
"""
"""Joints of the small arm that the tests of the commands share."""


def write_table(folder, text=SMALL):
    path = folder / "robot.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("prior", "most"), [("none", 1e-6), ("auto", 5e-3)])
def test_identify_gives_the_same_torques_from_either_file(tmp_path, prior, most):
    """With the weak prior to a part of the noise: only the URDF declares inertials that may be its centre."""
    runs = [write(tmp_path / f"run_{k}.parquet", run(k)) for k in range(3)]
    models = {}
    for robot in (write_robot(tmp_path), write_table(tmp_path)):
        output = tmp_path / robot.suffix[1:]
        done = dynid("identify", robot, *runs[:2], "--test", runs[2], "--prior", prior, "-o", output)
        assert done.exit_code in (0, 1)
        models[robot.suffix] = TorqueModel.load(output / "model.json")
        result = json.loads((output / "result.json").read_text())
        assert result["joints"] == ["shoulder", "elbow", "wrist"]
    # Within the joints' limits: only the URDF has some, and states beyond are evaluated at them.
    states = tuple(x * [1.0, 0.6, 0.6] for x in random_states(50, 3, 0))
    states = (states[0] * 0.9, *states[1:])
    # The frames differ, and so do the lifted parameters; what both say about the same motion does not.
    one, other = (models[suffix].evaluate(*states)[0] for suffix in (".urdf", ".toml"))
    assert error(one, other) <= most
    assert_array_equal(models[".toml"].robot.gear_ratio, [100, 80, 50])
    assert np.isnan(models[".urdf"].robot.gear_ratio).all()


def test_gravity_is_the_files_unless_it_is_given(tmp_path):
    runs = [write(tmp_path / f"run_{k}.parquet", run(k)) for k in range(2)]
    robot = write_table(tmp_path, "gravity = [0.0, 0.0, 9.81]\n" + SMALL)
    for k, (options, expected) in enumerate([((), 9.81), (("--gravity", "0,0,-9.81"), -9.81)]):
        output = tmp_path / f"out_{k}"
        assert dynid("identify", robot, *runs, "-o", output, *options).exit_code in (0, 1)
        assert TorqueModel.load(output / "model.json").robot.gravity[2] == expected


def test_base_and_tip_are_for_urdfs(tmp_path):
    path = write(tmp_path / "run.parquet", run(0))
    result = dynid("identify", write_table(tmp_path), path, "-o", tmp_path / "out", "--tip", "hand")
    assert "robot.toml: a robot.toml is one chain from its first row to its last; leave out tip" in refusal(result)
    assert not (tmp_path / "out").exists()


def test_inspect_takes_a_table(tmp_path):
    path = write(tmp_path / "run.parquet", run(0))
    answer = json.loads(dynid("inspect", path, "--robot", write_table(tmp_path), "--json").stdout)
    assert answer["robot"] == "small_arm"
    assert [joint["name"] for joint in answer["runs"][0]["joints"]] == ["shoulder", "elbow", "wrist"]
    spoilt = write_table(tmp_path, SMALL.replace("wrist", "elbow"))
    assert "robot.toml:19:8: name of joint" in refusal(dynid("inspect", path, "--robot", spoilt))


def test_simulate_takes_a_table_and_keeps_it(tmp_path):
    options = ("-o", tmp_path, "--runs", 1, "--duration", 5, "--json")
    answer = json.loads(dynid("simulate", bundled_table(), *options).stdout)
    assert answer["robot_file"] == str(tmp_path / "robot.toml")
    assert (tmp_path / "robot.toml").read_bytes() == bundled_table().read_bytes()
    before = (tmp_path / "run_0.parquet").read_bytes()
    assert dynid("simulate", tmp_path / "robot.toml", *options, "--force").exit_code == 0
    assert (tmp_path / "run_0.parquet").read_bytes() == before
    assert not (tmp_path / "robot.urdf").exists()


# ---------------------------------------------------------------- gear ratios


def unreduced(columns, ratios):
    """The same run with the motor encoders as they turn."""
    return {name: x * ratios[int(name[-1])] if name.startswith("q_motor_") else x for name, x in columns.items()}


@pytest.fixture
def geared(tmp_path):
    columns = run(0, encoders=2)
    path = write_parquet(tmp_path / "run.parquet", unreduced(columns, (100, 80, 50)))
    return path, np.stack([columns[f"q_motor_{j}"] for j in range(3)], axis=1)


def config(tmp_path, text):
    path = tmp_path / "dynid.toml"
    path.write_text(text)
    return read_config(path)


def test_gear_ratios_of_the_robot_count_where_the_config_says_what_they_apply_to(tmp_path, geared):
    path, q_motor = geared
    robot = RobotModel.from_file(write_table(tmp_path))
    asked = config(tmp_path, '[gear]\napply_to = ["q_motor"]')
    assert_allclose(read_recording(path, robot, asked).q_motor, q_motor, rtol=1e-15)
    own = config(tmp_path, '[gear]\nratio = [50, 40, 25]\napply_to = ["q_motor"]')
    assert_allclose(read_recording(path, robot, own).q_motor, 2 * q_motor, rtol=1e-15)
    alone = config(tmp_path, "[gear]\nratio = [50, 40, 25]")
    assert_allclose(read_recording(path, robot, alone).q_motor, 2 * q_motor, rtol=1e-15)


def test_nothing_is_divided_unasked(tmp_path, geared):
    path, q_motor = geared
    robot = RobotModel.from_file(write_table(tmp_path))
    for rules in (None, config(tmp_path, "[units]\nangle = 'rad'")):
        assert_array_equal(read_recording(path, robot, rules).q_motor, q_motor * [100, 80, 50])


@pytest.mark.parametrize("robot", ["none", "names", "urdf", "one missing"])
def test_gear_ratios_that_nobody_knows_are_asked_for(tmp_path, geared, robot):
    path, _ = geared
    given = {
        "none": None,
        "names": ["shoulder", "elbow", "wrist"],
        "urdf": RobotModel.from_file(write_robot(tmp_path)),
        "one missing": RobotModel.from_mdh_string(SMALL.replace("gear_ratio = 80\n", "")),
    }[robot]
    asked = config(tmp_path, '[gear]\napply_to = ["q_motor"]')
    with pytest.raises(DataError, match=r"^dynid\.toml, \[gear\] apply_to: needs ratio beside it, because no robot"):
        read_recording(path, given, asked)
