"""A model as a person looks at it: friction over speed, what is left of a run, and its numbers as a table."""

import functools
import sys

import matplotlib
import numpy as np
import pytest
from helpers import printed
from helpers.diagnosed import ROBOT, measured
from helpers.small_arm import URDF

from dynid_rs import Effect, MissingLibraryError, Recording, RobotModel, ThreeLoopIdentifier, TorqueModel
from dynid_rs.base.drawing import chosen_joints
from dynid_rs.model.along import compared
from dynid_rs.regression.evaluation import band_rmse, r2

matplotlib.use("agg")  # no window, wherever this runs

NAMES = ["shoulder", "elbow", "wrist"]
WIDTH = [0.02, 0.03, 0.05]
FRICTION = np.array(
    [[3.0, 2.5, 1.0, 1.2, 0.1, -0.1, 0.02, 0.02], [2.0, 2.2, 0.8, 0.7, 0, 0, 0, 0], [1.0, 0.9, 0.3, 0.2, 0, 0, 0, 0]]
)
TOP = [2.0, 2.5, 3.0]


@pytest.fixture(autouse=True)
def _closed():
    yield
    import matplotlib.pyplot as plt

    plt.close("all")


def model(*more: tuple[Effect, np.ndarray], robot: RobotModel = ROBOT, **options) -> TorqueModel:
    """The small arm with the paper's friction, and more."""
    friction = (Effect.friction([0.0] * 3, WIDTH), FRICTION)
    given = {"torque_unit": "N*m", "noise_std": [0.3, 0.2, 0.1], "encoder_delay": [0.0] * 3, "step": 0.004}
    domain = ([[-1.0, 1.5]] * 3, TOP, [5.0, 6.0, 7.0])
    return TorqueModel(robot, robot.phi, [friction, *more], domain=domain, **(given | options))


def sliding() -> RobotModel:
    return RobotModel.from_urdf_string(URDF.replace('name="wrist" type="revolute"', 'name="wrist" type="prismatic"'))


@functools.cache
def identified() -> tuple[TorqueModel, tuple[Recording, ...]]:
    runs = measured()
    return ThreeLoopIdentifier(ROBOT, residual=None).fit(runs[:2]).model_, tuple(runs)


def test_the_curve_is_the_papers_friction():
    axes = model().plot_friction()
    assert axes.shape == (3,)
    for j, panel in enumerate(axes):
        (curve,) = panel.lines
        speed = curve.get_xdata()
        assert (speed[0], speed[-1]) == (-TOP[j], TOP[j])
        expected = printed.friction(speed, 0.0, WIDTH[j], FRICTION[j])
        np.testing.assert_allclose(curve.get_ydata(), expected, rtol=1e-12, atol=1e-12)
        assert panel.get_title(loc="left") == NAMES[j]
        assert (panel.get_xlabel(), panel.get_ylabel()) == ("speed [rad/s]", "friction [N·m]")
        assert not panel.collections


def test_friction_under_load_is_a_band_over_poses():
    """tau = c |tau_link| sign(dq): between nothing and what the heaviest pose of the training data takes."""
    share = 0.2
    kind = Effect.of("load_dependent_friction", transition_width=[0.02] * 3)
    loaded = model((kind, np.array([[0.0, 0.0], [share, 0.0], [0.0, 0.0]])))
    axes = loaded.plot_friction()
    assert [len(panel.collections) for panel in axes] == [0, 1, 0]  # the shoulder's axis is upright and carries nothing
    band = axes[1].collections[0].get_paths()[0].get_extents()
    plain = printed.friction(np.array(TOP[1:2]), 0.0, WIDTH[1], FRICTION[1])[0]
    corners = np.array([[0.0, e, w] for e in np.linspace(-1.0, 1.5, 41) for w in np.linspace(-1.0, 1.5, 41)])
    heaviest = np.abs(ROBOT.inverse_dynamics(corners, 0 * corners, 0 * corners)[:, 1]).max()
    assert plain < band.y1 < plain + 1.05 * share * heaviest
    assert band.y1 > plain + 0.8 * share * heaviest


@pytest.mark.parametrize("distance", [1e-4, 0.01, 0.2])
def test_hysteresis_is_what_it_becomes_in_steady_sliding(distance):
    """Its whole size against the motion, whatever way it takes to turn round."""
    hysteresis = Effect.of("friction_hysteresis", presliding_distance=[distance] * 3)
    axes = model((hysteresis, np.array([[0.0], [2.0], [0.0]]))).plot_friction()
    assert axes[0].figure.get_suptitle() == ""
    for j, (panel, plain) in enumerate(zip(axes, model().plot_friction(), strict=True)):
        speed, torque = panel.lines[0].get_data()
        more = (0.0, 2.0, 0.0)[j] * np.sign(speed)
        np.testing.assert_allclose(torque, plain.lines[0].get_ydata() + more, rtol=1e-6, atol=1e-9)
        assert not panel.collections


def test_what_speed_does_not_tell_is_named_and_not_drawn():
    warm = Effect.of("thermal_friction", time_constant=[600.0] * 3, reference_speed=[1.0] * 3, transition_width=WIDTH)
    axes = model((warm, np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 0.0]]))).plot_friction()
    assert axes[0].figure.get_suptitle() == "Not drawn, because speed alone does not tell it: thermal friction"
    for panel, plain in zip(axes, model().plot_friction(), strict=True):
        np.testing.assert_array_equal(panel.lines[0].get_ydata(), plain.lines[0].get_ydata())
    idle = model((warm, np.zeros((3, 2))))
    assert idle.plot_friction()[0].figure.get_suptitle() == ""


def test_friction_that_follows_a_temperature_is_drawn_at_its_own():
    kind = Effect.of(
        "temperature_friction",
        reference_temperature=[35.0] * 3,
        transition_width=WIDTH,
        **{name: FRICTION[:, k] for k, name in enumerate(Effect.friction([0.0] * 3, WIDTH).coefficient_names)},
    )
    for panel, plain in zip(
        model((kind, np.full((3, 1), -0.01))).plot_friction(), model().plot_friction(), strict=True
    ):
        np.testing.assert_allclose(panel.lines[0].get_ydata(), plain.lines[0].get_ydata(), rtol=1e-12)


def test_measured_dots_lie_on_the_curve_of_a_good_model():
    found, runs = identified()
    for panel in found.plot_friction(list(runs)):
        dots, curve = panel.lines
        assert dots.get_label() == "measured, less all else"
        x, y = (np.asarray(data, dtype=float) for data in dots.get_data())
        expected = np.interp(x, *curve.get_data())
        steady = np.isfinite(y) & (np.abs(x) > 0.3)
        assert steady.sum() > 100
        size = np.abs(curve.get_ydata()).max()
        assert np.sqrt(np.mean((y - expected)[steady] ** 2)) < 0.05 * size


def test_what_is_left_is_drawn_and_said():
    found, runs = identified()
    axes = found.plot_residual(runs[2])
    assert axes.shape == (3, 2)
    (comparison,) = compared(found, [runs[2]])
    for j, (left, right) in enumerate(axes):
        for line, values in zip(
            [*left.lines, *right.lines], (comparison.measured, comparison.predicted, comparison.error), strict=True
        ):
            drawn = np.asarray(line.get_ydata())
            counted = comparison.states.counted[:, j]
            np.testing.assert_array_equal(drawn[np.isfinite(drawn)], values[counted, j])
        error, explained = band_rmse([comparison])[j], r2([comparison])[j]
        assert right.get_title(loc="right") == f"RMSE {error:.3g} N·m, R² {explained:.4f}"
        assert left.get_title(loc="left") == NAMES[j]
        assert (left.get_ylabel(), right.get_ylabel()) == ("torque [N·m]", "left [N·m]")
    assert axes[2, 0].get_xlabel() == "time [s]"
    assert "below 5 Hz" in axes[0, 0].figure.get_suptitle()


def test_several_runs_stand_behind_each_other():
    found, runs = identified()
    axes = found.plot_residual(list(runs), joints=["wrist"])
    assert axes.shape == (1, 2)
    starts = [np.nanmin(line.get_xdata()) for line in axes[0, 1].lines]
    assert len(starts) == 3
    assert starts == sorted(starts)
    assert starts[2] == pytest.approx(runs[0].duration + runs[1].duration, abs=0.5)


def test_axes_of_ones_own_and_joints_by_name():
    import matplotlib.pyplot as plt

    _, mine = plt.subplots(1, 2)
    drawn = model().plot_friction(joints=["wrist", 0], axes=mine)
    assert [panel.get_title(loc="left") for panel in mine] == ["wrist", "shoulder"]
    assert drawn[0] is mine[0]
    with pytest.raises(ValueError, match="there is no joint 'knee'"):
        model().plot_friction(joints=["knee"])


def test_without_matplotlib_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(MissingLibraryError, match=r"plots need the library matplotlib.*pip install 'dynid-rs\[plot\]'"):
        model().plot_friction()


def test_a_joint_that_slides_has_newtons():
    axes = model(robot=sliding()).plot_friction()
    assert (axes[2].get_xlabel(), axes[2].get_ylabel()) == ("speed [m/s]", "friction [N]")
    rows = {row.name: row for row in model(robot=sliding()).summary().rows}
    assert rows["friction: viscous1 pos"].units == ("N*m*s/rad", "N*m*s/rad", "N*s/m")


def test_the_summary_holds_every_number():
    hysteresis = Effect.of("friction_hysteresis", presliding_distance=[0.01] * 3)
    found = model((hysteresis, np.array([[0.0], [2.0], [0.0]])), torque_scale=[1.0, 1.1, 1.0], torque_delay=0.002)
    said = found.summary()
    table = said.to_dict()["rows"]
    assert table["friction: coulomb pos"]["elbow"] == {"value": 2.0, "unit": "N*m"}
    assert table["friction hysteresis: hysteresis"]["elbow"] == {"value": 2.0, "unit": "N*m"}
    assert table["friction hysteresis: hysteresis"]["wrist"]["value"] is None
    assert table["friction hysteresis: presliding distance"]["elbow"] == {"value": 0.01, "unit": "rad"}
    assert table["left by the model (std)"]["shoulder"] == {"value": 0.3, "unit": "N*m"}
    assert table["torque channel's gain"]["elbow"]["value"] == 1.1
    lines = str(said).splitlines()
    assert lines[0] == "Torque model of small_arm: 3 joints, in N·m"
    assert lines[1].split() == ["unit", *NAMES]
    assert any(line.startswith("friction: viscous2 neg") and "N·m·(s/rad)²" in line for line in lines)
    assert "The torque channel is late by 2 ms." in str(said)
    each = found.with_torque_delay([0.0, 0.002, -0.0013]).summary()
    assert "Torque channels are late: elbow by 2 ms, wrist by -1.3 ms." in str(each)
    assert "friction: coulomb pos" in found._repr_html_()


def test_the_summary_of_a_fit_says_where_errors_are_told():
    assert "errors told below 5 Hz" in str(identified()[0].summary())


def test_no_joint_is_nothing_to_draw():
    with pytest.raises(ValueError, match="joints: none is given; expected some of a, b"):
        chosen_joints([], ["a", "b"])
