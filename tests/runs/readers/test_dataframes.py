"""Data frames in and out: pandas, polars, Arrow, and the rules that say what their columns are."""

import builtins
import datetime

import numpy as np
import pandas
import polars
import pyarrow as pa
import pytest
from helpers.run_files import valid_columns
from helpers.small_arm import URDF

import dynid_rs
from dynid_rs import DataError, MissingLibraryError, PartsWarning, Recording, RobotModel
from dynid_rs.runs.readers.config_file import as_config

ROBOT = RobotModel.from_urdf_string(URDF)
FRAMES = {"pandas": pandas.DataFrame, "polars": polars.DataFrame, "pyarrow": pa.table}
SIGNALS = ("t", "q", "dq", "tau", "q_motor", "q_reference", "temperature")


def valid(**changes) -> Recording:
    columns = valid_columns()
    stacked = {s: np.stack([columns[f"{s}_{j}"] for j in range(3)], axis=1) for s in ("q", "dq", "tau")}
    more = {"q_motor": stacked["q"] + 1e-3, "q_reference": stacked["q"] - 1e-3, "temperature": 30 + stacked["q"]}
    return Recording(**({"t": columns["t"], "joints": tuple(ROBOT.joint_names)} | stacked | more | changes))


@pytest.mark.parametrize("kind", FRAMES)
def test_there_and_back_again(kind):
    run = valid()
    frame = run.to_dataframe(kind)
    assert type(frame).__module__.startswith(kind)
    assert list(frame.column_names if kind == "pyarrow" else frame.columns)[:4] == [
        "t",
        "q_shoulder",
        "q_elbow",
        "q_wrist",
    ]
    for robot in (ROBOT, None):
        again = Recording.from_dataframe(frame, robot, name="again")
        assert again.joints == run.joints
        assert again.name == "again"
        for signal in SIGNALS:
            np.testing.assert_array_equal(getattr(again, signal), getattr(run, signal))


def test_pandas_is_the_default_and_the_recording_is_a_stream():
    run = valid()
    assert isinstance(run.to_dataframe(), pandas.DataFrame)
    assert polars.DataFrame(run).equals(run.to_dataframe("polars"))
    assert pa.table(run).equals(run.to_dataframe("pyarrow"))


def test_ampere_stays_ampere():
    run = valid(torque_unit="A")
    frame = run.to_dataframe()
    assert "current_elbow" in frame
    again = Recording.from_dataframe(frame, ROBOT)
    assert again.torque_unit == "A"
    np.testing.assert_array_equal(again.tau, run.tau)


def test_joints_that_are_numbers_are_counted_from_zero():
    """A column q_1 of a joint called "1" would be read as the second one's."""
    frame = valid(joints=("1", "2", "3")).to_dataframe()
    assert list(frame.columns[1:4]) == ["q_0", "q_1", "q_2"]
    np.testing.assert_array_equal(Recording.from_dataframe(frame).q, valid().q)


@pytest.mark.parametrize("kind", FRAMES)
def test_columns_of_other_names_and_units(kind, tmp_path):
    run = valid()
    columns = {"ms": 1e3 * run.t}
    for j in range(3):
        columns |= {f"pos{j + 1}": np.rad2deg(run.q[:, j]), f"m_{ROBOT.joint_names[j]}": -run.tau[:, j]}
    frame = FRAMES[kind](columns)
    tables = {
        "columns": {"t": "ms", "q": "pos{n}", "tau": tuple(f"m_{joint}" for joint in ROBOT.joint_names)},
        "units": {"time": "ms", "angle": "deg"},
        "signs": {"tau": np.full(3, -1.0)},
    }
    path = tmp_path / "dynid.toml"
    path.write_text(
        '[columns]\nt = "ms"\nq = "pos{n}"\ntau = "m_{joint}"\n[units]\ntime = "ms"\nangle = "deg"\n'
        "[signs]\ntau = [-1, -1, -1]\n"
    )
    for rules in (tables, path, str(path), as_config(tables)):
        found = dynid_rs.read_recording(frame, ROBOT, rules)
        np.testing.assert_allclose(found.t, run.t, rtol=1e-14)
        np.testing.assert_allclose(found.q, run.q, rtol=1e-14)
        np.testing.assert_array_equal(found.tau, run.tau)


def test_a_mapping_is_checked_as_a_file_is():
    frame = valid().to_dataframe()
    with pytest.raises(DataError, match=r"^config, tua: this key is not known; did you mean tau\?"):
        Recording.from_dataframe(frame, ROBOT, {"tua": "tau_{i}"})
    with pytest.raises(DataError, match=r"^config, \[units\] angle: must be one of rad, deg, mrad, rev, got 'degrees'"):
        Recording.from_dataframe(frame, ROBOT, {"units": {"angle": "degrees"}})
    with pytest.raises(DataError, match="column position_0 is missing, which config names for q"):
        Recording.from_dataframe(frame, ROBOT, {"q": [f"position_{j}" for j in range(3)]})
    with pytest.raises(ValueError, match=r"config must be the path of a dynid\.toml"):
        Recording.from_dataframe(frame, ROBOT, 3)


def in_place_of_time(frame: pandas.DataFrame, values: object) -> pandas.DataFrame:
    return frame.assign(t=values)


def test_time_is_numbers_moments_or_differences():
    run = valid()
    frame = run.to_dataframe()
    start = datetime.datetime(2026, 3, 1, 12, tzinfo=datetime.UTC)
    differences = pandas.to_timedelta(run.t, unit="s")
    for values in (differences, start + differences, (start + differences).tz_localize(None)):
        found = Recording.from_dataframe(in_place_of_time(frame, values), ROBOT)
        np.testing.assert_allclose(found.t, run.t, atol=2e-9)


def test_an_index_is_a_column():
    run = valid()
    frame = run.to_dataframe()
    np.testing.assert_array_equal(Recording.from_dataframe(frame.set_index("t"), ROBOT).t, run.t)
    nameless = frame.drop(columns="t").set_index(run.t)
    np.testing.assert_array_equal(Recording.from_dataframe(nameless, ROBOT, {"t": "index"}).t, run.t)


def test_what_is_no_signal_may_be_anything():
    frame = valid().to_dataframe()
    frame["note"] = [None, "x", 3, {}] * (len(frame) // 4)
    frame["flag"] = True
    found = dynid_rs.runs.readers.read_run(frame, ROBOT)
    np.testing.assert_array_equal(found.recording.q, valid().q)
    assert any("columns that hold no numbers are not looked at: note" in note for note in found.columns.notes)


def test_lists_of_one_length_are_a_signal():
    run = valid()
    frame = polars.DataFrame({"t": run.t, "q": run.q.tolist(), "tau": run.tau.tolist()})
    np.testing.assert_array_equal(Recording.from_dataframe(frame, ROBOT).tau, run.tau)


def test_what_is_refused():
    frame = valid().to_dataframe()
    holed = frame.copy()
    holed.loc[17, "q_elbow"] = np.nan
    with pytest.raises(DataError, match=r"^my log, row 18, column q_elbow: nan is not a finite number"):
        Recording.from_dataframe(holed, ROBOT, name="my log")
    doubled = pandas.concat([frame, frame[["q_elbow"]]], axis=1)
    with pytest.raises(DataError, match=r"different names|appears 2 times"):
        Recording.from_dataframe(doubled, ROBOT)
    with pytest.raises(DataError, match=r"column q_0 or q_shoulder is missing.* the file has q for 2 of 3 joints"):
        Recording.from_dataframe(frame.drop(columns="q_shoulder"), ROBOT)
    other = frame.rename(columns=lambda name: name.replace("tau_", "moment_"))
    with pytest.raises(DataError, match=r"tau_0 or tau_shoulder .*is missing.*a mapping says the same: config={\"q\""):
        Recording.from_dataframe(other, ROBOT)
    for wrong in ("run.csv", frame["q_elbow"].to_numpy(), {"t": [1.0]}):
        with pytest.raises(ValueError, match=r"frame must be a data frame .* files are read by read_recording"):
            Recording.from_dataframe(wrong, ROBOT)
    with pytest.raises(ValueError, match="kind must be one of pandas, polars, pyarrow, got 'numpy'"):
        valid().to_dataframe("numpy")


def test_a_gap_makes_parts():
    run = valid()
    frame = run.to_dataframe()
    frame.loc[300:, "t"] += 5.0
    with pytest.warns(
        PartsWarning, match=r"a gap of 5.01 s before row 301: read as 2 parts.*read_recordings gives all"
    ):
        longest = Recording.from_dataframe(frame, ROBOT)
    assert longest.n_samples == 300
    assert [part.n_samples for part in dynid_rs.read_recordings(frame, ROBOT)] == [300, 100]


@pytest.mark.parametrize("kind", ["pandas", "polars"])
def test_a_library_that_is_not_there_is_named(kind, monkeypatch):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name.partition(".")[0] == kind:
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingLibraryError, match=rf"pip install {kind}, or take an Arrow table"):
        valid().to_dataframe(kind)
