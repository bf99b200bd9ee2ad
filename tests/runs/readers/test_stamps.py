"""Clocks of other programs: 100 ns since year 1 or 1601, and seconds and nanoseconds in two columns."""

import json
import tomllib
from datetime import UTC, datetime
from types import SimpleNamespace

import numpy as np
import pandas
import pytest
from helpers.log_files import columns_of, joint_states, table, text, write_mcap
from helpers.small_arm import JOINTS, dynid, run, write_robot

from dynid_rs.base.errors import DataError
from dynid_rs.runs.checks.clocks import Clock, likely_unit
from dynid_rs.runs.readers import Config, count_parts, read_config, read_recording, read_recordings, read_run
from dynid_rs.runs.readers.epochs import by_size

NET_1970 = 621_355_968_000_000_000
"""`DateTime.UnixEpoch.Ticks`, by the documentation of .NET."""
FILETIME_1970 = 116_444_736_000_000_000
"""`FILETIME` of 1 January 1970, by Microsoft's documentation of the conversion."""
MOMENT = datetime(2024, 5, 1, 12, 0, 0, 123_456, UTC)
SINCE_1970 = 17_145_648_001_234_567
"""Steps of 100 ns from 1970 to `MOMENT`, and 7 more."""
ERAS = {".NET ticks": NET_1970 + SINCE_1970, "Windows FILETIME": FILETIME_1970 + SINCE_1970}


def log(folder, start, name="Timestamp"):
    path = folder / "run.csv"
    path.write_text(text(table(0, name, start=start, time=1e7)))
    return path


def check(t):
    np.testing.assert_allclose(t, columns_of(0)[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize(("era", "start"), ERAS.items(), ids=ERAS)
def test_steps_of_100_ns_are_told_by_their_size(era, start, tmp_path):
    assert round((MOMENT - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds() * 1e7) // 10 == SINCE_1970 // 10
    path, robot = log(tmp_path, start), write_robot(tmp_path)
    found = read_run(path, JOINTS)
    check(found.recording.t)
    assert found.recording.time_unit == "100ns"
    (said,) = (one.message for one in found.findings() if one.code == "read_as")
    assert said.startswith("Timestamp counts steps of 100 ns since ")
    assert era in said
    assert said.endswith("the first is 2024-05-01 12:00:00.123")
    result = dynid("init", robot, path, "-o", tmp_path / "dynid.toml")
    assert result.exit_code == 0, result.output
    assert said in result.output
    assert tomllib.loads((tmp_path / "dynid.toml").read_text())["units"]["time"] == "100ns"
    check(read_recording(path, JOINTS, read_config(tmp_path / "dynid.toml")).t)
    result = dynid("inspect", path, "--json")
    assert result.exit_code == 0, result.output
    assert era in result.output
    assert "sampling_rate" not in result.output


@pytest.mark.parametrize("start", ERAS.values(), ids=ERAS)
def test_steps_of_100_ns_go_to_identify(start, tmp_path):
    robot, path = write_robot(tmp_path), log(tmp_path, start, "Ticks")
    quick = ("--friction-law", "coulomb_viscous", "--residual", "none")
    result = dynid("identify", robot, path, *quick, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize("kind", ["int64", "uint64", "float64"])
def test_ticks_of_a_frame(kind):
    """Floats, which pandas makes of a column with one hole, hold them to 12.8 us."""
    frame = pandas.DataFrame(table(0, start=ERAS[".NET ticks"], time=1e7)).astype({"t": kind})
    t = read_recording(frame, JOINTS).t
    np.testing.assert_allclose(t, columns_of(0)[0], rtol=0, atol=13e-6 if kind == "float64" else 1e-9)


def test_what_is_said_of_the_unit_wins_over_the_size(tmp_path):
    path = log(tmp_path, 0)
    check(read_recording(path, JOINTS, Config(units={"time": "100ns"})).t)
    path = log(tmp_path, 0, "time_100ns")
    check(read_recording(path, JOINTS).t)
    frame = pandas.DataFrame(table(0, start=ERAS[".NET ticks"], time=1e9))
    check(read_recording(frame, JOINTS, Config(units={"time": "ns"})).t)


def test_a_rate_tells_no_steps_of_100_ns():
    """They lie between us and ns, and one of three would fit any rate; read in them a usual clock stays so."""
    assert likely_unit(Clock("run", 100e-7, 1e7, 1e-7)) in ("us", "ns")
    assert likely_unit(Clock("run", 100.0, 8.0, 1.0, "100ns")) == "100ns"


def test_parts_of_ticks_are_counted(tmp_path):
    columns = run(0)
    gap = columns["t"] + 100.0 * (columns["t"] > 4.0)
    columns["t"] = ERAS[".NET ticks"] + np.round(gap * 1e7).astype(np.int64)
    frame = pandas.DataFrame(columns)
    assert count_parts(frame, JOINTS) == len(read_recordings(frame, JOINTS)) == 2


# ---------------------------------------------------------------- seconds and nanoseconds

HALVES = {
    "ros 2": ("header.stamp.sec", "header.stamp.nanosec", "header.stamp"),
    "ros 1": ("header.stamp.secs", "header.stamp.nsecs", "header.stamp"),
    "underscores": ("stamp_secs", "stamp_nsecs", "stamp"),
    "topic": ("/joint_states/header/stamp/sec", "/joint_states/header/stamp/nanosec", "/joint_states/header/stamp"),
    "alone": ("sec", "nanosec", "stamp"),
    "no word of time": ("robot_Sec", "robot_NanoSec", "robot_stamp"),
    "protobuf": ("time.seconds", "time.nanos", "time"),
}


def states(sec, nanosec):
    """Columns of run 0, its stamps in two halves."""
    stamps = np.array([stamp for stamp, *_ in joint_states(0)])
    columns = {name: values for name, values in table(0).items() if name != "t"}
    return {sec: stamps // 10**9, nanosec: stamps % 10**9} | columns, stamps


def as_csv(folder, frame):
    frame.to_csv(folder / "run.csv", index=False)
    return folder / "run.csv"


def as_parquet(folder, frame):
    frame.to_parquet(folder / "run.parquet")
    return folder / "run.parquet"


def as_lines(folder, frame):
    frame.to_json(folder / "run.jsonl", orient="records", lines=True, double_precision=15)
    return folder / "run.jsonl"


WRITTEN = {"csv": as_csv, "parquet": as_parquet, "json lines": as_lines, "frame": lambda _, frame: frame}


@pytest.mark.parametrize("write", WRITTEN.values(), ids=WRITTEN)
@pytest.mark.parametrize(("sec", "nanosec", "name"), HALVES.values(), ids=HALVES)
def test_halves_of_a_stamp_are_one_time(sec, nanosec, name, write, tmp_path):
    columns, stamps = states(sec, nanosec)
    found = read_run(write(tmp_path, pandas.DataFrame(columns)), JOINTS)
    assert found.columns.time == name
    assert not {sec, nanosec} & set(found.columns.ignored)
    np.testing.assert_array_equal(found.recording.t, (stamps - stamps[0]) * 1e-9)
    assert f"{name} is joined of {sec} and {nanosec}" in [one.message for one in found.findings()]


def test_halves_of_another_librarys_messages(tmp_path):
    """Messages of Foxglove's MCAP, read by rosbags and written as JSON lines: both halves of the header's stamp."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    bag = write_mcap(tmp_path / "run.mcap", {"/joint_states": joint_states(0)})
    lines = tmp_path / "run.jsonl"
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader, lines.open("w") as stream:
        for connection, _, data in reader.messages():
            state = reader.deserialize(data, connection.msgtype)
            stamp = {"sec": state.header.stamp.sec, "nanosec": state.header.stamp.nanosec}
            row = {"header": {"stamp": stamp}, "name": state.name}
            row |= {field: getattr(state, field).tolist() for field in ("position", "velocity", "effort")}
            stream.write(json.dumps(row) + "\n")
    robot = write_robot(tmp_path)
    result = dynid("init", robot, lines, "-o", tmp_path / "dynid.toml")
    assert result.exit_code == 0, result.output
    assert tomllib.loads((tmp_path / "dynid.toml").read_text())["columns"]["t"] == "header_stamp"
    found = read_recording(lines, JOINTS, read_config(tmp_path / "dynid.toml"))
    same = read_recording(bag, JOINTS)
    np.testing.assert_array_equal(found.t, same.t)
    np.testing.assert_array_equal(found.q, same.q)


def test_a_time_that_is_there_stays(tmp_path):
    columns, _ = states("time_sec", "time_nsec")
    t = columns_of(0)[0]
    found = read_run(as_csv(tmp_path, pandas.DataFrame({"time": t} | columns)), JOINTS)
    assert found.columns.time == "time"
    np.testing.assert_array_equal(found.recording.t, t)


@pytest.mark.parametrize(
    ("half", "value", "expected"),
    [
        ("nanosec", 10**9, "row 6 .line 7., column nanosec: 1000000000 is no half of a stamp, expected nanos"),
        ("nanosec", -1, "expected nanoseconds from 0 to 999999999"),
        ("sec", 0.5, "row 6 .line 7., column sec: 0.5 is no half of a stamp, expected whole numbers"),
        ("sec", 10**12, "expected seconds before the year 2262"),
    ],
)
def test_halves_that_are_none_are_refused(half, value, expected, tmp_path):
    columns, _ = states("sec", "nanosec")
    columns[half] = columns[half].astype(float)
    columns[half][5] = value
    with pytest.raises(DataError, match=expected):
        read_recording(as_csv(tmp_path, pandas.DataFrame(columns)), JOINTS)


def test_a_difference_in_its_parts_is_no_stamp():
    """pandas takes a Timedelta to pieces: seconds, milliseconds, microseconds, nanoseconds."""
    t, q, _, tau = columns_of(0)
    frame = pandas.to_timedelta(pandas.Series(t), unit="s").dt.components
    frame = frame.assign(t=t, **{f"q_{j}": q[:, j] for j in range(3)}, **{f"tau_{j}": tau[:, j] for j in range(3)})
    found = read_run(frame, JOINTS)
    assert found.columns.time == "t"
    assert "seconds" in found.columns.ignored


@pytest.mark.parametrize(
    ("first", "known"),
    [
        (630_822_816_000_000_000, True),  # .NET's midnight of 1 January 2000, by Microsoft's documentation
        (630_822_816_000_000_000 - 1, False),
        (662_380_416_000_000_000 - 1, True),  # the last step of 2099
        (662_380_416_000_000_000, False),
    ],
)
def test_a_clock_is_known_from_the_first_step_of_2000_to_the_last_of_2099(first, known):
    adopted, notes = by_size(np.array([first]), "t", SimpleNamespace(stamps=()), Config())
    assert (adopted.units.get("time") == "100ns", bool(notes)) == (known, known)
