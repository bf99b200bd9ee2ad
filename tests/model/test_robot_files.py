"""Robots as others write them: which chain is meant, what is carried, and torque as Pinocchio has it."""

import re

import numpy as np
import pytest
from helpers.link_models import bare_model
from helpers.run_files import write
from helpers.small_arm import URDF, dynid, refusal, run, write_robot
from numpy.testing import assert_allclose
from robot_files import difference, held_positions, pinocchio_torque, robot_files

import dynid_rs as dyn
from dynid_rs import RobotModel, UrdfError
from dynid_rs.model.export import urdf

SAME_TORQUE = 1e-10
REFUSED = {
    "hector_description/robots/quadrotor_base.urdf": "no joint moves",
    "iris_description/robots/iris_simple.urdf": "no joint moves",
    "ur_description/urdf/ur3.urdf": "holds no <link>",
}
"""Files without an actuated chain, and what is said of them."""
PANDA = "panda_description/urdf/panda.urdf"

GRIPPER = """<robot name="gripper">
  <link name="world"/>
  <joint name="j1" type="revolute"><parent link="world"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="3" effort="60"/></joint>
  <link name="arm"><inertial><origin xyz="0 0 0.2"/><mass value="4"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.05"/></inertial></link>
  <joint name="j2" type="continuous"><parent link="arm"/><child link="hand"/><origin xyz="0 0.1 0.4"/></joint>
  <link name="hand"><inertial><mass value="2"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <joint name="cam" type="revolute"><parent link="arm"/><child link="lens"/><origin xyz="0.1 0 0" rpy="0.3 0 0"/>
    <axis xyz="0 0.6 0.8"/><limit lower="0.4" upper="1" velocity="1" effort="1"/></joint>
  <link name="lens"><inertial><origin xyz="0.2 0 0"/><mass value="0.3"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="left" type="prismatic"><parent link="hand"/><child link="finger_l"/><axis xyz="0 1 0"/>
    <limit lower="0.02" upper="0.04" velocity="1" effort="9"/></joint>
  <link name="finger_l"><inertial><origin xyz="0.05 0 0"/><mass value="0.1"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
  <joint name="right" type="prismatic"><parent link="hand"/><child link="finger_r"/><axis xyz="0 -1 0"/>
    <limit lower="0" upper="0.2" velocity="1" effort="9"/><mimic joint="left" multiplier="1.5" offset="0.05"/></joint>
  <link name="finger_r"><inertial><origin xyz="0.05 0 0"/><mass value="0.1"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
</robot>
"""


@pytest.fixture
def gripper(tmp_path):
    path = tmp_path / "gripper.urdf"
    path.write_text(GRIPPER)
    return path


def test_every_robot_of_the_package_loads_or_has_no_chain():
    files = robot_files()
    assert len(files) >= 69
    refused, apart = {}, {}
    for name, path in files.items():
        try:
            robot = RobotModel.from_urdf(path)
        except UrdfError as error:
            refused[name] = str(error)
        else:
            apart[name] = difference(path, robot)
    assert refused.keys() == REFUSED.keys()
    for name, sentence in refused.items():
        assert REFUSED[name] in sentence
        assert "\n" not in sentence
    assert {name: apart for name, apart in apart.items() if not apart <= SAME_TORQUE} == {}


def test_a_panda_is_its_seven_joints_and_says_so():
    path = robot_files()[PANDA]
    robot = RobotModel.from_urdf(path)
    assert robot.joint_names == [f"panda_joint{k}" for k in range(1, 8)]
    assert re.search(r'chain of 7 joints from "panda_link0" to "panda_link7" is proposed', robot.choice)
    assert "panda_finger_joint1 at 0" in robot.choice
    assert any("panda_finger_joint2" in note and "panda.urdf:" in note for note in robot.notes)
    with pytest.raises(UrdfError, match=r"follows the joint .* which moves.*choose a tip before that joint"):
        RobotModel.from_urdf(path, tip="panda_leftfinger")
    assert RobotModel.from_urdf(path, tip="panda_link4").n_joints == 4


def test_branches_weigh_where_they_are_held(gripper):
    robot = RobotModel.from_urdf(gripper)
    assert robot.joint_names == ["j1", "j2"]
    stand = held_positions(gripper)
    assert (stand["cam"], stand["left"]) == (0.4, 0.02)
    assert stand["right"] == pytest.approx(0.08)
    assert difference(gripper, robot) < SAME_TORQUE
    states = np.random.default_rng(1).uniform(-1, 1, (3, 5, 2))
    at_zero = RobotModel.from_urdf_string(re.sub(r"<limit[^>]*/>|<mimic[^>]*/>", "", GRIPPER), tip="hand")
    assert np.abs(at_zero.inverse_dynamics(*states) - pinocchio_torque(gripper, robot, *states)).max() > 1e-3


def test_the_command_says_which_chain_it_takes(gripper, tmp_path):
    path = write(tmp_path / "run.parquet", {n: x for n, x in run(0).items() if not n.endswith("_2")})
    printed = dynid("inspect", path, "--robot", gripper)
    assert (
        'gripper.urdf: the robot branches; the chain of 2 joints from "world" to "hand" is proposed' in printed.stderr
    )
    assert "j1" in printed.stdout
    printed = dynid("inspect", path, "--robot", gripper, "--tip", "arm", "--json")
    assert 'the chain of 1 joint from "world" to "arm" is taken: "j1"; held where they stand: ' in printed.stderr


def test_a_floating_base_says_what_to_do(tmp_path):
    path = tmp_path / "float.urdf"
    path.write_text(GRIPPER.replace('name="j1" type="revolute"', 'name="j1" type="floating"'))
    with pytest.raises(UrdfError, match=r'is of type "floating".*choose base="arm"'):
        RobotModel.from_urdf(path)
    assert RobotModel.from_urdf(path, base="arm").joint_names == ["j2"]


def test_links_without_inertials_weigh_nothing():
    bare = re.sub(r"<inertial>.*?</inertial>", "", URDF, flags=re.S)
    assert not RobotModel.from_urdf_string(bare).phi.any()


def test_the_edited_original_keeps_the_weight_of_what_is_held(gripper):
    robot = RobotModel.from_urdf(gripper)
    heavy = with_bodies(robot, 1.1 * robot.phi)
    text = urdf(heavy, gripper).decode()
    assert_allclose(RobotModel.from_urdf_string(text).phi, 1.1 * robot.phi, rtol=0, atol=1e-9)
    assert text.count('<mass value="0.1"/>') == 2
    with pytest.raises(UrdfError, match="declared with more mass or inertia than was identified"):
        urdf(with_bodies(robot, 0.01 * robot.phi), gripper)


def test_the_chain_up_to_a_tip_goes_back_into_the_whole_file(gripper):
    robot = RobotModel.from_urdf(gripper, tip="arm")
    text = urdf(with_bodies(robot, 1.1 * robot.phi), gripper).decode()
    assert_allclose(RobotModel.from_urdf_string(text, tip="arm").phi, 1.1 * robot.phi, rtol=0, atol=1e-9)


def with_bodies(robot, phi):
    """A model with these bodies as its physical set."""
    zero = np.zeros(robot.n_joints)
    bodies = dyn.PhysicalSet(phi, zero, damping=zero, friction=zero, drive_gain=np.ones(robot.n_joints))
    return bare_model(robot, phi).with_physical(bodies)


def test_the_frame_of_a_link(gripper):
    robot = RobotModel.from_urdf(gripper)
    joint, rotation, translation = robot.link_frame("lens")
    assert joint == 0
    turn = np.array([[1, 0, 0], [0, np.cos(0.3), -np.sin(0.3)], [0, np.sin(0.3), np.cos(0.3)]])
    cross = np.array([[0, -0.8, 0.6], [0.8, 0, 0], [-0.6, 0, 0]])
    assert_allclose(rotation, turn @ (np.eye(3) + np.sin(0.4) * cross + (1 - np.cos(0.4)) * cross @ cross), atol=1e-15)
    assert_allclose(translation, [0.1, 0, 0], atol=1e-15)
    with pytest.raises(ValueError, match=r'no link .* is named "nowhere"; there are: world, arm'):
        robot.link_frame("nowhere")


def test_xacro_is_expanded_on_request(tmp_path):
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(
        URDF.replace(
            '<robot name="small_arm">',
            '<robot name="small_arm" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arg name="mass" default="8"/>',
        ).replace('<mass value="8"/>', '<mass value="$(arg mass)"/>')
    )
    with pytest.raises(ValueError, match=r"is a xacro source, a program .* ask for it with --xacro"):
        dyn.read_robot(path)
    plain = RobotModel.from_urdf_string(URDF)
    assert np.array_equal(dyn.read_robot(path, xacro=True).phi, plain.phi)
    assert dyn.read_robot(path, xacro={"mass": "9"}).phi[0] == 9.0
    path.write_text(path.read_text().replace("$(arg mass)", "$(arg nothing)"))
    with pytest.raises(ValueError, match=r"xacro cannot expand it: .*nothing"):
        dyn.read_robot(path, xacro=True)
    runs = write(tmp_path / "run.parquet", run(0))
    assert "--xacro" in refusal(dynid("identify", path, runs, "-o", tmp_path / "out"))


def test_reading_by_suffix(tmp_path):
    assert dyn.read_robot(write_robot(tmp_path)).joint_names == RobotModel.from_urdf_string(URDF).joint_names


def test_no_line_is_quoted_of_a_file_that_nobody_has_seen(tmp_path):
    """xacro puts all on one line, and out of MuJoCo there comes a URDF of our own."""
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', 1))
    with pytest.raises(dyn.UrdfError) as plain:
        dyn.RobotModel.from_urdf_string(path.read_text())
    assert re.match(r".*:\d+:\d+: <axis> of joint", str(plain.value))
    with pytest.raises(dyn.UrdfError) as made:
        dyn.read_robot(path, xacro=True)
    assert str(made.value).startswith(f"{path}, as the URDF made of it: <axis> of joint")
    path.write_text(URDF.replace("</robot>", '<link name="base"/></robot>').replace('"lower"', '"base"'))
    with pytest.raises(dyn.UrdfError, match="as the URDF made of it") as twice:
        dyn.read_robot(path, xacro=True)
    assert not re.search(r"line \d", str(twice.value))
