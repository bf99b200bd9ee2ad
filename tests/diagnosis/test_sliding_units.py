"""Numbers of effects are told in the units of their joint: a slide's in N and m, a current's in A."""

import re

import pytest
from helpers.diagnosed import recorded, rigid, with_effects
from helpers.small_arm import URDF

import dynid_rs as dyn
from dynid_rs.model.physical_result import _reason
from dynid_rs.model.units import load_unit, shape_unit

SLIDE = dyn.RobotModel.from_urdf_string(URDF.replace('"revolute"', '"prismatic"', 1), tip="upper")


def test_what_is_found_on_a_slide_is_a_force():
    robot = SLIDE
    found = dyn.diagnose(robot, recorded(with_effects(rigid(robot), "friction_hysteresis:shoulder")))
    (effect,) = found.effects
    assert {number.name: number.unit for number in effect.parameters} == {"hysteresis": "N", "presliding_distance": "m"}
    assert re.search(r"hysteresis \S+ N \(", str(effect))


@pytest.mark.parametrize(
    ("torque", "kind", "unit"), [("N*m", "revolute", "N*m"), ("N*m", "prismatic", "N"), ("A", "revolute", "A")]
)
@pytest.mark.parametrize("load", ["hysteresis_load", "carried_load"])
def test_the_load_along_which_a_gear_loses_is_in_the_channel_s_unit(load, torque, kind, unit):
    assert shape_unit(load, torque, kind) == unit


def test_drive_gains_of_slides_are_forces_per_ampere():
    assert "(5.5 N/A) is the one" in _reason(SLIDE, [0.0], [5.5])


def test_moments_of_a_load_have_a_unit_as_its_mass_has():
    assert [load_unit(unit, "kg*m") for unit in ("N*m", "A")] == ["kg*m", "kg*m A/(N*m)"]
