"""`dynid export`: a URDF edited in place, byte for byte but for inertials and dynamics."""

import re

import numpy as np
import pytest
from helpers.engines import Pinocchio
from helpers.link_models import bare_model, model_of
from helpers.robots import chain, random_chain, random_states
from helpers.small_arm import URDF, dynid, refusal, snapshot
from numpy.testing import assert_allclose

from dynid_rs import RobotModel, UrdfError
from dynid_rs.model.export import urdf

ROUND_TRIP = 1e-9
CHANGED = re.compile(r"\s*<inertial>.*?</inertial>|\s*<inertial\s*/>|\s*<dynamics\b[^>]*?/>", re.S)
"""What an export may change, with the white space before it."""

ODD = """\ufeff<?xml version="1.0" encoding="utf-8"?>\r
<!-- a comment with <inertial> in it -->\r
<robot name="odd &amp; arm" xmlns:drake="http://drake.mit.edu">\r
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>\r
  <link name="world"/>\r
  <joint name="mount" type="fixed"><parent link="world"/><child link="base"/><origin rpy="0 0.3 0"/></joint>\r
  <link name="base"><inertial><mass value="7"/>\r
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>\r
  <link name="upper">\r
    <visual><geometry><mesh filename="package://arm/upper &lt;1&gt;.dae"/></geometry></visual>\r
    <unknown:tag xmlns:unknown="urn:x" a='1'><![CDATA[ <inertial> & <dynamics> ]]></unknown:tag>\r
    <inertial>\r
      <!-- measured by hand -->\r
      <origin xyz="0 0 0.05"/><mass value="8"/>\r
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.08"/>\r
    </inertial>\r
  </link>\r
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>\r
    <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="3" effort="80"/>\r
    <dynamics spring_stiffness = '4' damping='0.1'/></joint>\r
  <link name="fore"/>\r
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>\r
    <origin xyz="0 0 0.1"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="3" effort="60"/></joint>\r
  <link name="cover"><inertial><mass value="1"/>\r
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>\r
  <joint name="screw" type="fixed"><parent link="fore"/><child link="cover"/></joint>\r
  <transmission name="t"><joint name="elbow"><dynamics damping="3"/></joint><actuator name="m"/></transmission>\r
  <gazebo reference="fore"><inertial>kept</inertial></gazebo>\r
</robot>\r
<!-- the end -->"""


@pytest.fixture
def odd(tmp_path):
    path = tmp_path / "odd.urdf"
    path.write_bytes(ODD.encode())
    return path, model_of(RobotModel.from_urdf(path, base="base"))


def rest(text):
    """The text without what may change; comments, CDATA and foreign elements protected."""
    kept = re.compile(r"<!--.*?-->|<!\[CDATA\[.*?\]\]>|<gazebo.*?</gazebo>|<transmission.*?</transmission>", re.S)
    parts, last = [], 0
    for match in kept.finditer(re.sub(r"<!-- measured by hand -->", "", text)):
        parts.append(CHANGED.sub("", match.string[last : match.start()]))
        parts.append(match.group())
        last = match.end()
    parts.append(CHANGED.sub("", re.sub(r"<!-- measured by hand -->", "", text)[last:]))
    return "".join(parts)


def test_everything_but_inertials_and_dynamics_stays_byte_for_byte(odd):
    path, model = odd
    text = urdf(model, path).decode()
    assert text != ODD
    # <link name="fore"/> is opened for its inertial; that is all.
    opened = re.compile(r'<link name="fore">\s*</link>')
    assert opened.sub('<link name="fore"/>', rest(text)) == rest(ODD)
    assert "\n" not in text.replace("\r\n", "")
    for kept in ('<mass value="7"/>', "<![CDATA[ <inertial> & <dynamics> ]]>", "<inertial>kept</inertial>"):
        assert kept in text
    assert '<joint name="elbow"><dynamics damping="3"/></joint>' in text


def test_the_moving_link_gets_the_total_and_its_fixed_children_none(odd):
    path, model = odd
    text = urdf(model, path).decode()
    assert '<link name="cover"></link>' in text
    back = RobotModel.from_urdf_string(text.lstrip("\ufeff"), base="base")
    assert_allclose(back.phi, model.physical_phi, rtol=0, atol=ROUND_TRIP)


def test_dynamics_keep_their_other_attributes(odd):
    path, model = odd
    text = urdf(model, path).decode()
    damping, friction = model.physical.damping, model.physical.friction
    assert f"<dynamics friction=\"{friction[0]}\" spring_stiffness = '4' damping='{damping[0]}'/>" in text
    assert f'<dynamics damping="{damping[1]}" friction="{friction[1]}"/>' in text


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("with_original", [True, False])
def test_any_chain_gives_the_same_torque_after_the_round_trip(seed, with_original, tmp_path):
    """Odd frames and axes, fixed links at every place: our reader and Pinocchio's, against the set's own torque."""
    chain = random_chain(seed)
    path = tmp_path / "chain.urdf"
    path.write_text(chain.urdf)
    model = model_of(RobotModel.from_urdf(path, gravity=chain.gravity), seed)
    text = urdf(model, path if with_original else None).decode()
    states = random_states(20, chain.n_joints, seed)
    expected = model.robot.inverse_dynamics(*states, model.physical_phi)
    back = RobotModel.from_urdf_string(text, gravity=chain.gravity)
    assert back.joint_names == model.robot.joint_names
    size = np.abs(expected).max()
    assert_allclose(back.inverse_dynamics(*states), expected, rtol=0, atol=ROUND_TRIP * size)
    if with_original:  # there Pinocchio's own gravity frame is the root's
        assert back.link_names == model.robot.link_names
    else:
        pinocchio = Pinocchio(text, chain.gravity)
        assert_allclose(pinocchio.inverse_dynamics(*states), expected, rtol=0, atol=ROUND_TRIP * size)
        for name in ("lower", "upper", "velocity_limits", "effort_limits"):
            assert np.array_equal(getattr(back, name), getattr(model.robot, name)), name
        assert_allclose(back.rotor_inertia, model.physical.rotor_inertia, rtol=1e-15)


def test_another_robot_is_refused_with_the_difference(odd, tmp_path):
    _, model = odd
    other = tmp_path / "other.urdf"
    for text, said in (
        (URDF.replace('xyz="0 0 0.1"', 'xyz="0 0 0.2"'), 'the joint "elbow" has another'),
        (URDF.replace("shoulder", "hip"), 'no joint is named "shoulder"'),
        (ODD.replace('xyz="0 0 0.3"', 'xyz="0 0 0.31"').lstrip("\ufeff"), 'the joint "shoulder" has another'),
        (ODD.replace('"elbow"', '"knee"').lstrip("\ufeff"), 'joint 1 is "knee"'),
    ):
        other.write_text(text)
        with pytest.raises(UrdfError, match=said) as caught:
            urdf(model, other)
        assert "another robot than the model's" in str(caught.value)
        assert "give the URDF that the model was identified with" in str(caught.value)


def test_the_command_writes_the_file(odd, tmp_path):
    path, model = odd
    model.save(tmp_path / "model.json")
    printed = dynid("export", tmp_path / "model.json", "--urdf", tmp_path / "out.urdf", "--robot", path)
    assert printed.exit_code == 0, printed.output
    assert (tmp_path / "out.urdf").read_bytes() == urdf(model, path)
    assert "no place for rotor inertias" in printed.stdout
    printed = dynid("export", tmp_path / "model.json", "--urdf", tmp_path / "min.urdf", "--json")
    assert printed.exit_code == 0
    assert (tmp_path / "min.urdf").read_bytes() == urdf(model)


def test_rotor_inertias_are_said_in_the_joints_own_units(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(chain(["revolute", "prismatic"]))
    model = model_of(RobotModel.from_urdf(path))
    model.save(tmp_path / "model.json")
    printed = dynid("export", tmp_path / "model.json", "--urdf", tmp_path / "out.urdf", "--robot", path)
    turning, sliding = model.physical.rotor_inertia
    assert f"joint by joint: {turning:.4g} kg*m^2, {sliding:.4g} kg\n" in printed.stdout


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ("no_set", "--physical"),
        ("other_robot", "another robot than the model's"),
        ("missing_folder", "does not exist"),
        ("folder", "this is a folder"),
        ("onto_original", "would be replaced"),
        ("no_model", "does not exist"),
        ("broken_original", "never closed"),
        ("a_table", "only a URDF can be edited"),
    ],
)
def test_bad_input_is_refused_in_a_sentence_and_nothing_is_written(spoil, said, odd, tmp_path):
    path, model = odd
    source, target, original = tmp_path / "model.json", tmp_path / "out.urdf", path
    model.save(source)
    if spoil == "no_set":
        bare_model(model.robot, model.phi).save(source)
    elif spoil == "other_robot":
        original = tmp_path / "other.urdf"
        original.write_text(URDF.replace('xyz="0 0 0.1"', 'xyz="0 0 0.2"'))
    elif spoil == "missing_folder":
        target = tmp_path / "nowhere" / "out.urdf"
    elif spoil == "folder":
        target.mkdir()
    elif spoil == "onto_original":
        target = original
    elif spoil == "no_model":
        source = tmp_path / "none.json"
    elif spoil == "broken_original":
        original = tmp_path / "broken.urdf"
        original.write_text(ODD[1:].replace("</robot>", ""))
    elif spoil == "a_table":
        original = tmp_path / "robot.toml"
    before = snapshot(tmp_path)
    sentence = refusal(dynid("export", source, "--urdf", target, "--robot", original))
    assert said in sentence
    assert snapshot(tmp_path) == before


def test_a_file_that_is_there_is_replaced_with_force_only(odd, tmp_path):
    path, model = odd
    model.save(tmp_path / "model.json")
    (tmp_path / "out.urdf").write_text("mine")
    words = ("export", tmp_path / "model.json", "--urdf", tmp_path / "out.urdf", "--robot", path)
    assert "out.urdf: there is one already; name another file, or replace it with --force" in refusal(dynid(*words))
    assert (tmp_path / "out.urdf").read_text() == "mine"
    assert dynid(*words, "--force").exit_code == 0
    assert "<robot" in (tmp_path / "out.urdf").read_text()


def test_a_model_without_a_set_gives_no_urdf(odd):
    path, model = odd
    with pytest.raises(ValueError, match="--physical"):
        urdf(bare_model(model.robot, model.phi), path)
