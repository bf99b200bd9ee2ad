"""Logs as an attack, and logs that are damaged: one sentence each; nothing runs, recurses or grows without bound."""

# ruff: noqa: E501 - the tables of faults have one case a line

import bz2
import contextlib
import gzip
import io
import json
import os
import struct
import subprocess
import sys
import tracemalloc
import zipfile
import zlib
from datetime import datetime, timedelta

import numpy as np
import pytest
from helpers.log_files import (
    VARIANTS,
    _bag1,
    _bag2,
    _feather,
    _hdf5,
    _mat5,
    _mat73,
    _mcap,
    _xlsx,
    joint_states,
    write_mcap,
)
from helpers.run_files import N_SAMPLES, csv_text, valid_columns
from helpers.small_arm import JOINTS

from dynid_rs.base.errors import DataError, MissingLibraryError
from dynid_rs.runs.readers import Config, PartsWarning, open_run, read_recording, read_run, table

BINARY = {"feather": _feather, "xlsx": _xlsx, "h5": _hdf5, "mat5": _mat5, "mat73": _mat73, "bag": _bag1, "mcap": _mcap}
WORKBOOK = Config(units={"time": "ms", "angle": "deg"}, columns={"t": "Time", "q": "Axis {n}", "tau": "Torque {n}"})


def refused(path, match, config=None):
    with pytest.raises(DataError, match=match) as caught:
        read_recording(path, JOINTS, config)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600
    assert path.name in str(caught.value)


@pytest.mark.parametrize("kind", BINARY)
def test_flipped_and_missing_bytes(kind, tmp_path):
    path, config = BINARY[kind](tmp_path, 0), WORKBOOK if kind == "xlsx" else None
    assert np.isfinite(read_recording(path, JOINTS, config).q).all()
    data, rng = path.read_bytes(), np.random.default_rng(1)
    for trial in range(24):
        spoiled = bytearray(data[: int(rng.integers(1, len(data)))] if trial % 2 else data)
        for place in rng.integers(0, len(spoiled), 4):
            spoiled[place] ^= int(rng.integers(1, 256))
        path.write_bytes(spoiled)
        with contextlib.suppress(DataError, OSError, PartsWarning):  # anything else is a leak
            assert np.isfinite(read_recording(path, JOINTS, config).q).all()


RUBBISH = (b"\0" * 300, b"x" * 300, bytes(range(256)) * 4, b"{" * 3000)


@pytest.mark.parametrize("data", RUBBISH, ids=range(len(RUBBISH)))
@pytest.mark.parametrize("suffix", [".feather", ".xlsx", ".xls", ".h5", ".mat", ".bag", ".db3", ".mcap", ".jsonl", ".csv.gz", ".csv.zst", ".dat", ".txt"])  # fmt: skip
def test_rubbish(suffix, data, tmp_path):
    path = tmp_path / f"run{suffix}"
    path.write_bytes(data)
    refused(path, "expected|damaged|missing|holds no")


JSON_FAULTS = {
    "deep": ('{"t":' + "[" * 200_000, r"line 1: .*(nested too deep|expected one JSON object)"),
    "nested": ('{"t":' + '{"a":' * 30 + "1" + "}" * 31, "line 1: is nested too deep"),
    "wide": ('{"q": [' + "1," * 5000 + "1]}", "line 1: is nested too deep or too wide"),
    "list": ("[1, 2]\n", "line 1: expected an object"),
    "long": ('{"t": 1' + " " * (1 << 21) + "}", "line 1: is longer than"),
    "huge_integer": ('{"t": ' + "9" * 10_000 + "}", "line 1: expected one JSON object"),
    "text": ('{"t": 0, "q_0": 1, "tau_0": 1}\n{"t": 1, "q_0": "a", "tau_0": 1}\n', r"row 2 \(line 2\), column q_0: 'a' is not a number"),
    "missing": ('{"t": 0, "q_0": 1, "tau_0": 1}\n{"t": 1, "tau_0": 1}\n', r"row 2 \(line 2\), column q_0: is missing"),
    "bool": ('{"t": 0, "q_0": 1, "tau_0": true}\n', "column tau_0: True is not a number"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "match"), JSON_FAULTS.values(), ids=JSON_FAULTS)
def test_json_lines_that_are_none(content, match, tmp_path):
    path = tmp_path / "run.jsonl"
    path.write_text(content)
    with pytest.raises(DataError, match=match):
        read_recording(path, ["a"])


@pytest.mark.parametrize("pack", [gzip.compress, lambda data: __import__("pyarrow").Codec("zstd").compress(data, asbytes=True)])  # fmt: skip
def test_packed_text_that_grows(pack, tmp_path, monkeypatch):
    path = tmp_path / ("run.csv.gz" if pack is gzip.compress else "run.csv.zst")
    path.write_bytes(pack(csv_text(valid_columns()).encode() + b"\n" * (32 << 20)))
    monkeypatch.setattr(table, "MAX_BYTES", 8 << 20)
    tracemalloc.start()
    refused(path, "declares .* more than")
    assert tracemalloc.get_traced_memory()[1] < 32 << 20
    tracemalloc.stop()


def mat_element(kind, data):
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


def mat_array(kind, dims, *inner, name=b"x"):
    flags = mat_element(6, struct.pack("<II", kind, 0))
    content = flags + mat_element(5, struct.pack(f"<{len(dims)}i", *dims)) + mat_element(1, name) + b"".join(inner)
    return struct.pack("<II", 14, len(content)) + content


def mat_file(path, element, *, packed):
    body = mat_element(15, zlib.compress(element))[: 8 + len(zlib.compress(element))] if packed else element
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + body)
    return path


@pytest.mark.parametrize("packed", [False, True])
def test_matlab_cells_in_cells(packed, tmp_path):
    element = mat_array(6, (1, 1), mat_element(9, bytes(8)))
    for _ in range(3000):
        element = mat_array(1, (1, 1), element)
    refused(mat_file(tmp_path / "run.mat", element, packed=packed), "nests its variables more than 32 deep")


@pytest.mark.parametrize("packed", [False, True])
def test_matlab_that_claims_more_cells_than_it_has(packed, tmp_path):
    element = mat_array(1, (2**20, 2**10))
    refused(mat_file(tmp_path / "run.mat", element, packed=packed), "claims 1073741824 cells")


def test_matlab_that_unpacks_to_more_than_a_run_may_take(tmp_path, monkeypatch):
    element = mat_array(6, (2**20, 4), mat_element(9, bytes(8 << 22)))
    path = mat_file(tmp_path / "run.mat", element, packed=True)
    monkeypatch.setattr(table, "MAX_BYTES", 8 << 20)
    tracemalloc.start()
    refused(path, "declares .* more than")
    assert tracemalloc.get_traced_memory()[1] < 8 << 20
    tracemalloc.stop()


def test_matlab_objects_are_refused_with_the_mend(tmp_path):
    opaque = (
        mat_element(6, struct.pack("<II", 17, 0))
        + mat_element(1, b"run")
        + mat_element(1, b"MCOS")
        + mat_element(1, b"timetable")
    )
    opaque += mat_array(13, (1, 1), mat_element(6, bytes(4)), name=b"")
    path = mat_file(tmp_path / "run.mat", struct.pack("<II", 14, len(opaque)) + opaque, packed=False)
    refused(path, r"is an object of MATLAB.*table2struct|damaged")


def test_links_to_other_files_are_not_followed(tmp_path):
    import h5py

    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["q"] = np.zeros((50, 3))
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["t"] = np.arange(50.0)
        file["q"] = h5py.ExternalLink("other.h5", "/q")
        file["again"] = file["/"]  # a circle
        layout = h5py.VirtualLayout((50, 3), "f8")
        layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "q", (50, 3))
        file.create_virtual_dataset("tau", layout)
    refused(tmp_path / "run.h5", "column q_0 .*missing.*the file has t;")


def test_workbook_that_unpacks_to_more_than_a_run_may_take(tmp_path, monkeypatch):
    path = tmp_path / "run.xlsx"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("xl/worksheets/sheet1.xml", "w") as member,
    ):
        member.write(b" " * (2 << 20))
    monkeypatch.setattr(table, "MAX_BYTES", 8 << 20)
    refused(path, "declares .* GiB of data, more than")


def workbook_of(path, times):
    import openpyxl

    book = openpyxl.Workbook()
    columns = valid_columns()
    book.active.append(list(columns))
    for time, row in zip(times, zip(*(values.tolist() for values in columns.values()), strict=True), strict=True):
        book.active.append([time, *row[1:]])
    book.save(path)
    return path


@pytest.mark.parametrize("start", [datetime(2024, 5, 1, 23, 59, 58), datetime(2024, 5, 1), timedelta(), timedelta(1.5)])
def test_times_of_a_workbook_pass_midnight_and_may_be_durations(tmp_path, start):
    """The library gives a moment at midnight as its day, and a cell of hours as a duration."""
    times = [start + timedelta(milliseconds=10 * k) for k in range(N_SAMPLES)]
    run = read_recording(workbook_of(tmp_path / "run.xlsx", times))
    np.testing.assert_allclose(run.t, valid_columns()["t"], atol=1e-12)


def test_a_moment_of_a_workbook_beyond_all_clocks_is_refused(tmp_path):
    times = [datetime(9999, 1, 1, 12) + timedelta(milliseconds=10 * k) for k in range(N_SAMPLES)]
    refused(workbook_of(tmp_path / "run.xlsx", times), r"row 1 \(line 2 of the sheet\), column t: 9999.* before 2262")


def test_pickled_arrays_in_a_matlab_7_3_file_are_no_numbers(tmp_path):
    import h5py

    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["t"] = np.arange(50.0)
        file["q"] = np.void(b"cposix\nsystem\n(S'true'\ntR.")
    refused(tmp_path / "run.h5", "the file has t;")


# ---------------------------------------------------------------- bags


def test_several_publishers_of_the_same_joints_are_asked(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", {"/a": joint_states(0), "/b": joint_states(1)})
    refused(path, r"2 publishers send the states of these joints \(/a, /b\); say which in dynid.toml: \[file\] topic")
    one = read_recording(path, JOINTS, Config(topic="/b"))
    other = read_recording(_mcap(tmp_path, 1), JOINTS)
    np.testing.assert_array_equal(one.q, other.q)
    refused(path, "no sensor_msgs/JointState on /c; topics with joint states: /a, /b", Config(topic="/c"))


def states(k, joints=JOINTS, effort=True):
    """Messages of run `k`, without efforts, or with efforts that are all NaN or zero; with joints beside the arm's."""
    for stamp, names, q, dq, tau in joint_states(k):
        more = [name for name in joints if name not in JOINTS]
        beside = np.zeros(len(more))
        tau = np.zeros(0) if effort is False else tau if effort is True else np.full(3, effort)
        yield stamp, [*names, *more], *(np.append(x, beside) if len(x) else x for x in (q, dq, tau))


GRIPPED = (*JOINTS, "finger")


@pytest.mark.parametrize("effort", [False, np.nan, 0.0], ids=["none", "NaN", "zeros"])
@pytest.mark.parametrize("robot", [JOINTS, None], ids=["robot", "no robot"])
def test_the_publisher_with_efforts_of_all_joints_is_taken_and_said(robot, effort, tmp_path):
    """ROS 2 control sends NaN for what a drive does not measure."""
    publishers = {"/arm/joint_states": states(1), "/joint_states": states(0, GRIPPED, effort)}
    run = read_run(write_mcap(tmp_path / "run.mcap", publishers), robot)
    alone = read_recording(_mcap(tmp_path, 1), run.recording.joints)
    np.testing.assert_array_equal(run.recording.tau, alone.tau)
    said = " ".join(run.columns.notes)
    assert "read from /arm/joint_states, which alone has efforts of all these joints" in said or robot is None
    assert "read from /arm/joint_states, " in said
    assert "other joint states are left out: /joint_states (801 messages, " in said


def test_efforts_of_other_joints_do_not_count(tmp_path):
    """A gripper's force in a sum of states is no torque of the arm, and the gripper alone is no arm."""
    summed = [(*rest, np.append(tau[:3] * 0, 5.0)) for *rest, tau in states(0, GRIPPED)]
    publishers = {"/sum": summed, "/joint_states": joint_states(1)}
    run = read_run(write_mcap(tmp_path / "run.mcap", publishers), JOINTS)
    assert "read from /joint_states, which alone has efforts of all these joints" in " ".join(run.columns.notes)
    finger = [(stamp, ["finger"], np.ones(1), np.ones(1), np.ones(1)) for stamp, *_ in joint_states(0)]
    publishers = {"/joint_states": states(0, GRIPPED, False), "/gripper": finger}
    assert "q_elbow" in open_run(write_mcap(tmp_path / "run.mcap", publishers)).names


def test_messages_with_and_without_efforts_are_two_publishers(tmp_path):
    """Two nodes on one topic, as joint_state_publisher beside a controller: their rows are not merged."""
    pairs = zip(states(0), states(1, effort=False), strict=True)
    both = [message for pair in pairs for message in pair]
    run = read_run(write_mcap(tmp_path / "run.mcap", {"/joint_states": both}), JOINTS)
    np.testing.assert_array_equal(run.recording.tau, read_recording(_mcap(tmp_path, 0), JOINTS).tau)
    assert "other joint states are left out: /joint_states (801 messages, " in " ".join(run.columns.notes)


@pytest.mark.parametrize("nodes", [("/robot", "/simulator"), ("/robot", "/robot")], ids=["two nodes", "one node"])
def test_rows_of_two_nodes_on_one_topic_are_not_merged(nodes, tmp_path):
    """A ROS 1 bag says which node sent a message; a node that connects twice is one."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    state, header = store.types["sensor_msgs/msg/JointState"], store.types["std_msgs/msg/Header"]
    time = store.types["builtin_interfaces/msg/Time"]
    path, messages = tmp_path / "run.bag", list(joint_states(0))
    with Writer(path) as bag:
        connections = [
            bag.add_connection("/joint_states", state.__msgtype__, typestore=store, callerid=node, latching=k)
            for k, node in enumerate(nodes)
        ]
        for k, (stamp, names, *values) in enumerate(messages):
            message = state(header(k, time(*divmod(stamp, 10**9)), ""), names, *values)
            bag.write(connections[k % 2], stamp, store.serialize_ros1(message, state.__msgtype__))
    if len(set(nodes)) == 1:
        assert read_recording(path, JOINTS).n_samples == len(messages)
    else:
        refused(path, r"2 publishers .* \(/joint_states\); they are the nodes /robot, /simulator; record one")


def test_stamps_are_those_of_the_headers_exactly(tmp_path):
    messages = list(joint_states(0))
    late = [(stamp + 3 * (k % 2), *rest) for k, (stamp, *rest) in enumerate(messages)]
    recording = read_recording(write_mcap(tmp_path / "run.mcap", {"/joint_states": late}), JOINTS)
    wanted = np.array([stamp - late[0][0] for stamp, *_ in late], dtype=np.float64) * 1e-9
    np.testing.assert_allclose(recording.t, wanted, rtol=0, atol=1e-15)


def test_overtaken_and_repeated_messages(tmp_path):
    messages = list(joint_states(0))
    messages[100], messages[101] = messages[101], messages[100]
    messages.insert(300, messages[299])
    path = write_mcap(tmp_path / "late.mcap", {"/joint_states": messages}, in_order=True)
    run = read_run(path, JOINTS)
    np.testing.assert_array_equal(run.recording.q, read_recording(_mcap(tmp_path, 0), JOINTS).q)
    said = " ".join(run.columns.notes)
    assert "1 messages were stored out of order" in said
    assert "1 messages repeat the stamp of the one before" in said


MESSAGES = {
    "twice": (lambda n, q: (["a", "a", "b"], q), "names a joint twice"),
    "short": (lambda n, q: (n, q[:2]), "has 3 names and 2 numbers as position"),
}


@pytest.mark.parametrize(("spoil", "match"), MESSAGES.values(), ids=MESSAGES)
def test_messages_that_do_not_fit_themselves(spoil, match, tmp_path):
    messages = list(joint_states(0))
    stamp, names, q, *rest = messages[7]
    messages[7] = (stamp, *spoil(names, q), *rest)
    refused(write_mcap(tmp_path / "run.mcap", {"/joint_states": messages}), rf"message 8 on /joint_states: {match}")


def test_a_bag_of_another_robot_names_its_joints(tmp_path):
    path = _mcap(tmp_path, 0)
    with pytest.raises(DataError, match=r"q_joint_1 is missing.*q_(shoulder|elbow|wrist)"):
        read_recording(path, ["joint_1", "joint_2", "joint_3"])


def test_types_in_a_bag_are_never_compiled(tmp_path):
    """A definition in the bag under the known name stays a text, whatever it says."""
    path = write_mcap(tmp_path / "run.mcap", {"/joint_states": joint_states(0)}, packed=False)
    path.write_bytes(path.read_bytes().replace(b"float64[] velocity", b"this is no type at"))
    assert b"this is no type at" in path.read_bytes()
    assert read_recording(path, JOINTS).n_samples > 100


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_chunks_that_grow(kind, tmp_path):
    """A chunk that unpacks to far more than it says is refused, whatever the library would do."""
    if kind == "bag":
        from rosbags.rosbag1.reader import decompressors

        from dynid_rs.runs.readers.bag_bounds import bounded

        data = bz2.compress(bytes(64 << 20))
        tracemalloc.start()
        with pytest.raises(ValueError, match="grows"), bounded(1 << 20):
            decompressors["bz2"](data)
        assert tracemalloc.get_traced_memory()[1] < 8 << 20
        tracemalloc.stop()
        assert len(decompressors["bz2"](data)) == 64 << 20  # as it was
    else:
        import lz4.frame
        from rosbags.rosbag2.storage_mcap import DECOMPRESSORS

        from dynid_rs.runs.readers.bag_bounds import bounded

        data = lz4.frame.compress(bytes(64 << 20))
        with pytest.raises(ValueError, match="grows"), bounded(1 << 20):
            DECOMPRESSORS["lz4"](data, 1)


# ---------------------------------------------------------------- libraries, folders, traces


@pytest.mark.parametrize(
    ("library", "write"), [("h5py", _hdf5), ("h5py", _mat73), ("python_calamine", _xlsx), ("rosbags", _bag2)]
)
def test_a_missing_library_is_named_with_its_extra(library, write, tmp_path, monkeypatch):
    path = write(tmp_path, 0)
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MissingLibraryError, match=rf"need the library {library}, .*dynid-rs\[io\]") as caught:
        read_recording(path, JOINTS)
    assert path.name in str(caught.value)


def test_libraries_are_imported_late():
    code = "import sys, dynid_rs.runs.readers; print([m for m in ('h5py', 'rosbags', 'python_calamine', 'scipy.io', 'pyarrow') if m in sys.modules])"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ)
    assert answer.stdout.strip() == "[]"


def test_folders_that_are_no_runs(tmp_path):
    (tmp_path / "run").mkdir()
    with pytest.raises(IsADirectoryError, match="it is a folder; name a file"):
        read_recording(tmp_path / "run", JOINTS)
    (tmp_path / "run" / "metadata.yaml").write_text("!!python/object/apply:os.abort []")
    refused(tmp_path / "run", "this ROS 2 bag .* is damaged")


def test_a_trace_whose_numbers_are_elsewhere(tmp_path):
    path = VARIANTS["kuka trace, .dat and .r64"].write(tmp_path, 0)
    data = next(tmp_path.glob("*.R64"))
    content = data.read_bytes()
    data.write_bytes(content[:-8])
    config = Config(columns={"t": "Zeit", "q": "AxisAct_A{n}", "tau": "TorqueAxisAct_A{n}"})
    refused(path, "channel TorqueAxisAct_A3: .* is shorter than the header says", config)
    data.unlink()
    refused(path, "does not lie beside the header", config)
    path.write_bytes(path.read_bytes().replace(b"211,trace_0.r64", b"211,../../../etc/passwd"))
    refused(path, "its numbers are in passwd, which does not lie beside", config)


def small_csv(path, header):
    rows = "\n".join(f"{k / 100},{np.sin(k / 9)},{np.cos(k / 7)},{k % 5},{k % 7}" for k in range(50))
    path.write_text(f"{header}\n{rows}\n")
    return path


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("packed", ["", ".gz"])
def test_text_in_utf_16_is_the_same_run(encoding, packed, tmp_path):
    """What Excel calls Unicode text: a mark, tabs, CRLF, and here decimal commas and a unit that ASCII has not."""
    columns = valid_columns()
    text = csv_text(columns)
    excel = text.replace(",", "\t").replace(".", ",").replace("\n", "\r\n").replace("q_0", "q_0 [°]", 1)
    lines = "".join(json.dumps({name: float(x[k]) for name, x in columns.items()}) + "\n" for k in range(400))
    pack = gzip.compress if packed else bytes
    for suffix, content, unit in ((".txt", excel, np.pi / 180), (".csv", text, 1.0), (".jsonl", lines, 1.0)):
        path = tmp_path / f"run{suffix}{packed}"
        path.write_bytes(pack(("\ufeff" + content).encode(encoding)))
        run = read_recording(path, ["a", "b", "c"])
        np.testing.assert_array_equal(run.q, np.column_stack([columns[f"q_{j}"] for j in range(3)]) * unit)
        np.testing.assert_array_equal(run.tau, np.column_stack([columns[f"tau_{j}"] for j in range(3)]))
    path = tmp_path / f"run.csv{packed}"
    spoiled = text.splitlines()
    spoiled[300] = spoiled[300].replace(".", ".x", 1)
    path.write_bytes(pack(("\ufeff" + "\n".join(spoiled)).encode(encoding)))
    refused(path, r"row 300 \(line 301\), column t: .* is not a number")


def test_a_torque_whose_header_says_ampere_is_a_current(tmp_path):
    run = read_run(small_csv(tmp_path / "run.csv", "t,q_0,q_1,effort_0 [A],effort_1 [A]"), ["a", "b"])
    assert run.recording.torque_unit == "A"
    assert "effort_0 is in A by the file's own words, and so is read as current" in " ".join(run.columns.notes)


TORQUES = {
    "index": ("t,q_0,q_1,torque_0,torque_1", ("torque_0", "torque_1")),
    "name": ("t,q_a,q_b,torque_a,torque_b", ("torque_a", "torque_b")),
    "beside": ("t,q_0,torque_0,torque_1,tau_0", ("tau_0",)),
    "current": ("t,q_0,torque_0,torque_1,current_0", ("current_0",)),
}


@pytest.mark.parametrize(("header", "columns"), TORQUES.values(), ids=TORQUES)
@pytest.mark.parametrize("named", [True, False])
def test_columns_called_torque_are_the_torque_where_nothing_else_is(header, columns, named, tmp_path):
    path, joints = small_csv(tmp_path / "run.csv", header), ["a", "b"][: len(columns)]
    run = read_run(path, joints if named else None)
    assert [run.columns.signals[signal] for signal in ("tau", "current") if signal in run.columns.signals] == [columns]
    assert run.recording.torque_unit == ("A" if "current" in header else "N*m")


WORDS = {
    "torque_of_one": ("t,q_0,q_1,torque_0,x", "column torque_1 is missing"),
    "torque_beyond": ("t,q_0,q_1,torque_0,torque_2", "column torque_2 is there, but the robot has 2 joints"),
    "torque_percent": ("t,q_0,q_1,torque_0 (%),torque_1 (%)", "in percent of a rated torque or current"),
    "mixed": ("t,q_0 [deg],q_1 [rad],tau_0,tau_1", "is in rad and q_0 in deg, by the file's own words"),
    "percent": ("t,q_0,q_1,tau_0 (%),tau_1 (%)", "in percent of a rated torque or current"),
}


@pytest.mark.parametrize(("header", "match"), WORDS.values(), ids=WORDS)
def test_units_in_headers_that_say_too_little(header, match, tmp_path):
    with pytest.raises(DataError, match=match):
        read_run(small_csv(tmp_path / "run.csv", header), ["a", "b"])


def test_only_the_controllers_model_is_refused(tmp_path):
    columns = valid_columns()
    names = (
        {"t": "timestamp"}
        | {f"q_{j}": f"actual_q_{j}" for j in range(3)}
        | {f"dq_{j}": f"actual_qd_{j}" for j in range(3)}
    )
    names |= {f"tau_{j}": f"target_moment_{j}" for j in range(3)}
    stream = io.StringIO(csv_text({names[name]: x for name, x in columns.items()}))
    (tmp_path / "run.csv").write_text(stream.read())
    refused(
        tmp_path / "run.csv", "target_moment_0 is no measured torque: .*copy of the controller's; record actual_current"
    )


@pytest.mark.parametrize("also", ["current", "target_q"])
def test_rtde_is_known_without_velocities(also, tmp_path):
    """The recipe is the user's: positions and currents are enough."""
    columns = valid_columns()
    told = {"t": columns["t"] + 1000.5}
    told |= {f"actual_q_{j}": columns[f"q_{j}"] for j in range(3)}
    told |= {f"actual_current_{j}": columns[f"tau_{j}"] for j in range(3)}
    told |= {f"target_q_{j}": columns[f"q_{j}"] for j in range(3 if also == "target_q" else 0)}
    (tmp_path / "run.csv").write_text(csv_text({"timestamp" if name == "t" else name: x for name, x in told.items()}))
    run = read_run(tmp_path / "run.csv", ["a", "b", "c"])
    assert run.recording.torque_unit == "A"
    assert "read as Universal Robots RTDE writes it" in " ".join(run.columns.notes)
