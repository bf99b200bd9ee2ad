"""Two slides and a wrist that turns about one axis: most of a load's inertia shows in no torque, and forces are N."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.small_arm import dynid

import dynid_rs as dyn
from dynid_rs.reference.changes import Believed, ChangeColumns, hypotheses
from dynid_rs.reference.compare import compare
from dynid_rs.simulation import build_effects, equip, parse_wish, simulate, typical_arm


def part(name, parent, kind, axis, mass, effort):
    return f"""<link name="{name}"><inertial><origin xyz="0.1 0 0.02"/><mass value="{mass}"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
      <joint name="j{name}" type="{kind}"><parent link="{parent}"/><child link="{name}"/><origin xyz="0 0 0.2"/>
      <axis xyz="{axis}"/><limit lower="-1" upper="1" effort="{effort}" velocity="1.5"/></joint>"""


PARTS = (
    part("x", "base", "prismatic", "1 0 0", 20, 500),
    part("z", "x", "prismatic", "0 0 -1", 8, 300),
    part("tool", "z", "revolute", "0 1 0", 2, 40),
)
ROBOT = dyn.RobotModel.from_urdf_string(f'<robot name="gantry"><link name="base"/>{"".join(PARTS)}</robot>')
SHOWN = {"mass", "hx", "hz", "Iyy"}


@pytest.fixture(scope="module")
def runs():
    """Runs without a load, and with one."""
    arm = replace(typical_arm(ROBOT).rigid(), delay=0.0)
    loaded = equip(arm, build_effects([parse_wish("payload")], typical_arm(ROBOT)))
    return [simulate(one, n_runs=3, duration=10.0, seed=seed).recordings for seed, one in enumerate((arm, loaded))]


@pytest.fixture(scope="module")
def reference(runs):
    return dyn.ThreeLoopIdentifier(ROBOT, residual=None).fit(runs[0]).model_


def test_what_no_torque_shows_of_a_payload_has_no_interval(reference, runs):
    (effect,) = compare(reference, ROBOT, runs[1][:2], runs[1][2:]).effects
    assert effect["kind"] == "payload"
    assert {number["name"] for number in effect["parameters"] if number["interval"] is not None} == SHOWN


def test_nobody_is_told_to_turn_faster_about_axes_that_are_not_there(reference, runs, tmp_path):
    reference.save(tmp_path / "model.json")
    runs[1][0].to_dataframe("polars").write_parquet(tmp_path / "run.parquet")
    said = dynid("payload", tmp_path / "model.json", tmp_path / "run.parquet").stdout
    assert "(not seen) kg*m^2" in said
    assert "do not determine Ixx, Iyy, Izz, which may as well be zero\n" in said
    assert "the runs do not show all of the load" in said


def test_changes_of_a_slide_are_forces(reference):
    believed = Believed.unchanged(reference, np.zeros(30))
    units = {h.place: h.units for h in hypotheses(believed, ChangeColumns([], np.zeros((30, 0)), 0))}
    assert units["friction", (0,)] == ("1", "N", "N*s/m")
    assert units["friction", (2,)] == ("1", "N*m", "N*m*s/rad")
    assert {units["torque_offset", (j,)] for j in (0, 1)} == {("N",)}
