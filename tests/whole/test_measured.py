"""Measured arms through the plain command, no option given: errors, lists, names, and no joint worse."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path

import numpy as np
import pytest
from helpers.data import data_folder
from helpers.measured_sets import (
    MOST_OF_DECLARED,
    MOST_OF_WLS,
    REACHED,
    SETS,
    SLACK,
    missing_names,
    relative,
    worst_ratio,
)
from helpers.result_files import validator


@functools.cache
def diagnosed(name):
    """result.json of a set and bytes of its report, diagnosed once per session."""
    data_folder()
    with tempfile.TemporaryDirectory() as folder:
        result = SETS[name].answer("diagnose", Path(folder) / "out")
        return result, (Path(folder) / "out" / "report.html").stat().st_size


def answer(name):
    return diagnosed(name)[0]


@pytest.mark.parametrize("name", SETS)
def test_errors_on_unseen_runs(name):
    result, limits, reached = answer(name), SETS[name].limits, REACHED[name]
    validator().validate(result)
    errors = np.array(relative(result))
    print(name, errors.round(3))
    least = np.maximum(0.0 if limits.error is None else limits.error, SLACK * np.array(reached.error))
    assert np.all(errors <= least), (errors / least).round(3)


@pytest.mark.parametrize("name", SETS)
def test_no_joint_is_worse_than_declared_or_than_least_squares(name):
    result, reached = answer(name), REACHED[name]
    of_declared, of_wls = worst_ratio(result, "before"), worst_ratio(result, "wls")
    print(name, round(of_declared, 3), round(of_wls, 3))
    assert of_declared <= max(MOST_OF_DECLARED, SLACK * reached.of_declared)
    assert of_wls <= max(MOST_OF_WLS, SLACK * reached.of_wls)


@pytest.mark.parametrize("name", SETS)
def test_a_list_that_a_person_believes(name):
    result, limits, reached = answer(name), SETS[name].limits, REACHED[name]
    print(name, [(effect["kind"], effect["joints"]) for effect in result["effects"]])
    assert len(result["effects"]) <= max(limits.effects, reached.effects)
    if reached.named:
        assert missing_names(result, limits) == []


def test_the_ur10e_s_names():
    """Load friction on shoulder and elbow, memory on the wrists; nothing of the sensors is accused."""
    result = answer("ur10e")
    named = {(effect["kind"], joint) for effect in result["effects"] for joint in effect["joints"]}
    for joint in ("shoulder_lift_joint", "elbow_joint"):
        # They differ in the first milliradians after a reversal only.
        assert named & {("load_dependent_friction", joint), ("load_hysteresis", joint)}
    for joint in ("wrist_1_joint", "wrist_2_joint", "wrist_3_joint"):
        assert ("friction_hysteresis", joint) in named
    assert not [f for f in result["data"]["findings"] if f["severity"] == "error" or f["code"] == "contact"]
    assert not any("delay" in effect["kind"] or "gain" in effect["kind"] for effect in result["effects"])


def test_the_ur10e_s_load_friction_is_drawn_as_it_acts():
    """Friction over the load is a V: none without a load, in the direction of motion on both sides."""
    result = answer("ur10e")
    effects = [
        effect for effect in result["effects"] if effect["kind"] in ("load_dependent_friction", "load_hysteresis")
    ]
    assert effects
    for effect in effects:
        plot = effect["plot"]
        load, friction = np.abs(plot["curve_x"]), np.array(plot["curve"])
        assert np.all(friction[load > 0.5 * load.max()] > 0)
        assert np.corrcoef(load, friction)[0, 1] > 0.95
        assert np.corrcoef(plot["mean"], friction)[0, 1] > 0.95  # and the data say so


def test_the_ur10e_s_report_is_small():
    _, size = diagnosed("ur10e")
    print(size)
    assert size <= 1_500_000


def test_the_kuka_s_encoders_are_on_two_clocks():
    result = answer("kuka")
    (clock,) = (effect for effect in result["effects"] if effect["kind"] == "encoder_delay")
    assert clock["joints"] == result["joints"][:3]
    low, high = clock["parameters"][0]["interval"]
    assert 2.5e-3 < low < high < 3.4e-3
