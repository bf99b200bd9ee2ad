"""MuJoCo and Pinocchio: robots out of MuJoCo's files, identified models into both; torque by the engines themselves."""

import mujoco
import numpy as np
import pinocchio
import pytest
from helpers.link_models import bare_model, model_of
from helpers.robots import chain, random_chain
from helpers.small_arm import dynid, refusal
from numpy.testing import assert_allclose

import dynid_rs as dyn
from dynid_rs import RobotModel
from dynid_rs.model.export import mjcf, urdf
from dynid_rs.model.mjcf import urdf_of

SAME_TORQUE = 1e-9
N_STATES = 20

ARM = """<mujoco model="arm">
  <compiler angle="degree" autolimits="true"/>
  <option gravity="0.1 -2 -9"/>
  <worldbody>
    <body name="stand" pos="0 0 0.5" euler="10 20 30">
      <body name="upper" pos="0.1 0 0.2" quat="0.9 0.1 0.2 0.3">
        <inertial pos="0.1 0.02 0.03" euler="20 10 5" mass="3" diaginertia="0.03 0.025 0.02"/>
        <joint name="pan" axis="0 0.6 0.8" pos="0.05 0.02 0" armature="0.3" range="-100 90" ref="15"
          actuatorfrcrange="-50 40"/>
        <joint name="lift" type="slide" axis="1 0 0" pos="0 0.1 0" damping="2" frictionloss="3"/>
        <body pos="0.3 0 0" euler="0 90 0">
          <geom type="capsule" size="0.04 0.1" mass="1.5" pos="0.01 0.02 0.1"/>
          <joint name="roll" axis="1 2 2" pos="-0.02 0 0.03"/>
          <body name="tool" pos="0 0.1 0.2"><geom type="box" size="0.02 0.03 0.04" mass="0.4"/></body>
          <body name="left"><geom type="sphere" size="0.02" mass="0.1"/>
            <joint name="grip" type="slide" axis="0 1 0" range="0.01 0.04"/></body>
          <body name="right"><geom type="sphere" size="0.02" mass="0.1"/>
            <joint name="grop" type="slide" axis="0 -1 0" range="0.01 0.4"/></body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="grop" joint2="grip" polycoef="0.003 2 0 0 0"/></equality>
</mujoco>
"""


def rigid_torque(model, states):
    """Torque (n_samples, nv) of MuJoCo's bodies and armature alone."""
    flags = mujoco.mjtDisableBit
    model.opt.disableflags |= flags.mjDSBL_CONSTRAINT | flags.mjDSBL_CONTACT | flags.mjDSBL_LIMIT
    model.dof_damping[:], model.dof_frictionloss[:] = 0, 0
    data, torques = mujoco.MjData(model), []
    for q, dq, ddq in zip(*states, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        torques.append(data.qfrc_inverse.copy())
    return np.array(torques)


def with_rotors(robot, phi, rotors, states):
    """The estimator's rigid part, and what the rotors add."""
    return bare_model(robot, phi).evaluate(*states)[0] + np.asarray(rotors) * states[2]


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    return path


def test_a_mujoco_model_is_a_robot(arm):
    robot = dyn.read_robot(arm)
    assert (robot.name, robot.joint_names) == ("arm", ["pan", "lift", "roll"])
    assert robot.joint_kinds == ["revolute", "prismatic", "revolute"]
    assert robot.link_names == ["upper/pan", "upper", "body_3"]
    assert_allclose(robot.gravity, [0.1, -2, -9])
    assert_allclose(robot.rotor_inertia, [0.3, 0, 0])
    assert_allclose([robot.lower[0], robot.upper[0], robot.effort_limits[0]], [*np.deg2rad([-115, 75]), 50])
    model = mujoco.MjModel.from_xml_path(str(arm))
    states = np.random.default_rng(0).uniform(-1, 1, (3, N_STATES, 3))
    # Where the fingers are held, and pan's reference.
    fingers = np.tile([0.01, 0.023], (N_STATES, 1))
    q = np.hstack([states[0] + [np.deg2rad(15), 0, 0], fingers])
    moving = [np.hstack([x, np.zeros((N_STATES, 2))]) for x in states[1:]]
    expected = rigid_torque(model, (q, *moving))[:, :3]
    found = with_rotors(robot, robot.phi, robot.rotor_inertia, states)
    assert_allclose(found, expected, rtol=0, atol=SAME_TORQUE * np.abs(expected).max())


def test_a_mujoco_model_has_its_tip_and_gravity(arm):
    robot = dyn.read_robot(arm, tip="upper", gravity=(0, 0, -1.6), rotor_inertia=[1, 2])
    assert robot.joint_names == ["pan", "lift"]
    assert (robot.gravity.tolist(), robot.rotor_inertia.tolist()) == ([0, 0, -1.6], [1, 2])
    text, _ = urdf_of(arm)
    assert '<dynamics damping="2.0" friction="3.0" />' in text


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('<joint name="pan"', '<freejoint name="free"/><joint name="pan"', "arm.xml: MuJoCo cannot read it: "),
        ('<joint name="roll" axis="1 2 2"', '<joint name="roll" type="ball"', "the joint roll is a ball"),
        (
            '<body name="stand" pos="0 0 0.5" euler="10 20 30">',
            '<body name="stand"><freejoint name="f"/><geom size="1"/>',
            'joint "f": is of type "floating".*choose base="stand"',
        ),
    ],
)
def test_what_no_chain_expresses_is_refused(arm, old, new, said):
    assert old in ARM
    arm.write_text(ARM.replace(old, new))
    with pytest.raises(ValueError, match=said):
        dyn.read_robot(arm)


@pytest.mark.parametrize("seed", range(6))
def test_the_exported_models_have_the_estimators_torque(seed, tmp_path):
    """Along random states: rigid bodies and rotors, by MuJoCo and by Pinocchio, and by us from MuJoCo's file."""
    drawn = random_chain(seed)
    robot = RobotModel.from_urdf_string(drawn.urdf, gravity=drawn.gravity)
    model = model_of(robot, seed)
    physical = model.physical
    states = np.random.default_rng(seed).uniform(-2, 2, (3, N_STATES, robot.n_joints))
    expected = with_rotors(robot, physical.phi, physical.rotor_inertia, states)
    size = np.abs(expected).max()
    path = tmp_path / "arm.xml"
    path.write_text(mjcf(model))
    in_mujoco = mujoco.MjModel.from_xml_path(str(path))
    assert_allclose(in_mujoco.dof_armature, physical.rotor_inertia, rtol=1e-15)
    assert_allclose(np.reshape(in_mujoco.dof_damping, (robot.n_joints, -1))[:, 0], physical.damping, rtol=1e-15)
    assert_allclose(in_mujoco.dof_frictionloss, physical.friction, rtol=1e-15)
    assert_allclose(in_mujoco.actuator_gear[:, 0], physical.drive_gain, rtol=1e-15)
    assert_allclose(rigid_torque(in_mujoco, states), expected, rtol=0, atol=SAME_TORQUE * size)
    back = dyn.read_robot(path)
    assert back.joint_names == robot.joint_names
    found = with_rotors(back, back.phi, back.rotor_inertia, states)
    assert_allclose(found, expected, rtol=0, atol=SAME_TORQUE * size)
    in_pinocchio = dyn.to_pinocchio(model)
    data, torques = in_pinocchio.createData(), []
    for q, dq, ddq in zip(*states, strict=True):
        joints = list(in_pinocchio.joints)[1:]
        places = [[np.cos(x), np.sin(x)] if joint.nq == 2 else [x] for joint, x in zip(joints, q, strict=True)]
        torques.append(pinocchio.rnea(in_pinocchio, data, np.concatenate(places), dq, ddq).copy())
    assert_allclose(torques, expected, rtol=0, atol=SAME_TORQUE * size)
    assert_allclose(in_pinocchio.damping, physical.damping)
    assert_allclose(in_pinocchio.friction, physical.friction)


def test_a_declared_effort_limits_the_joints_torque_whatever_drives_the_motor(tmp_path):
    """Of a motor that takes ampere its own range would be in ampere: 20 N m/A gave twenty times the torque."""
    robot = RobotModel.from_urdf_string(chain(["revolute", "prismatic"]))
    model = model_of(robot)
    bodies = model.physical
    driven = dyn.PhysicalSet(
        bodies.phi, bodies.rotor_inertia, damping=bodies.damping, friction=bodies.friction, drive_gain=[20.0, 1.0]
    )
    path = tmp_path / "arm.xml"
    path.write_text(mjcf(model.with_physical(driven)))
    in_mujoco = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(in_mujoco)
    for ctrl, torque in (([1e3, -1e3], [400.0, -400.0]), ([1.0, 1.0], [20.0, 1.0])):
        data.ctrl[:] = ctrl
        mujoco.mj_forward(in_mujoco, data)
        assert_allclose(data.qfrc_actuator, torque)
    assert dyn.read_robot(path).effort_limits.tolist() == [400.0, 400.0]


@pytest.mark.parametrize("kind", ["revolute", "prismatic", "continuous"])
@pytest.mark.parametrize(
    "limit", ["", '<limit lower="-1" upper="2"/>', '<limit velocity="3"/>', '<limit lower="-1" upper="2" effort="4"/>']
)
def test_limits_that_a_robot_lacks_keep_no_reader_away(kind, limit):
    """ROS takes no joint with half a limit, and no slide without one: robots out of MuJoCo's files have no speed."""
    robot = RobotModel.from_urdf_string(chain([kind] * 2, limits=False).replace("</joint>", f"{limit}</joint>"))
    model = model_of(robot)
    in_pinocchio = dyn.to_pinocchio(model)
    assert_allclose(in_pinocchio.velocityLimit, robot.velocity_limits)
    assert_allclose(in_pinocchio.effortLimit, robot.effort_limits)
    if in_pinocchio.nq == 2:
        assert_allclose(in_pinocchio.lowerPositionLimit, robot.lower)
        assert_allclose(in_pinocchio.upperPositionLimit, robot.upper)
    back = RobotModel.from_urdf_string(urdf(model).decode())
    for name in ("lower", "upper", "velocity_limits", "effort_limits"):
        assert getattr(back, name).tolist() == getattr(robot, name).tolist(), name


def test_the_command_writes_a_mujoco_model(tmp_path):
    robot = RobotModel.from_urdf_string(random_chain(1).urdf)
    model = model_of(robot)
    model.save(tmp_path / "model.json")
    printed = dynid("export", tmp_path / "model.json", "--mjcf", tmp_path / "arm.xml")
    assert printed.exit_code == 0, printed.output
    assert (tmp_path / "arm.xml").read_text() == mjcf(model)
    assert "ctrl is in N*m" in printed.stdout
    assert "say what to write" in refusal(
        dynid("export", tmp_path / "model.json", "--mjcf", tmp_path / "b.xml", "--urdf", tmp_path / "b.urdf")
    )
    bare_model(robot, model.phi).save(tmp_path / "bare.json")
    assert "--physical" in refusal(dynid("export", tmp_path / "bare.json", "--mjcf", tmp_path / "b.xml"))
    assert not (tmp_path / "b.xml").exists()


def test_without_a_physical_set_there_is_no_pinocchio_model():
    robot = RobotModel.from_urdf_string(random_chain(1).urdf)
    with pytest.raises(ValueError, match="identify it again with --physical"):
        dyn.to_pinocchio(bare_model(robot, robot.phi))
