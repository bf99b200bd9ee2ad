"""Recordings in a notebook: cut by seconds or rows, put together, said, shown and drawn."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from helpers.run_files import motion, valid_columns, write_csv

from dynid_rs import DataError, MissingLibraryError, Recording, Recordings, read_recording

matplotlib.use("agg")  # no window, wherever this runs

NAMES = ("shoulder", "elbow", "wrist")


def valid(**changes) -> Recording:
    t, q, dq, ddq = motion()  # 4 s at 100 Hz
    given = {"t": t, "q": q, "tau": ddq + dq, "dq": dq, "name": "run.csv", "joints": NAMES, "first_line": 2}
    return Recording(**(given | changes))


@pytest.fixture(autouse=True)
def _closed():
    yield
    import matplotlib.pyplot as plt

    plt.close("all")


@pytest.mark.parametrize(
    ("key", "rows"),
    [
        (slice(1.0, 3.0), (100, 300)),
        (slice(None, 1.005), (0, 101)),
        (slice(3.5, None), (350, 400)),
        (slice(np.float64(1.0), np.float32(3.0)), (100, 300)),
        (slice(-7.0, 99.0), (0, 400)),
        (slice(100, 300), (100, 300)),
        (slice(-50, None), (350, 400)),
        (slice(np.int64(100), 300), (100, 300)),
        (slice(None, None), (0, 400)),
    ],
)
def test_floats_are_seconds_and_whole_numbers_rows(key, rows):
    run = valid()
    cut = run[key]
    assert len(cut) == cut.n_samples == rows[1] - rows[0]
    for signal in ("t", "q", "dq", "tau"):
        np.testing.assert_array_equal(getattr(cut, signal), getattr(run, signal)[slice(*rows)])
    assert cut.line_of(0) == run.line_of(rows[0])


def test_seconds_are_those_of_the_clock():
    """A part keeps the run's clock, so the same seconds are the same samples of both."""
    run = valid()
    np.testing.assert_array_equal(run[1.0:4.0][2.0:3.0].q, run[2.0:3.0].q)
    late = replace(run, t=run.t + 1e6)
    with pytest.raises(DataError, match=r"run.csv: 0 samples lie there.*its time goes from 1e\+06 s to 1e\+06 s"):
        late[1.0:3.0]


def test_what_is_no_slice_of_seconds_or_rows():
    run = valid()
    with pytest.raises(DataError, match=r"2 samples lie there.*whole numbers count rows; for seconds write floats"):
        run[1:3]
    for key in (3, 2.0, "q", (0, 1)):
        with pytest.raises(TypeError, match=r"cut by a slice, of seconds .* or of rows"):
            run[key]
    with pytest.raises(TypeError, match="with a step: filters need every sample"):
        run[0:400:2]
    with pytest.raises(TypeError, match=r"seconds .floats. or rows .whole numbers., got float and int"):
        run[1.0:300]
    with pytest.raises(TypeError):
        iter(run)


def test_what_continues_is_joined():
    run = valid()
    (whole,) = Recording.concat([run[:1.0], run[1.0:2.5], run[2.5:]])
    for signal in ("t", "q", "dq", "tau"):
        np.testing.assert_array_equal(getattr(whole, signal), getattr(run, signal))
    assert (whole.name, whole.joints, whole.line_of(399)) == ("run.csv", NAMES, 401)


@pytest.mark.parametrize(("lost", "n_parts"), [(0, 1), (8, 1), (9, 1), (10, 2), (100, 2)])
def test_a_gap_is_as_long_as_one_in_a_file(lost, n_parts):
    """A step of more than ten median steps splits a file; so it does here."""
    run = valid()
    assert len(Recording.concat([run[:150], run[150 + lost :]])) == n_parts


def test_what_does_not_continue_stays_a_part():
    run = valid()
    for other in (run[:2.0], run[2.0:].without("dq"), replace(run[2.0:], t=run.t[200:] + 1.0)):
        both = Recording.concat([run[:2.0], other])
        assert isinstance(both, Recordings)
        assert [part.n_samples for part in both] == [200, other.n_samples]
        assert both.n_samples == 200 + other.n_samples
        assert both.duration == pytest.approx(1.99 + other.duration)
        assert both[1] is other
        assert len(both[1:]) == 1
    named = Recording.concat([run[:2.0], replace(run[2.0:], name="more.csv")])[0]
    assert named.name == "run.csv + more.csv"


def test_what_is_never_put_together():
    run = valid()
    with pytest.raises(ValueError, match="no recording is given"):
        Recording.concat([])
    with pytest.raises(ValueError, match="expected a list of recordings, got one of str"):
        Recording.concat(["run.csv"])
    assert list(Recording.concat(run)) == [run]
    assert len(run[:1.0].concat(run[1.0:2.5], run[2.5:])) == 1
    with pytest.raises(DataError, match="concatenate runs of one arm in one unit"):
        Recording.concat([run, replace(run, torque_unit="A")])
    with pytest.raises(DataError, match="has the joints a, b, c"):
        Recording.concat([run, replace(run, joints=("a", "b", "c"))])


def test_several_as_one_table():
    run = valid()
    frame = Recording.concat([run[:2.0], replace(run[3.0:], name="b").without("dq")]).to_dataframe()
    assert frame["run"].tolist() == ["run.csv"] * 200 + ["b"] * 100
    assert frame["dq_elbow"].isna().sum() == 100
    np.testing.assert_array_equal(frame["q_elbow"], np.concatenate([run.q[:200, 1], run.q[300:, 1]]))


def test_it_says_what_it_is():
    assert repr(valid()) == (
        "<Recording 'run.csv': 3.99 s at 100 Hz, 400 samples of 3 joints (shoulder, elbow, wrist); q, tau [N*m], dq>"
    )
    several = Recording.concat([valid()[:1.0], valid()[2.0:]])
    assert repr(several).splitlines()[0] == "2 recordings, 2.98 s in all:"
    assert "<table" in several._repr_html_()


def test_a_notebook_shows_a_table():
    html = valid(
        name="<b>.csv", joints=("<i>", "elbow", "wrist"), kinds=("prismatic", "revolute", "revolute")
    )._repr_html_()
    assert "<b>" not in html
    assert "&lt;i&gt;" in html
    run = valid()
    assert f"{run.q[:, 0].min():.3g} to {run.q[:, 0].max():.3g} m<" in html
    assert f"{np.abs(run.dq[:, 1]).max():.3g} rad/s<" in html
    assert f"{run.tau[:, 2].min():.3g} to {run.tau[:, 2].max():.3g} N·m<" in html


def test_the_plot_names_joints_and_units():
    run = valid(kinds=("prismatic", "revolute", "revolute"), q_reference=motion()[1], temperature=motion()[1])
    axes = run.plot(["q", "dq", "tau", "temperature"])
    assert axes.shape == (3, 4)
    assert [row[0].get_title(loc="left") for row in axes] == list(NAMES)
    assert [panel.get_ylabel() for panel in axes[0]] == [
        "position [m]",
        "speed [m/s]",
        "torque [N]",
        "temperature [°C]",
    ]
    assert [panel.get_ylabel() for panel in axes[1]][:3] == ["position [rad]", "speed [rad/s]", "torque [N·m]"]
    assert axes[2, 0].get_xlabel() == "time [s]"
    measured, reference = axes[1, 0].lines
    np.testing.assert_array_equal(measured.get_ydata(), run.q[:, 1])
    assert reference.get_label() == "reference"
    assert axes[0, 0].figure.get_suptitle() == "run.csv"


def test_joints_are_chosen_by_name_or_index():
    run = valid(torque_unit="A")
    (panel,) = run.plot("tau", joints="elbow")
    assert panel.get_ylabel() == "current [A]"
    np.testing.assert_array_equal(panel.lines[0].get_ydata(), run.tau[:, 1])
    import matplotlib.pyplot as plt

    _, mine = plt.subplots(2)
    assert all(a is b for a, b in zip(run.plot(["q"], joints=[2, "shoulder"], axes=mine), mine, strict=True))
    with pytest.raises(ValueError, match="there is no joint 'knee'; expected some of shoulder, elbow, wrist"):
        run.plot(joints=["knee"])
    with pytest.raises(ValueError, match=r"signals: none is given; .* holds q, tau, dq"):
        run.plot([])
    with pytest.raises(ValueError, match="'q_motor' was not recorded; it holds q, tau, dq"):
        run.plot(["q_motor"])
    with pytest.raises(ValueError, match="6 axes are needed, 3 x 2, got 2"):
        run.plot(axes=mine)


def test_a_long_run_keeps_its_peaks():
    n = 100_000
    q = np.zeros((n, 1))
    q[54_321] = 5.0
    run = Recording(t=np.arange(n) / 1e3, q=q, tau=q)
    line = run.plot("q")[0].lines[0]
    assert len(line.get_xdata()) < 5000
    assert line.get_ydata().max() == 5.0


def test_without_matplotlib_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.pyplot", None)
    with pytest.raises(MissingLibraryError, match=r"plots need the library matplotlib.*pip install 'dynid-rs\[plot\]'"):
        valid().plot()


def test_kinds_are_checked():
    assert valid().kinds == ("revolute",) * 3
    with pytest.raises(ValueError, match="kinds must be 'revolute' or 'prismatic' for each of 3 joints"):
        valid(kinds=("round", "revolute", "revolute"))


def test_a_path_is_no_robot(tmp_path):
    """A text is a sequence of letters: each would be taken for a joint."""
    path = write_csv(tmp_path / "run.csv", valid_columns())
    with pytest.raises(ValueError, match=r"robot must be a RobotModel or the names of its joints, got 'arm\.urdf'"):
        read_recording(path, "arm.urdf")
