"""`dynid excite --separate`: what nothing imitates, against least squares; and motions that have more of it."""

import json
import shlex

import numpy as np
import pytest
from helpers.robots import chain
from helpers.small_arm import URDF, dynid, refusal, write_robot
from numpy.testing import assert_allclose
from scipy.linalg import orth

from dynid_rs import RobotModel, _core
from dynid_rs.excitation import FourierExcitation
from dynid_rs.excitation.named import COLUMN_KINDS, TILT, is_separable, parse_effect, separate_command
from dynid_rs.excitation.separating import separate
from dynid_rs.excitation.separation import CUTOFF, RATE, WEAK, WIDTHS, Separation
from dynid_rs.excitation.shapes import ShapedEffect
from dynid_rs.runs.preprocessing import ROW_RATE, Band
from dynid_rs.simulation import build_effects, parse_wish, typical_arm

LEAST_SQUARES = {"rtol": 1e-5, "atol": 0}
"""Two orders of elimination, on columns of which some nearly repeat others."""
LINEAR_IN_GRAVITY = {"rtol": 1e-6, "atol": 1e-9}
"""A tilt of 1 mrad against one of 10 urad: the torque is linear in gravity up to the angle's square."""


@pytest.fixture(scope="module")
def robot():
    return RobotModel.from_urdf_string(URDF)


@pytest.fixture(scope="module")
def design(robot):
    return FourierExcitation(duration=8.0, n_restarts=2, max_iter=15, random_state=0).fit(robot)


def separation(robot, a, b, duration=8.0):
    pair = (ShapedEffect.of(parse_effect(text, robot), robot) for text in (a, b))
    return Separation(robot, robot.base_parameters(), *pair, duration)


def least_squares(robot, trajectory, measure):
    """Power of the first effect that is left, per imitator, by one dense least-squares fit of everything at once."""
    motion = trajectory.evaluate(measure.t)
    n = robot.n_joints
    band, rows = Band(CUTOFF), np.arange(int(RATE / CUTOFF), len(measure.t) - int(RATE / CUTOFF))
    rows = rows[:: int(RATE / (ROW_RATE * CUTOFF))]
    base = robot.base_parameters()

    def stacked(columns):
        return band.apply(columns, RATE)[rows].reshape(len(rows) * n, -1)

    declared = [stacked(base.reduce(robot.joint_torque_regressor(*motion)))]
    effects = [_core.Effect.rotor_inertia(), _core.Effect.torque_offset()]
    effects += [_core.Effect.friction([0.0] * n, [width] * n) for width in WIDTHS]
    every = np.concatenate([_core.effect_columns(effect, *motion) for effect in effects], axis=2)
    for j in range(n):
        columns = stacked(every * np.eye(n)[j][:, None])
        columns = columns[:, np.linalg.norm(columns, axis=0) > 0]
        declared.append(orth(columns / np.linalg.norm(columns, axis=0), rcond=WEAK))
    declared = np.column_stack(declared)

    def of(shaped, shape):
        (joint,) = shaped.effect.joints
        effect = _core.Effect.of(shaped.effect.kind, **{name: [value] * n for name, value in shape.items()})
        return stacked(_core.effect_columns(effect, *motion) * np.eye(n)[joint][:, None])

    first, second = measure.pair
    target = of(first, first.shapes[0])
    left = []
    for shape in second.shapes:
        columns = np.column_stack([declared, of(second, shape)])
        columns = columns[:, np.linalg.norm(columns, axis=0) > 0]
        columns /= np.linalg.norm(columns, axis=0)
        basis, values, _ = np.linalg.svd(columns, full_matrices=False)
        basis = basis[:, values > 1e-9 * values[0]]
        rest = target - basis @ (basis.T @ target)
        left.append(np.sum(rest**2) / target.shape[1] / len(rows))
    return np.array(left)


def test_what_is_left_is_what_one_big_fit_leaves(robot, design):
    measure = separation(robot, "stribeck:1", "friction_hysteresis:1")
    expected = least_squares(robot, design.trajectory_, measure)
    power, _ = measure.powers(design.trajectory_)
    assert_allclose(power.left, expected.min(), **LEAST_SQUARES)
    assert power.imitator == int(np.argmin(expected))
    assert power.left <= power.declared <= power.whole


def test_tilt_is_gravity_from_another_side(robot, design):
    motion = design.trajectory_.evaluate(np.linspace(0, 8, 50))
    columns = ShapedEffect.of(parse_effect(TILT, robot), robot).columns(motion, [0], 0.02)
    angle = 1e-5
    turned = robot.with_gravity((robot.gravity + angle * np.cross([1.0, 0, 0], robot.gravity)).tolist())
    roll = (turned.inverse_dynamics(*motion) - robot.inverse_dynamics(*motion)) / angle
    assert_allclose(np.stack([columns[j][:, 0, 0] for j in range(3)], axis=1), roll, **LINEAR_IN_GRAVITY)


def test_a_pair_acts_on_both_joints_with_one_stage(robot, design):
    """The stage's speed v1 + r v2 brakes the second joint r times as much as the first, with the same coefficients."""
    motion = design.trajectory_.evaluate(np.linspace(0, 8, 50))
    shaped = ShapedEffect.of(parse_effect("coupled_friction:1,2:ratio=0.5:transition_width=0.1", robot), robot)
    columns = shaped.columns(motion, [0], 0.02)
    assert_allclose(0.5 * columns[1][:, 0], columns[2][:, 0], rtol=1e-9)


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_a_bearing_rubs_under_the_torque_of_a_neighbour(robot, design, joint):
    """Every side that there is, under its own sign's width, beside each other in one call."""
    motion = design.trajectory_.evaluate(np.linspace(0, 8, 50))
    shaped = ShapedEffect.of(parse_effect(f"bearing_friction:{joint}", robot), robot)
    beside = [k for k in (joint - 1, joint + 1) if k in range(3)]
    assert {joint + int(shape["side"]) for shape in shaped.shapes} == set(beside)
    chosen = range(len(shaped.shapes))
    columns = shaped.columns(motion, chosen, 0.02)[joint][:, :, 0]
    load = np.abs(robot.inverse_dynamics(*motion))
    for k, shape in enumerate(shaped.shapes):
        expected = load[:, joint + int(shape["side"])] * np.tanh(motion[1][:, joint] / shape["transition_width"])
        assert_allclose(columns[:, k], expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("wish", "words"), [("2:side=1", "behind"), ("0:side=-1", "before")])
def test_a_bearing_needs_the_neighbour_that_is_named(robot, wish, words):
    with pytest.raises(ValueError, match=f"there is no joint {words} {robot.joint_names[int(wish[0])]}"):
        ShapedEffect.of(parse_effect(f"bearing_friction:{wish}", robot), robot)


def test_what_is_no_law_is_not_simulated(robot):
    """A tie of a law with any function of its angle has another command, which is said."""
    with pytest.raises(
        ValueError, match=r"is no law .* `dynid excite ROBOT -o next.csv --after RESULT` designs motion"
    ):
        parse_effect("another_function_of_the_position:1", robot)


def test_one_joint_has_no_neighbour_to_rub_under():
    alone = RobotModel.from_urdf_string(chain(["revolute"]))
    with pytest.raises(ValueError, match="there is no joint beside j1"):
        ShapedEffect.of(parse_effect("bearing_friction:0", alone), alone)
    with pytest.raises(ValueError, match="needs two joints, and this robot has one"):
        build_effects([parse_wish("bearing_friction")], typical_arm(alone))


def test_a_saturation_is_of_the_links_and_the_rotor(robot, design):
    """Of what the robot file tells of the motors' torque; friction it does not."""
    motion = design.trajectory_.evaluate(np.linspace(0, 8, 50))
    columns = ShapedEffect.of(parse_effect("torque_saturation:1", robot), robot).columns(motion, [0], 0.02)
    tau = robot.inverse_dynamics(*motion) + robot.rotor_inertia * motion[2]
    assert_allclose(columns[1][:, 0, 0], tau[:, 1] ** 3, rtol=1e-9)


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("stribeck:1", "friction_hysteresis:1"),
        ("joint_spring:1", "counterbalance:1:b=0.2:phase=-1.5:gas_length=0.6"),
    ],
)
def test_twice_the_power_of_the_exciting_trajectory(robot, design, a, b):
    found, separated = separate(design, parse_effect(a, robot), parse_effect(b, robot), max_iter=25)
    assert separated.gain > 2
    # Judged again from the trajectory itself, with all imitators.
    measure = separation(robot, a, b)
    before, after = (measure.powers(d.trajectory_) for d in (design, found))
    assert np.sqrt(np.prod([x.left / y.left for x, y in zip(after, before, strict=True)])) == pytest.approx(
        separated.gain, rel=1e-9
    )
    assert found.merit_.violations(found.limits_) == 0
    assert all(report["kept"] for report in found.constraint_report_.values())
    assert_allclose(found.trajectory_.evaluate(np.array([0.0, 8.0]))[0], np.stack([design.start_] * 2), atol=1e-12)


def test_the_command_writes_both_motions_figures(tmp_path):
    quick = ("--duration", 8, "--restarts", 1, "--iterations", 5)
    robot, output = write_robot(tmp_path), tmp_path / "sep.csv"
    arguments = ("excite", robot, "-o", output, *quick, "--separate", "stribeck:elbow", "friction_hysteresis:elbow")
    printed = dynid(*arguments, "--json")
    assert printed.exit_code == 0, printed.output
    result = json.loads(printed.stdout)
    separation_ = result["separation"]
    assert separation_["gain"] >= 1
    assert [entry["effect"] for entry in separation_["effects"]] == ["stribeck:elbow", "friction_hysteresis:elbow"]
    for entry in separation_["effects"]:
        assert entry["before"]["whole"] == 1
        assert 0 < entry["before"]["left"] <= entry["before"]["left_by_declared"] <= 1
    assert "Separation" in (tmp_path / "sep.html").read_text()
    assert len(output.read_text().splitlines()) == 8002
    first = output.read_bytes()
    assert "times the power" in dynid(*arguments, "--force").stdout
    assert output.read_bytes() == first


@pytest.mark.parametrize(
    ("a", "b", "words"),
    [
        ("payload", "stribeck:1", "no motion of some seconds is designed for payload"),
        ("friction:1", "stribeck:1", "friction is part of every model"),
        ("stribek:1", "stribeck:1", "did you mean stribeck"),
        ("stribeck", "joint_spring:1", "name the joint, as in stribeck:shoulder"),
        ("stribeck:9", "joint_spring:1", "'9' is no joint of small_arm"),
        ("coupled_friction:1", "stribeck:1", "acts on two joints of a pair"),
        ("stribeck:1,2", "joint_spring:1", "stribeck acts on one joint"),
        ("stribeck:1:a=2", "joint_spring:1", "'a=2' is no shape parameter of stribeck"),
        ("stribeck:1:exponent=x", "joint_spring:1", "exponent must be a finite number, found 'x'"),
        ("stribeck:1:exponent=-2", "joint_spring:1", "exponent must be positive"),
        ("stribeck:1", "stribeck:elbow:exponent=1", "both are stribeck at the same place"),
        ("gravity_tilt:1", "stribeck:1", "write gravity_tilt alone"),
    ],
)
def test_what_cannot_be_designed_for_is_refused(tmp_path, a, b, words):
    robot = write_robot(tmp_path)
    sentence = refusal(dynid("excite", robot, "-o", tmp_path / "sep.csv", "--separate", a, b))
    assert words in sentence
    assert [path.name for path in tmp_path.iterdir()] == ["robot.urdf"]


def test_what_no_motion_tells_is_refused_before_the_search(tmp_path):
    """Behind parallel axes a coupling of 2 and 3 is one of 1 and 3 with more in link and rotor."""
    robot, output = write_robot(tmp_path), tmp_path / "sep.csv"
    robot.write_text(robot.read_text().replace('axis xyz="0 0 1"', 'axis xyz="0 1 0"'))
    a, b = "inertial_coupling:1,2", "inertial_coupling:0,2"
    sentence = refusal(dynid("excite", robot, "-o", output, "--separate", a, b))
    assert sentence == f"--separate: beside the declared model no motion tells {a} from {b}"
    assert not separation(RobotModel.from_urdf(robot), a, "stribeck:1").is_hopeless
    assert not separation(RobotModel.from_urdf_string(URDF), "inertial_coupling:0,1", b).is_hopeless


def test_a_load_needs_inertials(tmp_path):
    bare = tmp_path / "robot.urdf"
    bare.write_text("".join(line for line in _without_inertials().splitlines(keepends=True)))
    sentence = refusal(
        dynid("excite", bare, "-o", tmp_path / "s.csv", "--separate", "load_dependent_friction:1", "stribeck:1")
    )
    assert "small_arm declares no inertials" in sentence


def _without_inertials():
    import re

    return re.sub(r"<inertial>.*?</inertial>", "", URDF, flags=re.S)


def test_the_command_that_a_tie_names_is_read_back(robot):
    for kind in COLUMN_KINDS:
        if is_separable(kind):
            place = "1,2" if kind in ("coupled_friction", "inertial_coupling") else "1"
            named = parse_effect(f"{kind}:{place}", robot)
            assert parse_effect(named.text(robot.joint_names), robot) == named
    a = parse_effect("stribeck:1:stribeck_velocity=0.1", robot)
    command = separate_command(a, parse_effect(TILT, robot), robot.joint_names)
    assert command.endswith("--separate stribeck:elbow:stribeck_velocity=0.1 gravity_tilt")
    # As a shell takes it, whatever joints are called.
    for name in ("elbow joint", "l'épaule;", "ns:elbow", "a,b"):
        odd = RobotModel.from_urdf_string(URDF.replace('"elbow"', f'"{name}"'))
        one, other = (parse_effect(f"{kind}:1", odd) for kind in ("stribeck", "friction_hysteresis"))
        *_, first, second = shlex.split(separate_command(one, other, odd.joint_names))
        assert parse_effect(first, odd) == one
        assert parse_effect(second, odd) == other
