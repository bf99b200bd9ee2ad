"""Effects on the page: families, curves with quantity and unit on both axes, and what is folded away."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from helpers import made_diagnosis
from test_diagnosis_report import make_diagnosis, make_residuals, page_of
from test_report import array_of, data_of, write_inputs

from dynid_rs.report import write_report
from dynid_rs.report.families import families


def test_dots_curve_and_interval_reach_the_page(tmp_path: Path) -> None:
    result = make_diagnosis(2)
    source, _ = page_of(tmp_path, result)
    data = data_of(source)

    def array(name: str) -> np.ndarray:
        return array_of(source, name)

    plot = result["effects"][0]["plot"]
    (panel,) = data["figures"]["effect-0"]["panels"]
    dots, band, means, curve = panel["series"]
    assert (panel["x"], panel["y"]) == ("speed [rad/s]", "torque [N\u00b7m]")
    np.testing.assert_allclose(array(dots["y"]), plot["partial"], rtol=1e-6)
    np.testing.assert_allclose(array(curve["x"]), plot["curve_x"], rtol=1e-6)
    np.testing.assert_allclose(array(curve["y"]), plot["curve"], rtol=1e-6)
    np.testing.assert_allclose(array(means["y"]), plot["mean"], rtol=1e-6)
    np.testing.assert_allclose(array(band["low"]), plot["curve_low"], rtol=1e-6)
    assert [series["name"] for series in data["figures"]["time-0"]["panels"][1]["series"]] == [
        "residual before",
        "residual",
    ]


@pytest.mark.parametrize(
    ("signal", "unit", "quantity", "axes"),
    [
        ("dq_{j}", "rad/s", "torque", ("speed [rad/s]", "torque [N\u00b7m]")),
        ("q_{j}", "rad", "torque", ("angle [rad]", "torque [N\u00b7m]")),
        ("q_{j}", "m", "torque", ("position [m]", "torque [N\u00b7m]")),
        ("tau_link_{j}", "N*m", "friction_torque", ("gear torque [N\u00b7m]", "friction torque [N\u00b7m]")),
        ("temperature_{j}", "degC", "friction_torque", ("temperature [\u00b0C]", "friction torque [N\u00b7m]")),
        ("t", "s", "friction_torque", ("time since the start of the run [s]", "friction torque [N\u00b7m]")),
        ("ddq_{k}", "rad/s^2", "torque", ("acceleration of joint_1 [rad/s\u00b2]", "torque [N\u00b7m]")),
        ("q_{j}", "rad", "deflection", ("angle [rad]", "motor minus link angle [rad]")),
    ],
)
def test_axes_say_quantity_and_unit(
    tmp_path: Path, signal: str, unit: str, quantity: str, axes: tuple[str, str]
) -> None:
    result = make_diagnosis(2)
    plot = result["effects"][0]["plot"]
    plot |= {"signal": signal.format(j="joint_0", k="joint_1"), "unit": unit, "quantity": quantity, "joint": "joint_0"}
    plot |= {"value_unit": "rad"} if quantity == "deflection" else {}
    (panel,) = data_of(page_of(tmp_path, result)[0])["figures"]["effect-0"]["panels"]
    assert (panel["x"], panel["y"]) == axes


@pytest.mark.parametrize(("kind", "name"), [("torque_delay", "delay"), ("torque_gain", "gain")])
def test_what_the_torque_channel_does_is_drawn_from_the_residuals(tmp_path: Path, kind: str, name: str) -> None:
    """The line has the slope that was found, and the mean of the data lies on it where the model leaves noise."""
    result = make_diagnosis(2)
    size = {"name": name, "value": 0.02, "unit": "s", "interval": [0.015, 0.025]}
    result["effects"][1] |= {"kind": kind, "parameters": [size], "ties": [], "joints": ["joint_0"]}
    table = make_residuals(2)
    table["residual_0"] = np.random.default_rng(0).normal(0.0, 0.01, len(table["t"]))
    source = write_report(write_inputs(tmp_path, result, table)).read_text("utf-8")
    (panel,) = data_of(source)["figures"]["effect-1"]["panels"]
    axes = {"torque_delay": "rate of the torque [N\u00b7m/s]", "torque_gain": "motor torque [N\u00b7m]"}
    assert (panel["x"], panel["y"]) == (axes[kind], "torque [N\u00b7m]")
    _, band, means, line = panel["series"]
    x, y = array_of(source, line["x"]), array_of(source, line["y"])
    slope = -0.02 if kind == "torque_delay" else 0.02
    np.testing.assert_allclose(y, slope * x, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(array_of(source, means["y"]), y, atol=0.01)
    low, high = array_of(source, band["low"]), array_of(source, band["high"])
    np.testing.assert_allclose(high - low, 0.01 * np.abs(x), rtol=1e-4, atol=1e-6)


def test_an_effect_without_a_name_has_no_numbers_of_the_law_that_stands_in_for_it(tmp_path: Path) -> None:
    result = make_diagnosis(2)
    (unknown,) = (entry for entry in result["effects"] if entry["kind"] == "unknown")
    result["effects"] = [unknown | {"told_as": "stribeck"}]
    _, page = page_of(tmp_path, result)
    assert "stribeck" not in page.text
    assert "Unknown effect" in page.text
    result["effects"][0]["ties"] = [made_diagnosis.tie("joint_spring", "joint_0", [1.0])]  # one or the other
    assert "stribeck pos" in page_of(tmp_path, result)[1].text


def test_a_channel_that_is_early_is_not_said_to_be_late(tmp_path: Path) -> None:
    result = make_diagnosis(3)
    early = {"name": "delay", "value": -0.02, "unit": "s", "interval": [-0.025, -0.015]}
    entry = made_diagnosis.entry("torque_delay", result["joints"], [2.0] * 3, [1.0] * 3)
    result["effects"] = [entry | {"parameters": [early]}]
    _, page = page_of(tmp_path, result)
    assert "The torque channel comes late" not in page.text
    assert "or earlier where its delay is negative" in page.text


def test_points_of_a_delay_of_all_joints_are_of_one_joint_alone(tmp_path: Path) -> None:
    result = make_diagnosis(3)
    drawn = {**made_diagnosis.plot("tau_rate_joint_1"), "joint": "joint_1"}
    result["effects"] = [made_diagnosis.entry("torque_delay", result["joints"], [2.0] * 3, [1.0] * 3, plot=drawn)]
    _, page = page_of(tmp_path, result)
    assert "Drawn on joint_1, which shows most of it." in page.text
    result["effects"][0]["kind"] = "gravity_tilt"
    _, page = page_of(tmp_path, result)
    assert "the other joints\u2019 angles count too" in page.text


def test_signals_of_slides_are_no_angles(tmp_path: Path) -> None:
    result = make_diagnosis(2) | {"torque_units": ["N", "N*m"]}
    signals = [{"signal": f"{name}_joint_0", "strength": 0.4, "direct": True} for name in ("q", "q_motor")]
    result["unexplained"] = [made_diagnosis.leftover("joint_0", depends_on=signals)]
    result["effects"] = []
    text = page_of(tmp_path, result)[1].text.partition("What is left")[2]
    assert "motor position of joint_0" in text
    assert "angle" not in text.partition("Torque over time")[0]


def test_small_angles_are_drawn_in_thousandths(tmp_path: Path) -> None:
    result = make_diagnosis(2)
    plot = result["effects"][0]["plot"]
    for key in ("x", "curve_x"):
        plot[key] = [0.004 * value for value in plot[key]]
    plot |= {"signal": "way_joint_0", "unit": "rad", "quantity": "friction_torque"}
    source, _ = page_of(tmp_path, result)
    (panel,) = data_of(source)["figures"]["effect-0"]["panels"]
    assert panel["x"] == "way since the joint last turned round [mrad]"
    drawn = array_of(source, panel["series"][-1]["x"])
    np.testing.assert_allclose(drawn, 1e3 * np.array(plot["curve_x"]), rtol=1e-6)


def test_effects_below_the_noise_are_folded_away() -> None:
    """Folded: an interval of the change that holds zero, and what lies above the band; not: what was not measured."""
    result = make_diagnosis(3)
    first, tilt, unknown = result["effects"]
    first["rmse_test_change_interval"] = [[-0.4, -0.2], None, None]
    tilt |= {"rmse_test_before": [1.0] * 3, "rmse_test_after": [1.0] * 3}  # its fit cannot be undone
    unknown["rmse_test_change_interval"] = [[-0.1, 0.05], None, None]
    unknown["rmse_test_before"] = [2.0 * x for x in unknown["rmse_test_after"]]
    ripple = made_diagnosis.entry("torque_ripple", ["joint_1"], [], [], above_band=True)
    found, small = families(result | {"effects": [first, tilt, unknown, ripple]})
    assert [family.name for family in found] == ["load-dependent friction", "gravity tilt"]
    assert [family.name for family in small] == ["unknown effect", "torque ripple"]


def test_without_an_interval_of_the_change_the_error_s_own_decides() -> None:
    result = make_diagnosis(3)
    entry = result["effects"][0] | {"rmse_test_change_interval": None}
    test = result["rmse"]["test"]
    after = test["after"][0]
    test["after_interval"][0] = [0.8 * after, 1.2 * after]
    for before, matters in ((1.1 * after, False), (1.3 * after, True)):
        entry |= {"rmse_test_before": [before, 1.0, 1.0], "rmse_test_after": [after, 1.0, 1.0]}
        assert bool(families(result | {"effects": [entry]})[0]) == matters


def test_a_family_stands_once_with_all_its_joints(tmp_path: Path) -> None:
    result = make_diagnosis(3)
    before, after = (result["rmse"]["test"][key] for key in ("before", "after"))
    either = {"kind": "unknown", "told_as": "stribeck"}
    ties = [made_diagnosis.tie("torque_ripple", "joint_1", after)]
    result["effects"] = [
        made_diagnosis.entry("friction_hysteresis", [joint], before, after, plot=None)
        for joint in ("joint_0", "joint_2")
    ] + [made_diagnosis.entry("x", ["joint_1"], before, after, ties=ties) | either]
    for effect in result["effects"]:
        effect["rmse_test_change_interval"] = [[-0.4, -0.2]] * 3
    source, page = page_of(tmp_path, result)
    titles = re.findall(r"<h3>([^<]*?) <span class=\"soft\">on ([^<]*)</span></h3>\n<p class=\"meaning\">", source)
    assert titles == [("Friction hysteresis", "joint_0 and joint_2"), ("Stribeck or torque ripple", "joint_1")]
    answer = " ".join(page.text.partition("What was missing?")[2].partition("What to do next?")[0].split())
    assert answer.startswith("Friction hysteresis on joint_0 and joint_2; stribeck or torque ripple on joint_1.")
