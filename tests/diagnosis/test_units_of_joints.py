"""Numbers of effects are told in the units of their joint: a slide's in N and m, a current's in A."""

import re

import numpy as np
import pytest
from helpers.diagnosed import recorded, rigid, with_effects
from helpers.link_models import bare_model
from helpers.small_arm import URDF

import dynid_rs as dyn
from dynid_rs.diagnosis.estimates import _coefficients, _shape
from dynid_rs.model.assembly import with_changes
from dynid_rs.model.physical_result import _reason
from dynid_rs.model.placed import PlacedEffect
from dynid_rs.model.units import load_unit, shape_unit
from dynid_rs.reference.gear_loss import GearLoss

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


@pytest.mark.parametrize(("torque", "unit"), [("N*m", "kg"), ("A", "kg A/(N*m)")])
def test_what_of_a_load_may_be_a_gear_s_loss_is_no_kilogram_in_ampere(torque, unit):
    reference = with_changes(bare_model(SLIDE, SLIDE.phi), torque_unit=torque)
    finding = GearLoss((0,), np.zeros(1)).finding(reference, 0.09)
    assert f"up to 0.09 {unit} of the load may be that" in finding.message
    assert finding.unit == unit


def test_a_gear_loses_in_the_amperes_of_its_own_channel():
    """Where the first joint shows 1 A of a load, the second shows 0.5; the model counts as the first."""
    gear = PlacedEffect.at("gear_hysteresis", 1, hysteresis_load=2.0, carried_load=0.1)
    scale = np.array([1.0, 0.5])
    (lost,) = _coefficients(gear, np.array([0.3]), np.array([0.0]), scale, scale)
    load = _shape(gear, "hysteresis_load", 0.1, scale)
    assert (lost.value, load.value) == (0.3, 1.0)
    assert load.interval[0] < 1.0 < load.interval[1] < 1.3
